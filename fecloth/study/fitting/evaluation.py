"""Specimens at some constants: computed values beside the measured points."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fecloth.errors import InputError
from fecloth.study.fitting.computed import (
    Computed,
    best_shift,
    computed_curve,
    computed_values,
)
from fecloth.study.fitting.measured import Measured
from fecloth.study.fitting.specimens import Specimen
from fecloth.study.fitting.unknowns import Unknown, values_of
from fecloth.study.runs import Run, Runs, run_all
from fecloth.study.status import OK, REFUSED, failure

# Relative error of the derivatives: below `LEAST_SINGULAR`, so that what is not told is seen.
ERROR_OF_DERIVATIVES = 1e-5


@dataclass(frozen=True, eq=False)
class Column:
    """A measured column beside what the problem gives at its points.

    Attributes
    ----------
    specimen
        The specimen.
    points
        What was measured.
    residual
        (n,) values of (computed − measured)/σ; NaN where the run failed.
    jacobian
        (n, m) their derivatives by the unknowns.
    computed
        What the problem gives; None where the run failed.
    """

    specimen: Specimen
    points: Measured
    residual: np.ndarray
    jacobian: np.ndarray
    computed: Computed | None = None

    @property
    def label(self) -> str:
        """The name of the experiment."""
        return self.specimen.experiment.label

    @property
    def is_fitted(self) -> bool:
        """Whether the fit uses the column."""
        return self.specimen.experiment.fitted


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What the problems give at some constants, beside what was measured.

    Attributes
    ----------
    u
        (m,) unknowns, see `Unknown`.
    values
        Values of constants and offsets, by name.
    columns
        The columns of all specimens that were run.
    cause
        Why a run failed; "" if none did.
    folds
        Number of folds at the end of a run, by the name of its experiment; of equilibria with a
        rim.
    is_converged
        Whether a search ended there because nothing was left to gain.
    """

    u: np.ndarray
    values: Mapping[str, float]
    columns: tuple[Column, ...]
    cause: str = ""
    folds: Mapping[str, float] = field(default_factory=dict)
    is_converged: bool = True

    @cached_property
    def fitted(self) -> list[Column]:
        """The columns that the fit uses."""
        return [column for column in self.columns if column.is_fitted]

    @property
    def residual(self) -> np.ndarray:
        """The residuals of all fitted points."""
        return np.concatenate([column.residual for column in self.fitted])

    @property
    def jacobian(self) -> np.ndarray:
        """The derivatives of the residuals by the unknowns."""
        return np.concatenate([column.jacobian for column in self.fitted])


