"""Which steps of a march go without Python between them, up to the next one that is wanted."""

import math
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fecloth.integrators.explicit import CentralDifference, LastForce
from fecloth.integrators.fused_steps import Flows, FusedSteps, Taken
from fecloth.integrators.protocol import StepChoice
from fecloth.integrators.step import Step
from fecloth.simulation.error_control import Adaptive, Control
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.stability_limited import (
    STEPS_BETWEEN_CHECKS,
    STRETCH_BEYOND,
    UPDATE_STEPS,
    LimitMemory,
    StabilityLimited,
)
from fecloth.simulation.step_times import SAME_TIME
from fecloth.simulation.steps import Place, Plan, StepInfo, find_problem, take
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.records import remembered

MOST = 2**14  # steps of a call: their times and the motion of pins are kept as arrays
ROWS = 1000  # of a run whose steps can be fused, if it has as many steps
CHECK_EVERY = 8  # explicit steps between two looks at the stretches
# The same of fused steps of one size, whose values are all finite at the end.
FUSED_CHECK_EVERY = 64


@remembered
@dataclass(frozen=True)
class Wanted:
    """The next step that a loop over `march` needs, by number or time, whichever comes first.

    Attributes
    ----------
    step
        Number of the step.
    t
        A time: the first step that ends at it or after it is needed [s].
    """

    step: int
    t: float = math.inf


@dataclass(frozen=True, eq=False)
class Skipped:
    """Steps that were taken without a stop.

    Attributes
    ----------
    number
        Number of the steps.
    state, memory
        The state and the memory of the method after them.
    step
        The step after them, if it is known too.
    flows
        What the energy ledger adds up over all of these.
    seconds
        Wall time.
    """

    number: int
    state: State
    memory: object
    step: Step | None
    flows: Flows
    seconds: float


def steps_with_skips(
    plan: Plan, place: Place, stops: Sequence[float], wanted: Wanted | None
) -> Generator[tuple[State, StepInfo], Wanted | None, tuple[Place, Wanted | None]]:
    """Take steps as `steps` does, and skip those that are not `wanted` where this is possible.

    What is wanted next comes by ``send``. Steps that end at a stop, or at the end, are yielded.
    Return the place at the end, and what is wanted next.
    """
    skipping = Skipping(plan.system, plan.method, plan.most_stretch, plan.targets, stops)
    while place.state.t < plan.t_end:
        memory = place.memory
        skipped = skipping.skip(place.state, memory.method_memory, memory.step, wanted)
        known = None
        if skipped:
            place = _after(plan, place, skipped)
            known = skipped.step
        place, info = take(plan, place, known)
        wanted = yield place.state, replace(info, skipped=skipped)
    return place, wanted


def _after(plan: Plan, place: Place, skipped: Skipped) -> Place:
    """Return the place after skipped steps."""
    number = place.memory.step + skipped.number
    memory = replace(place.memory, step=number, method_memory=skipped.memory)
    checked = place.checked
    if find_problem(plan, skipped.state, check_stretch=True) is None:
        checked = skipped.state
    return Place(skipped.state, memory, checked)


class Checks(NamedTuple):
    """When fused steps look at the stretches, and which principal stretches end them.

    Attributes
    ----------
    look
        Phase and period of the looks, in steps; see `FusedSteps.take`.
    least, largest
        Bounds of the principal stretches.
    """

    look: tuple[int, int]
    least: float
    largest: float


