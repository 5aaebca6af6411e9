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
from fecloth.nonlinear.error_left import ALLOWED_OF_DISPLACEMENT, ErrorInPlace
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.progress import Progress
from fecloth.nonlinear.static_equation import EquilibriumFailed, StaticEquation
from fecloth.nonlinear.statistics import Counts
from fecloth.system.carried import carry
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import Increment, StepDifference
from fecloth.terms.traits import traits_of

# Extents of the cloth: after a larger mean displacement nothing holds it. A cloth that is held
# goes about one extent at most.
FARTHEST_TRAVEL = 10.0
# An increment of the loads grows again after a solution in so many iterations.
QUICK_ITERATIONS = 8
SMALLEST_INCREMENT = 1 / 64  # of the first one
# A half must have less than this part of the deviation of the whole, or halving does not help.
LESS_DEVIATION = 0.95
# The principal stretch of a cloth that holds on to its pins while the rest goes far away.
FARTHEST_STRETCH = 3.0
TOO_MUCH_LOAD = (
    "Lower the loads. A balloon of rubber has a limit pressure, above which nothing holds."
)
NO_MEMBRANE = "No membrane resists a stretch: add StVK, and pin the cloth."
# Iterations with the first normal forces of friction, which may be far off. Each of the next
# passes may take twice as many.
FIRST_PASS_ITERATIONS = 4
# How often the normal forces of friction are taken anew in an increment, …
MOST_PASSES = 40
# … and the most iterations of all these passes, times the option `max_iterations`.
PASSES_OVER_ONE = 4
# The part of the friction inside the fabric that is left after each increment of `shake`.
FRICTION_LEFT = tuple(np.linspace(0.9, 0.0, 10))


@dataclass(frozen=True)
class Iteration:
    """Figures of one Newton iteration.

    Attributes
    ----------
    number
        Counted from 1.
    residual
        ‖f‖ of the free directions after it, relative to Σ ‖f_term‖ of all directions.
    shift
        σ of its tangent K + σ M [1/s²]; 0 is the exact tangent.
    length
        Fraction of Newton's step; more than 1 where the potential is concave along it.
    load
        Factor on the loads.
    """

    number: int
    residual: float
    shift: float
    length: float
    load: float = 1.0


Report = Callable[[Iteration], None]


def static_context(
    system: System, tolerance: float | Literal["auto"], max_iterations: int, solver: str
) -> SolverContext:
    """The direct solver with its matrix, and Newton's options, for `solve_static`."""
    options = Newton(tolerance, max_iterations, forcing=1e-8, reuse=False)
    over = resist_disturbances(system, system.rest(), size=1.0)
    linear, matrix, _ = make_linear_solver(system, solver, over.symmetric)
    return SolverContext(linear, matrix, options)


class SolvedIncrement(NamedTuple):
    """An increment of the loads, and the positions (n, 3) [m] in equilibrium at its end."""

    increment: LoadIncrement
    x: np.ndarray


class Solved(NamedTuple):
    """Positions in equilibrium, and how they were found.

    Attributes
    ----------
    x
        (n, 3) positions [m].
    counts
        What the iterations took.
    error
        The error left in x [m]; NaN where it is not estimated.
    moved
        The largest displacement [m] since the start.
    is_definite
        Whether K was found to be positive definite in the last iteration.
    cause
        What causes an error that is larger than it should be.
    """

    x: np.ndarray
    counts: Counts
    error: float = math.nan
    moved: float = math.nan
    is_definite: bool = False
    cause: str = "round-off of the forces"

    def reason(self, tolerance: float | str) -> str:
        """A sentence that says why the iteration ended.

        `tolerance` is the option of Newton's iteration: with "auto" it ended by the error.
        """
        residual = self.counts.residual
        if not residual and math.isnan(self.error):
            return "no force exceeds its round-off"
        residual_is = f"its residual, {residual:.1e} of the forces, is"
        if tolerance != "auto":
            return f"{residual_is} below the tolerance {tolerance:g}"
        if math.isnan(self.error):
            unknown = "the error of its positions is not known"
            return f"{residual_is} small; {unknown}, as the tangent is not definite there"
        part = f"{self.error / self.moved:.1e} of the largest displacement"
        error = f"about {self.error:.1e} m, {part}"
        if self.error <= ALLOWED_OF_DISPLACEMENT * self.moved:
            return f"the error left in its positions is {error}"
        return f"{self.cause} leaves an error of {error}"


