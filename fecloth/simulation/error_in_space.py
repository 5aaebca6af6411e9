"""The error in space at the end of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.system.space_error import name_space_error, space_error
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True)
class ErrorInSpace(Account):
    """The error of stress and moment, see `space_error`."""

    name = "space_error"
    relative: float = math.nan
    reason: str = ""  # why there is no estimate

    def finish(self, run: Run, end: End, others: Accounts) -> ErrorInSpace:
        error = space_error(run.system, end.state)
        return ErrorInSpace(error.relative, error.reason)

    def words(self) -> str:
        return name_space_error(self.relative, self.reason)

    def summary(self) -> dict[str, object]:
        error = None if math.isnan(self.relative) else self.relative
        return {"space_error": error, "space_error_in_words": self.words()}