@dataclass(frozen=True, eq=False)
class Fitting:
    """Specimens and unknowns: what is evaluated."""

    specimens: tuple[Specimen, ...]
    unknowns: tuple[Unknown, ...]
    how: Runs

    @property
    def constants(self) -> tuple[Unknown, ...]:
        """The unknowns without the offsets."""
        return tuple(unknown for unknown in self.unknowns if not unknown.is_offset)

    def finer(self) -> "Fitting | None":
        """The same with finer meshes and shorter steps; None if no specimen has such."""
        finer = [specimen.finer() for specimen in self.specimens]
        if all(specimen is None for specimen in finer):
            return None
        pairs = zip(finer, self.specimens, strict=True)
        return replace(self, specimens=tuple(new or old for new, old in pairs))

    def evaluate(self, u: np.ndarray, only_fitted: bool = True) -> Evaluation:
        """Run all specimens, or the fitted ones only, at the unknowns u (m,); return the results.

        A failed run gives NaN as residuals and derivatives, also if the fabric refuses its
        constants; the first cause stands in `Evaluation.cause`.

        Raises
        ------
        InputError
            For what does not depend on the constants, as points beyond the end of a curve.
        """
        values = values_of(self.unknowns, u)
        numbers = [
            i
            for i, specimen in enumerate(self.specimens)
            if specimen.experiment.fitted or not only_fitted
        ]
        try:
            runs = self.runs(u, numbers)
        except InputError as error:
            rows = [failure(REFUSED, error) for _ in numbers]
        else:
            rows = run_all(runs, replace(self.how, quiet=True))
        cause = ""
        columns = list[Column]()
        folds = dict[str, float]()
        for i, row in zip(numbers, rows, strict=True):
            specimen = self.specimens[i]
            if row["status"] == OK:
                if row.get("folds") is not None:
                    folds[specimen.experiment.label] = row["folds"]
                results = self._computed(i, row, values)
                pairs = zip(specimen.points, results, strict=True)
                columns += [self._column(i, points, result, u) for points, result in pairs]
                continue
            cause = cause or f"{specimen.experiment.label}: {row['cause']}"
            for points in specimen.points:
                nothing = np.full((len(points.values), len(u)), np.nan)
                columns.append(Column(specimen, points, nothing[:, 0], nothing))
        return Evaluation(u, values, tuple(columns), cause, folds)

    def runs(self, u: np.ndarray, numbers: Sequence[int]) -> list[Run]:
        """Return the runs of the specimens with these `numbers` at the unknowns u (m,).

        Raise `InputError` if a fabric refuses its constants.
        """
        values = values_of(self.unknowns, u)
        # with dp/du as the unit of each constant p, its derivatives are by u
        pairs = zip(self.unknowns, u, strict=True)
        widths = {unknown.name: unknown.slope(float(at)) for unknown, at in pairs}
        return [self.specimens[i].run(values, widths, ERROR_OF_DERIVATIVES) for i in numbers]

    def _computed(self, i: int, row: Mapping, values: Mapping[str, float]) -> Iterator[Computed]:
        """Yield what the run of specimen number i gives for each of its columns.

        `row` is the row of the run, and `values` has the constants and offsets by name. An
        experiment that is compared only gets the offset that fits its first column best.
        """
        specimen = self.specimens[i]
        experiment = specimen.experiment
        if experiment.order is None:
            for number, points in enumerate(specimen.points):
                yield computed_values(row, number, len(points.values))
            return
        # the quantity that orders the points, if it is not t, is the first value of the row
        is_by_quantity = experiment.order[1] is not None
        index_of_order = 0 if is_by_quantity else None
        offsets = [values[unknown.name] for unknown in self.unknowns if unknown.specimen == i]
        offset = offsets[0] if offsets else None
        for number, points in enumerate(specimen.points, start=int(is_by_quantity)):
            curve = partial(computed_curve, row, number, index_of_order, points)
            if offset is None and experiment.offset:  # it is not fitted, so no unknown gives it
                offset = best_shift(curve, points, specimen.reach / 2)
            yield curve(offset)

    def _column(self, i: int, points: Measured, result: Computed, u: np.ndarray) -> Column:
        """Return a measured column of specimen number i beside its computed `result`.

        Both the residuals and their derivatives by u are divided by the uncertainties.
        """
        J = np.zeros((len(result.values), len(self.unknowns)))
        names = self.specimens[i].names
        for k, unknown in enumerate(self.unknowns):
            if unknown.specimen == i:  # its offset moves all points along the curve
                J[:, k] = -result.along_slope * unknown.slope(float(u[k]))
            elif unknown.name in names:  # by u already, see `_run`
                J[:, k] = result.slopes[:, names.index(unknown.name)]
        residual = (result.values - points.values) / points.sigma
        return Column(self.specimens[i], points, residual, J / points.sigma[:, None], result)

    def report(self, number: int, at: Evaluation, phase: str) -> None:
        """Print a line for evaluation `number`, with its constants and misfit, unless quiet.

        The misfit is the mean square of the residuals. `phase` is a text before the number. If a
        run failed, the line has the cause in place of the misfit.
        """
        if self.how.quiet:
            return
        constants = ", ".join(
            f"{unknown.name.removeprefix('fabric.')} = {at.values[unknown.name]:.4g}"
            for unknown in self.constants
        )
        if at.cause:
            result = f"failed ({at.cause.splitlines()[0]})"
        else:
            result = f"misfit {(at.residual @ at.residual) / len(at.residual):.3g}"
        words = f"[{phase}evaluation {number}] {result} with {constants}"
        print(words, file=sys.stderr, flush=True)


def check_signs(at: Evaluation) -> None:
    """Refuse a column whose values all have the sign opposite to the computed values."""
    for column in at.fitted:
        points = column.points
        computed = column.computed
        if computed and (computed.values * points.values < 0).all():
            what = f"{column.label}: column {points.column!r}"
            allowed = f"has the sign opposite to {points.quantity} of the first run"
            raise InputError(what, allowed, "fit", "Turn the signs of the column.")
