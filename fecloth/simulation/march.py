"""The only loop over time: a generator of states."""

import math
import warnings
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, InputError, SolveFailed, StepFailed
from fecloth.integrators import protocol
from fecloth.integrators.step import Step
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.statistics import Counts
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation.doubts.before_run import OF_MARCH, find_doubts
from fecloth.simulation.doubts.jumps import find_jumping_motions
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.fused_march import CHECK_EVERY, Skipped, Skipping, Wanted
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.no_room import name_no_room
from fecloth.simulation.resolve import choose_steps, resolve
from fecloth.simulation.stability_limited import remedy_for_growth
from fecloth.simulation.step_history import StepHistory, needs_history
from fecloth.simulation.step_times import EARLIER, coarse_clock, targets_after
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.kinematics import largest_stretch, principal_stretches
from fecloth.terms.records import remembered

ELSEWHERE = "Lead the pins, or the obstacles, elsewhere, or end earlier."
BACK = 2  # steps before one that failed, whose jumps are looked for: they can act later


@remembered
@dataclass(frozen=True, eq=False)
class Memory:
    """The data, beside the state, from which `march` continues bit for bit."""

    step: int  # steps so far
    start: float  # time at which the first of them began [s]
    method_memory: object  # `Step.memory` of the last step
    # what Newton's iteration knows of the last steps
    history: StepHistory = field(default_factory=StepHistory)
    term_history: History | None = None  # `Step.history` of the last step


@dataclass(frozen=True, eq=False)
class StepInfo:
    """One step of `march` and its figures."""

    step: int  # number, from 1
    old: State  # the state before it
    result: Step  # of the method
    memory: Memory  # continues `march` from here
    skipped: Skipped | None = None  # the steps since the one yielded before; see `Wanted`
    is_part: bool = False  # whether it is a part of a step of dt, which was divided as it failed

    @property
    def t(self) -> float:
        return self.result.state.t

    @property
    def dt(self) -> float:
        """The size of the step [s], by the times of its states."""
        return self.t - self.old.t

    @property
    def counts(self) -> Counts:
        """Newton and linear iterations, relative residual, seconds of assembly and solve."""
        if self.skipped is None:
            return self.result.counts
        return Counts(seconds={"force": self.skipped.seconds}).plus(self.result.counts)

    @property
    def size(self) -> float:
        """The size [s] for which the method was asked, which differs from `dt` by round-off."""
        return self.result.size or self.dt

    @property
    def number(self) -> int:
        """Of the steps since the one yielded before."""
        return 1 + (self.skipped.number if self.skipped else 0)


