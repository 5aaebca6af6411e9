"""Static equilibrium: positions at which the forces of all terms balance, f(x, v = 0, t) = 0."""

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, InputError, is_number
from fecloth.nonlinear import increments
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.eigenpairs import least_stiffness
from fecloth.quantities.arguments import checks_arguments
from fecloth.simulation.beyond_curve import area_beyond, doubt_curve
from fecloth.simulation.doubts.before_run import OF_EQUILIBRIA, find_doubts
from fecloth.simulation.doubts.doubt import NOTE, Doubt, warnings_of
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.units import refuse_start_in_other_units
from fecloth.simulation.doubts.unseen import find_missed_by_load_steps
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.rest_stability import doubt_jumps, doubt_stability
from fecloth.system.arguments import check_system
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class Equilibrium(State):
    """A `State` in equilibrium, and how it was found.

    Attributes
    ----------
    t
        Time of the loads and of the pins [s].
    x
        (n, 3) positions [m].
    v
        (n, 3) velocities [m/s], zero.
    history
        Records that terms keep, of a state from which a run shall go on with them, as
        `equilibrium` leaves it; see `System.start_history`. None: they begin anew.
    residual
        ‖f‖ of the free directions over Σ ‖f_term‖ of all; 0 where no force exceeds its
        round-off.
    iterations
        Newton iterations of all load steps together.
    factorisations
        Factorisations of all load steps together.
    reason
        Why the iteration ended, a sentence.
    space_error
        The estimated relative error in space: see `space_error`.
    space_error_reason
        Why there is none, or "".
    solver_error
        The estimated error [m] that the iteration left in x; NaN where it is not
        estimated.
    doubts
        Reasons to doubt it, such as an equilibrium that is unstable.
    """

    residual: float
    iterations: int
    factorisations: int
    reason: str
    space_error: float = math.nan
    space_error_reason: str = ""
    solver_error: float = math.nan
    doubts: tuple[Doubt, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts that spoil an answer, in words: a sentence each."""
        return warnings_of(self.doubts)

    @property
    def state(self) -> Self:
        """Itself, so that ``result.state`` is the end of a run and of an equilibrium alike."""
        return self

    def __repr__(self) -> str:
        return f"<Equilibrium of {len(self.x)} nodes at t = {self.t:g} s: {self.reason}>"


@checks_arguments
def equilibrium(
    system: System,
    state: State,
    *,
    load_steps: int | None = None,
    friction: Literal["laid", "shaken"] = "laid",
    tolerance: float | Literal["auto"] = "auto",
    max_iterations: int = 500,
    solver: str = "direct",
    report: increments.Report = lambda iteration: None,
) -> Equilibrium:
    """The equilibrium that Newton's iteration reaches from `state`, at the loads of its time.

    Each iteration solves (K + σ M) s = f with the tangent K = −∂f/∂x of all terms. σ is zero
    where K is positive definite and its step is an improvement: near the solution the
    convergence is quadratic. Elsewhere each term's tangent is made positive semi-definite, and
    σ grows until the step is an improvement (after Nocedal and Wright 2006, Numerical
    Optimization, algorithm 3.3): a flat cloth without stress has no stiffness across, and σ M
    stands in for it. The length of a step is chosen by `fecloth.nonlinear.line_search`, with
    its sources; `nonlinear.iteration` has what helps a wrinkled sheet, the watchdog technique
    (Chamberlain et al. 1982) and truncated Newton. No node moves by more than the extent of
    the cloth in one iteration.

    A compressed cloth has many equilibria, and the start decides which one is found; a flat
    start without any load across stays flat. If the last `Iteration` had a shift, the tangent is
    not positive definite near the solution: it may be unstable, or not the only one around.

    Parameters
    ----------
    system, state
        What is to be balanced and where to start; its velocity is not used.
    load_steps
        None: the loads act at once, as at the time of `state`, and pins hold their nodes where
        `state` has them, slides their held directions: a start for a run. A number n, as in
        `[equilibrium]` of a scene: the forces of the loads, which are `Gravity`, `Pressure`,
        `Gas`, `Wind`, `EdgeForce`, `PointForce`, `UserForce` and every term that says `load =
        True`, are multiplied by λ = 1/n, 2/n, …, 1, each solved from where the line through the
        last two solutions leads. λ is also the time t at which motions of pins and obstacles are
        evaluated, so that a specimen is drawn from t = 0 to 1, with n = 1 at once. Where that
        fails, or leads to another branch of equilibria, the increment of λ is halved, down to
        1/64 of the first; after a solution in at most 8 iterations it doubles again, up to 1/n.
        A jump to another branch that halving does not avoid is among the `doubts`. With
        friction the result depends on this path, and `reason` says so: in each increment
        friction acts against the way along the surface since the solution before. Load steps
        serve loads that turn the cloth far, and give the states between. With
        `BendingFriction` there are at least 20 steps; for None the time stays as in `state`.
    friction
        Of `BendingFriction`. "laid": as the loads grow. "shaken": then its moments sink to
        zero in ten more steps, and the elastic equilibrium is left, beside which a cloth rests
        that is shaken.
    tolerance
        A number: on ‖f‖ of the free directions over Σ ‖f_term‖ of all directions at the same
        positions; the forces on what the pins hold are the reactions. "auto": the iteration
        ends where the error left in the positions is below 1e-6 of the largest displacement
        since the start and the residual below 1e-9, or where both are as small as round-off
        allows. The error is estimated from the last two corrections, if Newton's steps were
        whole and shrank. Where the tangent is not definite the residual alone decides.
    max_iterations
        Of each load step, and four times as many with friction; beyond it the step has failed.
    solver
        "direct", "pardiso", "rslab" or "superlu".
    report
        Called with each `Iteration`.

    Returns
    -------
    Equilibrium
        A `State` with v = 0, and the residual, iterations, factorisations, reason, and the
        estimated `solver_error` [m] that is left in x. It has the t of `state`, or t = 1 where
        load steps have moved pins or obstacles: a run then goes on with their motion at t = 1.
        An unstable equilibrium is among its `doubts`, beside doubts about units, terms and
        pins, which `run` has too; each comes as a `FeclothWarning`.

    Raises
    ------
    EquilibriumFailed
        If the tolerance is not met: the cloth moves away as nothing holds it, the iteration
        ends before (the message says how many triangles are slack, the usual cause), or the
        round-off of the forces is greater than a number that was given (the message says which
        tolerance can be met). Its `state` is the best one. A cloth on which no force exceeds
        its round-off is in equilibrium.

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
    validation.one_of("friction", friction, ("laid", "shaken"), "equilibrium")
    system = system.after(state.t)
    start = State(state.t, state.x.copy(), np.zeros_like(state.x))
    least = max((term.load_steps for term in system.bound), default=1)
    number = max(load_steps or 1, least)
    planned = PlannedRun(system, start, LoadSteps(number), np.ones(1))
    checks = OF_EQUILIBRIA
    if load_steps:  # else pins and obstacles stand still
        checks = (*checks, find_missed_by_load_steps)
    foreseen = tuple(find_doubts(planned, checks))
    _warn(foreseen)
    context = increments.static_context(system, tolerance, max_iterations, solver)
    jumps: tuple[float, ...] = ()
    if load_steps is None and least == 1:
        solved, history = _solve_at_once(system, start, context, report)
    else:
        time_of_terms = None if load_steps else start.t
        increase = increments.increase_loads(
            system,
            start,
            context,
            1 / number,
            history=system.start_history(start),
            report=report,
            at=time_of_terms,
        )
        if friction == "shaken":
            increase = increments.shake(increase, context, report)
        solved = increase.solved
        jumps = increase.course.jumps
        history = increase.history
    still = np.zeros_like(solved.x)
    error = space_error(system, State(start.t, solved.x, still))
    end = State(1.0 if load_steps else start.t, solved.x, still)
    noticed = [*_find_instability(system, end, number, solved), *doubt_jumps(jumps)]
    if beyond := doubt_curve(area_beyond(system, end)):
        noticed.append(beyond)
    _warn(noticed)
    t = start.t
    if load_steps and increments.moves(system):
        t = 1.0
    reason = solved.reason(tolerance)
    if path := increments.describe_path(system, number):
        reason = f"{reason}; {path}"
    return Equilibrium(
        t=t,
        x=solved.x,
        v=still,
        history=history,
        residual=solved.counts.residual,
        iterations=solved.counts.newton,
        factorisations=solved.counts.factorisations,
        reason=reason,
        space_error=error.relative,
        space_error_reason=error.reason,
        solver_error=solved.error,
        doubts=(*foreseen, *noticed),
    )


def _solve_at_once(
    system: System, start: State, context: SolverContext, report: increments.Report
) -> tuple[increments.Solved, History | None]:
    """Return the equilibrium under the whole loads at the time of `start`, and its history."""
    history = system.start_history(start)
    whole = increments.LoadIncrement(system, start, 1.0, 1.0, start.t, start.t, history)
    solved, over = increments.solve_increment(whole, None, context, report)
    return solved, over.commit(replace(start, x=solved.x), history)


def _warn(doubts: Iterable[Doubt]) -> None:
    """Warn of each doubt that is no note, at the line that calls `equilibrium`."""
    for doubt in doubts:
        if doubt.kind.label != NOTE:
            warnings.warn(str(doubt), FeclothWarning, stacklevel=4)


def _check(system, state, load_steps, tolerance, max_iterations, solver, report):
    """Raise `InputError` for an argument of `equilibrium` that it cannot take."""
    check_system(system, state, "equilibrium")
    refuse_start_in_other_units(system.cloth, state.x, "equilibrium")
    validation.function(
        "report", report, "lambda iteration: print(iteration.residual)", "equilibrium"
    )
    if tolerance != "auto" and not (is_number(tolerance) and 1e-13 <= tolerance < 1):
        allowed = 'must lie in [1e-13, 1), or be "auto"'
        raise InputError(f"tolerance = {tolerance!r}", allowed, "equilibrium")
    for name, value in (("max_iterations", max_iterations), ("load_steps", load_steps)):
        if value is not None:
            validation.whole(name, value, 1, "equilibrium")
    if solver not in ("direct", "pardiso", "rslab", "superlu"):
        allowed = "must be direct, pardiso, rslab or superlu"
        raise InputError(f"solver = {solver!r}", allowed, "equilibrium")


def _find_instability(system: System, end: State, load_steps: int, solved) -> list[Doubt]:
    """Return a doubt if the stiffness at the end is not positive definite, in a list.

    Its least eigenvalue is computed only where the solve has not shown that it is.
    """
    if solved.is_definite:
        return []
    about = increments.resist_disturbances(system, end, 1 / load_steps)
    return doubt_stability(*least_stiffness(about, end))
