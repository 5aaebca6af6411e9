"""`march`: what is chosen before the first step, and the steps with their explanations."""

import math
import warnings
from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, InputError, StepFailed
from fecloth.integrators import protocol
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation.doubts.before_run import OF_MARCH, find_doubts
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.units import refuse_start_in_other_units
from fecloth.simulation.fused_march import CHECK_EVERY, Wanted, steps_with_skips
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.resolve import choose_steps, resolve
from fecloth.simulation.step_failures import explain
from fecloth.simulation.step_history import StepHistory
from fecloth.simulation.step_times import targets_after, with_releases
from fecloth.simulation.steps import Memory, Place, Plan, StepInfo, steps
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System


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
        "auto", "direct", "pardiso", "rslab", "superlu", "pcg", "multigrid", or a `SolverContext`
        made by `solver_for`.
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
        beyond `most_stretch`; its `state` is the last one that was checked.

    Warns
    -----
    FeclothWarning
        Before the first step of a new march, of pins and obstacles whose motion jumps.
    """
    refuse_arguments(system, method, state, newton, most_stretch)
    if memory is not None:
        validation.instance("memory", memory, Memory, "info.memory of a step", "march")
    begin = memory or Memory(0, state.t, None)
    chosen = choose_steps(method, dt)
    stops = with_releases(system, chosen, begin.start, t_end, stops)
    targets = targets_after(chosen.end_times(begin.start, t_end, stops), state.t)
    if memory and isinstance(chosen, Auto):
        raise InputError("memory with Auto()", "needs the method that Auto chose", "march")
    opening = replace(state, t=begin.start)
    taker, context, _ = resolve(system, chosen, opening, float(targets[-1]), solver, newton, stops)
    if not memory:  # a continued march has passed these checks
        taker.check_start(system, state)
        for doubt in find_doubts(PlannedRun(system, state, taker, targets), OF_MARCH):
            warnings.warn(str(doubt), FeclothWarning, stacklevel=2)
    records = begin.term_history or system.start_history(state)
    protocol.check_history(system, taker, records)
    plan = Plan(
        system=system,
        method=taker,
        solver=context,
        targets=targets,
        first=begin.step + 1,
        most_stretch=most_stretch,
        check_every=CHECK_EVERY if taker.traits.explicit else 1,
    )
    place = Place(state, replace(begin, term_history=records), checked=state)
    yield from _through_releases(plan, place, stops, wanted)


def _through_releases(
    plan: Plan, place: Place, stops: Sequence[float], wanted: Wanted | None
) -> Generator[tuple[State, StepInfo], Wanted | None, None]:
    """Take the steps of a plan, with the pins that hold in each of them.

    Where a pin lets go, the method and the solver begin anew, with the positions, the velocities
    and the records of the terms.
    """
    while place.state.t < plan.t_end:
        t = place.state.t
        system = plan.system.after(t)
        if t in plan.system.releases:
            memory = replace(place.memory, method_memory=None, history=StepHistory())
            place = replace(place, memory=memory)
            plan.solver.drop()
        end = min([*system.releases[:1], plan.t_end])
        count = 1 + int(np.searchsorted(plan.targets, end))
        phase = replace(plan, system=system, targets=plan.targets[:count])
        try:
            if place.memory.term_history:  # a term that keeps a history needs each step
                place = yield from steps(phase, place)
            else:
                place, wanted = yield from steps_with_skips(phase, place, stops, wanted)
        except StepFailed as failure:
            raise explain(failure, system, plan.method) from failure.__cause__


def refuse_arguments(
    system: System, method, state: State, newton: Newton | None, most_stretch: float
) -> None:
    """Raise `InputError` for arguments that are swapped, of a wrong type or of another cloth."""
    protocol.check_method(method)
    check_system(system, state, "march")
    protocol.check_terms(system, method, "march")
    if newton is not None:
        validation.instance("newton", newton, Newton, "Newton(tolerance=1e-8)", "march")
    validation.number("most_stretch", most_stretch, 1.0, "march", infinite=True)
    if math.isfinite(most_stretch):
        refuse_start_in_other_units(system.cloth, state.x, "march")
