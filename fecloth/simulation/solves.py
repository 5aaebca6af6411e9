"""The iterations of a run, and how large the error of Newton's iteration is."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fecloth.nonlinear.statistics import SUMMED, describe_newton_error
from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.steps import StepInfo
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True)
class Solves(Account):
    """The equation solves of all steps.

    Attributes
    ----------
    steps
        Number of the steps.
    sums
        Sums over all steps of what their `Counts` say, by its name.
    doubt
        The doubt about the round-off of the iterations, at the end.
    """

    name = "solves"
    steps: int = 0
    sums: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(SUMMED, 0))
    doubt: Doubt | None = None

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Solves":
        counts = info.counts
        sums = {name: value + getattr(counts, name) for name, value in self.sums.items()}
        return Solves(self.steps + info.number, sums)

    def finish(self, run: Run, end: End, others: Accounts) -> "Solves":
        return self.changed(doubt=doubt_round_off(int(self.sums["limited"])))

    def doubts(self) -> list[Doubt]:
        if self.doubt:
            return [self.doubt]
        return []

    def words(self) -> str:
        return describe_newton_error(
            self.steps,
            int(self.sums["estimated"]),
            newton_error=self.sums["newton_error"],
            step_error=self.sums["step_error"],
        )

    def summary(self) -> dict[str, object]:
        return {"steps": self.steps, **self.sums, "newton_error_in_words": self.words()}


def doubt_round_off(steps: int) -> Doubt | None:
    """Return a doubt about this number of steps that round-off limited."""
    if not steps:
        return None
    many = f"{steps} steps were" if steps > 1 else "1 step was"
    words = f"{many} solved to round-off only, which is above Newton's tolerance"
    remedy = "ask for a greater tolerance, or take away what is stiff and small, such as slivers"
    return Doubt(DoubtKind.ROUND_OFF, words, remedy)
