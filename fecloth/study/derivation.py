"""Run a problem, and beside it the derivatives of what is recorded by its parameters."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fecloth.integrators.derivatives import DerivedStep, StepTangents, derive_step
from fecloth.integrators.protocol import chooses_method, has_symmetric_matrix, method_of
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.increment_derivatives import StaticTangent, derive_increment
from fecloth.nonlinear.increments import LoadIncrement, SolvedIncrement
from fecloth.simulation.derived_loads import DerivedLoads
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.equilibrium import Equilibrium, equilibrium
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.run import columns
from fecloth.simulation.setup import Setup
from fecloth.simulation.steps import StepInfo
from fecloth.study.parameters import Parameter
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import records
from fecloth.terms.traits import parameters_of

SMALL = 1e-5  # of the edge length, or of a gap: how far nodes are moved for differences
REST = 0.05  # times the tolerance of a step: the tolerance of an equilibrium
SHARPEST = 1e-8  # the tolerance of an equilibrium that round-off allows
POLISHED = 2  # Newton steps after an equilibrium was found
LARGEST, LEAST = 1e-4, 1e-9  # change of a parameter for differences, over its width

Row = dict[str, float]


@dataclass(frozen=True, eq=False)
class Recorded:
    """What is derived of a run: rows of each step or of both ends, and whether with the ledger."""

    whole: bool
    flows: bool  # whether dissipation and work are among what is asked for
    only_start: bool = False  # whether nothing runs


@dataclass(eq=False)
class Follower:
    """Follows the derivatives by a parameter over its width along a run."""

    parameter: Parameter
    setup_at: Callable[[float], Setup]  # of a value of the parameter
    base: Setup
    recorded: Recorded
    both: dict[float, list[Setup]] = field(default_factory=dict)  # at p + size and p − size
    start: Along = field(init=False)
    along: Along = field(init=False)  # now, and in the end
    rows: list[Row] = field(default_factory=list)
    flows: Any = None  # slopes of the ledger

    def __post_init__(self) -> None:
        plus, minus = self._setups(LARGEST)
        history = plus.system.start_history(plus.start), minus.system.start_history(minus.start)
        pairs = (None, None), history
        self.start = Along.between(plus.start, minus.start, 2 * LARGEST, *pairs)
        self.along = self.start
        self.flows = records.slope(plus.ledger, minus.ledger, 2 * LARGEST)
        self._add([plus.row(), minus.row()], LARGEST)

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Column → (s + 1,) derivatives of what the run recorded, when it has ended."""
        return columns(self.rows)

    def size(self, dt: float) -> float:
        """ε, a power of ten: so small that nodes move little, so large that they move at all."""
        far = self.along.longest(dt)
        wanted = SMALL * shortest_length(self.base) / far if far else LARGEST
        return float(10.0 ** math.floor(math.log10(min(max(wanted, LEAST), LARGEST)) + 1e-9))

    def sides(self, size: float = LARGEST) -> Sides:
        plus, minus = self._setups(size)
        return Sides(plus.system, minus.system, size)

    def _setups(self, size: float) -> list[Setup]:
        if size not in self.both:
            values = self.parameter.at(size), self.parameter.at(-size)
            self.both[size] = [self.setup_at(value).probed_as(self.base) for value in values]
        return self.both[size]

    def follow(
        self, info: StepInfo, derive: Callable[[Along, Sides], DerivedStep], ledger: Ledger,
        method: Any, is_last: bool,
    ) -> None:  # fmt: skip
        """Go on to the end of a step; `ledger` is at its begin."""
        size = self.size(info.size)
        sides = self.sides(size)
        derived = derive(self.along, sides)
        if self.recorded.whole or is_last:
            self._record(info, derived, sides, ledger, method)
        self.along = derived.end

    def _record(self, info, derived: DerivedStep, sides: Sides, ledger: Ledger, method) -> None:
        rows = []
        ledgers = []
        both = zip(self._setups(sides.size), sides.signed, derived.steps, strict=True)
        for setup, (system, size), step in both:
            old = self.along.shift(info.old, size)
            if self.recorded.flows:
                before = records.shift(ledger, self.flows, size)
                ledgers.append(before.after(system, method, old, step))
            else:
                around = system.with_history(step.history)
                ledgers.append(Ledger.open(around, step.state))
            rows.append(ledgers[-1].row() | setup.observer.row(old, step))
        self.flows = records.slope(ledgers[0], ledgers[1], 2 * sides.size)
        self._add(rows, sides.size)

    def rest(self, states: Sequence[State], sides: Sides) -> None:
        """Record the row of an equilibrium."""
        both = zip(self._setups(sides.size), states, strict=True)
        self._add([setup.row(state) for setup, state in both], sides.size)

    def _add(self, rows: Sequence[Row], size: float) -> None:
        """Add the slopes of the rows at p + size and p − size."""
        plus, minus = rows
        self.rows.append({name: (plus[name] - minus[name]) / (2 * size) for name in plus})


@dataclass(frozen=True, eq=False)
class Derivation:
    """A run, and the derivatives of what it recorded by each parameter."""

    result: Any  # the `Result`, or the `Equilibrium`
    times: np.ndarray  # (s + 1,) [s]
    columns: Mapping[str, np.ndarray]  # column → (s + 1,)
    followers: Sequence[Follower]  # of each parameter
    sizes: tuple[float, ...] = ()  # the steps [s]
    method: str = ""  # the name of the method that `Auto` chose, or ""
    why: str = ""  # how the steps were chosen, or ""


