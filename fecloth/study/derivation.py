"""Run a problem, and beside it the derivatives of what is recorded by its parameters."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fecloth.integrators.derivatives import DerivedStep, StepTangents, derive_step
from fecloth.integrators.protocol import chooses_method, has_symmetric_matrix, method_of
from fecloth.integrators.step import Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.linearised import NoDerivative
from fecloth.simulation.derived_loads import DerivedLoads
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.equilibrium import equilibrium
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.run import columns
from fecloth.simulation.setup import Setup
from fecloth.study.parameters import Parameter
from fecloth.system.pins import Pin
from fecloth.system.state import State
from fecloth.terms import records
from fecloth.terms.traits import parameters_of

# How far nodes are moved for central differences, over the edge length or a gap: little against
# both, and far above the round-off of positions.
MOVED_NODES = 1e-5
# The tolerance of the derivative of an equilibrium: a part of the tolerance of a step, but not
# less than round-off allows.
REST_TOLERANCE = 0.05
LEAST_REST_TOLERANCE = 1e-8
# The change of a parameter for central differences, over its width.
LARGEST_CHANGE = 1e-4
LEAST_CHANGE = 1e-9

Row = dict[str, float]


@dataclass(frozen=True, eq=False)
class Recorded:
    """Which rows of a run are derived.

    Attributes
    ----------
    whole
        Whether the rows of the start and of each step, not only of the end.
    flows
        Whether dissipation and work are among the columns, for which the ledger is derived.
    only_start
        Whether the start is enough, so that nothing runs.
    """

    whole: bool
    flows: bool
    only_start: bool = False


@dataclass(eq=False)
class Follower:
    """Follows the derivatives by a parameter over its width along a run.

    Attributes
    ----------
    parameter
        The parameter p.
    setup_at
        Makes the setup with a value of the parameter.
    base
        The setup that runs.
    recorded
        Which rows are derived.
    farthest
        How far a difference may move nodes, over the edge length or a gap: its relative error
        is about the square.
    setups_by_size
        The setups at p + size and p − size, by the size.
    start
        Derivatives of the start.
    along
        Derivatives of the state now, and in the end.
    rows
        Derivatives of the rows that the run has recorded.
    flows
        Derivatives of the ledger.
    """

    parameter: Parameter
    setup_at: Callable[[float], Setup]
    base: Setup
    recorded: Recorded
    farthest: float
    setups_by_size: dict[float, list[Setup]] = field(default_factory=dict)
    start: Along = field(init=False)
    along: Along = field(init=False)
    rows: list[Row] = field(default_factory=list)
    flows: Any = None

    def __post_init__(self) -> None:
        """Derive the start, and what is recorded there, by central differences."""
        larger, smaller = self._setups_at(LARGEST_CHANGE)
        width = 2 * LARGEST_CHANGE
        no_memories = (None, None)  # a method remembers nothing before its first step
        histories = (
            larger.system.start_history(larger.start),
            smaller.system.start_history(smaller.start),
        )
        self.start = Along.between(larger.start, smaller.start, width, no_memories, histories)
        self.along = self.start
        if self.recorded.flows:
            self.flows = records.slope(larger.ledger, smaller.ledger, width)
        if self.recorded.whole:
            self._add_row(larger.row(), smaller.row(), LARGEST_CHANGE)

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Column → derivatives of the rows that the run has recorded, after its end."""
        return columns(self.rows)

    def size(self, along: Along, dt: float) -> float:
        """Return ε, the change of the parameter for central differences, over its width.

        It is a power of ten by which nodes move little, but more than by round-off, so that the
        setups of a few changes serve all steps. `along` are derivatives that tell how far nodes
        move, and `dt` is the size of the step [s], over which velocities count, too.
        """
        wanted_size = LARGEST_CHANGE
        if moved := along.longest(dt):  # for a change of p by its width [m]
            wanted_size = MOVED_NODES * shortest_length(self.base) / moved
        size = min(max(wanted_size, LEAST_CHANGE), LARGEST_CHANGE)
        return float(10.0 ** math.floor(math.log10(size) + 1e-9))  # 1e-9 against round-off

    def sides(self, size: float = LARGEST_CHANGE, t: float = -math.inf) -> Sides:
        """Return the systems at p + size and p − size, with the pins that hold from t [s] on.

        Raises `NoDerivative` for a parameter that changes when a pin lets go.
        """
        larger, smaller = (setup.system for setup in self._setups_at(size))
        if larger.releases != self.base.system.releases:
            raise NoDerivative(f"{self.parameter.name} changes when a pin lets go")
        return Sides(larger.after(t), smaller.after(t), size)

    def _setups_at(self, size: float) -> list[Setup]:
        """Return the setups at p + size and p − size, which are made once."""
        if size not in self.setups_by_size:
            values = self.parameter.at(size), self.parameter.at(-size)
            setups = [self.setup_at(value).probed_as(self.base) for value in values]
            self.setups_by_size[size] = setups
        return self.setups_by_size[size]

    def follow(
        self,
        old: State,
        step: Step,
        derive: Callable[[Along, Sides], DerivedStep],
        is_last: bool,
        ledger: Ledger | None = None,
        method: Any = None,
    ) -> None:
        """Derive a step of the run: the state at its end and, if it is recorded, its row.

        Where nodes turn out to move farther than the differences allow, the step is derived
        again with a smaller change of the parameter.

        Parameters
        ----------
        old, step
            The state before the step, and the step.
        derive
            Derives the step from the derivatives at its begin.
        is_last
            Whether the run ends there.
        ledger, method
            The ledger at the begin of the step, and its method; for `recorded.flows` alone.
        """
        dt = step.state.t - old.t
        if old.t in self.base.system.releases:  # where a pin lets go the method begins anew
            self.along = replace(self.along, memory=None)
        sides = self.sides(self.size(self.along, dt), old.t)
        derived = derive(self.along, sides)
        moved = sides.size * derived.end.longest() / shortest_length(self.base)
        if moved > self.farthest:
            sides = self.sides(self.size(derived.end, dt), old.t)
            derived = derive(self.along, sides)
        if self.recorded.whole or is_last:
            self._record(old, derived, sides, ledger, method)
        self.along = derived.end

    def _record(self, old: State, derived: DerivedStep, sides: Sides, ledger, method) -> None:
        """Add the derivatives of the row at the end of a step, and derive the ledger there.

        Both are central differences between the steps at p + ε and p − ε, which `derived` has.
        For the arguments `old`, `ledger` and `method` see `follow`; `sides` are the systems at
        p ± ε.
        """
        rows = []
        ledgers = []
        both_sides = zip(self._setups_at(sides.size), sides.signed, derived.steps, strict=True)
        for setup, (system, signed_size), step in both_sides:
            old_there = self.along.shift(old, signed_size)
            if self.recorded.flows:
                ledger_before = records.shift(ledger, self.flows, signed_size)
                ledgers.append(ledger_before.after(system, method, old_there, step))
            else:  # only energies are among the columns: a ledger that begins here has them
                at_end = system.with_history(step.history)
                ledgers.append(Ledger.open(at_end, step.state))
            rows.append(ledgers[-1].row() | setup.observer.row(old_there, step, system))
        self.flows = records.slope(ledgers[0], ledgers[1], 2 * sides.size)
        self._add_row(rows[0], rows[1], sides.size)

    def _add_row(self, larger_row: Row, smaller_row: Row, size: float) -> None:
        """Add the derivatives from the rows at p + size and p − size."""
        self.rows.append(
            {name: (larger_row[name] - smaller_row[name]) / (2 * size) for name in larger_row}
        )


