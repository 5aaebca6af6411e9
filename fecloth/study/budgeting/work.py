"""The runs of a budget: levels, derivatives, samples, disturbed starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import value_of
from fecloth.study.budgeting.inputs import Inputs
from fecloth.study.command import StudyFailed
from fecloth.study.opened import Opened
from fecloth.study.refinement import levels_to_run, summarise
from fecloth.study.runs import Row, Run, announce, record_at, run_quantities
from fecloth.study.sensitivities import sensitivity
from fecloth.study.states import run_other_starts
from fecloth.study.status import OK, REFUSED, failure
from fecloth.study.uncertainty import UNSAFE
from fecloth.terms import BendingFriction

MOST_STAGES = 5  # levels, slopes, runs that probe the first order, samples, disturbed starts
PARTS = ("space", "time", "solver", "start")  # parts of the uncertainty that the levels show
LEVELS = 3  # of h: the least number that shows an order
# Samples where the first order does not hold: their standard deviation is then known to a tenth,
# 1/√(2 · 63).
SAMPLES = 64
# The first order holds where a probing sample lies off it by at most this part of the
# uncertainty.
PART_OFF_FIRST_ORDER = 0.25
# Part of a quantity that its solver may leave: smaller differences say nothing.
PART_LEFT_BY_SOLVER = 1e-6
# Of the uncertainty by inputs that do not cancel: less is round-off of the slopes.
ROUND_OFF_OF_SLOPES = 1e-6


@dataclass(frozen=True, eq=False)
class Work:
    """The runs of a budget.

    Attributes
    ----------
    study
        The opened study.
    quantities
        The quantities whose uncertainties are added up.
    """

    study: Opened
    quantities: Sequence[Quantity]

    def numerical(self) -> tuple[dict[str, Any], np.ndarray, list[str]]:
        """Run the problem on several levels; return values and numerical uncertainties.

        The first result has arrays (q,) by name: the "value" on the finest level, the standard
        uncertainties "space", "time" and "solver", and "start", the distance of other states. An
        uncertainty is NaN if a run for it failed, "space" also where no limit is seen, and
        "start" where other states are not excluded. The second result are the values (q,) of the
        first level, the problem as it is, the third sentences on several states and on quantities
        without a limit.

        Raises
        ------
        StudyFailed
            If a level fails.
        """
        opened = self.study.problem
        levels = levels_to_run(opened, self.quantities[0], "h", LEVELS, None)
        rows = self._rows(levels, MOST_STAGES)
        rows_of_mesh = rows[:LEVELS]
        others = rows[LEVELS:]  # with half of a gap, half of dt, or a sharper solver
        failed = [row for row in others if row["status"] != OK]
        no_share = np.nan if failed else 0.0
        remarks = list[str]()
        for row in failed:
            cause = (row["cause"] or row["status"]).splitlines()[0]
            remarks.append(f"A run for a part of the uncertainty failed: {cause}")
        columns: list[list[float]] = []
        starts = run_other_starts(rows_of_mesh, self.quantities, self.study.runs())
        for quantity in self.quantities:
            study = summarise(opened, quantity, "h", rows_of_mesh, others, starts)
            if study.estimate is None:
                raise StudyFailed(f"{opened.where}: {study.verdict}")
            # shares are estimated errors: UNSAFE times as much should cover the exact value
            gap = UNSAFE * study.shares.get("gap", no_share)
            time = UNSAFE * study.shares.get("time step", no_share)
            solver = UNSAFE * study.shares.get("solver", no_share)
            space = float(np.hypot(study.estimate.uncertainty, gap))
            start = np.nan
            if not study.may_have_other_states:
                values = [study.value, *(value for value, _ in study.states)]
                start = float(np.max(np.abs(np.array(values) - study.value)))
            if not (study.is_one_state and study.has_limit):
                remarks.append(f"{quantity.text}: {study.verdict.splitlines()[0].rstrip('.')}.")
            # a standard uncertainty is half of one that covers the exact value
            columns.append([study.value, 0.5 * space, 0.5 * time, 0.5 * solver, start])
        parts = dict(zip(("value", *PARTS), np.array(columns).T, strict=True))
        return parts, self.values(rows[:1])[0], remarks

    def values_at_start(self) -> np.ndarray:
        """(quantities,) values at the start; 0 of what has no value there, as a reaction."""
        asked = [quantity.column for quantity in self.quantities]
        row = self.study.problem.first.recording(asked).row()
        values = [row.get(name, 0.0) for name in asked]
        is_value = [quantity.how == "value" for quantity in self.quantities]
        return np.where(is_value, np.nan_to_num(values), 0.0)

    def _rows(self, to_run: Sequence[Run | dict], stages: int = 0) -> list[Row]:
        """Run what can run; raise `InputError` if it would take too long.

        `stages` are as for `announce`.
        """
        how = self.study.runs()
        announce(to_run, how, stages)
        return run_quantities(to_run, self.quantities, how)

    def values(self, rows: Sequence[Mapping]) -> np.ndarray:
        """(rows, quantities) values; NaN of a run that failed."""
        values = np.full((len(rows), len(self.quantities)), np.nan)
        for i, row in enumerate(rows):
            if row["status"] == OK:
                for k, quantity in enumerate(self.quantities):
                    values[i, k] = value_of(quantity, record_at(row, quantity))
        return values

    def run(
        self,
        changed: Sequence[tuple[str, Mapping[str, Any]]],
        starts: Sequence[int] | None = None,
    ) -> tuple[np.ndarray, str]:
        """Run the problem with changed numbers; return the values, and a sentence on failures.

        Each entry of `changed` is a name for the run and the new values of numbers by their
        names. `starts` are the seeds of disturbed starts, one for each entry; None for the
        problem's own start.

        The values are (changes, quantities), NaN in rows of runs that failed or were refused.
        The sentence says how many these are, and why the first of them failed; "" for none.
        """
        seeds: Sequence[int | None] = starts or [None] * len(changed)
        pairs = zip(changed, seeds, strict=True)
        to_run = [self._run_of(name, values, seed) for (name, values), seed in pairs]
        rows = self._rows(to_run)
        values = self.values(rows)
        failed = np.flatnonzero(np.isnan(values).any(axis=1)).tolist()
        if not failed:
            return values, ""
        first = failed[0]
        cause = rows[first]["cause"].splitlines() or ["a quantity has no value"]
        lost = f"{len(failed)} of {len(rows)} do not count; {changed[first][0]}: {cause[0]}"
        return values, lost

    def _run_of(self, name: str, values: Mapping[str, Any], seed: int | None) -> Run | dict:
        """What runs; a row with the reason if the values are not admissible together."""
        try:
            problem = self.study.problem.at(values, name)
        except InputError as error:
            return failure(REFUSED, error)
        arguments = {} if seed is None else {"disturbed": seed}
        return Run(problem, name, arguments=arguments)

    def input(
        self, inputs: Inputs, samples: int | None, seed: int
    ) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Return the uncertainty by the uncertain numbers, the parts of its square, and remarks.

        The uncertainty is (quantities,). If no number of `samples` is given and the first order
        holds for all quantities, it is √(gᵀ V g), and the parts of its square are
        (quantities, parameters). Else it is the standard deviation over samples, and the parts
        are empty, because samples do not give them.
        """
        no_shares = np.zeros((0, 0))
        remarks = list[str]()
        if not inputs.parameters:
            return np.zeros(len(self.quantities)), no_shares, remarks
        if samples is None:
            slopes = self._slopes(inputs)
            has_first_order = np.isfinite(slopes).all(axis=1)
            has_first_order &= self.first_order_holds(inputs, np.nan_to_num(slopes))
            if has_first_order.all():
                shares = slopes * (slopes @ inputs.covariance)  # their sums are gᵀ V g
                # correlations may make a sum that is 0 slightly negative, by round-off
                return np.sqrt(np.maximum(shares.sum(axis=1), 0.0)), shares, remarks
            without_first_order = np.flatnonzero(~has_first_order).tolist()
            names = ", ".join(self.quantities[i].text for i in without_first_order)
            remarks.append(f"The first order does not hold for {names}: samples take its place.")
        drawn_samples = inputs.samples(samples or SAMPLES, seed)
        changed = [(f"sample {i}", sample) for i, sample in enumerate(drawn_samples, start=1)]
        values, lost = self.run(changed)
        if lost:
            remarks.append(f"Samples: {lost}")
        return spread(values), no_shares, remarks

    def _slopes(self, inputs: Inputs) -> np.ndarray:
        """(quantities, parameters) derivatives."""
        scale_of_zeros = {p.name: p.width for p in inputs.parameters if not p.value}
        asked = [quantity.function or quantity.text for quantity in self.quantities]
        answer = sensitivity(self.study, inputs.names, asked, scale=scale_of_zeros)
        return np.atleast_2d(answer.derivative)

    def first_order_holds(self, inputs: Inputs, slopes: np.ndarray) -> np.ndarray:
        """Return for each quantity whether it changes in proportion to the uncertain numbers.

        `slopes` (q, k) are its derivatives by the numbers. Two runs show it: their numbers are
        changed by one standard deviation, in opposite directions. The first order holds where
        both runs are off the straight line by at most `PART_OFF_FIRST_ORDER` of the uncertainty.
        It does not hold where a run fails.
        """
        change = probing_change(slopes, inputs.covariance)
        middle, above, below = (inputs.moved(sign * change) for sign in (0.0, 1.0, -1.0))
        probes = {"the problem": middle, "probing sample, +": above, "probing sample, -": below}
        changed = [
            (name, dict(zip(inputs.names, numbers.tolist(), strict=True)))
            for name, numbers in probes.items()
        ]
        (values, values_above, values_below), _ = self.run(changed)
        off_above = abs(values_above - values - slopes @ (above - middle))
        off_below = abs(values_below - values - slopes @ (below - middle))
        u = standard_uncertainty(slopes, inputs.covariance)
        allowed = PART_OFF_FIRST_ORDER * u + PART_LEFT_BY_SOLVER * abs(values)
        # False where a value is NaN
        return np.asarray(np.maximum(off_above, off_below) <= allowed)

    def slack(self, u: float) -> np.ndarray:
        """(quantities,) uncertainty by a slack with the standard uncertainty `u` [m].

        It is half of the difference of the values with u more and u less slack. A slack moves
        the place of a quantity such as "reaction.grip.x at grip.x = 10 mm", and nothing else.
        """
        ends = []
        for change in (-u, u):
            moved = [replace(q, slack=q.slack + change * bool(q.place)) for q in self.quantities]
            (values,), _ = replace(self, quantities=moved).run([("the problem", {})])
            ends.append(values)
        return np.asarray(abs(ends[1] - ends[0]) / 2)

    def starts(self, count: int, seed: int) -> tuple[np.ndarray | float, list[str]]:
        """The uncertainty by disturbed starts, and what was lost."""
        if not count:
            return 0.0, []
        numbers = [seed + i for i in range(1, count + 1)]
        values, lost = self.run([(f"start {number}", {}) for number in numbers], numbers)
        remarks = [f"Disturbed starts: {lost}"] if lost else []
        return spread(values), remarks

    def ends_of_friction(self, laid: np.ndarray) -> list[str]:
        """Return a sentence with the quantities of the cloth that is laid and that is shaken.

        With friction inside the fabric an equilibrium depends on how the cloth came there: these
        are its two ends. `laid` (q,) are the values of the problem as it is. Of other problems
        the list is empty. If the shaken cloth fails, the sentence says why.
        """
        problem = self.study.problem
        has_ends = "friction" in problem.tables.get("equilibrium", {})
        terms = problem.first.system.terms
        if not (has_ends and any(isinstance(term, BendingFriction) for term in terms)):
            return []
        (shaken,), lost = self.run([("shaken", {"equilibrium.friction": "shaken"})])
        pairs = zip(self.quantities, laid, shaken, strict=True)
        words = [f"{q.text} {a:.4g} laid, {b:.4g} shaken" for q, a, b in pairs]
        return [f"Both ends of the friction inside the fabric: {lost or '; '.join(words)}."]