@dataclass(frozen=True, eq=False)
class LoadIncrement:
    """An increment of the loads.

    Attributes
    ----------
    system
        The cloth and its terms.
    start
        The equilibrium at its begin; its t is the time of the loads.
    load
        Factor on the loads at its end.
    size
        Its part of the loads.
    begin, end
        Times of what moves, at its begin and at its end [s].
    history
        What the terms remember at its begin.
    friction
        The part that is left of the friction inside the fabric.
    """

    system: System
    start: State
    load: float
    size: float
    begin: float
    end: float
    history: History | None = None
    friction: float = 1.0

    @cached_property
    def carried(self) -> np.ndarray:
        """(n, 3) where the pins carry the cloth, without a stretch [m]."""
        return self._carry(stretches=False)

    @cached_property
    def stretched(self) -> np.ndarray:
        """(n, 3) where the pins carry and stretch the cloth evenly [m]."""
        return self._carry(stretches=True)

    def _carry(self, stretches: bool) -> np.ndarray:
        x = self.start.x
        size = self.end - self.begin
        target, _ = self.system.constraints.target(self.begin, size, x)
        if target is x:
            return x
        return carry(self.system, x, target, stretches)

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
    """The system about an equilibrium `state`, in which friction resists a disturbance.

    It resists as in a next increment of the loads, of the part `size`, in which nothing moves.
    """
    increment = LoadIncrement(
        system=system,
        start=state,
        load=1.0,
        size=size,
        begin=state.t,
        end=state.t,
    )
    return over_increment(increment)


def describe_path(system: System, load_steps: int | None) -> str:
    """A sentence on what the equilibrium depends on, with friction; else ""."""
    if not any(term.needs_path for term in system.bound):
        return ""
    sentence = "friction: the place of rest depends on the way there"
    if load_steps in (None, 1):
        more = "more load_steps follow the way more closely"
        return f"{sentence}, which was one increment from the start; {more}"
    return f"{sentence}, and on the number of load steps, here {load_steps}"


@remembered
@dataclass(frozen=True, eq=False)
class Course:
    """What the increments so far tell about the next one.

    Attributes
    ----------
    rate
        ∂x/∂(factor on the loads) (n, 3) [m] in the last increment, beyond where the pins carry
        the cloth; None before the first one.
    is_smooth
        Whether the last solution lay where the course led.
    jumps
        Factors on the loads where the cloth jumped to another branch of equilibria.
    """

    rate: np.ndarray | None = None
    is_smooth: bool = False
    jumps: tuple[float, ...] = ()


NO_COURSE = Course()  # before the first increment


class Increase(NamedTuple):
    """What `increase_loads` found.

    Attributes
    ----------
    solved
        The equilibrium at the end, with the counts of all increments.
    course
        What the increments tell about the next one.
    over
        The system over the last increment.
    history
        What its terms remember after that.
    path
        The increments, each from the end of the one before.
    """

    solved: Solved
    course: Course
    over: System
    history: History | None
    path: tuple[SolvedIncrement, ...]


