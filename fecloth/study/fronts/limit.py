"""The limit of the quantities of a problem: one line of settings, refined until it is known."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from fecloth.errors import amount
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import (
    RunRecord,
    difference_of,
    is_number,
    size_of,
    value_of,
)
from fecloth.study.command import StudyFailed
from fecloth.study.convergence import Convergence, has_no_limit
from fecloth.study.fronts.bench import Bench, check_sizes
from fecloth.study.fronts.settings import ALL_METHODS, Line, Setting
from fecloth.study.result import Table
from fecloth.study.runs import record_at
from fecloth.study.states import find_states, may_have_others, run_other_starts
from fecloth.study.status import OK
from fecloth.study.uncertainty import Estimate, estimate_uncertainty

# The observed order of a ladder over the theory, above which its changes shrink as the order says.
LEAST_PART_OF_ORDER = 0.5
LEVELS = 4  # of a ladder that are judged: the finest ones
LEAST_LEVELS = 3  # which show two consecutive changes
COARSEST_LEVEL = 2  # how often h and dt of the first level of a ladder were refined
# The uncertainty of the limit over the tolerance, above which the limit is refined further.
PART_OF_TOLERANCE = 0.4
PART_OF_TIME = 0.6  # of the time of a front that the limit may take
LEVEL_COSTS = 8.0  # time of a level over the time of the one before: 4 times the triangles, 2 steps
# Time of the first level of a ladder over the time of the fastest one, above which it is left out.
PATIENCE = 4.0
LARGEST_SHIFT = 4  # by how many halvings dt of a ladder is refined against its h


@dataclass(frozen=True, eq=False)
class Limit:
    """What a ladder of levels says of the exact values of the quantities.

    Attributes
    ----------
    quantities
        The quantities.
    settings
        The settings of the levels, coarse to fine; h and dt of each are half of the one before.
    rows
        Their rows.
    estimates
        For each quantity the estimate from the finest levels.
    states
        Why the levels of an equilibrium have no common limit, as several states; or "".
    """

    quantities: tuple[Quantity, ...]
    settings: tuple[Setting, ...]
    rows: tuple[dict, ...]
    estimates: tuple[Estimate, ...]
    states: str = ""

    @property
    def finest(self) -> dict:
        """The row of the finest level."""
        return self.rows[-1]

    @cached_property
    def records(self) -> tuple[RunRecord, ...]:
        """What the quantities of the finest level are computed from."""
        return tuple(record_at(self.finest, quantity) for quantity in self.quantities)

    @cached_property
    def sizes(self) -> np.ndarray:
        """(q,) sizes of the quantities, by which errors are relative."""
        pairs = zip(self.quantities, self.records, strict=True)
        return np.array([size_of(quantity, record) for quantity, record in pairs])

    @cached_property
    def uncertainty(self) -> np.ndarray:
        """(q,) relative uncertainty of the limit; infinite where two changes do not shrink."""
        absolute = [
            estimate.uncertainty if shrinks(estimate) else math.inf for estimate in self.estimates
        ]
        return np.array(absolute) / self.sizes

    @property
    def is_known(self) -> bool:
        """Whether all quantities have an uncertainty, and the levels one state."""
        return not self.states and bool(np.isfinite(self.uncertainty).all())

    def is_within(self, wanted: float, levels: int) -> bool:
        """Whether the uncertainty is at most the wanted one, and there are enough levels."""
        return float(self.uncertainty.max()) <= wanted and len(self.rows) >= levels

    @property
    def why_unknown(self) -> str:
        """Why a quantity has no uncertainty."""
        if self.states:
            return self.states
        count = len(self.rows)
        if count < LEAST_LEVELS:
            levels = amount(count, "level")
            return f"{levels} reached the end of the run in time; a limit needs {LEAST_LEVELS}"
        return "the changes from level to level do not shrink as the order says"

    def error(self, row: dict) -> np.ndarray:
        """Return the (q,) relative distances of a run to the limit.

        A number is compared with the extrapolated value. A field, path or vector has none: it is
        compared with the finest level.
        """
        distances = []
        for quantity, estimate, finest in zip(
            self.quantities, self.estimates, self.records, strict=True
        ):
            record = record_at(row, quantity)
            if is_number(quantity, record):
                distances.append(abs(value_of(quantity, record) - estimate.limit))
            else:
                distances.append(difference_of(quantity, finest, record))
        return np.array(distances) / self.sizes

    def convergences(self) -> dict[str, Convergence]:
        """Return the convergence of each quantity over the levels, by its text."""
        return {
            quantity.text: self._convergence(quantity, estimate)
            for quantity, estimate in zip(self.quantities, self.estimates, strict=True)
        }

    def _convergence(self, quantity: Quantity, estimate: Estimate) -> Convergence:
        """Return the convergence of a quantity: its levels in a table, and its limit."""
        values = [value_of(quantity, record_at(row, quantity)) for row in self.rows]
        rows = []
        for row, value in zip(self.rows, values, strict=True):
            cells: dict = {"h": row["problem"].h}
            if math.isfinite(row["step"]):
                cells["dt"] = row["step"]
            cells |= {name: row[name] for name in ("triangles", "steps", "newton", "cpu_seconds")}
            rows.append(cells | {"value": value, "error": abs(value - estimate.limit)})
        has_limit = is_number(quantity, record_at(self.finest, quantity))
        converges = shrinks(estimate)
        return Convergence(
            title=self.finest["problem"].name,
            verdict="converges" if converges else "not known to converge",
            table=Table(tuple(rows)),
            quantity=quantity.text,
            unit=quantity.unit(self.finest["energies"]),
            value=values[-1],
            uncertainty=math.nan if has_no_limit(estimate) else estimate.uncertainty,
            limit=estimate.limit if has_limit else values[-1],
            order=estimate.order,
            theory=estimate.theory,
            converges=converges,
            refine="both" if "dt" in rows[0] else "h",
            estimate=estimate,
            levels=self.rows,
        )


def shrinks(estimate: Estimate) -> bool:
    """Whether the last two changes of a ladder shrink as the order says.

    The observed order must be at least half of the theory, or all values be equal to round-off.
    """
    if estimate.behaviour == "constant":
        return True
    least_order = LEAST_PART_OF_ORDER * estimate.theory
    return estimate.behaviour == "monotone" and estimate.order >= least_order


def find_limit(
    bench: Bench,
    lines: Sequence[Line],
    tolerance: float,
    levels: int = LEAST_LEVELS,
    report: Callable[[str], None] = lambda words: None,
) -> Limit:
    """Refine the most promising line until the uncertainty of the limit is small enough.

    Each level halves h and dt. The ladder that should reach the wanted uncertainty in the least
    time goes on, by what its levels took and by how they changed: so a line whose changes do not
    shrink gives way to another. The limit is the one of the ladder with the least uncertainty.
    It has at least `levels` levels, as far as the time allows. The levels run with a sharper
    solver, so that the limit has no error of the solver, and distances to it have. `report` is
    told each level in words.

    Raises
    ------
    StudyFailed
        If no run on a coarse mesh reaches its end.
    InputError
        If a quantity is zero.
    """
    wanted = PART_OF_TOLERANCE * tolerance
    bench = bench.with_sharper_solver()
    ladders = [Ladder(bench, line) for line in lines if is_second_order(line)]
    ladders = ladders or [Ladder(bench, line) for line in lines]
    most = math.inf
    for ladder in ladders:
        ladder.begin(most)
        if ladder.levels:
            most = min(most, PATIENCE * bench.took(ladder.levels[0]))
    checked = False
    while True:
        open_ladders = [ladder for ladder in ladders if ladder.can_go_on]
        limits = [ladder.limit for ladder in ladders if ladder.limit]
        if limits and not checked:
            where = bench.settings.problem.where
            check_sizes(bench.quantities, limits[0].finest, where)
            checked = True
        best = min(limits, key=lambda limit: limit.uncertainty.max(), default=None)
        is_known = best is not None and best.is_within(wanted, levels)
        if is_known or not open_ladders or bench.spent > PART_OF_TIME * bench.seconds:
            break
        ladder = min(open_ladders, key=lambda ladder: ladder.seconds_to(wanted))
        ladder.go_on()
        known = best.uncertainty.max() if best else math.inf
        words = f"U of the limit {100 * known:.2g} %" if known < math.inf else "U not known yet"
        report(f"level {len(ladder.levels)} of {str(ladder.line) or 'the limit'}; {words}")
    if best is None:  # no ladder has three levels: its finest one counts, with an unknown error
        started = [ladder for ladder in ladders if ladder.levels]
        if started:
            best = max(started, key=lambda ladder: bench.took(ladder.levels[-1])).unknown_limit
            check_sizes(bench.quantities, best.finest, bench.settings.problem.where)
    if best is None:
        causes = {row["cause"] for row in bench.rows.values() if row["status"] != OK}
        why = "; ".join(sorted(map(str, causes))) or "the time was too short"
        raise StudyFailed(f"{bench.settings.problem.where}: no limit was found: {why}")
    return _with_states(best, bench)


def _with_states(limit: Limit, bench: Bench) -> Limit:
    """Return a limit that says whether its levels, and other starts, have several states."""
    if not may_have_others(limit.finest):
        return limit
    how = replace(bench.runs, quiet=True)
    starts = run_other_starts(limit.rows, limit.quantities, how, most=bench.left)
    for quantity, estimate in zip(limit.quantities, limit.estimates, strict=True):
        states = find_states(quantity, limit.rows, starts, estimate.uncertainty)
        if states.why:
            return replace(limit, states=f"{quantity.text}: {states.why}")
    return limit


def is_second_order(line: Line) -> bool:
    """Whether the steps of a line can be halved, with an error of second order."""
    if not line.method:
        return True
    if line.method == "auto":
        return False
    return ALL_METHODS[line.method]().traits.order >= 2


class Ladder:
    """Levels of one line, each with half of h and half of dt of the one before.

    Parameters
    ----------
    bench
        Where the levels run.
    line
        The line.
    """

    def __init__(self, bench: Bench, line: Line):
        self.bench = bench
        self.line = line
        self.levels: list[Setting] = []
        self.is_open = True

    def begin(self, most: float) -> None:
        """Run the first level, whose h and dt have errors of about the same size.

        Half of h, and half of dt, of a coarse setting show which error is larger; the other size
        starts so much coarser. A line whose coarse setting takes more than `most` CPU seconds has
        no level: others are faster.
        """
        refine_h, refine_dt = self.bench.settings.varies(self.line)
        first = Setting(self.line, COARSEST_LEVEL * refine_h, COARSEST_LEVEL * refine_dt)
        if self.bench.run(first, most)["status"] != OK:
            self.is_open = False
            return
        if refine_h and refine_dt:
            first = self._balance(first)
        self._add(first)

    def _balance(self, first: Setting) -> Setting:
        """Return the first level with so many halvings of dt, or of h, that the errors agree."""
        bench = self.bench
        settings = [first, first.finer(i=2), first.finer(j=1)]
        if not all(bench.run(setting)["status"] == OK for setting in settings):
            return first
        records = [
            [record_at(bench.rows[setting], quantity) for quantity in bench.quantities]
            for setting in settings
        ]
        by_h, by_dt = (
            max(
                difference_of(quantity, before, after)
                / max(size_of(quantity, before), np.finfo(float).tiny)
                for quantity, before, after in zip(
                    bench.quantities, records[0], others, strict=True
                )
            )
            for others in records[1:]
        )
        if not (by_h > 0 and by_dt > 0):
            return first
        halvings = round(math.log2(by_dt / by_h) / 2)  # both errors are of second order
        halvings = min(max(halvings, -LARGEST_SHIFT), LARGEST_SHIFT)
        if halvings > 0:
            return first.finer(j=halvings)
        return first.finer(i=-2 * halvings)

    def _add(self, setting: Setting) -> None:
        """Run a level; the ladder ends where it fails."""
        if self.bench.run(setting)["status"] == OK:
            self.levels.append(setting)
        else:
            self.is_open = False

    @property
    def can_go_on(self) -> bool:
        """Whether a further level can run in the time that is left."""
        has_sizes = any(self.bench.settings.varies(self.line))
        return self.is_open and has_sizes and self.bench.allows(self._next_seconds)

    @property
    def _next_seconds(self) -> float:
        """CPU seconds of the next level by those of the last one [s]."""
        return self.growth * self.bench.took(self.levels[-1])

    @property
    def growth(self) -> float:
        """The time of a level over the time of the level before it."""
        if len(self.levels) < 2:
            return LEVEL_COSTS / 2  # coarse levels take the time of their steps, not of triangles
        took, before = (self.bench.took(setting) for setting in self.levels[-1:-3:-1])
        return min(max(took / before, 2.0), 2 * LEVEL_COSTS)

    def go_on(self) -> None:
        """Run the next level."""
        refine_h, refine_dt = self.bench.settings.varies(self.line)
        self._add(self.levels[-1].finer(i=2 * refine_h, j=int(refine_dt)))

    def seconds_to(self, wanted: float) -> float:
        """Return the CPU seconds until the relative uncertainty is small enough."""
        limit = self.limit
        missing = LEAST_LEVELS - len(self.levels)
        if limit is not None:
            uncertainty = float(limit.uncertainty.max())
            if math.isinf(uncertainty):
                missing = LEAST_LEVELS - 1
            else:
                order = min(estimate.theory for estimate in limit.estimates)
                missing = max(math.ceil(math.log2(uncertainty / wanted) / order), 1)
        return self.bench.took(self.levels[-1]) * self.growth**missing

    @property
    def limit(self) -> Limit | None:
        """What the levels say; None of less than three."""
        if len(self.levels) < LEAST_LEVELS:
            return None
        rows = [self.bench.rows[setting] for setting in self.levels]
        quantities = self.bench.quantities
        estimates = [self._estimate(quantity, rows[-LEVELS:]) for quantity in quantities]
        return Limit(quantities, tuple(self.levels), tuple(rows), tuple(estimates))

    @property
    def unknown_limit(self) -> Limit:
        """The finest level as the limit, with an infinite uncertainty."""
        rows = tuple(self.bench.rows[setting] for setting in self.levels)
        quantities = self.bench.quantities
        values = [value_of(quantity, record_at(rows[-1], quantity)) for quantity in quantities]
        unknown = Estimate(
            value=math.nan,
            limit=math.nan,
            uncertainty=math.inf,
            order=math.nan,
            theory=math.nan,
            behaviour="unknown",
            scatter=math.nan,
            data_range=math.nan,
            procedure="none",
        )
        estimates = tuple(replace(unknown, value=value, limit=value) for value in values)
        return Limit(quantities, tuple(self.levels), rows, estimates)

    def _estimate(self, quantity: Quantity, rows: Sequence[dict]) -> Estimate:
        """Return the estimate of a quantity from the rows of levels, coarse to fine."""
        records = [record_at(row, quantity) for row in rows]
        if is_number(quantity, records[0]):
            values = [value_of(quantity, record) for record in records]
        else:  # sums of the changes to the finest level fall with the order of the error
            changes = [difference_of(quantity, a, b) for a, b in pairwise(records)]
            values = [sum(changes[k:]) for k in range(len(records))]
        sizes = [2.0 ** (len(rows) - k) for k in range(len(rows))]
        return estimate_uncertainty(sizes, values, self._theory(quantity))

    def _theory(self, quantity: Quantity) -> float:
        """Return the theoretical order of the levels: the least one of h and of dt."""
        problem = self.bench.rows[self.levels[0]]["problem"]
        space_order, time_order = problem.orders(quantity)
        refine_h, _ = self.bench.settings.varies(self.line)
        orders = [space_order] * refine_h
        if self.line.method in METHODS or self.line.method in EXPLICIT or problem.dt:
            orders.append(time_order)
        return min(orders, default=2.0)
