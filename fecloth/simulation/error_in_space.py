"""The error in space at the end of a run."""

import math
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.accepted import accepts_element, join_accepted
from fecloth.system.space_error import name_space_error, space_error
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

LOCKED = 0.2  # the error of a buckled strip on P1 "cross" whose energy is 5 % too large
LOCKING = (
    "; P1 triangles are too stiff where they bend and cannot stretch (they lock), most of all "
    'with the pattern "cross": take '
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
    may_lock
        Whether the elements are P1, and the cloth resists bending.
    remedy
        What such a cloth can take.
    """

    name = "space_error"
    relative: float = math.nan
    reason: str = ""
    may_lock: bool = False
    remedy: str = "a smaller h"

    def finish(self, run: Run, end: End, others: Accounts) -> "ErrorInSpace":
        system = run.system
        error = space_error(system, end.state)
        may_lock = system.cloth.element == "P1" and has_kind(system.terms, "bending")
        remedy = join_accepted({"P2": accepts_element(system, "P2"), "a smaller h": True})
        return ErrorInSpace(error.relative, error.reason, may_lock, remedy)

    def words(self) -> str:
        words = name_space_error(self.relative, self.reason)
        if self.may_lock and self.relative > LOCKED:
            return words + LOCKING + self.remedy
        return words

    def summary(self) -> dict[str, object]:
        error = None if math.isnan(self.relative) else self.relative
        return {"space_error": error, "space_error_in_words": self.words()}