def increase_loads(
    system: System,
    start: State,
    context: SolverContext,
    largest: float,
    loads: tuple[float, float] = (0.0, 1.0),
    course: Course = NO_COURSE,
    history: History | None = None,
    report: Report = lambda iteration: None,
    at: float | None = None,
) -> Increase:
    """Increase the factor on the loads from the first to the second of `loads`.

    The factor is also the time of what moves, unless all stands still `at` a time. An increment
    that is not solved is halved, and doubled again after one that was solved quickly. If no
    small increment is solved at the begin, all loads are tried at once, because a small load
    may hold a cloth less than the whole. They are not where the equilibrium depends on the path
    or on what moves with the loads.

    An increment is also halved where its solution has left the branch: where it is farther from
    the prediction than the prediction is from the begin. If it is as far, relative to this
    way, in the half, then halving does not help: the cloth jumps, and the solution is taken.
    Where the equilibrium depends on the path anyway, the increments stay as they are.

    Raises `EquilibriumFailed` where the increments become too small.

    Parameters
    ----------
    system
        The cloth and its terms.
    start
        The state at the first factor: in equilibrium, or the start of all where the factor is 0.
    context
        The solvers.
    largest
        The largest increment of the factor.
    loads
        The first factor and the last one.
    course
        What is known of the increments before the start.
    history
        What the terms remember at the start. They remember each increment that is solved. One
        that is repeated in smaller ones begins with what they remembered before it.
    report
        Called after each iteration.
    at
        The time at which all stands still [s]; None where pins or obstacles move.
    """
    first_load, last_load = loads
    reached = first_load
    x = start.x
    size = largest
    total_counts = Counts()
    over = system
    path = list[SolvedIncrement]()
    depends_on_path = any(term.needs_path for term in system.bound)
    remembers = any(record is not None for record in history or ())
    follows_path = depends_on_path or remembers or (at is None and moves(system))
    may_try_all_loads = largest < last_load - first_load and not follows_path
    has_tried_all_loads = False
    deviation_of_whole = math.inf  # of the increment that was halved
    while reached < last_load:
        load = reached + size
        if load >= last_load - 1e-9:  # what would be left is round-off
            load = last_load
        begin, end = (reached, load) if at is None else (at, at)
        state_before = State(start.t, x, np.zeros_like(x))
        part = load - reached
        increment = LoadIncrement(system, state_before, load, part, begin, end, history)
        try:
            solved, over = solve_increment(increment, course.rate, context, report)
        except EquilibriumFailed as failure:
            size /= 2
            if size >= SMALLEST_INCREMENT * largest and not has_tried_all_loads:
                continue
            if may_try_all_loads and reached == first_load and not has_tried_all_loads:
                has_tried_all_loads = True
                size = last_load - reached
                continue
            raise EquilibriumFailed(
                f"load stepping ended at {reached:.4g} of the loads: {failure.reason}",
                failure.residual,
                increment.start,
                failure.remedy,
                load=reached,
            ) from failure
        deviation = 0.0 if depends_on_path else measure_deviation(increment, course.rate, solved.x)
        total_counts = total_counts.plus(solved.counts)
        jumps = course.jumps
        if deviation > 1.0 and course.is_smooth:
            can_halve = size / 2 >= SMALLEST_INCREMENT * largest
            if can_halve and deviation < LESS_DEVIATION * deviation_of_whole:
                deviation_of_whole = deviation
                size /= 2
                continue
            jumps = (*jumps, load)
        deviation_of_whole = math.inf
        rate = (solved.x - increment.carried) / increment.size
        course = Course(rate, is_smooth=deviation <= 1.0, jumps=jumps)
        path.append(SolvedIncrement(increment, solved.x))
        x = solved.x
        reached = load
        history = over.commit(State(start.t, x, np.zeros_like(x)), history)
        if solved.counts.newton <= QUICK_ITERATIONS:
            size = min(2 * size, largest)
    solved = solved._replace(counts=total_counts)
    return Increase(solved, course, over, history, tuple(path))


def measure_deviation(
    increment: LoadIncrement, rate: np.ndarray | None, solution: np.ndarray
) -> float:
    """Distance of a solution (n, 3) from its prediction, over the way to the prediction.

    Both are root mean squares over the nodes, weighted by their mass. It is infinite where the
    prediction is the begin of the increment, and 0 where both are the solution.
    """
    guess = _first_guess(increment, increment.equation(), rate)
    system = increment.system
    distance = system.sums.rms(system.diagonal_mass, solution - guess)
    way = system.sums.rms(system.diagonal_mass, guess - increment.start.x)
    if way:
        return float(distance / way)
    return math.inf if distance else 0.0


def moves(system: System) -> bool:
    """Whether pins or obstacles move with time."""
    constraints = system.constraints
    pins = any(pin.moves for pin, _ in constraints.groups.values()) or constraints.followers.closes
    return pins or any(term.supplies and term.limits_direction for term in system.bound)


