"""`run` marches and collects: the ledger, the probes' paths, the counts."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning
from fecloth.integrators.protocol import check_offers
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.energy_ledger import Ledger, doubt, slight
from fecloth.simulation.march import Memory, Problem, StepInfo, march, refuse_arguments, step_failed
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.resolve import settled
from fecloth.simulation.step_times import targets_of
from fecloth.system.system import State, System

MOST_GROWTH = 4.0  # of the kinetic energy that there can be: no usable step has shown more


@dataclass(frozen=True, eq=False)
class Result:
    """What `run` collected.

    Attributes
    ----------
    state
        The last state.
    times
        (s + 1,) start and the end of every step [s].
    energies
        Column of the ledger → (s + 1,) [J]; see `Ledger`.
    observed
        Column → (s + 1,): probe paths, mean displacement, sag, area, reactions of the pins.
    seconds
        Wall seconds by phase.
    newton, linear
        Iterations in all.
    solver
        The linear solver and why it was chosen.
    method
        What took the steps; `Auto`'s choice, and an explicit method's steps without dt.
    doubt
        In words that the energy balance does not close, or "": see `record.doubt`.
    """

    state: State
    times: np.ndarray
    energies: dict[str, np.ndarray]
    observed: dict[str, np.ndarray]
    seconds: dict[str, float]
    newton: int
    linear: int
    solver: str
    method: object
    doubt: str = ""

    def __repr__(self) -> str:
        steps, t = len(self.times) - 1, self.times[-1]
        remark = ", energy balance in doubt" if self.doubt else ""
        return f"<Result of {steps} steps of {self.method} to t = {t:g} s{remark}>"

    def _repr_html_(self) -> str:
        """Return figures of the energies and the probes, for notebooks."""
        from fecloth.view.notebook import result_figures  # not needed to run

        return result_figures(repr(self), self.times, self.energies, self.observed)


def run(
    system: System,
    method,
    state: State,
    dt: float | None = None,
    t_end: float | None = None,
    *,
    stops: Sequence[float] = (),
    probes: Sequence[Probe] = (),
    solver: str = "auto",
    newton: Newton | None = None,
    most_stretch: float = 20.0,
    most_growth: float = MOST_GROWTH,
    memory: Memory | None = None,
    report: Callable[[StepInfo], None] = lambda info: None,
) -> Result:
    """March to `t_end` and return the last state with the energy ledger and the probes' paths.

    Arguments as for `march`; `report` is called after every step. A step after which the cloth
    has more kinetic energy than `most_growth` times what its start, its loads and its pins can
    have given (`Ledger.available`) has failed too. Where the energy balance does not close, the
    result says so in `doubt`, and a `FeclothWarning` does.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    >>> result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=0.005, t_end=0.05)
    >>> len(result.times), bool(abs(result.energies["remainder"][-1]) < 1e-3)
    (11, True)
    """
    refuse_arguments(system, method, state, newton, most_stretch)
    validation.number("most_growth", most_growth, 0.0, "run", infinite=True)
    validation.function("report", report, "lambda info: print(info.t)", "run")
    opening = replace(state, t=memory.start) if memory else state
    targets_of(method, opening.t, dt, t_end, stops)  # refuse them before anything else
    ledger, observer = Ledger.open(system, state), Observer.bind(system, state, probes)

    def record(one, old, step):
        return ledger.after(system, one, old, step).row(), observer.row(old, step)

    method, chosen, why = settled(system, method, opening, dt, t_end, solver, newton, record)
    check_offers(method, ("numerical",), "run")
    energies, observed = [ledger.row()], [observer.row(None, None)]
    counts, begin, start, turnover = Counts(), time.perf_counter(), state.t, 0.0
    options = {"stops": stops, "most_stretch": most_stretch, "memory": memory}
    for new, info in march(system, method, state, dt, t_end, solver=chosen, **options):
        state, ledger = new, balanced(system, method, ledger, info, most_growth)
        turnover = max(turnover, ledger.turnover)
        energies.append(ledger.row())
        observed.append(observer.row(info.old, info.result))
        counts = counts.plus(info.counts)
        report(info)
    seconds = counts.seconds | {"total": time.perf_counter() - begin}
    times = np.array([row["t"] for row in energies])
    if doubted := doubt(system, ledger, turnover, start):
        warnings.warn(doubted, FeclothWarning, stacklevel=2)
    kept = columns(energies), columns(observed), seconds, counts.newton, counts.linear
    return Result(state, times, *kept, why, method, doubted)


def balanced(
    system: System, method, ledger: Ledger, info: StepInfo, most: float = MOST_GROWTH
) -> Ledger:
    """The ledger after a step; a `StepFailed` where this and the last one had too much energy.

    One alone may: a load that sets in has given momentum before it has worked.
    """
    after = ledger.after(system, method, info.old, info.result)
    noise = _noise(system, info)
    grown = [one.kinetic > noise and one.growth(most) for one in (ledger, after)]
    if all(grown):
        raise step_failed(system, info.old, info.step, info.dt, Problem(grown[1]))
    return after


def _noise(system: System, info: StepInfo) -> float:
    """Kinetic energy [J] that tells nothing.

    `record.slight`, or ½ m (64 ε |x|/dt)² if that is more, which the round-off of positions makes.
    """
    speed = 64 * np.finfo(float).eps * np.abs(info.result.state.x).max() / info.dt
    rounded = 0.5 * float(system.nodal_mass.sum()) * speed**2
    return max(rounded, slight(system, info.t - info.memory.start))


def add_seconds(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
    """Seconds by phase, summed."""
    return {key: a.get(key, 0.0) + b.get(key, 0.0) for key in {**a, **b}}


def columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Rows of equal keys as one array for each key."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0] if key != "t"}