@dataclass(frozen=True, eq=False)
class Derivation:
    """A run, and the derivatives of what it recorded by each parameter.

    Attributes
    ----------
    result
        The `Result`, or the `Equilibrium`.
    times
        Times of the rows that are derived [s].
    columns
        Column → values of these rows.
    followers
        The derivatives by each parameter.
    sizes
        The steps of the run [s].
    method
        The name of the method that `Auto` chose; "" for another method.
    why
        A sentence on steps that were chosen; "" for others.
    """

    result: Any
    times: np.ndarray
    columns: Mapping[str, np.ndarray]
    followers: Sequence[Follower]
    sizes: tuple[float, ...] = ()
    method: str = ""
    why: str = ""


def shortest_length(setup: Setup) -> float:
    """Return √(mean area of a triangle), or the least gap of contact if that is smaller [m]."""
    cloth = setup.cloth
    lengths = [math.sqrt(cloth.area / len(cloth.triangles))]
    for term in setup.system.terms:
        if gap := parameters_of(term).get("gap"):
            lengths.append(float(gap))
    return min(lengths)


def derive_run(
    setup: Setup,
    parameters: Sequence[Parameter],
    setup_at: Callable[[Parameter, float], Setup],
    recorded: Recorded,
    tolerance: float,
    report: Callable[..., None] = lambda *_: None,
) -> Derivation:
    """Run a setup, and find the derivatives of what it records by each parameter.

    A setup without `t_end` is run to its equilibrium. With `recorded.only_start` nothing runs,
    and only the start is derived.

    Parameters
    ----------
    setup_at
        Makes the setup with another value of a parameter.
    recorded
        Which rows are derived.
    tolerance
        Relative error of a derivative over a step.
    report
        Is called after each step or iteration.
    """
    if setup.t_end is None:  # an equilibrium has no ledger of a run
        recorded = replace(recorded, flows=False)
    rest_tolerance = max(REST_TOLERANCE * tolerance, LEAST_REST_TOLERANCE)
    farthest = math.sqrt(rest_tolerance)
    followers = [Follower(p, partial(setup_at, p), setup, recorded, farthest) for p in parameters]
    if recorded.only_start:
        return Derivation(setup.start, np.array([setup.start.t]), {}, followers)
    if setup.t_end is None:
        return _derive_rest(setup, followers, recorded, rest_tolerance, report)
    return _derive_motion(setup, followers, recorded, tolerance, rest_tolerance, report)


