"""The answer of a fit in words: constants, what is not told, the law, mesh and step."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.special import stdtrit

from fecloth.errors import amount
from fecloth.fabric.uncertainty import CONSTANTS
from fecloth.quantities.digits import with_uncertainty
from fecloth.study.fitting.discrepancy import Discrepancy
from fecloth.study.fitting.evaluation import Column, Evaluation, Fitting
from fecloth.study.fitting.measured import ASSUMED_SIGMA
from fecloth.study.fitting.statistics import COVERAGE, Statistics
from fecloth.study.result import Table, in_percent
from fecloth.study.uncertainty import COVERS

PARTS_OF_CURVE = 3  # begin, middle and end, for where the law fails
WORST_PARTS = 4  # parts of curves that are named, where the law fails
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
    if not name.startswith("fabric."):
        return ""
    dimension = CONSTANTS.get(name.split(".")[1])
    return dimension.si if dimension else ""


def half_of(interval: tuple[float, float]) -> float:
    """Half of the length of an interval."""
    return (interval[1] - interval[0]) / 2


def describe_values(
    values: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    of_data: Mapping[str, tuple[float, float]],
) -> Iterator[str]:
    """Yield each constant with half of its interval, of new specimens or of these, if known."""
    for name, value in values.items():
        unit = unit_of(name)
        half = half_of(intervals[name])
        half_of_data = half_of(of_data[name])
        if np.isfinite(half):
            yield f"{name} = {with_uncertainty(value, half, unit)} (95 %, a new specimen)"
        elif np.isfinite(half_of_data):
            yield f"{name} = {with_uncertainty(value, half_of_data, unit)} (95 %, this specimen)"
        else:
            yield f"{name} = {value:.4g} {unit}".rstrip() + ", no interval"


def describe_search(end: Evaluation) -> Iterator[str]:
    """Yield a sentence if the search ended before it converged."""
    if not end.is_converged:
        yield (
            "the search has not converged: the constants are where it stopped, and nothing is "
            "said of the law. Begin at these constants"
        )


def describe_specimens(scale: Discrepancy | None) -> Iterator[str]:
    """Yield sentences on how much specimens differ, and on how far the law is off."""
    if scale is None:
        return
    if np.isfinite(scale.specimens):
        how = "as stated" if scale.is_stated else f"from {scale.experiments} specimens"
        yield f"specimens differ by {in_percent(scale.specimens)} (standard deviation, {how})"
    else:
        yield (
            "the intervals hold for these specimens only: each direction has one. Measure two "
            'more of each, numbered by a column repeat, or state specimens = "5 %"'
        )
    if np.isfinite(scale.law):
        yield f"the law is off by {in_percent(scale.law)} (standard deviation, of curves left out)"
    elif np.isfinite(scale.both):
        yield f"specimens and law together are off by {in_percent(scale.both)} (curves left out)"


def slacks(end: Evaluation) -> dict[str, float]:
    """Return the fitted slack of each experiment by its name, in SI."""
    return {
        column.label: column.computed.shift
        for column in end.fitted
        if column.specimen.experiment.offset and column.computed
    }


def mean_and_next(values: Collection[float]) -> tuple[float, float]:
    """Return the mean of n values, and the standard uncertainty of the next one.

    It is sd √(1 + 1/n), widened so that twice of it covers 95 % by Student's t; NaN of one value.
    """
    n = len(values)
    if n < 2:
        return float(np.mean(list(values))) if n else np.nan, np.nan
    known = np.array(list(values))
    widened = float(stdtrit(n - 1, 0.5 + COVERAGE / 2)) / COVERS
    return float(known.mean()), widened * float(known.std(ddof=1)) * np.sqrt(1 + 1 / n)


def describe_slack(end: Evaluation) -> Iterator[str]:
    """Yield a sentence with the slack of each experiment, and how to take it to a prediction."""
    known = slacks(end)
    if not known:
        return
    listed = ", ".join(f"{label} {shift:.3g}" for label, shift in known.items())
    unit = next((c.points.along_unit for c in end.fitted if c.label in known), "")
    mean, u = mean_and_next(known.values())
    text = f"slack: {listed} {unit}".rstrip()
    if unit == "m":
        text += f'. Write "after {1e3 * mean:.3g} mm" behind a quantity at a place'
        if np.isfinite(u):
            text += f"; the next one is uncertain by {1e3 * u:.2g} mm"
    yield text


def describe_untold(fitting: Fitting, facts: Statistics) -> Iterator[str]:
    """Yield a sentence for each group of unknowns that the data tell only in combination.

    It names the unknowns and, where a hint is known, a test that would tell them. A group of one
    is an unknown that the data do not tell at all.
    """
    for group in facts.together:
        unknowns = [fitting.unknowns[i] for i in group]
        first, *others = [unknown.name.removeprefix("fabric.") for unknown in unknowns]
        sentence = f"these tests do not tell {first}"
        if others:
            sentence += f" apart from {' and '.join(others)}"
        if any(unknown.is_offset for unknown in unknowns):
            hint = "points farther along the curve, or no offset,"
        else:
            names = " ".join(unknown.name for unknown in unknowns)
            # the first hint whose words all stand in the names
            hint = next((test for keys, test in HINTS if all(key in names for key in keys)), "")
        yield f"{sentence}: {hint} would" if hint else sentence


def describe_law(fitting: Fitting, end: Evaluation, facts: Statistics) -> Iterator[str]:
    """Yield sentences if the law is wrong: that it is, and what the parts of the curves want.

    The `WORST_PARTS` parts that are farthest off are named; see `_wants`.
    """
    if not facts.law_fails:
        return
    yield (
        "the law is wrong, not the constants: the residuals are "
        f"{np.sqrt(facts.misfit):.2g} times the uncertainty of the points"
    )
    wants = [want for column in end.fitted for want in _wants(fitting, end, column)]
    for _, sentence in sorted(wants, reverse=True)[:WORST_PARTS]:
        yield sentence


def _wants(fitting: Fitting, end: Evaluation, column: Column) -> Iterator[tuple[float, str]]:
    """Yield, for each part of a curve that is off, its distance and a sentence.

    A curve has a begin, a middle and an end. The distance is the mean difference of computed and
    measured values there, relative to the largest measured value of the curve; parts below
    `ASSUMED_SIGMA` are left out. The sentence says which value this part alone wants of the
    constant that changes it most.
    """
    points = column.points
    if points.along is None:
        places = np.zeros(len(points.values))
        parts = [np.arange(len(places))]
    else:
        places = points.along
        order = np.argsort(places, kind="stable")
        parts = np.array_split(order, PARTS_OF_CURVE if len(order) >= PARTS_OF_CURVE else 1)
    for rows in parts:
        r = column.residual[rows]
        J = column.jacobian[rows, : len(fitting.constants)]  # the offsets come last
        distance = float(np.abs((r * points.sigma[rows]).mean())) / points.largest
        if distance < ASSUMED_SIGMA or not J.any():
            continue
        k = int(np.argmax((J**2).sum(axis=0)))
        change = float(-(J[:, k] @ r) / (J[:, k] @ J[:, k]))  # of u, by least squares
        constant = fitting.constants[k]
        u = float(end.u[k])
        wanted = constant.at(u + float(np.clip(change, -5.0, 5.0)))  # exp(5) is far enough
        where = column.label
        if points.along is not None:
            span = f"from {places[rows].min():.3g} to {places[rows].max():.3g} {points.along_unit}"
            where = f"{where} {span}".rstrip()
        fitted_value = f"{constant.at(u):.3g}"
        yield distance, f"{where} wants {constant.name} = {wanted:.3g}, not {fitted_value}"


def unresolved(
    numerical: Mapping[str, float], intervals: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Return the constants that mesh and step shift by more than half of their interval."""
    return [name for name, shift in numerical.items() if abs(shift) > half_of(intervals[name])]


