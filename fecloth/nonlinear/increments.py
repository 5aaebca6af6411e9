"""Increments of the loads: from one equilibrium to the next one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from fecloth.errors import amount
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import admit, has_limits
from fecloth.nonlinear.error_left import PLACE, ErrorInPlace
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.progress import Progress
from fecloth.nonlinear.static_equation import EquilibriumFailed, StaticEquation
from fecloth.nonlinear.statistics import Counts
from fecloth.system.carried import carry
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.step_difference import Increment, StepDifference
from fecloth.terms.traits import traits_of

FAR = 10.0  # extents of the cloth: a mean displacement beyond this means that no pin holds it
QUICK = 8  # iterations after which a load increment may grow again
SMALLEST = 1 / 64  # of the first load increment
NO_MEMBRANE = "No membrane resists a stretch: add StVK, and pin the cloth."
LAGGED = 1e-6  # of the forces: the error of friction whose normal forces belong to the pass before
FIRST_PASS = 4  # iterations with the first normal forces; twice as many with each of the next ones
PASSES = 40  # of an increment: how often the normal forces of friction are taken anew
SHAKEN = tuple(np.linspace(0.9, 0.0, 10))  # of the friction inside the fabric, when it is shaken
MANY = 4  # times `max_iterations`: the most iterations of all passes of an increment


@dataclass(frozen=True)
class Iteration:
    """Figures of one Newton iteration."""

    number: int  # counted from 1
    residual: float  # ‖f‖ of the free directions after it, relative to Σ ‖f_term‖ of all directions
    shift: float  # σ of its tangent K + σ M [1/s²]; 0 is the exact tangent
    length: float  # fraction of Newton's step; more than 1 where the potential is concave along it
    load: float = 1.0  # factor on the loads


Report = Callable[[Iteration], None]


def static_context(
    system: System, tolerance: float | Literal["auto"], max_iterations: int, solver: str
) -> SolverContext:
    """Return the direct solver with its matrix, and Newton's options, for `solve_static`."""
    options = Newton(tolerance, max_iterations, forcing=1e-8, reuse=False)
    over = resist_disturbances(system, system.rest(), 1.0)
    linear, matrix, _ = system.linear_solver(solver, over.symmetric)
    return SolverContext(linear, matrix, options)


class SolvedIncrement(NamedTuple):
    """An increment of the loads, and the positions (n, 3) [m] in equilibrium at its end."""

    increment: LoadIncrement
    x: np.ndarray


class Solved(NamedTuple):
    """Positions (n, 3) [m] in equilibrium, and how they were found."""

    x: np.ndarray
    counts: Counts
    error: float = math.nan  # left in x [m]; NaN where it is not estimated
    moved: float = math.nan  # the largest displacement [m] since the start
    is_definite: bool = False  # whether K was found to be positive definite in the last iteration
    cause: str = "round-off of the forces"  # of an error that is larger than it should be

    def reason(self, tolerance: float | str) -> str:
        """A sentence: why the iteration ended."""
        residual = self.counts.residual
        if not residual:
            return "no force exceeds its round-off"
        if tolerance != "auto":
            met = f"is below the tolerance {tolerance:g}"
            return f"its residual, {residual:.1e} of the forces, {met}"
        if math.isnan(self.error):
            unknown = (
                "the error of its positions is not known, as the tangent is not definite there"
            )
            return f"its residual, {residual:.1e} of the forces, is small; {unknown}"
        part = f"{self.error / self.moved:.1e} of the largest displacement"
        error = f"about {self.error:.1e} m, {part}"
        if self.error <= PLACE * self.moved:
            return f"the error left in its positions is {error}"
        return f"{self.cause} leaves an error of {error}"


@dataclass(frozen=True, eq=False)
class LoadIncrement:
    """An increment of the loads from the equilibrium `start`; its t is the time of the loads."""

    system: System
    start: State
    load: float  # factor on the loads at its end
    size: float  # its part of the loads
    # Times of what moves, at its begin and its end.
    begin: float
    end: float
    history: History | None = None  # what the terms remember at its begin
    friction: float = 1.0  # part that is left of the friction inside the fabric

    @cached_property
    def carried(self) -> np.ndarray:
        """(n, 3) where the pins carry the cloth [m]."""
        x = self.start.x
        size = self.end - self.begin
        target, _ = self.system.constraints.target(self.begin, size, x)
        if target is x:
            return x
        return carry(self.system, x, target)

    def equation(self, place: np.ndarray | None = None) -> StaticEquation:
        """The equation of its end; friction has the normal forces of a `place` (n, 3) there."""
        over = over_increment(self, place)
        return StaticEquation(over, self.start, self.load, self.end)


def over_increment(increment: LoadIncrement, place: np.ndarray | None = None) -> System:
    """The system over an increment, for terms with a record and for contact."""
    step = StepDifference.between(increment.start.x, increment.size, increment.begin)
    step = replace(step, increment=Increment(increment.end, place, increment.friction))
    return increment.system.over_step(step, increment.history, rates=False)


