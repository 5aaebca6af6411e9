"""Likely mistakes in measured data: single points far off their curve, and a wrong unit."""

from collections.abc import Iterator, Sequence

import numpy as np

from fecloth.study.fitting.evaluation import Column, Evaluation
from fecloth.study.fitting.unknowns import Unknown

FAR_POINT = 4.0  # standard deviations of a point from its curve, where it is named
LARGEST_PART = 0.1  # of the points of a curve that may be single ones; more are its shape
NORMAL = 1.4826  # standard deviation over the median of |r|, of a normal distribution
NAMED = 5  # points of a column that are named
# What a constant of the fabric is multiplied by if a unit of the data is wrong. All are far from
# what fabrics differ by, as is a change of a constant by more than `LARGEST_CHANGE`.
SCALES = {
    1e3: "mN written as N, or N as kN",
    102.0: "gf written as N",
    25.4: "mm written as in",
    9.81: "N written as kgf",
    1 / 9.81: "kgf written as N",
    1 / 25.4: "in written as mm",
    1 / 102.0: "N written as gf",
    1e-3: "N written as mN, or mm as m",
}
LARGEST_CHANGE = 8.0
NEAR_SCALE = 1.6  # factor around a scale: half of the distance to the next, in logarithms


def far_points(column: Column) -> np.ndarray:
    """Return the numbers of the points that lie far off, where these are few.

    A point is far off beyond `FAR_POINT` standard deviations of the residuals: of the stated
    ones, or of the ones by the median of the residuals if these are larger. If more than
    `LARGEST_PART` of the points are, the curve has another shape, and no point is named. Means
    of repeats have no single points.
    """
    if column.points.scatter is not None:
        return np.zeros(0, dtype=int)
    r = np.abs(column.residual)
    far = np.flatnonzero(r > FAR_POINT * max(1.0, NORMAL * float(np.median(r))))
    return far if len(far) <= LARGEST_PART * len(r) else far[:0]


def far_in_repeats(scatter: np.ndarray) -> list[tuple[int, int]]:
    """Return (repeat, place) of single points far off, of repeats less their mean (R, n).

    z is the distance of a value from the middle of its neighbours along the repeat: repeats of
    other shapes are smooth. It is far beyond `FAR_POINT` standard deviations of all z, by their
    median, and of the scatter itself. At each place the repeat with the largest z counts; a
    neighbour of a larger z does not.
    """
    z = np.abs(scatter[:, 1:-1] - 0.5 * (scatter[:, :-2] + scatter[:, 2:]))
    limit = FAR_POINT * max(NORMAL * float(np.median(z)), float(np.median(np.abs(scatter))))
    largest = z.max(axis=0, initial=0.0)
    neighbours = np.maximum(np.append(largest[1:], 0.0), np.append(0.0, largest[:-1]))
    far = np.flatnonzero((largest > limit) & (largest > neighbours))
    if len(far) > LARGEST_PART * scatter.shape[1]:
        return []
    return [(int(z[:, i].argmax()), int(i) + 1) for i in far]


def describe_points(end: Evaluation) -> Iterator[str]:
    """Yield a sentence for each column with points far off their curve."""
    for column in end.fitted:
        points = column.points
        if points.scatter is not None and points.along is not None and len(points.along) > 2:
            places = [
                f"specimen {repeat + 1} near {points.along[i]:.4g} {points.along_unit}".rstrip()
                for repeat, i in far_in_repeats(points.scatter)
            ]
            if places:
                yield (
                    f"{column.label}: single points of {points.column} far off their curve: "
                    f"{', '.join(places[:NAMED])}. Look at them"
                )
        far = far_points(column)
        if not len(far):
            continue
        worst = sorted(far, key=lambda i: -abs(column.residual[i]))[:NAMED]
        names = []
        for i in worst:
            place = f"point {i + 1}"
            if points.along is not None:
                place += f" at {points.along[i]:.4g} {points.along_unit}".rstrip()
            value = f"{points.values[i]:.4g} {points.unit}".rstrip()
            names.append(f"{place} ({value}) by {abs(column.residual[i]):.2g} σ")
        yield (
            f"{column.label}: far off the curve of {points.column}: {', '.join(names)}. They say "
            'nothing of the law. Look at them, or take loss = "soft_l1"'
        )


def describe_units(unknowns: Sequence[Unknown], u: np.ndarray, told: np.ndarray) -> Iterator[str]:
    """Yield a sentence if all told constants moved from their starts as by a wrong unit.

    `u` (m,) are the changes of the unknowns, the logarithms of positive ones.
    """
    changes = [
        u[i]
        for i, unknown in enumerate(unknowns)
        if told[i] and not unknown.width and not unknown.is_offset
    ]
    if not changes or min(np.abs(changes)) < np.log(LARGEST_CHANGE):
        return
    change = float(np.exp(np.median(changes)))
    for scale, words in SCALES.items():
        if abs(np.log(change / scale)) < np.log(NEAR_SCALE):
            yield (
                f"constants are {change:.3g} times their starts: were these far off, or is a unit "
                f"wrong ({words})?"
            )
