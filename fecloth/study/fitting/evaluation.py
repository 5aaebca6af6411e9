"""Computed values at the measured points, and their derivatives by the unknowns."""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from fecloth.errors import InputError, amount
from fecloth.study.derived_cases import derive_case
from fecloth.study.fitting.measured import Measured
from fecloth.study.fitting.specimens import Specimen
from fecloth.study.fitting.unknowns import Unknown, values_of
from fecloth.study.run_problems import Runs, Task, run_tasks
from fecloth.study.status import OK

SPARE = 0.05  # of the curve: how far beyond its end it goes on straight


@dataclass(frozen=True, eq=False)
class Computed:
    """What the problem gives at the points of a measured column."""

    values: np.ndarray  # (n,)
    slopes: np.ndarray  # (n, k) by the unknown constants
    along_slope: np.ndarray  # (n,) by the place along the curve
    shift: float = 0.0  # where the measured places begin


def computed_values(row: Mapping, number: int, count: int) -> Computed:
    """The number of a run without a curve, for each of `count` measurements of it."""
    slopes = np.array(row["slopes"][number], dtype=float)
    same = np.ones(count)
    return Computed(row["values"][number] * same, np.outer(same, slopes), 0.0 * same)


def computed_curve(
    row: Mapping, number: int, order: int | None, points: Measured, shift: float | None
) -> Computed:
    """The curve of a run at the measured places, which begin at `shift` if it is not None.

    Before the shift the specimen is slack, and has the value of its start. `number` is the
    place of the quantity among the values of the row, and `order` of what orders the points;
    None for t. With the curve q(a) of the rows (a_i, q_i) a parameter p changes a value at a
    fixed place A by ∂q/∂p − (dq/da) ∂a/∂p.
    """
    q, dq = _rows(row, number)
    if order is None:
        a, da = (np.array(row["times"]), 0 * dq)
    else:
        a, da = _rows(row, order)
    if order is not None:
        a = a - a[0]
        da = da - da[0]
    known = np.isfinite(q) & np.isfinite(a)
    a = a[known]
    q = q[known]
    da = da[known]
    dq = dq[known]
    if len(a) and a[-1] < a[0]:
        a = a[::-1]
        q = q[::-1]
        da = da[::-1]
        dq = dq[::-1]
    assert points.along is not None
    places = points.along - (shift or 0.0)
    _check_order(a, points, places if shift is None else np.zeros(1))
    is_slack = (places * np.sign(a[-1] + a[0]) < 0) & (shift is not None)
    places = np.where(is_slack, 0.0, places)
    inside = np.clip(places, a[0], a[-1])
    curve = CubicSpline(a, q)
    slope = curve(inside, 1)
    values = curve(inside) + slope * (places - inside)  # beyond the rows as at the end
    slopes = CubicSpline(a, dq)(inside) - slope[:, None] * CubicSpline(a, da)(inside)
    return Computed(values, slopes, np.where(is_slack, 0.0, slope), shift or 0.0)


def best_shift(curve: Callable[[float], Computed], points: Measured, reach: float) -> float:
    """The shift with the least sum of squares, for a curve that is compared only."""

    def misfit(shift: float) -> float:
        r = (curve(shift).values - points.values) / points.sigma
        return float(r @ r)

    return float(minimize_scalar(misfit, bounds=(-reach, reach), method="bounded").x)


