"""The error in time of a run by a companion: the same run with other steps, beside it."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from fecloth.errors import StepFailed
from fecloth.integrators.protocol import method_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import Run
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.march import march
from fecloth.simulation.resolve import solver_for
from fecloth.simulation.rigid_motion import rms_without_rigid
from fecloth.simulation.steps import Memory, StepInfo
from fecloth.system.state import State
from fecloth.terms.records import remembered

FEWEST_LOOKS = 50  # of an explicit run


@remembered
@dataclass(frozen=True, eq=False)
class Companion:
    """A second run that takes each pair of steps of the run as one step.

    The steps of explicit methods cannot grow: there the companion halves each of them. So it
    does where a double step cannot be solved. The largest distance of both runs is the error
    that is stated. It is not divided by 2^p − 1 for a method of order p, as in Richardson's
    extrapolation: steps that do not resolve a part of the motion have no order.

    Attributes
    ----------
    state, memory
        Where the companion is, and what it continues from.
    is_odd
        Whether the run is one step ahead.
    whole, deforming
        The largest rms distance so far, and without its rigid part [m].
    due
        Number of the step at which it goes on.
    kicked, unknown
        As of `SampledError`.
    """

    safety: ClassVar[float] = 1.0

    state: State
    memory: Memory
    is_odd: bool = False
    whole: float = 0.0
    deforming: float = 0.0
    due: int = 0
    kicked: float = math.inf
    unknown: str = ""

    @classmethod
    def begin(cls, run: Run) -> "Companion":
        """Return the companion before the first step."""
        history = run.system.start_history(run.start)
        return cls(run.start, Memory(run.step, run.start.t, None, term_history=history))

    def after(self, run: Run, info: StepInfo, moved: float) -> "Companion":
        """Return the companion after a step of the run, when it has caught up with each pair."""
        if self.unknown:
            return self
        explicit = run.method.traits.explicit
        lets_go = info.t in run.system.releases
        is_last = info.t >= run.t_end
        if not (explicit or self.is_odd or lets_go or is_last):
            return replace(self, is_odd=True, due=info.step + 1)
        size = info.t - self.state.t
        if explicit or not self.is_odd:
            size = info.dt / 2
        try:
            after = self._marched(run, info.t, size)
        except StepFailed as failure:
            return replace(self, unknown=f"the run with other steps failed: {failure}")
        if lets_go:
            memory = replace(after.memory, method_memory=None)
            after = replace(after, memory=memory)
        due = info.step + 1
        if explicit:
            due = info.step + math.ceil((run.t_end - run.start.t) / FEWEST_LOOKS / info.dt)
        return replace(after.compared(run, info.result.state), due=due)

    def _marched(self, run: Run, t: float, size: float) -> "Companion":
        """Return the companion at the time t [s], after steps of about this size [s]."""
        method = method_of(run.method)
        count = max(1, round((t - self.state.t) / size))
        steps = FixedStep(method, (t - self.state.t) / count)
        solver, _ = solver_for(run.system, method, size)
        ways = march(
            run.system,
            steps,
            self.state,
            t_end=t,
            solver=solver,
            most_stretch=math.inf,
            memory=replace(self.memory, start=self.state.t),
            wanted=Wanted(self.memory.step + count, t),
        )
        *_, (state, info) = ways
        return replace(self, state=state, memory=info.memory, is_odd=False)

    def compared(self, run: Run, state: State) -> "Companion":
        """Return the companion with its distance from the state of the run."""
        mass = run.system.diagonal_mass
        apart = self.state.x - state.x
        return replace(
            self,
            whole=max(self.whole, rms(mass, apart)),
            deforming=max(self.deforming, rms_without_rigid(mass, state.x, apart)),
        )