def describe_resolution(
    numerical: Mapping[str, float], intervals: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """Yield a sentence for each constant that is not resolved, see `unresolved`."""
    for name in unresolved(numerical, intervals):
        yield (
            f"not resolved: half of h and dt shifts {name} by {numerical[name]:+.2g}, its interval "
            f"is ± {half_of(intervals[name]):.2g}; take a finer mesh or shorter steps"
        )


def describe_predictions(end: Evaluation, predictions: Table) -> Iterator[str]:
    """Yield a sentence for each column that is not fitted: how far the fit is off there.

    `predictions` are as in `Fit`.
    """
    intervals = {(row["experiment"], row["column"]): row for row in predictions}
    for column in end.columns:
        if column.is_fitted:
            continue
        points = column.points
        r = column.residual
        share = float(np.sqrt(np.mean((r * points.sigma) ** 2))) / points.largest
        words = f"not fitted: {column.label}: {points.column} is off by {in_percent(share)} (rms)"
        row: Any = intervals.get((column.label, points.column))
        if row is None:
            yield words
        elif np.isnan(row["from"]):
            yield f"{words}; the fitted data do not tell it"
        else:
            verb = "is" if row["from"] <= row["measured"] <= row["to"] else "is not"
            interval = f"{row['from']:.4g} to {row['to']:.4g} {row['unit']}".rstrip()
            measured = f"{row['measured']:.4g} {verb} in the interval of a new specimen"
            yield f"{words}; its end, {measured}, {interval} (95 %)"


def describe_fit(fitting: Fitting, end: Evaluation, facts: Statistics) -> str:
    """Return the sentence that says how many constants were fitted to how many points.

    It ends with the misfit, which is not known if there are as many unknowns as points.
    """
    constants = amount(len(fitting.constants), "constant")
    points = amount(len(end.residual), "point")
    fitted = [specimen for specimen in fitting.specimens if specimen.experiment.fitted]
    experiments = amount(len(fitted), "experiment")
    if np.isfinite(facts.misfit):
        misfit = f"misfit {facts.misfit:.3g} (1 is the scatter)"
    else:
        misfit = "as many unknowns as points: no misfit is known"
    return f"{constants} fitted to {points} of {experiments}: {misfit}"


def describe_held(fitting: Fitting) -> Iterator[str]:
    """Yield a sentence with the constants of the fabrics that were not sought, and their values.

    There is none if all were sought. A constant that differs between the specimens has several
    values; constants that are 0 are left out.
    """
    held_values: dict[str, dict[str, None]] = {}  # by constant: texts, each once, in their order
    for specimen in fitting.specimens:
        for name, value in specimen.problem.source.numbers():
            # the unknown may be a pair, whose numbers end with .0 and .1
            is_sought = name in specimen.names or name.rpartition(".")[0] in specimen.names
            if name.startswith("fabric.") and value and not is_sought:
                texts = held_values.setdefault(name.removeprefix("fabric."), {})
                texts[f"{value:.4g}"] = None
    if held_values:
        items = [f"{name} = {' and '.join(texts)}" for name, texts in held_values.items()]
        yield f"taken as given, and not measured: {', '.join(items)}"


def describe_assumed(end: Evaluation) -> Iterator[str]:
    """For which experiments nobody states an uncertainty."""
    if names := {column.label for column in end.fitted if column.points.is_assumed}:
        share = in_percent(ASSUMED_SIGMA)
        listed = ", ".join(sorted(names))
        yield f"{listed}: no sigma is given, so {share} of the largest value is assumed"