def _rows(row: Mapping, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (s,) over the rows, and derivatives (s, k)."""
    values = np.array(row["values"][number], dtype=float)
    slopes = np.array(row["slopes"][number], dtype=float).reshape(-1, len(values)).T
    return values, slopes


def _check_order(a: np.ndarray, points: Measured, places: np.ndarray) -> None:
    """Refuse a run with too few rows, that goes back, or that ends before the last place."""
    if len(a) < 2:
        what = f"the run has {len(a)} rows with a value of {points.quantity}"
        remedy = "Give more steps: [equilibrium] load_steps = 10, or a smaller dt."
        raise InputError(what, "a curve needs at least 2", "Experiment", remedy)
    if not (np.diff(a) > 0).all():
        what = "the run goes back, or stands still, along the curve"
        raise InputError(what, "each row must be farther", "Experiment", 'Take along = "t".')
    if places.max() - a[-1] > SPARE * np.ptp(a):
        what = f"{points.column} is measured up to {places.max():.6g} {points.along_unit}".rstrip()
        remedy = "Move the grip farther, run longer, or leave points out."
        raise InputError(what, f"the run reaches {a[-1]:.6g}", "Experiment", remedy)


EXACTNESS = 1e-5  # relative error of the derivatives, so that what is not told is seen


@dataclass(frozen=True, eq=False)
class Column:
    """A measured column beside what the problem gives at its points."""

    specimen: Specimen
    points: Measured
    residual: np.ndarray  # (n,) (computed − measured)/σ; NaN where the run failed
    jacobian: np.ndarray  # (n, m) its derivatives by the unknowns
    computed: Computed | None = None  # None where the run failed

    @property
    def label(self) -> str:
        return self.specimen.experiment.label

    @property
    def is_fitted(self) -> bool:
        return self.specimen.experiment.fitted


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What the problems give at some constants, beside what was measured."""

    u: np.ndarray  # (m,)
    values: Mapping[str, float]  # of constants and offsets
    columns: tuple[Column, ...]  # all that were run
    cause: str = ""  # why a run failed

    @cached_property
    def fitted(self) -> list[Column]:
        return [column for column in self.columns if column.is_fitted]

    @property
    def residual(self) -> np.ndarray:
        return np.concatenate([column.residual for column in self.fitted])

    @property
    def jacobian(self) -> np.ndarray:
        return np.concatenate([column.jacobian for column in self.fitted])


@dataclass(frozen=True, eq=False)
class Fitting:
    """Specimens and unknowns: what is evaluated."""

    specimens: tuple[Specimen, ...]
    unknowns: tuple[Unknown, ...]
    runs: Runs

    @property
    def constants(self) -> tuple[Unknown, ...]:
        return tuple(each for each in self.unknowns if not each.is_offset)

    def finer(self) -> "Fitting | None":
        """The same with finer meshes and shorter steps, where a specimen has such."""
        finer = [each.finer() for each in self.specimens]
        if all(each is None for each in finer):
            return None
        pairs = zip(finer, self.specimens, strict=True)
        return replace(self, specimens=tuple(new or old for new, old in pairs))

    def evaluate(self, u: np.ndarray, only_fitted: bool = True) -> Evaluation:
        """Run all specimens, or the fitted specimens only.

        A failed run gives NaN. An `InputError` is of what does not depend on the constants.
        """
        values = values_of(self.unknowns, u)
        widths = {k.name: k.slope(at) for k, at in zip(self.unknowns, u, strict=True)}
        chosen = [
            i for i, each in enumerate(self.specimens) if each.experiment.fitted or not only_fitted
        ]
        cause = ""
        columns = list[Column]()
        try:
            tasks = [self._task(i, values, widths) for i in chosen]
        except InputError as error:  # the fabric refuses its constants
            rows: list[dict] = [{"status": "refused", "cause": str(error)} for _ in chosen]
        else:
            rows = run_tasks(tasks, replace(self.runs, quiet=True))
        for i, row in zip(chosen, rows, strict=True):
            specimen = self.specimens[i]
            if row["status"] == OK:
                results = self._computed(i, row, values)
                pairs = zip(specimen.points, results, strict=True)
                columns += [self._column(i, *pair, u) for pair in pairs]
                continue
            cause = cause or f"{specimen.experiment.label}: {row['cause']}"
            for points in specimen.points:
                nothing = np.full((len(points.values), len(u)), np.nan)
                columns.append(Column(specimen, points, nothing[:, 0], nothing))
        return Evaluation(u, values, tuple(columns), cause)

    def _task(self, i: int, values: Mapping[str, float], widths: Mapping[str, float]) -> Task:
        specimen = self.specimens[i]
        words = f"{specimen.experiment.label} with {amount(len(specimen.names), 'derivative')}"
        settings = {"sought": specimen.sought(values, widths, EXACTNESS).settings()}
        return Task(derive_case, specimen.at(values), settings, words, specimen.cost)

    def _computed(self, i: int, row: Mapping, values: Mapping[str, float]) -> Iterator[Computed]:
        specimen = self.specimens[i]
        order = specimen.experiment.order
        first = 1 if order and order[1] else 0
        offset = next((values[k.name] for k in self.unknowns if k.specimen == i), None)
        for number, points in enumerate(specimen.points, first):
            if order is None:
                yield computed_values(row, number, len(points.values))
                continue
            curve = partial(computed_curve, row, number, 0 if first else None, points)
            if offset is None:
                free = specimen.experiment.offset
                if free:
                    offset = best_shift(curve, points, specimen.reach / 2)
                else:
                    offset = None
            yield curve(offset)

    def _column(self, i: int, points: Measured, result: Computed, u: np.ndarray) -> Column:
        """The column of a run; the widths of constants are dp/du already."""
        J = np.zeros((len(result.values), len(self.unknowns)))
        names = self.specimens[i].names
        for k, each in enumerate(self.unknowns):
            if each.specimen == i:
                J[:, k] = -result.along_slope * each.slope(float(u[k]))
            elif each.name in names:
                J[:, k] = result.slopes[:, names.index(each.name)]
        residual = (result.values - points.values) / points.sigma
        return Column(self.specimens[i], points, residual, J / points.sigma[:, None], result)

    def report(self, number: int, at: Evaluation, phase: str) -> None:
        """Print a line for an evaluation."""
        if self.runs.quiet:
            return
        words = ", ".join(
            f"{each.name.removeprefix('fabric.')} = {at.values[each.name]:.4g}"
            for each in self.constants
        )
        if at.cause:
            words = f"failed ({at.cause.splitlines()[0]}) with {words}"
        else:
            words = f"misfit {(at.residual @ at.residual) / len(at.residual):.3g} with {words}"
        print(f"[{phase}evaluation {number}] {words}", file=sys.stderr, flush=True)


def check_signs(at: Evaluation) -> None:
    """Refuse a column whose values all have the sign opposite to the computed values."""
    for column in at.fitted:
        points = column.points
        computed = column.computed
        if computed and (computed.values * points.values < 0).all():
            what = f"{column.label}: column {points.column!r}"
            allowed = f"has the sign opposite to {points.quantity} of the first run"
            raise InputError(what, allowed, "fit", "Turn the signs of the column.")
