"""Where, and for how long, strains were beyond the last points of measured curves."""

from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

LEAST = 1e-3  # of the area: less is a corner, and no warning


@remembered
@dataclass(frozen=True)
class BeyondCurve(Account):
    """The largest part of the area that was beyond, and for how long, by steps with rows."""

    name = "beyond_curve"
    t: float  # [s] of the last row
    area: float = 0.0
    time: float = 0.0  # [s], or part of the loads
    doubt: str = ""  # at the end

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "BeyondCurve":
        return cls(run.start.t)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "BeyondCurve":
        area = area_beyond(run.system, info.result.state)
        time = self.time + (info.t - self.t if area > LEAST else 0.0)
        return self.changed(t=info.t, area=max(self.area, area), time=time)

    def finish(self, run: Run, end: End, others: Accounts) -> "BeyondCurve":
        unit = " of the loads" if isinstance(run.method, LoadSteps) else " s"
        return self.changed(doubt=words_beyond(self.area, f", {self.time:.2g}{unit}"))

    def summary(self) -> dict[str, object]:
        if self.doubt:
            return {"beyond_curve": {"area": self.area, "time": self.time}}
        return {}


def area_beyond(system: System, state: State) -> float:
    """The part of the area where a strain is beyond its curve."""
    tables = [term for term in system.bound if term.has_curves]
    area = sum(term.beyond(state.x, state.t) for term in tables)
    if tables:
        return system.sums.total(area) / system.sums.total(system.cloth.area)
    return 0.0


def words_beyond(area: float, time: str = "") -> str:
    """A warning, or "" for less than a thousandth of the area."""
    words = f"beyond the measured curve on {100 * area:.3g} % of the area{time}"
    advice = "there it goes on with its last slope; measure farther, or load less"
    if area > LEAST:
        return f"MembraneTable: strains are {words}: {advice}"
    return ""
