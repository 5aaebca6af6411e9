"""`run`: march to the end and collect the energies, the probes' paths and the counts."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning
from fecloth.integrators.protocol import check_offers
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.statistics import Counts, describe_newton_error, warn_of_round_off
from fecloth.simulation.contact_words import describe_contact
from fecloth.simulation.doubts.before_run import find_warnings
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.energy_balance import Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import Memory, StepInfo, march, refuse_arguments
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.record_steps import (
    MOST_GROWTH,
    ROWS,
    check_rows,
    record_steps,
    rows_at_least,
    trial_recorder,
)
from fecloth.simulation.resolve import choose_steps, method_to_report, resolve
from fecloth.simulation.rest_stability import RestStability
from fecloth.simulation.surface_checks import Shape, intersection_warning
from fecloth.simulation.time_error import relative_error
from fecloth.simulation.time_error_words import find_doubts, name_time_error
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True, eq=False)
class Result:
    """What `run` collected.

    Attributes
    ----------
    state
        The last state.
    times
        (s + 1,) the start, and the ends of the steps that have rows [s].
    energies
        Column of the ledger → (s + 1,) [J]; see `Ledger`.
    observed
        Column → (s + 1,): probe paths, mean displacement, sag, area, reactions of the pins and
        obstacles, least distance from each obstacle.
    seconds
        Wall seconds by phase.
    newton, linear
        Iterations in all.
    solver
        The linear solver and why it was chosen.
    method
        The method of the steps: `Auto`'s choice; `StabilityLimited` for an explicit one without
        dt.
    shape
        The least and largest stretch, triangles turned over and pairs of triangles that intersect,
        at the end.
    warnings
        A sentence for each reason to doubt the result, such as an energy balance that was off
        (`Balance.warning`), also if it closes at the end.
    time_error
        Error of x in time, relative to the largest displacement, as far as the steps tell it:
        `TimeError`. From 0.3 on it says only that they do not resolve the motion. NaN where there
        is no estimate: see `relative_error`.
    space_error, space_error_reason
        Error of stress and moment in space at the end, relative, or NaN and why there is no
        estimate: see `space_error`.
    newton_error_in_words
        How large the error of Newton's iteration is against that in time, for the tolerance
        "auto"; "" where no step ended by this.
    steps
        Number of steps; there may be fewer rows, see `run`.
    contact_in_words
        How far the gap and the barrier of each obstacle keep the cloth off it, or "".
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
    shape: Shape
    warnings: tuple[str, ...] = ()
    time_error: float = math.nan
    space_error: float = math.nan
    space_error_reason: str = ""
    newton_error_in_words: str = ""
    steps: int = 0
    contact_in_words: str = ""

    @property
    def doubt(self) -> str:
        """The first of the warnings, or ""."""
        return self.warnings[0] if self.warnings else ""

    def __repr__(self) -> str:
        steps, t = self.steps, self.times[-1]
        remarks = [name_time_error(self.time_error)]
        remarks += [count_warnings(self.warnings)] if self.warnings else []
        return f"<Result of {steps} steps of {self.method} to t = {t:g} s, {', '.join(remarks)}>"

    def _repr_html_(self) -> str:
        """Return figures of the energies and the probes, for notebooks."""
        from fecloth.view.svg_chart import result_figures  # not needed to run

        return result_figures(repr(self), self.times, self.energies, self.observed)


