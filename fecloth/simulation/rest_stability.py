"""Whether an equilibrium is stable, by the least eigenvalue of its stiffness."""

import math
from dataclasses import dataclass
from typing import cast

from fecloth.nonlinear.eigenpairs import least_stiffness
from fecloth.nonlinear.increments import describe_path, resist_disturbances
from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.load_steps import LoadCourse
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

LEAVE_INSTABILITY = (
    'to find a stable one, bend the start: [start] mode = 1, amplitude = "1 mm" in a scene, or '
    "fc.modes(system, equilibrium).shapes[0] times a small factor, added to the start"
)


def doubt_stability(least: float, zero: float) -> list[Doubt]:
    """Return a doubt if the least eigenvalue of K [N/m] is below round-off, in a list."""
    if not least < -zero:
        return []
    words = (
        f"the equilibrium is unstable: the least eigenvalue of K is {least:.3g} N/m, so that a "
        "cloth which is disturbed leaves it"
    )
    return [Doubt(DoubtKind.INSTABILITY, words, LEAVE_INSTABILITY)]


def doubt_jumps(jumps: tuple[float, ...]) -> list[Doubt]:
    """Return a doubt if the cloth jumped, at these factors on the loads, in a list."""
    if not jumps:
        return []
    words = (
        f"at {jumps[0]:.3g} of the loads the cloth jumped to another branch of equilibria, so "
        "that more than one may be stable"
    )
    return [Doubt(DoubtKind.BRANCH, words, "compare other load_steps, and disturbed starts")]


@remembered
@dataclass(frozen=True)
class RestStability(Account):
    """The least eigenvalue of K on the free directions of an equilibrium.

    Attributes
    ----------
    least
        The eigenvalue [N/m]; NaN if it is not known.
    zero
        Size up to which it may be round-off [N/m].
    is_reached
        Whether the cloth has come to its equilibrium.
    path
        By `describe_path`.
    jumps
        Parts of the loads at which the cloth jumped to another branch.
    """

    name = "stability"
    least: float = math.nan
    zero: float = 0.0
    is_reached: bool = False
    path: str = ""
    jumps: tuple[float, ...] = ()

    @classmethod
    def of(cls, system: System, state: State, load_steps: int = 1) -> "RestStability":
        """Return the record of an equilibrium.

        The eigenvalue is NaN for a cloth that is held whole, or a stiffness that is not finite.
        """
        about = resist_disturbances(system, state, 1 / load_steps)
        least, zero = least_stiffness(about, state)
        return cls(least, zero, is_reached=True, path=describe_path(system, load_steps))

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "RestStability":
        memory = cast(LoadCourse, info.memory.method_memory)
        return self.changed(jumps=memory.course.jumps)

    def finish(self, run: Run, end: End, others: Accounts) -> "RestStability":
        if end.is_whole:
            rest = self.of(run.system, end.state, run.method.load_steps)
            return rest.changed(jumps=self.jumps)
        return self

    def words(self) -> str:
        if self.path:
            return f"{self._stability()}; {self.path}"
        return self._stability()

    def _stability(self) -> str:
        """Return whether the equilibrium is stable, in words."""
        if not self.is_reached:
            return "equilibrium: not reached"
        if math.isnan(self.least):
            return "equilibrium: not known whether it is stable"
        if abs(self.least) <= self.zero:
            return (
                "equilibrium: the least eigenvalue of K is 0 within round-off; there is a "
                "motion without stiffness"
            )
        kind = "stable" if self.least > 0 else "unstable"
        return f"equilibrium: {kind}; the least eigenvalue of K is {self.least:.4g} N/m"

    def doubts(self) -> list[Doubt]:
        return [*doubt_stability(self.least, self.zero), *doubt_jumps(self.jumps)]

    def summary(self) -> dict[str, object]:
        """Return the stability in the place of the error in time."""
        entries: dict[str, object] = {"time_error": None, "time_error_in_words": self.words()}
        if self.is_reached:
            entries["least_eigenvalue"] = None if math.isnan(self.least) else self.least
        return entries