def resist_disturbances(system: System, state: State, size: float) -> System:
    """The system about an equilibrium: friction resists each disturbance, as a next increment."""
    return over_increment(LoadIncrement(system, state, 1.0, size, state.t, state.t))


def describe_path(system: System, load_steps: int | None) -> str:
    """A sentence on what the equilibrium depends on, with friction; else ""."""
    if not any(term.needs_path for term in system.bound):
        return ""
    what = f"and on the number of load steps, here {load_steps}"
    if load_steps in (None, 1):
        follow = "more load_steps follow the way more closely"
        what = f"which was one increment from the start; {follow}"
    return f"friction: the place of rest depends on the way there, {what}"


class Increase(NamedTuple):
    """What `increase_loads` found."""

    solved: Solved  # the last one, with the counts of all increments
    # ∂x/∂(factor on the loads) (n, 3) [m], beyond where the pins carry the cloth
    rate: np.ndarray | float
    # The system over the last increment, and what its terms remember after that.
    over: System
    history: History | None
    path: tuple[SolvedIncrement, ...]  # the increments, each from the end of the one before


def increase_loads(
    system: System,
    start: State,
    context: SolverContext,
    largest: float,
    loads: tuple[float, float] = (0.0, 1.0),
    rate: np.ndarray | float = 0.0,
    history: History | None = None,
    report: Report = lambda iteration: None,
    at: float | None = None,
) -> Increase:
    """Increase the factor on the loads from the first to the second of `loads`.

    The factor is also the time of what moves, unless all stands still `at` a time. `start` is
    the state at the first factor: in equilibrium, or the start of all where the factor is 0.
    No increment of the factor is larger than `largest`, but where none of these is solved and
    the path does not count: a small load may hold a cloth less than the whole. `rate` is
    ∂x/∂(factor) at the start [m] beyond where the pins carry the cloth, as far as it is known,
    and `history` what the terms remember there. They remember each increment that is solved;
    an increment that is repeated in smaller ones begins with what they remembered before it.
    """
    x, (reached, end), size, total = start.x, loads, largest, Counts()
    over = system
    path = list[SolvedIncrement]()
    tries_all = False
    may_try_all = largest < end - reached and not any(term.needs_path for term in system.bound)
    while reached < end:
        to = reached + size
        load = to if to < end - 1e-9 else end
        here = State(start.t, x, np.zeros_like(x))
        times = (reached, load) if at is None else (at, at)
        increment = LoadIncrement(system, here, load, load - reached, *times, history)
        try:
            solved, over = solve_increment(increment, rate, context, report)
        except EquilibriumFailed as failure:
            size /= 2
            if size < SMALLEST * largest or tries_all:
                if may_try_all and reached == loads[0] and not tries_all:
                    tries_all = True
                    size = end - reached
                    continue
                reason = f"load stepping ended at {reached:.4g} of the loads: {failure.reason}"
                args = failure.residual, here, failure.remedy, reached
                raise EquilibriumFailed(reason, *args) from failure
            continue
        rate = (solved.x - increment.carried) / increment.size
        path.append(SolvedIncrement(increment, solved.x))
        x = solved.x
        reached = load
        total = total.plus(solved.counts)
        history = over.commit(State(start.t, x, np.zeros_like(x)), history)
        if solved.counts.newton <= QUICK:
            size = min(2 * size, largest)
    return Increase(solved._replace(counts=total), rate, over, history, tuple(path))


def shake(increase: Increase, context: SolverContext, report: Report = lambda iteration: None):
    """Let the friction inside the fabric sink to zero in ten increments, under the whole loads.

    What is left is an equilibrium without it, the one beside the way there. Returns the
    `Increase` with these increments.
    """
    before = increase.path[-1].increment
    path = list(increase.path)
    total = increase.solved.counts
    over = increase.over
    history = increase.history
    x = increase.solved.x
    for left in SHAKEN:
        here = replace(before.start, x=x)
        increment = replace(before, start=here, size=1 / len(SHAKEN), begin=before.end)
        increment = replace(increment, history=history, friction=left)
        solved, over = solve_increment(increment, 0.0, context, report)
        x = solved.x
        total = total.plus(solved.counts)
        history = over.commit(replace(here, x=x), history)
        path.append(SolvedIncrement(increment, x))
    solved = solved._replace(counts=total)
    return Increase(solved, increase.rate, over, history, tuple(path))


