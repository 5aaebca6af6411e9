"""The answer of a fit in words: constants, what is not told, the law, mesh and step."""

from collections.abc import Iterator

import numpy as np

from fecloth.errors import amount
from fecloth.fabric.uncertainty import CONSTANTS
from fecloth.study.fitting.evaluation import Column, Evaluation, Fitting
from fecloth.study.fitting.statistics import Statistics
from fecloth.study.result import in_percent, with_uncertainty

PARTS = 3  # of a curve, for where the law fails
SHOWN = 4  # parts of curves, the worst ones
TELLING = 0.02  # of the largest value of a curve: residuals above it are said
BENDING = "a strip that hangs over an edge, or a fold,"
HINTS = (  # words in the names of unknowns, and what would tell them
    (("density",), "the weight of the cloth"),
    (("shear_stiffness", "poisson_ratio"), "the width of a strip under tension"),
    (("bending",), BENDING),
    (("bias_rigidity",), "a strip cut at 45° that hangs over an edge"),
    (("shear_stiffness",), "a strip cut at 45° under tension"),
    (("poisson_ratio",), "the width of a strip under tension"),
    (("tensile_stiffness",), "a strip under tension along that direction"),
    (("time", "damping", "drag"), "a motion that dies away"),
)


def unit_of(name: str) -> str:
    """The SI unit of a constant of the fabric; "" of any other."""
    if name.startswith("fabric."):
        dimension = CONSTANTS.get(name.split(".")[1])
    else:
        dimension = None
    return dimension.si if dimension else ""


def describe_value(name: str, value: float, interval: tuple[float, float]) -> str:
    """A constant with half of its interval, as far as it is told."""
    half = (interval[1] - interval[0]) / 2
    if np.isfinite(half):
        return f"{name} = {with_uncertainty(value, half, unit_of(name))} (95 %)"
    return f"{name} = {value:.4g} {unit_of(name)}".rstrip() + ", no interval"


def describe_untold(fitting: Fitting, facts: Statistics) -> Iterator[str]:
    """A sentence for each combination that the data do not tell."""
    for group in facts.together:
        names = [fitting.unknowns[i].name for i in group]
        short = [name.removeprefix("fabric.") for name in names]
        if len(short) == 1:
            words = short[0]
        else:
            words = f"{short[0]} apart from {' and '.join(short[1:])}"
        everything = " ".join(names)
        hint = next((h for keys, h in HINTS if all(key in everything for key in keys)), "")
        if any(fitting.unknowns[i].is_offset for i in group):
            hint = "points farther along the curve, or no offset,"
        yield f"these tests do not tell {words}" + (f": {hint} would" if hint else "")


def describe_law(fitting: Fitting, end: Evaluation, facts: Statistics) -> Iterator[str]:
    """That the law is wrong, and what each part of each curve would want."""
    if not facts.law_fails:
        return
    yield (
        "the law is wrong, not the constants: the residuals are "
        f"{np.sqrt(facts.misfit):.2g} times the uncertainty of the points"
    )
    wants = [want for column in end.fitted for want in _wants(fitting, end, column)]
    for _, sentence in sorted(wants, reverse=True)[:SHOWN]:
        yield sentence


def _wants(fitting: Fitting, end: Evaluation, column: Column) -> Iterator[tuple[float, str]]:
    """How far each part of a curve is off, and the value that it wants of what matters most."""
    points = column.points
    is_curve = points.along is not None
    if points.along is None:
        places = np.zeros(len(points.values))
    else:
        places = points.along
    order = np.argsort(places, kind="stable")
    for rows in np.array_split(order, PARTS if is_curve and len(order) >= PARTS else 1):
        r = column.residual[rows]
        J = column.jacobian[rows, : len(fitting.constants)]
        far = float(np.abs((r * points.sigma[rows]).mean()))
        if far < TELLING * points.largest or not J.any():
            continue
        k = int(np.argmax((J**2).sum(axis=0)))
        change = float(-(J[:, k] @ r) / (J[:, k] @ J[:, k]))
        each = fitting.constants[k]
        at = float(end.u[k])
        wanted = each.at(at + float(np.clip(change, -5.0, 5.0)))
        span = f" from {places[rows].min():.3g} to {places[rows].max():.3g} {points.along_unit}"
        where = span.rstrip() if is_curve else ""
        begin = f"{column.label}{where} wants {each.name} = "
        yield far / points.largest, f"{begin}{wanted:.3g}, not {each.at(at):.3g}"


def describe_resolution(
    numerical: dict[str, float], intervals: dict[str, tuple[float, float]]
) -> Iterator[str]:
    """Constants that mesh and step shift by more than half of their interval."""
    for name, shift in numerical.items():
        half = (intervals[name][1] - intervals[name][0]) / 2
        if abs(shift) > half:
            yield (
                f"not resolved: half of h and dt shifts {name} by {shift:+.2g}, its interval "
                f"is ± {half:.2g}; take a finer mesh or shorter steps"
            )


def describe_predictions(end: Evaluation) -> Iterator[str]:
    """How far the fit is off where an experiment is compared only."""
    for column in end.columns:
        if not column.is_fitted:
            points = column.points
            r = column.residual
            share = float(np.sqrt(np.mean((r * points.sigma) ** 2))) / points.largest
            yield (
                f"not fitted: {column.label}: {points.column} is off by "
                f"{in_percent(share)} of the largest value (rms), {np.sqrt(np.mean(r**2)):.2g} "
                "times the uncertainty of the points"
            )


def describe_fit(fitting: Fitting, end: Evaluation, facts: Statistics) -> str:
    """How many constants were fitted to how many points, and the misfit."""
    constants = amount(len(fitting.constants), "constant")
    points = amount(len(end.residual), "point")
    experiments = amount(sum(each.experiment.fitted for each in fitting.specimens), "experiment")
    size = f"misfit {facts.misfit:.3g} (1 is the scatter)"
    if np.isfinite(facts.misfit):
        misfit = size
    else:
        misfit = "as many unknowns as points: no misfit is known"
    return f"{constants} fitted to {points} of {experiments}: {misfit}"
