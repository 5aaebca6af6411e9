"""The residuals of all experiments at a set of constants, and their derivatives."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.study.change import FIRST
from fecloth.study.derived_cases import Task, run_tasks
from fecloth.study.fitting.curves import (
    Computed,
    best_shift,
    computed_curve,
    computed_values,
)
from fecloth.study.fitting.specimens import Specimen
from fecloth.study.fitting.unknowns import Unknown, values_of
from fecloth.study.run_problems import Runs
from fecloth.study.status import OK

EXACTNESS = 1e-5  # relative error of the derivatives, so that what is not told is seen
PRICE = 0.5  # of a derivative, in runs

Block = tuple[int, int]  # a specimen and one of its measured columns


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What the problems give at some constants, beside what was measured."""

    u: np.ndarray  # (m,)
    values: Mapping[str, float]  # of constants and offsets
    computed: Mapping[Block, Computed]  # empty where a run failed
    residuals: Mapping[Block, np.ndarray]  # (computed − measured)/σ of each block
    jacobians: Mapping[Block, np.ndarray]  # (n, m) their derivatives by u
    cause: str = ""  # why a run failed

    def residual(self, blocks: Sequence[Block]) -> np.ndarray:
        return np.concatenate([self.residuals[block] for block in blocks])

    def shift(self, block: Block) -> float:
        """The offset of a curve."""
        return self.computed[block].shift if block in self.computed else np.nan

    def jacobian(self, blocks: Sequence[Block]) -> np.ndarray:
        return np.concatenate([self.jacobians[block] for block in blocks])


@dataclass(frozen=True, eq=False)
class Fitting:
    """Specimens and unknowns: what is evaluated."""

    specimens: tuple[Specimen, ...]
    unknowns: tuple[Unknown, ...]
    runs: Runs

    @property
    def constants(self) -> tuple[Unknown, ...]:
        return tuple(each for each in self.unknowns if not each.is_offset)

    @property
    def all_blocks(self) -> list[Block]:
        return [(i, k) for i, each in enumerate(self.specimens) for k in range(len(each.points))]

    @property
    def blocks(self) -> list[Block]:
        """The blocks that are fitted."""
        return [b for b in self.all_blocks if self.specimens[b[0]].experiment.fitted]

    def free(self, block: Block) -> int:
        """The number of points of a block."""
        return len(self.specimens[block[0]].points[block[1]].values)

    def finer(self) -> "Fitting | None":
        """The same with finer meshes and shorter steps, where a specimen has such."""
        finer = [each.finer() for each in self.specimens]
        if all(each is None for each in finer):
            return None
        pairs = zip(finer, self.specimens, strict=True)
        return replace(self, specimens=tuple(new or old for new, old in pairs))

    def evaluate(self, u: np.ndarray, only_fitted: bool = True) -> Evaluation:
        """Run the specimens, or only those that are fitted.

        A failed run gives NaN. An `InputError` is of what does not depend on the constants.
        """
        values = values_of(self.unknowns, u)
        widths = {k.name: k.slope(at) for k, at in zip(self.unknowns, u, strict=True)}
        chosen = [
            i for i, each in enumerate(self.specimens) if each.experiment.fitted or not only_fitted
        ]
        cause = ""
        try:
            tasks = [self._task(i, values, widths) for i in chosen]
        except InputError as error:  # the fabric refuses its constants
            rows: list[dict] = [{"status": "refused", "cause": str(error)} for _ in chosen]
        else:
            rows = run_tasks(tasks, replace(self.runs, quiet=True))
        computed: dict[Block, Computed] = {}
        for i, row in zip(chosen, rows, strict=True):
            if row["status"] == OK:
                computed |= self._computed(i, row, values)
            else:
                cause = cause or f"{self.specimens[i].experiment.label}: {row['cause']}"
        return self._evaluation(u, values, computed, chosen, cause)

    def _task(self, i: int, values: Mapping[str, float], widths: Mapping[str, float]) -> Task:
        specimen = self.specimens[i]
        problem = specimen.at(values)
        size = problem.workload(FIRST)
        cost = replace(size, steps=round(size.steps * (1 + PRICE * len(specimen.names))))
        words = f"{specimen.experiment.label} with {amount(len(specimen.names), 'derivative')}"
        return Task(problem, specimen.sought(values, widths, EXACTNESS), "derive", words, cost)

    def _computed(
        self, i: int, row: Mapping, values: Mapping[str, float]
    ) -> Iterator[tuple[Block, Computed]]:
        specimen = self.specimens[i]
        order = specimen.experiment.order
        first = 1 if order and order[1] else 0
        offset = next((values[k.name] for k in self.unknowns if k.specimen == i), None)
        place = 0 if first else None
        for k, points in enumerate(specimen.points):
            if order is None:
                yield (i, k), computed_values(row, first + k, len(points.values))
                continue
            curve = partial(computed_curve, row, first + k, place, points)
            if offset is None:
                free = specimen.experiment.offset
                offset = best_shift(curve, points, specimen.reach / 2) if free else 0.0
            yield (i, k), curve(offset)

    def _evaluation(
        self,
        u: np.ndarray,
        values: Mapping[str, float],
        computed: Mapping[Block, Computed],
        chosen: Sequence[int],
        cause: str,
    ) -> Evaluation:
        residuals, jacobians = {}, {}
        for i, k in (block for block in self.all_blocks if block[0] in chosen):
            points, result = self.specimens[i].points[k], computed.get((i, k))
            residuals[i, k] = np.full(len(points.values), np.nan)
            if result:
                residuals[i, k] = (result.values - points.values) / points.sigma
                jacobians[i, k] = self._jacobian(i, result, u) / points.sigma[:, None]
        return Evaluation(u, values, computed, residuals, jacobians, cause)

    def _jacobian(self, i: int, result: Computed, u: np.ndarray) -> np.ndarray:
        """(n, m) ∂(computed)/∂u; the constants' widths are dp/du already."""
        J = np.zeros((len(result.values), len(self.unknowns)))
        names = self.specimens[i].names
        for column, each in enumerate(self.unknowns):
            if each.specimen == i:
                J[:, column] = -result.along_slope * each.slope(float(u[column]))
            elif each.name in names:
                J[:, column] = result.slopes[:, names.index(each.name)]
        return J

    def report(self, number: int, at: Evaluation) -> None:
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
            residual = at.residual(self.blocks)
            words = f"misfit {(residual @ residual) / len(residual):.3g} with {words}"
        print(f"[evaluation {number}] {words}", file=sys.stderr, flush=True)
