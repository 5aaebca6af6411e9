"""Where, and for how long, strains were beyond the last points of measured curves."""

from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

# Of the area of the cloth beyond a curve that is worth a doubt: less is a corner.
LEAST_AREA = 1e-3


@remembered
@dataclass(frozen=True)
class BeyondCurve(Account):
    """The largest part of the area that was beyond, and for how long, by steps with rows.

    Attributes
    ----------
    t
        Time of the last row [s].
    area
        Part of the area of the cloth.
    time
        For how long more than `LEAST_AREA` was beyond [s]; in load steps a part of the loads.
    doubt
        The doubt about it, at the end.
    """

    name = "beyond_curve"
    t: float
    area: float = 0.0
    time: float = 0.0
    doubt: Doubt | None = None

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "BeyondCurve":
        return cls(run.start.t)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "BeyondCurve":
        area = area_beyond(run.system, info.result.state)
        time = self.time
        if area > LEAST_AREA:
            time += info.t - self.t
        return self.changed(t=info.t, area=max(self.area, area), time=time)

    def finish(self, run: Run, end: End, others: Accounts) -> "BeyondCurve":
        unit = " of the loads" if isinstance(run.method, LoadSteps) else " s"
        return self.changed(doubt=doubt_curve(self.area, f", {self.time:.2g}{unit}"))

    def doubts(self) -> list[Doubt]:
        if self.doubt:
            return [self.doubt]
        return []

    def summary(self) -> dict[str, object]:
        if self.doubt:
            return {"beyond_curve": {"area": self.area, "time": self.time}}
        return {}


def area_beyond(system: System, state: State) -> float:
    """Return the part of the area where a strain is beyond its curve."""
    tables = [term for term in system.bound if term.has_curves]
    if not tables:
        return 0.0
    area = sum(term.beyond(state.x, state.t) for term in tables)
    return system.sums.total(area) / system.sums.total(system.cloth.area)


def doubt_curve(area: float, time: str = "") -> Doubt | None:
    """Return a doubt for this part of the area, None for less than a thousandth.

    `time` says for how long, after a comma; or "".
    """
    if area <= LEAST_AREA:
        return None
    words = (
        f"MembraneTable: strains are beyond the measured curve on {100 * area:.3g} % of the "
        f"area{time}: there it goes on with its last slope"
    )
    return Doubt(DoubtKind.CURVE, words, "measure farther, or load less")
