"""`budget`: what a computed quantity is worth beside a measured one."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import value_of
from fecloth.study import run_problems
from fecloth.study.budgeting.inputs import Inputs, read_inputs, read_measured
from fecloth.study.budgeting.result import Budget, make_budget
from fecloth.study.change import AS_IS, FIRST, Change
from fecloth.study.command import StudyFailed
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import grouped
from fecloth.study.problem import Asked
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.refinement import levels_to_run, summarise
from fecloth.study.sensitivities import sensitivity
from fecloth.study.status import OK, REFUSED
from fecloth.study.uncertainty import UNSAFE
from fecloth.terms import BendingFriction
from fecloth.validation import known as known_name
from fecloth.validation import whole

LEVELS = 3
SAMPLES = 64  # where the first order does not hold
HOLDS = 0.25  # of the uncertainty: how far a probing sample may lie from the first order
NOTHING = 1e-6  # of a quantity: what its solver may leave


def budget(
    problem: Scene | str | Path | Callable | Opened,
    uncertain: Mapping[str, Any] | None = None,
    measured: Mapping[str, Any] | None = None,
    quantity: Asked | Sequence[Asked] | None = None,
    *,
    samples: int | None = None,
    seed: int = 0,
    **shared: Any,
) -> Budget:
    """Add up how uncertain computed quantities are, and compare them with measured ones.

    Of each quantity these are standard uncertainties u:

        total² = time² + space² + solver² + input² + start² + data²

    time, space and solver are halves of the uncertainties that `converge` gives with 3 levels
    of h, which cover; so `value` belongs to the finest level. input² = gᵀ V g with the
    derivatives g of `sensitivity` by the uncertain numbers, and their covariance V: the first
    order. Two runs, one standard deviation away on both sides, show whether it holds; where it
    does not, as where a cloth buckles, samples take its place, and their standard deviation is
    the uncertainty. start is the standard deviation over disturbed starts. With a measured
    value D, whose uncertainty is data, `difference` = value − D, and they agree where
    |difference| ≤ 2 total; otherwise the model, its law or the experiment is wrong.

    Parameters
    ----------
    problem
        As for `fecloth.study.of`.
    uncertain
        Standard uncertainties by the names of numbers, as for `sensitivity`: a percentage as
        "10 %", a number in SI or, of a scene, a text with a unit; ``"start": 5`` for five
        disturbed starts. The numbers of a fabric have theirs from its [fabric.uncertainty],
        with correlations; entries here replace them. By default the table [uncertain] of a
        scene.
    measured
        (value, standard uncertainty) by quantity. By default the table [measured] of a scene.
    quantity
        One, or a list; by default all of [interest], else what was measured. They must be
        numbers, no fields or paths.
    samples
        Number of samples; None: the first order where it holds, else 64. Constants of fabrics
        that must be positive have a logarithmic normal distribution, other numbers a normal
        one.
    seed
        Of samples and disturbed starts.
    shared
        Arguments of `fecloth.study.of`, as h, dt, probes, jobs and cache.

    Returns
    -------
    Budget
        With value, time, space, solver, input, start, data, total, difference and agrees:
        numbers of a single quantity, else arrays. `difference` is NaN where nothing was
        measured.

    Raises
    ------
    InputError
        For a key that is no number of the problem, a wrong uncertainty, a quantity that is no
        number, a measured quantity that is not among the quantities, or too long a time.
    StudyFailed
        If the problem itself fails on a level.

    Notes
    -----
    Source: ASME V&V 20-2009, Standard for Verification and Validation in Computational Fluid
    Dynamics and Heat Transfer: E = S − D and u_val² = u_num² + u_input² + u_D².
    """
    study = open_study(problem, shared)
    opened = study.problem
    runs = study.runs()
    opened.check("h")
    whole("samples", SAMPLES if samples is None else samples, 2, "budget")
    whole("seed", seed, 0, "budget")
    tables = opened.tables if isinstance(opened, SceneProblem) else {}
    inputs = read_inputs(opened, tables.get("uncertain") or {} if uncertain is None else uncertain)
    data = read_measured(tables.get("measured") or {} if measured is None else measured)
    single = isinstance(quantity, str | Quantity) or callable(quantity)
    asked: Any = [quantity] if single else quantity or opened.interest or list(data) or None
    chosen = opened.choose_quantities(asked)
    _refuse_fields(opened, chosen)
    texts = dict.fromkeys(q.text for q in (*chosen, *opened.quantities))
    for name in data:
        known_name(f"measured {name!r} (it is not in [interest])", name, texts, "budget")
    run_problems.refuse_huge(opened, runs)
    warned = run_problems.print_warnings(opened)
    work = Work(study, opened, chosen, runs)
    known, base = work.numerical()
    known["input"], shares, remarks = work.input(inputs, samples, seed)
    known["start"], lost = work.starts(inputs.starts, seed)
    made = make_budget(opened, chosen, known, data, inputs.names, shares, single)
    remarks = [*work.ends_of_friction(base), *remarks, *lost]
    return replace(made, doubts=warned, remarks=tuple(remarks))


def tolerance_of_data(study: Opened, quantity: Any) -> float:
    """A third of input uncertainties over their quantities, the least: what the data deserve.

    Raises `InputError` for a problem without uncertain numbers.
    """
    opened = study.problem
    tables = opened.tables if isinstance(opened, SceneProblem) else {}
    inputs = read_inputs(opened, tables.get("uncertain") or {})
    if not inputs.parameters:
        what = "--to-data"
        allowed = "needs numbers in [uncertain] or [fabric.uncertainty]"
        raise InputError(what, allowed, opened.source)
    work = Work(study, opened, opened.choose_quantities(quantity), study.runs())
    values = np.abs(work.run([("the problem", {})])[0][0])
    return float((work.input(inputs, None, 0)[0] / (3 * values)).min())


def _refuse_fields(opened: Problem, chosen: Sequence[Quantity]) -> None:
    row = opened.first.recording(q.column for q in chosen).row()
    for q in chosen:
        is_vector = q.how == "value" and f"{q.column}.x" in row
        if q.is_field or q.how == "path" or is_vector:
            if not q.is_field:
                remedy = f"Take a component, as {q.name}.z."
            else:
                remedy = "Take sag, say."
            raise InputError(f"quantity {q.text}", "must be a number", "budget", remedy)


@dataclass(frozen=True, eq=False)
class Work:
    """The runs of a budget."""

    study: Opened
    problem: Problem
    quantities: Sequence[Quantity]
    runs: run_problems.Runs

    def numerical(self) -> tuple[dict[str, Any], np.ndarray]:
        """Values and uncertainties of mesh, step and solver, and the values of the first level."""
        opened = self.problem
        cases = levels_to_run(opened, self.quantities[0], "h", LEVELS, None)
        work = opened.workload
        point = run_problems.Point
        points = [point(opened, case, str(case), work(case)) for case in cases]
        run_problems.check_points(points, self.runs)
        rows = run_problems.run_points(points, self.quantities, self.runs)
        columns: list[list[float]] = []
        if all(row["status"] == OK for row in rows[LEVELS:]):
            missing = 0.0
        else:
            missing = np.nan
        for quantity in self.quantities:
            study = summarise(opened, quantity, "h", rows[:LEVELS], rows[LEVELS:])
            if study.estimate is None:
                raise StudyFailed(f"{opened.source}: {study.verdict}")
            shares = study.shares.get
            others = [UNSAFE * shares(name, missing) for name in ("gap", "time step", "solver")]
            space = float(np.hypot(study.estimate.uncertainty, others[0]))
            columns.append([study.value, *(0.5 * u for u in (space, *others[1:]))])
        named = zip(("value", "space", "time", "solver"), np.array(columns).T, strict=True)
        return dict(named), self.values(rows[:1])[0]

    def values(self, rows: Sequence[Mapping]) -> np.ndarray:
        """(rows, quantities) values; NaN of a run that failed."""
        values = np.full((len(rows), len(self.quantities)), np.nan)
        for each, row in zip(values, rows, strict=True):
            if row["status"] == OK:
                each[:] = [value_of(q, run_problems.record_at(row, q)) for q in self.quantities]
        return values

    def run(
        self, changed: Sequence[tuple[str, Mapping[str, Any]]], starts: Sequence[int] | None = None
    ) -> tuple[np.ndarray, str]:
        """(changes, quantities) values with changed numbers, and a sentence on what was lost."""
        size = self.problem.workload(FIRST)
        points = list[Any]()
        seeds: Sequence[int | None] = starts or [None] * len(changed)
        for (name, values), seed in zip(changed, seeds, strict=True):
            try:
                given = json.loads(json.dumps(grouped(self.problem, values), default=list))
                problem = self.problem.changed(Change(values=given))
                points.append(run_problems.Point(problem, AS_IS, name, size, disturbed=seed))
            except InputError as error:  # as constants that are not admissible together
                points.append({"status": REFUSED, "cause": str(error)})
        if able := [point for point in points if isinstance(point, run_problems.Point)]:
            run_problems.check_points(able, self.runs)
        rows = run_problems.run_or_skip(points, self.quantities, self.runs)
        found = self.values(rows)
        bad = np.flatnonzero(np.isnan(found).any(axis=1)).tolist()
        if not bad:
            return found, ""
        cause = rows[bad[0]]["cause"].splitlines() or ["a quantity has no value"]
        return found, f"{len(bad)} of {len(rows)} do not count; {changed[bad[0]][0]}: {cause[0]}"

    def input(
        self, inputs: Inputs, samples: int | None, seed: int
    ) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """The uncertainty by the uncertain numbers, the parts of its square, and in words how."""
        # The parts (quantities, parameters) are known by the first order alone.
        none = np.zeros((0, 0))
        remarks = list[str]()
        if not inputs.parameters:
            return np.zeros(len(self.quantities)), none, remarks
        if samples is None:
            zeros = {p.name: p.width for p in inputs.parameters if not p.value}
            asked = [q.function or q.text for q in self.quantities]
            answer = sensitivity(self.study, inputs.names, asked, scale=zeros)
            slopes = np.atleast_2d(answer.derivative)
            bad = ~np.isfinite(slopes).all(axis=1)
            bad |= ~self.first_order_holds(inputs, np.nan_to_num(slopes))
            if not bad.any():
                shares = slopes * (slopes @ inputs.covariance)
                return np.sqrt(np.maximum(shares.sum(axis=1), 0.0)), shares, remarks
            names = ", ".join(self.quantities[int(i)].text for i in np.flatnonzero(bad))
            remarks.append(f"The first order does not hold for {names}: samples take its place.")
        drawn = inputs.samples(samples or SAMPLES, seed)
        values, lost = self.run([(f"sample {i + 1}", each) for i, each in enumerate(drawn)])
        return spread(values), none, [*remarks, *([f"Samples: {lost}"] if lost else [])]

    def first_order_holds(self, inputs: Inputs, slopes: np.ndarray) -> np.ndarray:
        """(quantities,) whether two runs on both sides lie where the first order puts them."""
        d = probing_change(slopes, inputs.covariance)
        middle = np.array([p.value for p in inputs.parameters])
        words = {"the problem": middle, "probing sample, +": middle + d}
        words["probing sample, -"] = middle - d
        tables = [dict(zip(inputs.names, x.tolist(), strict=True)) for x in words.values()]
        (base, plus, minus), _ = self.run(list(zip(words, tables, strict=True)))
        off = np.maximum(abs(plus - base - slopes @ d), abs(minus - base + slopes @ d))
        u = np.sqrt(np.einsum("qi,ij,qj->q", slopes, inputs.covariance, slopes))
        return np.asarray(off <= HOLDS * u + NOTHING * abs(base))  # NaN does not

    def starts(self, count: int, seed: int) -> tuple[np.ndarray | float, list[str]]:
        """The uncertainty by disturbed starts, and what was lost."""
        if not count:
            return 0.0, []
        numbers = [seed + i for i in range(1, count + 1)]
        values, lost = self.run([(f"start {n}", {}) for n in numbers], numbers)
        return spread(values), [f"Disturbed starts: {lost}"] if lost else []

    def ends_of_friction(self, laid: np.ndarray) -> list[str]:
        """A sentence on the cloth that is shaken, beside the cloth that is laid."""
        problem = self.problem
        is_static = isinstance(problem, SceneProblem) and problem.scene.equilibrium
        terms = problem.first.system.terms if is_static else ()
        if not any(isinstance(term, BendingFriction) for term in terms):
            return []
        (values,), lost = self.run([("shaken", {"equilibrium.friction": "shaken"})])
        pairs = zip(self.quantities, laid, values, strict=True)
        words = [f"{q.text} {a:.4g} laid, {b:.4g} shaken" for q, a, b in pairs]
        return [f"Both ends of the friction inside the fabric: {lost or '; '.join(words)}."]


def probing_change(slopes: np.ndarray, V: np.ndarray) -> np.ndarray:
    """(k,) a change of numbers by one standard deviation that moves all quantities."""
    u = np.sqrt(np.einsum("qi,ij,qj->q", slopes, V, slopes))
    rows = slopes[u > 0] / u[u > 0, None]
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
