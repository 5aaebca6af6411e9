"""Static equilibrium: positions at which the forces of all terms balance, f(x, v = 0, t) = 0."""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, InputError, is_number
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import has_limits, largest_step
from fecloth.nonlinear.error_left import PLACE, ErrorInPlace
from fecloth.nonlinear.iteration import Progress, iterate
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.rest_stiffness import describe_instability, least_stiffness
from fecloth.nonlinear.static_equation import EquilibriumFailed, StaticEquation
from fecloth.nonlinear.statistics import Counts
from fecloth.quantities.arguments import checks_arguments
from fecloth.system.arguments import check_system
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import traits_of

FAR = 10.0  # extents of the cloth: a mean displacement beyond this means that no pin holds it
QUICK = 8  # iterations after which a load increment may grow again
SMALLEST = 1 / 64  # of the first load increment
NO_MEMBRANE = "No membrane resists a stretch: add StVK, and pin the cloth."


@remembered
@dataclass(frozen=True, eq=False)
class Equilibrium(State):
    """A `State` in equilibrium, and how it was found."""

    # ‖f‖ of the free directions over Σ ‖f_term‖ of all; 0 where no force exceeds its round-off
    residual: float
    iterations: int  # of all load steps together
    factorisations: int  # of all load steps together
    reason: str  # a sentence: why the iteration ended
    space_error: float = math.nan  # the estimated relative error in space: see `space_error`
    space_error_reason: str = ""  # why there is none, or ""
    # The estimated error [m] that the iteration left in x; NaN where it is not estimated
    solver_error: float = math.nan
    warnings: tuple[str, ...] = ()  # a sentence for each reason to doubt it

    @property
    def state(self) -> Self:
        """Itself: a function of a result reads ``result.state`` of a run and of an equilibrium."""
        return self

    def __repr__(self) -> str:
        return f"<Equilibrium of {len(self.x)} nodes at t = {self.t:g} s: {self.reason}>"


@dataclass(frozen=True)
class Iteration:
    """Figures of one Newton iteration."""

    number: int  # counted from 1
    residual: float  # ‖f‖ of the free directions after it, relative to Σ ‖f_term‖ of all directions
    shift: float  # σ of its tangent K + σ M [1/s²]; 0 is the exact tangent
    length: float  # fraction of Newton's step; more than 1 where the potential is concave along it
    load: float = 1.0  # factor on the loads