def shake(
    increase: Increase, context: SolverContext, report: Report = lambda iteration: None
) -> Increase:
    """Let the friction inside the fabric sink to zero in ten increments, under the whole loads.

    The end is an equilibrium without this friction, near the one with it. Returns the
    `increase` with these increments added to its path and counts. Raises `EquilibriumFailed`
    where an increment is not solved.
    """
    last_increment = increase.path[-1].increment
    path = list(increase.path)
    total_counts = increase.solved.counts
    over = increase.over
    history = increase.history
    x = increase.solved.x
    for friction in FRICTION_LEFT:
        state_before = replace(last_increment.start, x=x)
        increment = replace(
            last_increment,
            start=state_before,
            size=1 / len(FRICTION_LEFT),
            begin=last_increment.end,  # begin and end are the same time: nothing moves
            history=history,
            friction=friction,
        )
        solved, over = solve_increment(increment, None, context, report)
        x = solved.x
        total_counts = total_counts.plus(solved.counts)
        history = over.commit(replace(state_before, x=x), history)
        path.append(SolvedIncrement(increment, x))
    solved = solved._replace(counts=total_counts)
    return increase._replace(solved=solved, over=over, history=history, path=tuple(path))


def solve_increment(
    increment: LoadIncrement,
    rate: np.ndarray | None,
    context: SolverContext,
    report: Report = lambda iteration: None,
) -> tuple[Solved, System]:
    """Solve an increment, from where `rate`, ∂x/∂(factor on the loads) [m], leads.

    None: from where the pins carry and stretch the cloth. Also return the system over the
    increment. Raises `EquilibriumFailed`.
    """
    equation = increment.equation()
    x = _first_guess(increment, equation, rate)
    if any(term.lags for term in equation.system.bound):
        return _solve_in_passes(increment, x, context, report)
    return solve_static(equation, x, context, report), equation.system


def _solve_in_passes(
    increment: LoadIncrement, x: np.ndarray, context: SolverContext, report: Report
) -> tuple[Solved, System]:
    """Solve an increment with friction, from positions x (n, 3).

    Friction has a potential while its normal forces stay as they are. So a pass solves the
    increment with fixed normal forces: the first with those at its begin, and each further one
    with those at the solution before. The passes end when the forces with the normal forces at
    the solution itself balance, to the tolerance for the residual.

    Returns the solution and the system over the increment, with the normal forces there. Raises
    `EquilibriumFailed` for a pass that fails, and after too many passes or iterations.
    """
    options = context.options
    equation = increment.equation()
    total_counts = Counts()
    residual = math.inf
    for number in range(MOST_PASSES):
        # The first normal forces may be far off, as where nothing touches at the begin: so the
        # first passes are short.
        most_iterations = min(FIRST_PASS_ITERATIONS * 2**number, options.max_iterations)
        short = replace(context, options=replace(options, max_iterations=most_iterations))
        x_before = x
        solved, x, counts = _solve_pass(equation, x, short, report, total_counts.newton)
        total_counts = total_counts.plus(counts)
        equation = increment.equation(x)
        R, scale = equation.residual(x, 0.0)
        residual_before = residual
        residual = equation.system.sums.norm(R) / scale if scale else 0.0
        if solved and residual <= options.residual:
            solved = solved._replace(counts=replace(total_counts, residual=residual))
            # If the passes converge, the next one changes x by a part of the last change.
            converges = residual < 0.5 * residual_before
            part = residual / residual_before if converges else 1.0
            change = part * float(np.linalg.norm(x - x_before, axis=1).max())
            if not change <= solved.error:  # larger, or the error is not known (NaN)
                cause = "friction, which lags by one pass,"
                solved = solved._replace(error=change, cause=cause)
            return solved, equation.system
        if total_counts.newton >= PASSES_OVER_ONE * options.max_iterations:
            break
    what = f"friction and its normal forces did not agree in {number + 1} passes"
    reason = f"{what} of {amount(total_counts.newton, 'iteration')}"
    raise equation.failure(reason, Point(x, R, 0.0, scale), residual)


def _solve_pass(
    equation: StaticEquation,
    x: np.ndarray,
    context: SolverContext,
    report: Report,
    iterations_before: int,
) -> tuple[Solved | None, np.ndarray, Counts]:
    """Solve for an equilibrium with the normal forces of a pass, from positions x (n, 3).

    Returns the solution, the positions (n, 3) where the pass led, and its counts. A pass that
    reaches its last iteration is no failure, because it led nearer: then the solution is None.
    Raises `EquilibriumFailed` for any other failure. The iterations are reported after the pass,
    with numbers that go on from the `iterations_before` in earlier passes.
    """
    iterations: list[Iteration] = []
    solved: Solved | None
    try:
        solved = solve_static(equation, x, context, iterations.append)
    except EquilibriumFailed as failure:
        if len(iterations) < context.options.max_iterations:
            raise
        solved = None
        end = failure.state.x
        counts = Counts(newton=len(iterations))
    else:
        end = solved.x
        counts = solved.counts
    for iteration in iterations:
        report(replace(iteration, number=iteration.number + iterations_before))
    return solved, end, counts