def solve_increment(
    increment: LoadIncrement,
    rate: np.ndarray | float,
    context: SolverContext,
    report: Report = lambda iteration: None,
) -> tuple[Solved, System]:
    """Solve an increment, from where `rate`, ∂x/∂(factor on the loads) [m], leads.

    Also return the system over the increment. Friction has a potential while its normal forces
    stay as they are. So the increment is solved with the normal forces at its begin, then with
    those at this solution, and so on, until the forces with those at the solution itself balance
    to LAGGED, or to the tolerance that was given. The first normal forces may be far off, as
    where nothing touches at the begin, so the first passes are short.
    """
    equation = increment.equation()
    x = _first_guess(increment, equation, rate)
    if not any(term.lags for term in equation.system.bound):
        return solve_static(equation, x, context, report), equation.system
    options = context.options
    total = Counts()
    solved = None
    residual = math.inf
    allowed = LAGGED if options.tolerance == "auto" else options.tolerance
    for number in range(PASSES):
        most = min(FIRST_PASS * 2**number, options.max_iterations)
        short = replace(context, options=replace(options, max_iterations=most))
        taken: list[Iteration] = []
        try:
            solved = solve_static(equation, before := x, short, taken.append)
            x = solved.x
            counts = solved.counts
        except EquilibriumFailed as failure:
            if len(taken) < most:
                raise
            x = failure.state.x
            solved = None
            counts = Counts(newton=len(taken))
        for each in taken:
            report(replace(each, number=each.number + total.newton))
        total = total.plus(counts)
        equation = increment.equation(x)
        R, scale = equation.residual(x, 0.0)
        earlier = residual
        residual = equation.system.sums.norm(R) / scale if scale else 0.0
        if solved and residual <= allowed:
            part = residual / earlier if residual < 0.5 * earlier else 1.0  # of the last change
            change = part * float(np.linalg.norm(x - before, axis=1).max())
            counts = replace(total, residual=residual)
            if not change <= solved.error:
                solved = solved._replace(error=change, cause="friction, which lags by one pass,")
            return solved._replace(counts=counts), equation.system
        if total.newton >= MANY * options.max_iterations:
            break
    what = f"friction and its normal forces did not agree in {number + 1} passes"
    reason = f"{what} of {amount(total.newton, 'iteration')}"
    raise equation.failure(reason, Point(x, R, 0.0, scale), residual)


def _first_guess(
    increment: LoadIncrement, equation: StaticEquation, rate: np.ndarray | float
) -> np.ndarray:
    """Positions (n, 3): the nodes go along with the pins, and on at their rate."""
    x = increment.carried
    project = increment.system.constraints.project
    way = project(np.broadcast_to(increment.size * rate, x.shape).copy())
    if not has_limits(increment.system):
        return x + way
    guess = admit(equation.system, x + way, increment.end)
    if guess is None:
        point = Point(increment.start.x, np.zeros_like(x), 0.0, 0.0)
        raise equation.failure("the pins lead the cloth into an obstacle", point, math.nan)
    return guess


def solve_static(
    equation: StaticEquation,
    x: np.ndarray,
    context: SolverContext,
    report: Report = lambda iteration: None,
) -> Solved:
    """Return x in equilibrium with the loads of the equation, the counts and the error left."""
    is_definite = False
    guess = x

    def tell(progress: Progress):
        nonlocal is_definite
        point = progress.point
        shift = progress.remedy.shift
        is_definite = equation.system.symmetric and not shift
        report(Iteration(progress.number, point.relative, shift, progress.length, equation.load))
        _check_travel(equation, guess, point, point.relative)

    if context.options.tolerance == "auto":
        left = ErrorInPlace(start=equation.start.x)
    else:
        left = None
    x, counts = iterate(equation, context, x, report=tell, left=left)
    is_definite = is_definite and not equation.updates(x)
    if left:
        counts = replace(counts, estimated=0, limited=0)
        return Solved(x, counts, left.left, left.moved, is_definite)
    if counts.residual > context.options.residual:  # it is round-off
        reason = "the round-off of the forces is above the tolerance"
        remedy = (
            f"A tolerance of {2 * counts.residual:.1g} can be met; for less, take away what is "
            "stiff and small, such as slivers among the triangles that no pin holds."
        )
        raise EquilibriumFailed(reason, counts.residual, equation.at(x), remedy)
    return Solved(x, counts, is_definite=is_definite)


def _check_travel(
    equation: StaticEquation, guess: np.ndarray, point: Point, residual: float
) -> None:
    """Raise `EquilibriumFailed` for a cloth that goes away from the guess, as nothing holds it."""
    way = (point.y - guess).mean(axis=0)
    distance = float(np.linalg.norm(way))
    if distance > FAR * equation.longest:
        towards = ", ".join(f"{c:.2g}" for c in way / distance)
        has_friction = any(term.lags for term in equation.system.bound)
        if has_friction:
            what = "neither pins nor friction hold"
        else:
            what = "nothing holds"
        reason = f"{what} the cloth: it went {distance:.3g} m along ({towards})"
        kinds = {traits_of(term).kind for term in equation.system.terms}
        if kinds & {"membrane", ""}:
            remedy = "Pin it, or take the load away."
        else:
            remedy = NO_MEMBRANE
        raise equation.failure(reason, point, residual, remedy)