def standard_uncertainty(slopes: np.ndarray, V: np.ndarray) -> np.ndarray:
    """(q,) √(gᵀ V g) of each row g of the slopes (q, k)."""
    squares = np.einsum("qi,ij,qj->q", slopes, V, slopes)
    return np.sqrt(np.maximum(squares, 0.0))  # round-off may make a zero negative


def probing_change(slopes: np.ndarray, V: np.ndarray) -> np.ndarray:
    """(k,) a change of numbers by one standard deviation that moves all quantities."""
    u = standard_uncertainty(slopes, V)
    # where correlated numbers cancel, what is left is the round-off of the slopes
    is_moved = u > ROUND_OFF_OF_SLOPES * abs(slopes) @ np.sqrt(np.diag(V))
    rows = slopes[is_moved] / u[is_moved, None]
    if not len(rows):  # as where a sheet is about to buckle
        return np.asarray(np.sqrt(np.diag(V)))
    rows *= np.where(rows @ V @ rows[0] < 0, -1.0, 1.0)[:, None]  # so that no two cancel
    gradient = rows.sum(axis=0)
    return np.asarray(V @ gradient / np.sqrt(gradient @ V @ gradient))


def spread(values: np.ndarray) -> np.ndarray:
    """(quantities,) standard deviation of (rows, quantities); NaN of less than two values."""
    known = values[~np.isnan(values).any(axis=1)]
    if len(known) < 2:
        return np.full(values.shape[1], np.nan)
    return np.asarray(known.std(axis=0, ddof=1))