@checks_arguments
def equilibrium(
    system: System,
    state: State,
    *,
    load_steps: int | None = None,
    tolerance: float | Literal["auto"] = "auto",
    max_iterations: int = 500,
    solver: str = "direct",
    report: Callable[[Iteration], None] = lambda iteration: None,
) -> Equilibrium:
    """The equilibrium that Newton's iteration reaches from `state`, at the loads of its time.

    Each iteration solves (K + σ M) s = f with the tangent K = −∂f/∂x of all terms. σ is zero where
    K is positive definite and its step is an improvement: near the solution the convergence is
    quadratic. Elsewhere each term's tangent is made positive semi-definite, and σ grows until the
    step is an improvement (after Nocedal and Wright 2006, Numerical Optimization, algorithm 3.3,
    who add σ alone): a flat cloth without stress has no stiffness across, and σ M stands in for
    it. With the exact K + σ M a sheet squeezed by a fifth took twice the iterations. The first σ
    moves the cloth by about a tenth of its extent under its load. Of s, s/2, s/4, … the longest is
    taken that halves the residual, or reduces the potential sufficiently (their eq. 3.6a), or,
    where a force has no potential, at whose end the residual does not push back hard (after
    Matthies and Strang 1979); it is doubled while the potential is concave along it. Where it is
    shorter than s, up to twelve whole steps in a row are tried, and taken if the potential is then
    lower (the watchdog technique, Chamberlain et al. 1982): a sheet that is stiff in its plane
    stretches where a step turns it, and the next steps take that back. After three whole steps in a
    row that left more than half of the residual, conjugate gradients with the exact K follow,
    preconditioned by the definite K + σ M; a direction without positive curvature ends them and is
    taken (truncated Newton, algorithm 7.1 there): a wrinkled sheet took 326 iterations without
    them and 23 with them. No node moves by more than the extent of the cloth in one iteration.

    A compressed cloth has many equilibria, and which one is found depends on the start; a flat
    start without any load across stays flat. If the last `Iteration` had a shift, the tangent is
    not positive definite near the solution: it may be unstable, or not the only one around.

    Parameters
    ----------
    system, state
        What is to be balanced and where to start; its velocity is not used.
    load_steps
        None: the loads act at once, as at the time of `state`, and pins hold their nodes where
        `state` has them, slides their held directions: a start for a run. A number n, as in
        `[equilibrium]` of a scene: the forces of the loads, which are `Gravity`, `Pressure`, `Gas`,
        `Wind`, `PointForce`, `UserForce` and every term that says `load = True`, are multiplied by
        λ = 1/n, 2/n, …, 1, each solved from where the line through the last two solutions leads. λ
        is also the time t at which motions of pins and obstacles are evaluated, so that a specimen
        is drawn from t = 0 to 1, with n = 1 at once. Where that fails the increment of λ is halved,
        down to 1/64 of the first; after a solution in at most 8 iterations it doubles again, up to
        1/n. For loads that turn the cloth far, and for the states between: a strip that a follower
        pressure turned by 237° took 205 iterations at once and 246 in ten steps.
    tolerance
        A number: on ‖f‖ of the free directions over Σ ‖f_term‖ of all directions at the same
        positions; the forces on what the pins hold are the reactions. "auto": the iteration ends
        where the error left in the positions is below 1e-6 of the largest displacement since the
        start and the residual below 1e-9, or where both are as small as round-off allows. The
        error is estimated from the last two corrections, if Newton's steps were whole and shrank.
        Where the tangent is not definite the residual alone decides.
    max_iterations
        Of each load step; beyond it the step has failed.
    solver
        "direct", "pardiso" or "superlu".
    report
        Called with each `Iteration`.

    Returns
    -------
    Equilibrium
        A `State` at the same time, with v = 0, and the residual, iterations, factorisations,
        reason, and the estimated `solver_error` [m] that is left in x. An unstable equilibrium has
        a sentence in `warnings`, which comes as a `FeclothWarning` too.

    Raises
    ------
    EquilibriumFailed
        If the tolerance is not met: the cloth moves away as nothing holds it, the iteration ends
        before (the message says how many triangles are slack, the usual cause), or the round-off
        of the forces is greater than a number that was given (the message says which tolerance can
        be met). Its `state` is the best one. A cloth on which no force exceeds its round-off is in
        equilibrium.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    >>> sag = -fc.equilibrium(system, system.rest()).x[:, 2].min()
    >>> print(f"{1000 * sag:.0f} mm")
    38 mm
    """
    _check(system, state, load_steps, tolerance, max_iterations, solver, report)
    start = State(state.t, state.x.copy(), np.zeros_like(state.x))
    context = static_context(system, tolerance, max_iterations, solver)
    history = system.start_history(start)
    if load_steps is None:
        over = over_increment(system, start.t, start.x, 1.0, history)
        equation = StaticEquation(over, start, t=start.t)
        solved = solve_static(equation, start.x, context, report)
    else:
        solved = increase_loads(
            system, start, context, 1 / load_steps, history=history, report=report
        ).solved
    x, counts = solved.x, solved.counts
    work = counts.newton, counts.factorisations, solved.reason(tolerance)
    error = space_error(system, State(start.t, x, np.zeros_like(x)))
    space = error.relative, error.reason
    doubts = _find_instability(system, x, start.t if load_steps is None else 1.0, solved)
    for words in doubts:
        warnings.warn(words, FeclothWarning, stacklevel=3)
    still = np.zeros_like(x)
    return Equilibrium(start.t, x, still, counts.residual, *work, *space, solved.error, doubts)


def _check(system, state, load_steps, tolerance, max_iterations, solver, report):
    """Raise `InputError` for an argument that is not allowed."""
    check_system(system, state, "equilibrium")
    validation.function(
        "report", report, "lambda iteration: print(iteration.residual)", "equilibrium"
    )
    if tolerance != "auto" and not (is_number(tolerance) and 1e-13 <= tolerance < 1):
        allowed = 'must lie in [1e-13, 1), or be "auto"'
        raise InputError(f"tolerance = {tolerance!r}", allowed, "equilibrium")
    for name, value in (("max_iterations", max_iterations), ("load_steps", load_steps)):
        if value is not None and not (isinstance(value, int) and value >= 1):
            raise InputError(f"{name} = {value!r}", "must be an integer >= 1", "equilibrium")
    if solver not in ("direct", "pardiso", "superlu"):
        allowed = "must be direct, pardiso or superlu"
        raise InputError(f"solver = {solver!r}", allowed, "equilibrium")


def static_context(
    system: System, tolerance: float | Literal["auto"], max_iterations: int, solver: str
) -> SolverContext:
    """Return the direct solver with its matrix, and Newton's options, for `solve_static`."""
    for name, term in zip(system.names, system.bound, strict=True):
        if reason := term.no_equilibrium:
            remedy = "Let the motion come to rest in BackwardEuler or BDF2, or set friction = 0."
            raise InputError(f"{name} in equilibrium", reason, "equilibrium", remedy)
    options = Newton(tolerance, max_iterations, forcing=1e-8, reuse=False)
    linear, matrix, _ = system.linear_solver(solver, system.symmetric)
    return SolverContext(linear, matrix, options)


class Solved(NamedTuple):
    """Positions (n, 3) [m] in equilibrium, and how they were found."""

    x: np.ndarray
    counts: Counts
    error: float = math.nan  # left in x [m]; NaN where it is not estimated
    moved: float = math.nan  # the largest displacement [m] since the start
    is_definite: bool = False  # whether K was found to be positive definite in the last iteration

    def reason(self, tolerance: float | str) -> str:
        """A sentence: why the iteration ended."""
        residual = self.counts.residual
        if not residual:
            return "no force exceeds its round-off"
        if tolerance != "auto":
            met = f"is below the tolerance {tolerance:g}"
            return f"its residual, {residual:.1e} of the forces, {met}"
        if math.isnan(self.error):
            return (
                f"its residual, {residual:.1e} of the forces, is small; the error of its positions "
                "is not known, as the tangent is not definite there"
            )
        part = f"{self.error / self.moved:.1e} of the largest displacement"
        error = f"about {self.error:.1e} m, {part}"
        if self.error <= PLACE * self.moved:
            return f"the error left in its positions is {error}"
        return f"round-off of the forces leaves an error of {error}"


