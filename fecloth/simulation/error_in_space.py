"""The error in space at the end of a run."""

import math
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.accepted import accepts_element, join_accepted
from fecloth.system.space_error import name_space_error, space_error
from fecloth.system.system import System
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

LOCKED = 0.2  # the error of a buckled strip on P1 "cross" whose energy is 5 % too large
LOCKING = (
    "P1 triangles are too stiff where they bend and cannot stretch (they lock), most of all with "
    'the pattern "cross": take '
)


@remembered
@dataclass(frozen=True)
class ErrorInSpace(Account):
    """The error of stress and moment, see `space_error`.

    Attributes
    ----------
    relative
        The relative error; NaN for no estimate.
    reason
        Why there is no estimate, or "".
    remedy
        What to do, or "".
    """

    name = "space_error"
    relative: float = math.nan
    reason: str = ""
    remedy: str = ""

    def finish(self, run: Run, end: End, others: Accounts) -> "ErrorInSpace":
        error = space_error(run.system, end.state)
        remedy = error.remedy or remedy_of_locking(run.system, error.relative)
        return ErrorInSpace(error.relative, error.reason, remedy)

    def words(self) -> str:
        return name_space_error(self.relative, self.reason, self.remedy)

    def summary(self) -> dict[str, object]:
        error = None if math.isnan(self.relative) else self.relative
        return {"space_error": error, "space_error_in_words": self.words()}


def remedy_of_locking(system: System, relative: float) -> str:
    """Return what a cloth can take whose elements may lock, with this error in space; or ""."""
    may_lock = system.cloth.element == "P1" and has_kind(system.terms, "bending")
    if may_lock and relative > LOCKED:
        others = {"P2": accepts_element(system, "P2"), "a smaller h": True}
        return LOCKING + join_accepted(others)
    return ""
