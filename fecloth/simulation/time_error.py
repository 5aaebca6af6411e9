"""The error in time of a run: what is stated of it, by one of the estimates."""

import math
from dataclasses import dataclass

import numpy as np

from fecloth.linalg.reductions import rms
from fecloth.simulation.account import NEVER, Account, Accounts, End, Run
from fecloth.simulation.companion import Companion
from fecloth.simulation.deformation import MOTION_AT_REST
from fecloth.simulation.rigid_motion import rms_of_deformation
from fecloth.simulation.sampled_error import SampledError
from fecloth.simulation.steps import StepInfo
from fecloth.simulation.time_error_words import describe_time_error
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.records import remembered

ESTIMATES: dict[str, type[SampledError] | type[Companion]]
ESTIMATES = {"sampled": SampledError, "companion": Companion}
# Of a gap: so much a barrier gives way under the weight, and no place is sharper.
GAP_GIVEN_WAY = 0.1


@remembered
@dataclass(frozen=True, eq=False)
class TimeError(Account):
    """What is stated of the error in time of a run.

    It is the largest rms of the error of x over the run, weighted by mass, over the largest rms
    displacement, times the `safety` of the estimate; of the deformation the same without rigid
    motions. It is at most 1: then the steps do not resolve the motion, or small errors grow.
    There is none for a cloth at rest, after less than p + 1 steps, for a method that states no
    error constant, and by samples on several processes.

    Attributes
    ----------
    opening
        (n, 3) positions before the first step.
    start
        Time [s] and number of steps there.
    estimate
        `SampledError` or `Companion`; None where none is asked for.
    moved, deformed
        The largest rms displacement, and the largest without rigid motion [m].
    due
        Number of the step at which the estimate goes on.
    relative, relative_of_deformation
        At the end: what is stated, NaN without an estimate.
    sentence
        The same in words.
    unknown
        Why there is no estimate, or "".
    """

    name = "time_error"
    opening: np.ndarray
    start: tuple[float, int]
    estimate: SampledError | Companion | None
    moved: float = 0.0
    deformed: float = 0.0
    due: int = NEVER
    relative: float = math.nan
    relative_of_deformation: float = math.nan
    sentence: str = ""
    unknown: str = ""

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "TimeError":
        start = (run.start.t, run.step)
        if run.error_in_time not in ESTIMATES:
            return cls(run.start.x, start, None)
        estimate = ESTIMATES[run.error_in_time].begin(run)
        return cls(run.start.x, start, estimate, due=estimate.due)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "TimeError":
        """Return the record after a step: often the same object."""
        if info.step < self.due or self.estimate is None:
            return self
        after = self._looked(run.system, info.result.state)
        estimate = self.estimate.after(run, info, after.moved)
        return after.changed(estimate=estimate, due=estimate.due)

    def finish(self, run: Run, end: End, others: Accounts) -> "TimeError":
        """Return the record with the relative errors, or with why there are none."""
        if self.estimate is None:
            return self
        after = self._looked(run.system, end.state)
        unknown = self.estimate.unknown
        after = after.changed(unknown=unknown)
        whole, of_deformation = after.relative_errors(run.system)
        t, step = self.start
        dt = (end.state.t - t) / max(1, end.step - step)
        sentence = describe_time_error(whole, self.estimate, run.method, dt, unknown)
        return after.changed(
            relative=whole, relative_of_deformation=of_deformation, sentence=sentence
        )

    def summary(self) -> dict[str, object]:
        errors = {"time_error": self.relative, "deformation_error": self.relative_of_deformation}
        known = {key: None if math.isnan(error) else error for key, error in errors.items()}
        return {**known, "time_error_in_words": self.sentence}

    def relative_errors(self, system: System) -> tuple[float, float]:
        """Return what is stated of the whole motion and of the deformation, at most 1.

        Each is NaN where it is not known, or where nothing has moved or deformed.
        """
        estimate = self.estimate
        if estimate is None or self.unknown or not estimate.whole:
            return math.nan, math.nan
        at_rest = MOTION_AT_REST * system.cloth.extent
        gaps = (term.gap for term in system.bound if isinstance(term, BoundContact))
        still = max(at_rest, GAP_GIVEN_WAY * min(gaps, default=0.0))
        whole = deforming = math.nan
        if self.moved > still:
            whole = min(1.0, estimate.safety * estimate.whole / self.moved)
        if self.moved > still and self.deformed > at_rest:
            deforming = min(1.0, estimate.safety * estimate.deforming / self.deformed)
        return whole, deforming

    def _looked(self, system: System, state: State) -> "TimeError":
        mass = system.diagonal_mass
        return self.changed(
            moved=max(self.moved, rms(mass, state.x - self.opening)),
            deformed=max(self.deformed, rms_of_deformation(mass, self.opening, state.x)),
        )