def _first_guess(
    increment: LoadIncrement, equation: StaticEquation, rate: np.ndarray | None
) -> np.ndarray:
    """Positions (n, 3) [m] from which to solve an increment, which all contacts allow.

    The nodes go along with the pins, and from there on at the `rate` [m] of the last increment,
    which has the stretch. Without one they are stretched evenly by the pins. Raises
    `EquilibriumFailed` if no such positions are found.
    """
    if rate is None:
        guess = increment.stretched
    else:
        guess = increment.carried + increment.system.constraints.expand(increment.size * rate)
    if not has_limits(increment.system):
        return guess
    allowed = admit(equation.system, guess, increment.end)
    if allowed is None:
        x = increment.start.x
        point = Point(x, np.zeros_like(x), 0.0, 0.0)
        raise equation.failure("the pins lead the cloth into an obstacle", point, math.nan)
    return allowed


def solve_static(
    equation: StaticEquation,
    x: np.ndarray,
    context: SolverContext,
    report: Report = lambda iteration: None,
) -> Solved:
    """Solve for positions in equilibrium with the loads of the equation, from x (n, 3) [m].

    With the tolerance "auto" the iteration ends by the error left in the positions, which the
    result tells. `report` is called after each iteration.

    Raises `EquilibriumFailed` where the iteration fails, for a cloth that nothing holds, and
    where round-off keeps the residual above a tolerance that is a number.
    """
    is_definite = False
    guess = x

    def tell(progress: Progress) -> None:
        """Report an iteration, note whether K was definite, and check how far the cloth went."""
        nonlocal is_definite
        point = progress.point
        shift = progress.remedy.shift
        is_definite = equation.system.symmetric and not shift
        report(Iteration(progress.number, point.relative, shift, progress.length, equation.load))
        _check_travel(equation, guess, point, point.relative)

    error_left: ErrorInPlace | None = None
    if context.options.tolerance == "auto":
        error_left = ErrorInPlace(start=equation.start.x)
    x, counts = iterate(equation, context, x, report=tell, error_left=error_left)
    # The factor tells about K without its parts of low rank, the updates.
    is_definite = is_definite and not equation.updates(x)
    if error_left:
        counts = replace(counts, estimated=0, limited=0)  # `Solved.error` tells it instead
        return Solved(x, counts, error_left.left, error_left.moved, is_definite)
    # `iterate` accepts a residual above the tolerance if it is round-off.
    if counts.residual > context.options.residual:
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
    """Raise `EquilibriumFailed` for a cloth that goes far away: not held, or without strength.

    It is far if the nodes have moved, on average, by more than `FARTHEST_TRAVEL` extents of the
    cloth from the `guess` (n, 3) to the `point`. `residual` is the relative one there.
    """
    mean_move = (point.y - guess).mean(axis=0)
    distance = float(np.linalg.norm(mean_move))
    if distance <= FARTHEST_TRAVEL * equation.longest:
        return
    towards = ", ".join(f"{c:.2g}" for c in mean_move / distance)
    system = equation.system
    kinds = {traits_of(term).kind for term in system.terms}
    may_have_membrane = bool(kinds & {"membrane", ""})  # "": a user's term of unknown kind
    remedy = "Pin it, or take the load away." if may_have_membrane else NO_MEMBRANE
    what = "nothing holds the cloth"
    if any(term.lags for term in system.bound):
        what = "neither pins nor friction hold the cloth"
    elif may_have_membrane and principal_stretches(system.cloth, point.y).max() > FARTHEST_STRETCH:
        # as a balloon beyond its limit pressure
        what = "the cloth stretches without end under the loads"
        remedy = TOO_MUCH_LOAD
    reason = f"{what}: it went {distance:.3g} m along ({towards})"
    raise equation.failure(reason, point, residual, remedy)