def _derive_motion(
    setup: Setup,
    followers: Sequence[Follower],
    recorded: Recorded,
    tolerance: float,
    rest_tolerance: float,
    report: Callable[..., None],
) -> Derivation:
    """Run a setup over time or load steps, and derive each step when it is done.

    Parameters
    ----------
    followers
        The derivatives by each parameter, at the start; they follow the run.
    recorded
        Which rows are derived.
    tolerance, rest_tolerance
        Relative error of a derivative over a step, and over a load step.
    report
        Is called after each step.
    """
    t_end = setup.t_end
    assert t_end is not None
    # the setup with the steps that are taken, also of `Auto`; `solver` is the pair of the solver
    # of the steps and the reason for it
    simulation, solver = setup.choose()
    steps = simulation.steps
    method = method_of(steps)
    if recorded.flows and _clamp_lets_go(setup, t_end):
        raise NoDerivative("of energies there is none where a clamped pin lets go")
    sizes = list[float]()

    def watch(states) -> Iterator:
        """Pass on each state of the run when its step has been derived."""
        ledger = setup.ledger  # at the begin of the step
        system = setup.system
        tangents = None  # explicit steps solve no equation, load steps have their own tangent
        solves = not (steps.traits.explicit or isinstance(steps, LoadSteps))
        for state, info in states:
            sizes.append(info.size)
            has_let_go = system is not system.after(info.old.t)
            system = system.after(info.old.t)
            if solves and (tangents is None or has_let_go):
                symmetric = has_symmetric_matrix(system, method)
                tangents = StepTangents(system, symmetric, solver[0], tolerance)
            if isinstance(steps, LoadSteps):
                derive = DerivedLoads.of(system, info.old, info.result, rest_tolerance).derive
            else:
                derive = partial(derive_step, info.result, tangents=tangents)
            is_last = state.t >= t_end - 1e-12 * abs(t_end)  # times have round-off
            for follower in followers:
                follower.follow(info.old, info.result, derive, is_last, ledger, method)
            if recorded.flows:
                ledger = ledger.after(system, method, info.old, info.result)
            report(info)
            yield state, info

    result = simulation.run(solver, watch=watch)
    derived_rows = slice(None) if recorded.whole else slice(-1, None)
    all_columns = {**result.energies, **result.observed}
    derived_columns = {name: values[derived_rows] for name, values in all_columns.items()}
    chosen_method = ""
    if chooses_method(setup.steps):
        chosen_method = type(method).__name__
    why = ""
    if setup.steps.dt is None and not isinstance(steps, LoadSteps):
        why = "the steps that were chosen stay as they are"
    return Derivation(
        result=result,
        times=result.times[derived_rows],
        columns=derived_columns,
        followers=followers,
        sizes=tuple(sizes),
        method=chosen_method,
        why=why,
    )


def _clamp_lets_go(setup: Setup, t_end: float) -> bool:
    """Return whether a clamped pin lets go within the run of a setup, which ends at t_end [s]."""
    return any(
        pin.clamp and pin.until is not None and setup.start.t < pin.until < t_end
        for pin in setup.system.pins
        if isinstance(pin, Pin)
    )


def _derive_rest(
    setup: Setup,
    followers: Sequence[Follower],
    recorded: Recorded,
    tolerance: float,
    report: Callable[..., None],
) -> Derivation:
    """Find the equilibrium of a setup, and derive it as a single load step.

    The arguments are as for `_derive_motion`; `report` is called after each iteration.
    """
    start = setup.start
    rest = equilibrium(setup.system, start, report=report)
    loads = DerivedLoads.at_rest(setup.system, start, rest, tolerance)
    step = loads.step
    for follower in followers:
        follower.follow(start, step, loads.derive, is_last=True)
    rows = [setup.row(step.state)]
    if recorded.whole:
        rows.insert(0, setup.row())
    return Derivation(step.state, np.full(len(rows), start.t), columns(rows), followers)
