"""Runs of a problem and of simpler ones, and their changes of the quantities of interest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fecloth.errors import FeclothError, InputError
from fecloth.scene.probe_tables import Interest
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, relative_difference, size_of
from fecloth.study.change import AS_IS, FIRST_LEVEL, Change
from fecloth.study.command import StudyFailed
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.run_problems import Point, Runs, record_at, run_or_skip
from fecloth.study.simplification.outcome import Outcome, Trial
from fecloth.study.simplification.variants import PATIENCE, Variant, changes_of, list_variants
from fecloth.study.status import FAILED, OK, REFUSED, failure
from fecloth.system.system import System
from fecloth.terms import BendingFriction
from fecloth.terms.traits import traits_of

SECONDS_OF_SHORT_RUN = 0.5  # CPU seconds that every run may take, beside its patience
# Friction may be left out where the curvature that it holds, HB/B, is below this part of the
# curvature of the cloth.
WEAK_FRICTION = 0.1
# Kinds of the variants of a function's problem: its method stays.
KINDS_OF_FUNCTIONS = ("without", "cheaper", "strain", "mesh", "dt")


@dataclass(frozen=True, eq=False)
class Original:
    """The problem to simplify, the quantities that count, and how it is run.

    Attributes
    ----------
    problem
        The problem.
    quantities
        The quantities that count.
    tolerance
        The largest relative change of each of them.
    runs
        How cases are run.
    """

    problem: Problem
    quantities: tuple[Quantity, ...]
    tolerance: float
    runs: Runs

    @property
    def is_scene(self) -> bool:
        """Whether the problem is a scene, and no function."""
        return isinstance(self.problem, SceneProblem)

    def list_variants(self) -> list[Variant]:
        """List all variants, terms first; of a function's problem the method stays."""
        interest = Interest(quantities=tuple(quantity.text for quantity in self.quantities))
        terms = self.problem.first.system.terms
        traits = {type(term).__name__: traits_of(term) for term in terms}
        variants = list_variants(self.problem.tables, interest, traits)
        if self.is_scene:
            return variants
        return [variant for variant in variants if variant.kind in KINDS_OF_FUNCTIONS]

    def text(self, tables: dict) -> str:
        """Return the text of the reduced file, from the tables of the reduced problem.

        It is a scene; of a function it lists the terms, their strains, h and dt.
        """
        if self.is_scene:
            return to_toml(tables)
        terms = tables["terms"]
        names = ", ".join(term["type"] for term in terms)
        lines = [f"terms: {names or 'none'}"]
        for term in terms:
            if "strain" in term:
                lines.append(f"strain of {term['type']}: {term['strain']}")
        sizes = {"h": tables["cloth"].get("h"), "dt": tables.get("time", {}).get("dt")}
        for name, size in sizes.items():
            if isinstance(size, float):  # not None, and not dt = "auto"
                lines.append(f"{name} = {size:g}")
        return "\n".join(lines) + "\n"

    @cached_property
    def full(self) -> Mapping:
        """The row of the problem as it is; its run is made once.

        Raises
        ------
        StudyFailed
            If the run fails.
        InputError
            If all quantities are zero: then no relative change is known.
        """
        (row,) = run_or_skip([self._point("the scene", Change())], self.quantities, self.runs)
        if row["status"] != OK:
            raise StudyFailed(f"{self.problem.source}: the scene itself fails: {row['cause']}")
        pairs = zip(self.quantities, self._records(row), strict=True)
        if not any(size_of(quantity, record) for quantity, record in pairs):
            names = ", ".join(quantity.text for quantity in self.quantities)
            remedy = "Name another with --quantity or in [interest]."
            allowed = "cannot show what changes it"
            raise InputError(f"{names} = 0", allowed, self.problem.source, remedy)
        return row

    def _records(self, row: Mapping) -> list[RunRecord]:
        """Return what each quantity is computed from."""
        return [record_at(row, quantity) for quantity in self.quantities]

    @property
    def weak_friction(self) -> str:
        """A sentence, if the friction inside the fabric may be left out; else ""."""
        columns = self._records(self.full)[0].columns
        return describe_weak_friction(self.problem.first.system, columns)

    def run(self, tried: Sequence[tuple[str, Change, float]], fresh: bool = False) -> list[Outcome]:
        """Run changes of the problem, and return their outcomes in the same order.

        `tried` has for each its name, the change, and its patience: the largest CPU time, as a
        multiple of the time of the problem. With `fresh` no run is taken from the store.
        """
        points = []
        for name, change, patience in tried:
            most_seconds = SECONDS_OF_SHORT_RUN + patience * self.full["cpu_seconds"]
            points.append(self._point(name, change, round(most_seconds, 1)))
        runs = replace(self.runs, fresh=fresh or self.runs.fresh)
        rows = run_or_skip(points, self.quantities, runs)
        return [self.compare(name, row) for (name, *_), row in zip(tried, rows, strict=True)]

    def try_variants(self, tried: Sequence[Variant]) -> list[Trial]:
        """Run each variant alone; return it with what its run gave."""
        outcomes = self.run([(v.name, changes_of([v]), v.patience) for v in tried])
        return list(zip(tried, outcomes, strict=True))

    def run_one(self, name: str, change: Change, fresh: bool = False) -> Outcome:
        """Run a change; `fresh` for a run that is not taken from the store."""
        return self.run([(name, change, PATIENCE)], fresh)[0]

    def _point(self, name: str, change: Change, most: float | None = None) -> Point | dict:
        """Return what runs, for `most` CPU seconds; a row with the reason if it is refused."""
        try:
            changed = self.problem.changed(change)
        except InputError as error:
            return failure(REFUSED, error)
        return Point(changed, AS_IS, name, self.problem.workload(FIRST_LEVEL), most)

    def compare(self, name: str, row: Mapping) -> Outcome:
        """Return the outcome of a run, from its row: how it differs from the run of the problem.

        It has the relative change of each quantity, and the part of the CPU seconds that is
        saved. If the run failed, or a quantity has no value, it has the cause instead.
        """
        outcome = Outcome(name, row["status"], str(row["cause"]))
        if not outcome.is_ok:
            return outcome
        try:
            records_of_full = self._records(self.full)
            records = self._records(row)
            changes = {}
            for i, quantity in enumerate(self.quantities):
                change = relative_difference(quantity, records_of_full[i], records[i])
                changes[quantity.text] = change
        except FeclothError as error:  # for example, a signal has no period
            return replace(outcome, status=FAILED, cause=str(error))
        return Outcome(
            name=name,
            status=OK,
            changes=changes,
            seconds=row["cpu_seconds"],
            saved=1 - row["cpu_seconds"] / self.full["cpu_seconds"],
            triangles=row["triangles"],
            steps=row["steps"],
        )