def _find_instability(system: System, x: np.ndarray, t: float, solved: Solved) -> tuple[str, ...]:
    """Return a sentence if K is not positive definite at x; an eigenvalue is found if need be."""
    if solved.is_definite:
        return ()
    words = describe_instability(*least_stiffness(system, State(t, x, np.zeros_like(x))))
    return (words,) if words else ()


class Increase(NamedTuple):
    """What `increase_loads` found."""

    solved: Solved  # the last one, with the counts of all increments
    rate: np.ndarray | float  # ∂x/∂(factor on the loads) (n, 3) [m]
    # The system over the last increment, and what its terms remember after that.
    over: System
    history: History | None


def increase_loads(
    system: System,
    start: State,
    context: SolverContext,
    largest: float,
    loads: tuple[float, float] = (0.0, 1.0),
    rate: np.ndarray | float = 0.0,
    history: History | None = None,
    report: Callable[[Iteration], None] = lambda iteration: None,
) -> Increase:
    """Increase the factor on the loads from the first to the second of `loads`.

    `start` is the state at the first factor: in equilibrium, or the start of all where the factor
    is 0. No increment of the factor is larger than `largest`. `rate` is ∂x/∂(factor) at the start
    [m], as far as it is known, and `history` what the terms remember there. They remember each
    increment that is solved; an increment that is repeated in smaller ones begins with what they
    remembered before it.
    """
    x, (reached, end), increment, total = start.x, loads, largest, Counts()
    over = system
    while reached < end:
        to = reached + increment
        load = to if to < end - 1e-9 else end
        over = over_increment(system, reached, x, load - reached, history)
        equation = StaticEquation(over, start, load, load)
        moved, _ = system.constraints.target(reached, load - reached, x)
        guess = _towards(system, moved, (load - reached) * rate, load)
        try:
            solved = solve_static(equation, guess, context, report)
        except EquilibriumFailed as failure:
            increment /= 2
            if increment < SMALLEST * largest:
                reason = f"load stepping ended at {reached:.4g} of the loads: {failure.reason}"
                reached_state = State(start.t, x, np.zeros_like(x))
                args = failure.residual, reached_state, failure.remedy, reached
                raise EquilibriumFailed(reason, *args) from failure
            continue
        rate = (solved.x - x) / (load - reached)
        x, reached, total = solved.x, load, total.plus(solved.counts)
        history = over.commit(State(start.t, x, np.zeros_like(x)), history)
        if solved.counts.newton <= QUICK:
            increment = min(2 * increment, largest)
    return Increase(solved._replace(counts=total), rate, over, history)


def over_increment(
    system: System, t: float, x: np.ndarray, load: float, history: History | None
) -> System:
    """The system over an increment of the loads by `load` from x, for terms with a record."""
    return system.over_step(StepDifference.between(x, load, t), history, rates=False)


def _towards(system: System, x: np.ndarray, way: np.ndarray | float, t: float) -> np.ndarray:
    """x (n, 3) plus the way of free directions, or as much of it as contact allows."""
    way = system.constraints.project(np.broadcast_to(way, x.shape).copy())
    if not has_limits(system):
        return x + way
    return x + min(1.0, largest_step(system, x, way, t)) * way


def solve_static(
    equation: StaticEquation,
    x: np.ndarray,
    context: SolverContext,
    report: Callable[[Iteration], None] = lambda iteration: None,
) -> Solved:
    """Return x in equilibrium with the loads of the equation, the counts and the error left."""

    is_definite = False

    def tell(progress: Progress):
        nonlocal is_definite
        point, shift = progress.point, progress.remedy.shift
        is_definite = equation.system.symmetric and not shift
        relative = point.norm / point.scale if point.scale else 0.0
        report(Iteration(progress.number, relative, shift, progress.length, equation.load))
        _check_travel(equation, point, relative)

    left = ErrorInPlace(start=equation.start.x) if context.options.tolerance == "auto" else None
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


def _check_travel(equation: StaticEquation, point: Point, residual: float) -> None:
    """Raise `EquilibriumFailed` for a cloth that goes away, as nothing holds it."""
    way = (point.y - equation.start.x).mean(axis=0)
    distance = float(np.linalg.norm(way))
    if distance > FAR * equation.longest:
        towards = ", ".join(f"{c:.2g}" for c in way / distance)
        reason = f"nothing holds the cloth: it went {distance:.3g} m along ({towards})"
        kinds = {traits_of(term).kind for term in equation.system.terms}
        remedy = "Pin it, or take the load away." if kinds & {"membrane", ""} else NO_MEMBRANE
        raise equation.failure(reason, point, residual, remedy)
