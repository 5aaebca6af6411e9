"""Why a step has failed, beyond what the step itself can know: the cause, and what to do."""

import math
from dataclasses import replace

from fecloth.errors import StepFailed
from fecloth.integrators.protocol import StepChoice
from fecloth.simulation.doubts.jumps import find_jumping_motions
from fecloth.simulation.no_room import name_no_room
from fecloth.simulation.shorter_steps import name_shorter_steps
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.simulation.step_times import SMALLER
from fecloth.system.system import System

COLLAPSED = (
    "Its steps are at the stability limit, which fell faster than they follow, as where a cloth "
    "collapses: take an implicit method, or a term that prevents the collapse."
)
ELSEWHERE = "Lead the pins, or the obstacles, elsewhere, or end earlier."
STEPS_BACK = 2  # before a step that failed, whose jumps are looked for: they can act later


def explain(failure: StepFailed, system: System, method: StepChoice) -> StepFailed:
    """Return the failure with its cause, where pins or obstacles have caused it.

    They leave the cloth no room, or they jump. Without such a cause, a step that should be
    shorter gets the remedy for the method that took it.
    """
    assert failure.step is not None
    assert failure.t is not None
    assert failure.dt is not None
    reason = failure.reason
    residual = failure.residual
    remedy = failure.remedy
    unit = failure.unit
    is_solved = failure.__cause__ is None
    if remedy == SMALLER:
        at_limit = is_solved and isinstance(method, StabilityLimited)
        remedy = COLLAPSED if at_limit else f"Take {name_shorter_steps(method)}."
    if not is_solved:
        longest = max(failure.dt, method.dt or 0.0)
        if words := name_no_room(system, failure.state, longest):
            reason = words
            residual = math.nan
            remedy = ELSEWHERE
            unit = " s"
    start = replace(failure.state, t=failure.t - failure.dt * min(STEPS_BACK, failure.step - 1))
    jumps = find_jumping_motions(system, start, failure.t + failure.dt)
    if jumps:
        largest = max(jumps, key=lambda jump: jump.size)
        words = str(largest.doubt)
        remedy = f"{words[0].upper()}{words[1:]}."
    return StepFailed(
        reason,
        step=failure.step,
        t=failure.t,
        dt=failure.dt,
        residual=residual,
        stretch=failure.stretch,
        triangle=failure.triangle,
        state=failure.state,
        remedy=remedy,
        unit=unit,
    )