def describe_weak_friction(system: System, columns: Mapping[str, np.ndarray]) -> str:
    """Return the sentence that friction inside the fabric may be left out; "" if it may not.

    It may if the curvature that it holds, HB/B, is below a tenth of the mean curvature of the
    cloth at the end of a run. HB/B is the largest of all fabrics, along warp or weft. `columns`
    are the columns of the run by name.
    """
    if not any(isinstance(term, BendingFriction) for term in system.terms):
        return ""
    held_curvature = 0.0
    for fabric in system.panel.fabrics:
        for hysteresis, rigidity in zip(
            fabric.hysteresis or (), fabric.bending or (), strict=False
        ):
            # HB is half of the hysteresis, the distance of both branches of the bending moment
            held_curvature = max(held_curvature, hysteresis / (2 * rigidity))
    curvature = _mean_curvature(system, columns)
    if not held_curvature < WEAK_FRICTION * curvature:
        return ""
    return (
        f"BendingFriction may be left out: HB/B = {held_curvature:.3g}/m is below a tenth "
        f"of the curvature, {curvature:.3g}/m"
    )


def _mean_curvature(system: System, columns: Mapping[str, np.ndarray]) -> float:
    """Return κ by the energy of bending at the end of a run, W = ½ B κ² per area; 0 for no B."""
    pairs = zip(system.names, system.terms, strict=True)
    names = [name for name, term in pairs if traits_of(term).kind == "bending"]
    energy = sum(float(columns[name][-1]) for name in names)
    rigidity = system.panel.each(lambda fabric: np.mean(fabric.bending or 0.0))[:, 0]
    total = float(rigidity @ system.cloth.weights.sum(axis=1))
    return math.sqrt(2 * energy / total) if total else 0.0