@checks_arguments
def march(
    system: System,
    method,
    state: State,
    dt: Annotated[float | Sequence[float] | None, TIME] = None,
    t_end: Annotated[float | None, TIME] = None,
    *,
    stops: Annotated[Sequence[float], TIME] = (),
    solver: str | SolverContext = "auto",
    newton: Newton | None = None,
    most_stretch: float = 20.0,
    memory: Memory | None = None,
    wanted: Wanted | None = None,
) -> Generator[tuple[State, StepInfo], Wanted | None, None]:
    """Step from `state` to `t_end` and yield each new state with its `StepInfo`.

    A consumer that does not need each state says by ``send(Wanted(step, t))`` which it needs
    next; the steps before it are then taken in one compiled call where terms and pins allow
    it, with the same bits. Steps that end at a stop or at `t_end` are always yielded.

    Parameters
    ----------
    system, method, state
        What moves, the integrator, and the start; the pins start from where `state` has them.
    dt
        Step [s]. All steps are dt, except that steps before a stop or `t_end` are shortened to
        end there. A list or an array has the size of each step; then `t_end` may be left out,
        and the stops must be ends of steps. None for `Adaptive`, which chooses its steps, and
        for explicit methods, which then take 0.9 of their largest stable step
        (`StabilityLimited`).
    t_end, stops
        End time, and times between at which a step must end [s].
    solver
        "auto", "direct", "pardiso", "superlu", "pcg", "multigrid", or a `SolverContext` made by
        `solver_for`.
    newton
        Options of the nonlinear solve.
    most_stretch
        A step that leaves a triangle stretched by more has failed, so that a blow-up ends
        before its numbers overflow. Looked at after each implicit step, each eighth explicit
        one and, of steps taken in one call, each 64th.
    memory
        `StepInfo.memory` of an earlier march with the same arguments, which goes on from its
        state: bit for bit, if that called `SolverContext.drop` at this step.
    wanted
        The first step that the consumer of a continued march needs, as by ``send``.

    Raises
    ------
    InputError
        For a dt or t_end that makes no step, or an explicit dt beyond the stability limit.
    StepFailed
        If a step does not converge, makes a value that is not finite or stretches a triangle
        beyond `most_stretch`; its `state` is the last one that was found good.

    Warns
    -----
    FeclothWarning
        Before the first step of a new march, of pins and obstacles whose motion jumps.
    """
    refuse_arguments(system, method, state, newton, most_stretch)
    begin = memory or Memory(0, state.t, None)
    resumed = memory is not None
    steps = choose_steps(method, dt)
    targets = targets_after(steps.end_times(begin.start, t_end, stops), state.t)
    if resumed and isinstance(steps, Auto):
        raise InputError("memory with Auto()", "needs the method that Auto chose", "march")
    opening = replace(state, t=begin.start)
    steps, solver, _ = resolve(system, steps, opening, float(targets[-1]), solver, newton)
    if not resumed:  # a continued march has passed these checks
        steps.check_start(system, state)
        for doubt in find_doubts(PlannedRun(system, state, steps, targets), OF_MARCH):
            warnings.warn(str(doubt), FeclothWarning, stacklevel=2)
    check_every = CHECK_EVERY if steps.traits.explicit else 1
    records = begin.term_history or system.start_history(state)
    protocol.check_history(system, steps, records)
    number = begin.step
    last_memory = begin.method_memory
    good = state
    history = begin.history
    is_informed = needs_history(solver)
    system.constraints.expect(targets)
    fused = Skipping(system, steps, most_stretch, targets, stops)
    while state.t < targets[-1]:
        if records:
            skipped = None
        else:
            skipped = fused.skip(state, last_memory, number, wanted)
        if skipped:
            state = skipped.state
            last_memory = skipped.memory
            number += skipped.number
            if _problem(system, state, most_stretch, True):
                good = good
            else:
                good = state
        target = targets[np.searchsorted(targets, state.t, side="right")]
        number = number + 1
        horizon = target - state.t
        if is_informed:
            solver = history.inform(solver, system, steps.traits, state)
        try:
            known = skipped.step if skipped else None
            result = known or protocol.take_step(
                steps, system, state, horizon, solver, last_memory, records
            )
        except (NewtonFailed, SolveFailed) as failure:
            problem: Any = failure
            if words := name_no_room(system, state, max(horizon, steps.dt or 0.0)):
                problem = Problem(words, remedy=ELSEWHERE)
            raise step_failed(system, state, number, horizon, problem) from failure
        if number == begin.step + 1:
            protocol.check_step(result, protocol.method_of(steps))
        new = _snap_to_target(result.state, target, horizon)
        taken = new.t - state.t
        last = new.t == targets[-1]
        if new.t < target and (words := coarse_clock(new.t, taken)):
            raise step_failed(system, good, number, taken, Problem(words, remedy=EARLIER))
        if problem := _problem(system, new, most_stretch, number % check_every == 0 or last):
            problem = replace(problem, remedy=remedy_for_growth(steps))
            raise step_failed(system, good, number, taken, problem)
        good = new if number % check_every == 0 else good
        if is_informed:
            history = history.after(system, steps.traits, state, new)
        after = Memory(number, begin.start, result.memory, history, result.history)
        result = result if new is result.state else replace(result, state=new)
        is_part = steps.dt is not None and new.t < target
        info = StepInfo(number, state, result, after, skipped, is_part)
        state = new
        last_memory = result.memory
        records = result.history
        wanted = yield state, info


def refuse_arguments(system, method, state, newton, most_stretch):
    """Raise `InputError` for arguments that are swapped, of a wrong type or of another cloth."""
    protocol.check_method(method)
    check_system(system, state, "march")
    protocol.check_terms(system, method, "march")
    if newton is not None:
        validation.instance("newton", newton, Newton, "Newton(tolerance=1e-8)", "march")
    validation.number("most_stretch", most_stretch, 1.0, "march", infinite=True)


def _snap_to_target(state, target, horizon):
    """Return the state with t exactly at the target if it differs by round-off only."""
    differs = 0.0 < abs(target - state.t) <= 1e-9 * horizon
    return replace(state, t=target) if differs else state


def _problem(system, state, most_stretch, check_stretch):
    if not (np.isfinite(state.x).all() and np.isfinite(state.v).all()):
        return Problem("a position or velocity is not finite")
    stretch = largest_stretch(system.cloth, state.x) if check_stretch else 0.0
    if stretch <= most_stretch:
        return None
    return Problem(f"a triangle is stretched to {stretch:.3g} times, beyond {most_stretch:g}")


@dataclass(frozen=True)
class Problem:
    """The reason of a failed step, with the attributes of `NewtonFailed`."""

    reason: str
    residual: float = math.nan
    remedy: str = "Take a smaller dt."


def step_failed(system: System, state: State, number: int, dt: float, cause) -> StepFailed:
    """Return the error, with the most strained triangle of the last good state."""
    stretches = principal_stretches(system.cloth, state.x)
    strains = np.abs(np.log(np.maximum(stretches, 1e-300)))
    triangle, which = np.unravel_index(np.argmax(strains), strains.shape)
    remedy = getattr(cause, "remedy", "Take a smaller dt.")
    before = replace(state, t=state.t - dt * min(BACK, number - 1))
    if jumps := find_jumping_motions(system, before, state.t + dt):
        words = str(max(jumps, key=lambda jump: jump.size).doubt)
        remedy = f"{words[0].upper()}{words[1:]}."
    return StepFailed(
        getattr(cause, "reason", str(cause)),
        step=number,
        t=state.t,
        dt=dt,
        residual=getattr(cause, "residual", math.nan),
        stretch=float(stretches[triangle, which]),
        triangle=int(triangle),
        state=state,
        remedy=remedy,
        unit=getattr(cause, "unit", " s"),
    )