class Skipping:
    """The fused steps of one march.

    They are bound when a step is first skipped, and given up when they fail.
    """

    def __init__(
        self,
        system: System,
        steps: StepChoice,
        most_stretch: float,
        targets: np.ndarray,
        stops: Sequence[float],
    ):
        self.system = system
        self.steps = steps
        self.most_stretch = most_stretch
        self.targets = targets
        self.kept = np.flatnonzero(np.isin(targets, [*stops, targets[-1]]))  # never skipped
        self.fused: FusedSteps | None = None
        has_loop = isinstance(steps, FixedStep | StabilityLimited)
        if isinstance(steps, Adaptive):
            has_loop = steps.longest is None
        self.is_open = has_loop and type(steps.method) is CentralDifference

    def skip(
        self, state: State, memory: object, number: int, wanted: Wanted | None
    ) -> Skipped | None:
        """Take the steps before the `wanted` one; None where it is near or steps need Python.

        `state` and `memory` are left by the step of this `number`.
        """
        if wanted is None or wanted.step <= number + 1 or not self.is_open:
            return None
        if memory is None:  # the first step of a method makes its memory
            return None
        place = int(np.searchsorted(self.targets, state.t, side="right"))
        if place == len(self.targets):
            return None
        if isinstance(memory, Control):
            return self._skip_below_tolerance(state, memory, number, wanted)
        if isinstance(memory, LimitMemory):
            chosen = state.t + memory.dt
        else:
            chosen = self.targets[place]
        if wanted.t <= chosen:
            return None  # the next step is wanted
        self.fused = self.fused or FusedSteps.bind(self.system)
        if self.fused is None:
            self.is_open = False
            return None
        stop = self.kept[np.searchsorted(self.kept, place)]
        targets = self.targets[place : stop + 1]
        try:
            return self._take(self.fused, state, memory, number, targets, wanted)
        except FloatingPointError:
            self.is_open = False  # single steps will tell where they fail
            return None

    def _skip_below_tolerance(
        self, state: State, control: Control, number: int, wanted: Wanted
    ) -> Skipped | None:
        """Take stable steps, as `skip` does, where `Adaptive` would allow longer ones.

        Only the error of the last one is estimated. It decides on the steps that follow.
        """
        if not control.is_at_limit:
            return None
        skipped = self.skip(state, control.method_memory, number, wanted)
        if skipped is None:
            return None
        assert isinstance(skipped.memory, LimitMemory)
        last = skipped.memory.method_memory
        assert isinstance(last, LastForce)
        a = self.system.constraints.project(last.a.copy())
        left = replace(control, a=a, t=last.at.t, method_memory=skipped.memory)
        step = skipped.step
        if step:
            assert isinstance(self.steps, Adaptive)
            after = self.steps.control_after(self.system, skipped.state, step, left)
            step = replace(step, memory=after)
        return replace(skipped, memory=left, step=step)

    def _take(
        self,
        fused: FusedSteps,
        state: State,
        memory: object,
        number: int,
        targets: np.ndarray,
        wanted: Wanted,
    ) -> Skipped | None:
        """Take steps of one size, up to the last of the targets; None if there are too few.

        `state` and `memory` are left by step `number`, and `targets` the times at which steps
        must end, up to one that must not be skipped. Raises `FloatingPointError` if they end
        beyond all bounds; single steps will tell where.
        """
        begin = time.perf_counter()
        most = min(wanted.step - number, MOST)
        if isinstance(memory, LimitMemory):
            times = self._chosen_times(state, memory, targets[0], most)
            sizes = np.full(len(times) - 1, memory.dt)
            last = memory.method_memory
        else:
            times = np.concatenate([[state.t], targets[:most]])
            sizes = np.diff(times)
            last = memory
        count = min(_equal(sizes), 1 + int(np.searchsorted(times[1:], wanted.t)))
        if count <= 1:  # a call for a single step saves nothing
            return None
        assert isinstance(last, LastForce)
        checks = self._checks(memory, number)
        taken = fused.take(state, last, times[: count + 1], sizes[:count], *checks)
        if taken is None or not (isinstance(memory, LimitMemory) or taken.step):
            raise FloatingPointError("fused steps end beyond all bounds")
        left, step = _memories_after(memory, taken)
        seconds = time.perf_counter() - begin
        return Skipped(taken.number, taken.state, left, step, taken.flows, seconds)

    def _checks(self, memory: object, number: int) -> Checks:
        """Return the checks of fused steps after step `number`, which has left the `memory`."""
        if isinstance(memory, LimitMemory):
            return Checks(
                look=(memory.steps % STEPS_BETWEEN_CHECKS, STEPS_BETWEEN_CHECKS),
                least=memory.least / STRETCH_BEYOND,
                largest=min(self.most_stretch, memory.largest * STRETCH_BEYOND),
            )
        look = (number % FUSED_CHECK_EVERY, FUSED_CHECK_EVERY)
        return Checks(look, least=0.0, largest=self.most_stretch)

    def _chosen_times(
        self, state: State, limited: LimitMemory, target: float, most: int
    ) -> np.ndarray:
        """Begin and ends of the steps of one size before the limit is computed again."""
        most = min(most, UPDATE_STEPS - limited.steps)
        none = np.array([state.t])
        if most <= 0:
            return none
        is_due = limited.steps % STEPS_BETWEEN_CHECKS == 0
        if is_due and limited.is_exceeded(*extreme_stretches(self.system.cloth, state.x)):
            return none
        dt = limited.dt
        times = np.add.accumulate(np.concatenate([none, np.full(most, dt)]))
        is_shortened = np.ceil((target - times[:-1]) / dt - SAME_TIME) <= 2  # see `fit_step`
        return times[: 1 + int(np.argmax(np.append(is_shortened, True)))]


def _memories_after(memory: object, taken: Taken) -> tuple[object, Step | None]:
    """Return the memory after fused steps, and the step after them with its memory."""
    if not isinstance(memory, LimitMemory):
        return taken.memory, taken.step
    number = memory.steps + taken.number
    left = replace(memory, steps=number, method_memory=taken.memory)
    if taken.step is None:
        return left, None
    after = replace(memory, steps=number + 1, method_memory=taken.step.memory)
    return left, replace(taken.step, memory=after)


def _equal(sizes: np.ndarray) -> int:
    """Return the number of the first sizes that differ by round-off only."""
    if not len(sizes):
        return 0
    unlike = np.abs(sizes - sizes[0]) > SAME_TIME * sizes[0]
    return int(np.argmax(np.append(unlike, True)))