def shortest_length(setup: Setup) -> float:
    """The shortest edge of a right triangle of the mean area, or the least gap [m]."""
    cloth = setup.cloth
    gaps = [float(gap) for term in setup.system.terms if (gap := parameters_of(term).get("gap"))]
    return min([math.sqrt(cloth.area / len(cloth.triangles)), *gaps])


def derive_run(
    setup: Setup,
    parameters: Sequence[Parameter],
    setup_at: Callable[[Parameter, float], Setup],
    recorded: Recorded,
    tolerance: float,
    report: Callable[..., None] = lambda *_: None,
) -> Derivation:
    """Run a setup, and follow the derivatives by the parameters.

    `setup_at` is the setup with another value of a parameter. `tolerance` is the relative error
    of a derivative over a step.
    """
    followers = [Follower(p, partial(setup_at, p), setup, recorded) for p in parameters]
    if recorded.only_start:
        return Derivation(setup.start, np.array([setup.start.t]), {}, followers)
    if setup.t_end is None:
        return _derive_rest(setup, followers, max(REST * tolerance, SHARPEST), report)
    return _derive_motion(setup, followers, recorded, tolerance, report)


def _derive_motion(
    setup: Setup,
    followers: Sequence[Follower],
    recorded: Recorded,
    tolerance: float,
    report: Callable[..., None],
) -> Derivation:
    system, t_end, (chosen, solver) = setup.system, setup.t_end, setup.choose()
    assert t_end is not None
    steps = chosen.steps
    method = method_of(steps)
    tangents = None
    if not (steps.traits.explicit or isinstance(steps, LoadSteps)):
        symmetric = has_symmetric_matrix(system, method)
        tangents = StepTangents(system, symmetric, solver[0], len(followers), tolerance)
    sizes = list[float]()

    def watch(states) -> Iterator:
        before = setup.ledger
        for state, info in states:
            sizes.append(info.size)
            loads = None
            if isinstance(steps, LoadSteps):
                loads = DerivedLoads.of(system, info.old, info.result)

            def derive(along: Along, sides: Sides, info=info, loads=loads) -> DerivedStep:
                if loads:
                    return loads.derive(along, sides)
                return derive_step(info.result, along, sides, tangents)

            is_last = state.t >= t_end - 1e-12 * abs(t_end)
            for each in followers:
                each.follow(info, derive, before, method, is_last)
            if recorded.flows:
                before = before.after(system, method, info.old, info.result)
            report(info)
            yield state, info

    result = chosen.run(solver, watch=watch)
    all_columns = {**result.energies, **result.observed}
    times = result.times
    if not recorded.whole:
        times = times[[0, -1]]
        all_columns = {name: values[[0, -1]] for name, values in all_columns.items()}
    stay = setup.steps.dt is None and not isinstance(steps, LoadSteps)
    why = "the steps that were chosen stay as they are" if stay else ""
    chosen_method = type(method).__name__ if chooses_method(setup.steps) else ""
    return Derivation(result, times, all_columns, followers, tuple(sizes), chosen_method, why)


def find_rest(
    system: System, start: State, report: Callable[..., None] = lambda *_: None
) -> Equilibrium:
    """The equilibrium as exactly as round-off allows: twin runs differ by little."""
    return _polish(equilibrium(system, start, report=report), _whole(system, start))[0]


def _whole(system: System, start: State) -> LoadIncrement:
    """All loads in one increment, as `equilibrium` takes them without load steps."""
    begin = State(start.t, start.x, np.zeros_like(start.x))
    history = system.start_history(begin)
    return LoadIncrement(system, begin, 1.0, 1.0, start.t, start.t, history)


def _polish(state: Equilibrium, whole: LoadIncrement) -> tuple[Equilibrium, StaticTangent]:
    """The equilibrium after a Newton step or two with K where it was found, and K there."""
    tangent = StaticTangent.at(SolvedIncrement(whole, state.x))
    x = state.x
    for _ in range(POLISHED):
        x = x - tangent.solve(whole.equation(x).residual(x, 0.0)[0])
    return replace(state, x=x), tangent


def _derive_rest(
    setup: Setup, followers: Sequence[Follower], tolerance: float, report: Callable[..., None]
) -> Derivation:
    system = setup.system
    start = setup.start
    whole = _whole(system, start)
    state, tangent = _polish(equilibrium(system, start, report=report), whole)
    solved = SolvedIncrement(whole, state.x)
    for each in followers:
        sides = each.sides()
        derived = derive_increment(solved, each.start, sides, tangent, tolerance)
        each.along = derived.end
        # The error of a central difference goes with the square of how far nodes move.
        if (LARGEST * each.along.longest() / shortest_length(setup)) ** 2 > tolerance:
            sides = each.sides(each.size(0.0))
            derived = derive_increment(solved, each.start, sides, tangent, tolerance)
            each.along = derived.end
        each.rest(derived.states, sides)
    rows = columns([setup.row(), setup.row(state)])
    return Derivation(state, np.array([start.t, state.t]), rows, followers)