def run(
    system: System,
    method,
    state: State,
    dt: float | Sequence[float] | None = None,
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
    rows: int = ROWS,
) -> Result:
    """March to `t_end` and return the last state with the energy ledger and the probes' paths.

    Arguments as for `march`; `report` is called after every step of which there is a row. A run of
    more steps than `rows` has about that many rows, evenly spread, and those that the error in time
    needs, where its steps can be fused: `CentralDifference` at a fixed or stable dt, with terms and
    pins that need no Python. The steps, and the sums in the ledger, are those of single steps.

    The run also fails after two rows in a row that deform with more kinetic energy than
    `most_growth` times what the start, the loads and the pins can have supplied
    (`Ledger.available`). Reasons to doubt the result, such as an error in time above 10 % or an
    energy balance that does not close, are in its `warnings` and come as a `FeclothWarning` each.

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
    check_rows(rows)
    validation.function("report", report, "lambda info: print(info.t)", "run")
    opening = replace(state, t=memory.start) if memory else state
    steps = choose_steps(method, dt)
    ends = steps.end_times(opening.t, t_end, stops)  # refuses wrong times
    end = float(ends[-1])
    known = system.with_history(memory.term_history) if memory else system
    ledger, observer = Ledger.open(known, state), Observer.bind(system, state, probes)
    record = trial_recorder(system, ledger, observer)
    steps, chosen, why = resolve(system, steps, opening, end, solver, newton, record)
    check_offers(steps.method, ("numerical",), "run")
    is_static = isinstance(steps, LoadSteps)
    foreseen = tuple(find_warnings(PlannedRun(system, opening, steps, ends, is_static)))
    for words in foreseen:
        warnings.warn(words, FeclothWarning, stacklevel=2)
    if memory is None:  # `march` checks and warns only without a memory
        steps.check_start(system, state)
    states = march(
        system,
        steps,
        state,
        None,
        t_end,
        stops=stops,
        solver=chosen,
        most_stretch=most_stretch,
        memory=memory or Memory(0, state.t, None),
    )
    result = collect(
        states,
        system,
        method_to_report(steps),
        ledger,
        observer,
        why,
        most_growth,
        report,
        foreseen,
        rows_at_least(rows, opening.t, end),
    )
    for words in result.warnings[len(foreseen) :]:
        warnings.warn(words, FeclothWarning, stacklevel=2)
    return result


def collect(
    steps: Iterable[tuple[State, StepInfo]],
    system: System,
    method,
    ledger: Ledger,
    observer: Observer,
    why: str,
    most_growth: float = MOST_GROWTH,
    report: Callable[[StepInfo], None] = lambda info: None,
    foreseen: tuple[str, ...] = (),
    next_row: Callable[[StepInfo], Wanted] | None = None,
) -> Result:
    """Take all steps of `march` and return what was recorded of them.

    Parameters
    ----------
    ledger, observer
        At the state before the first step.
    why
        The linear solver and why it was chosen, for the result.
    most_growth, report
        As for `run`.
    foreseen
        Warnings from before the first step; those of the steps follow them in the result.
    next_row
        As for `record_steps`.
    """
    state, balance, warned = observer.start, Balance.open(ledger), ""
    record, taken = None, 0
    energies, observed = [ledger.row()], [observer.row(None, None)]
    counts, begin = Counts(), time.perf_counter()
    static = isinstance(method, LoadSteps)
    growth = math.inf if static else most_growth
    records = record_steps(
        steps, system, method, ledger, observer, most_growth=growth, next_row=next_row
    )
    for record in records:
        state, ledger, balance = record.state, record.ledger, record.balance
        warned = warned or balance.warning(ledger)
        energies.append(ledger.row())
        observed.append(record.observed)
        counts, taken = counts.plus(record.info.counts), taken + record.info.number
        report(record.info)
    shape, error = Shape.of(system, state), math.nan
    inaccurate: tuple[str, ...] = ()
    if static:
        inaccurate = (RestStability.of(system, state).warning,)
    elif record:
        error = relative_error(record.time_error, system, method, state, record.info.step, ledger)
        dt = (state.t - record.time_error.start.t) / taken
        inaccurate = find_doubts(error, system, method, dt, balance, ledger)
    space = space_error(system, state)
    shares = counts.estimated, counts.newton_error, counts.step_error
    doubts = (
        warned or balance.warning(ledger, ended=True),
        warn_of_round_off(counts.limited),
        *inaccurate,
        intersection_warning(state.t, shape.intersecting, "at"),
    )
    return Result(
        state=state,
        times=np.array([row["t"] for row in energies]),
        energies=columns(energies),
        observed=columns(observed),
        seconds=counts.seconds | {"total": time.perf_counter() - begin},
        newton=counts.newton,
        linear=counts.linear,
        solver=why,
        method=method,
        shape=shape,
        warnings=(*foreseen, *filter(None, doubts)),
        time_error=error,
        space_error=space.relative,
        space_error_reason=space.reason,
        newton_error_in_words=describe_newton_error(taken, *shares),
        steps=taken,
        contact_in_words=describe_contact(system, observer.start, state),
    )


def count_warnings(sentences: Sequence[str]) -> str:
    """Return "no warnings", "1 warning" or "2 warnings"."""
    number = len(sentences)
    return f"{number or 'no'} warning{'' if number == 1 else 's'}"


def add_seconds(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
    """Add seconds by phase."""
    return {key: a.get(key, 0.0) + b.get(key, 0.0) for key in {**a, **b}}


def columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Return rows of equal keys as one array for each key."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0] if key != "t"}
