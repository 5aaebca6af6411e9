"""`run`: march to the end and collect the energies, the probes' paths and the counts."""

import math
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, StepFailed, amount
from fecloth.integrators.protocol import check_offers
from fecloth.nonlinear.options import Newton
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.simulation import record_steps as recording
from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.answer import Answer, answer_quantities, places_of
from fecloth.simulation.beyond_curve import BeyondCurve
from fecloth.simulation.contact import Contact
from fecloth.simulation.defined_in_time import refuse_undefined
from fecloth.simulation.doubts.before_run import find_doubts
from fecloth.simulation.doubts.doubt import NOTE, Doubt, warnings_of
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.energy_balance import MOST_GROWTH, Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.error_in_space import ErrorInSpace
from fecloth.simulation.fused_march import ROWS, Wanted
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import march, refuse_arguments
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.simulation.resolve import choose_steps, method_to_report, resolve
from fecloth.simulation.rest_stability import RestStability
from fecloth.simulation.shapes import Shape, Shapes
from fecloth.simulation.solves import Solves
from fecloth.simulation.step_times import with_releases
from fecloth.simulation.steps import Memory, StepInfo
from fecloth.simulation.time_error import ESTIMATES, TimeError
from fecloth.simulation.time_error_words import name_time_error
from fecloth.simulation.verdict import Verdict
from fecloth.system.state import State
from fecloth.system.system import System

AT_END = (BeyondCurve, ErrorInSpace, Shapes)
IN_TIME: tuple[type[Account], ...] = (
    Balance,
    Solves,
    Contact,
    TimeError,
    Verdict,
    *AT_END,
)
STATIC: tuple[type[Account], ...] = (
    Balance,
    Verdict,
    Solves,
    RestStability,
    Contact,
    *AT_END,
)


def list_accounts(is_static: bool) -> tuple[type[Account], ...]:
    """Return what a run accounts for beside the ledger, in time or to an equilibrium."""
    if is_static:
        return STATIC
    return IN_TIME


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
        Column → (s + 1,): probe paths, mean displacement, sag (greatest fall since the
        start), area, reactions of the pins and obstacles, least distance from each
        obstacle.
    seconds
        Wall seconds by phase.
    solver
        The linear solver and why it was chosen.
    method
        The method of the steps: `Auto`'s choice; `StabilityLimited` for an explicit one
        without dt.
    doubts
        Reasons to doubt the result, such as an energy balance that is off (`Balance`), and
        notes.
    accounts
        What the run accounts for, at its end.
    quantities
        The answers, by the texts of the quantities: the values of [interest] of the scene, or
        without [interest] the places of the probes at the end. A run that has not reached its
        end has no answers: {}.
    """

    state: State
    times: np.ndarray
    energies: dict[str, np.ndarray]
    observed: dict[str, np.ndarray]
    seconds: dict[str, float]
    solver: str
    method: object
    doubts: tuple[Doubt, ...]
    accounts: Accounts
    quantities: Mapping[str, Answer] = field(default_factory=dict)

    @property
    def figures(self) -> dict[str, object]:
        """The figures of all accounts, by their keys in summary.json."""
        return self.accounts.summary()

    @property
    def steps(self) -> int:
        """Number of steps; there may be fewer rows, see `run`."""
        return self.accounts[Solves].steps

    @property
    def newton(self) -> int:
        """Newton iterations in all."""
        return int(self.accounts[Solves].sums["newton"])

    @property
    def linear(self) -> int:
        """Iterations of the linear solver in all."""
        return int(self.accounts[Solves].sums["linear"])

    @property
    def time_error(self) -> float:
        """What the error of x in time is at most, relative to the largest displacement.

        1 says only that the steps do not resolve the motion, or that small errors grow. NaN
        where there is no estimate: see `TimeError`.
        """
        error = self.accounts.get(TimeError)
        return error.relative if error else math.nan

    @property
    def deformation_error(self) -> float:
        """What the error of the deformation in time is at most, relative to the deformation.

        Error and deformation are the largest root mean squares over the run, both without rigid
        motions. 1 and NaN are as for `time_error`.
        """
        error = self.accounts.get(TimeError)
        return error.relative_of_deformation if error else math.nan

    @property
    def space_error(self) -> float:
        """Relative error of stress and moment in space at the end, or NaN: see `space_error`."""
        return self.accounts[ErrorInSpace].relative

    @property
    def space_error_reason(self) -> str:
        """Why there is no estimate of the error in space, or ""."""
        return self.accounts[ErrorInSpace].reason

    @property
    def newton_error_in_words(self) -> str:
        """How large the error of Newton's iteration is against the error in time.

        For the tolerance "auto"; "" where no step ended by it.
        """
        return self.accounts[Solves].words()

    @property
    def contact_in_words(self) -> str:
        """How far the gap and the barrier of each obstacle keep the cloth off it, or ""."""
        return self.accounts[Contact].words()

    @property
    def shape(self) -> Shape:
        """Stretches, triangles turned over and pairs of triangles that intersect, at the end."""
        shape = self.accounts[Shapes].at_end
        assert shape
        return shape

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts that spoil an answer, in words: a sentence each."""
        return warnings_of(self.doubts)

    def __repr__(self) -> str:
        steps = amount(self.steps, "step")
        t = self.times[-1]
        remarks = [name_time_error(self.time_error)]
        if self.warnings:
            remarks.append(amount(len(self.warnings), "warning"))
        return f"<Result of {steps} of {self.method} to t = {t:g} s, {', '.join(remarks)}>"

    def _repr_html_(self) -> str:
        from fecloth.view.charts import result_figures  # not needed to run

        return result_figures(repr(self), self.times, self.energies, self.observed)


@checks_arguments
def run(
    system: System,
    method,
    state: State,
    dt: Annotated[float | Sequence[float] | None, TIME] = None,
    t_end: Annotated[float | None, TIME] = None,
    *,
    stops: Annotated[Sequence[float], TIME] = (),
    probes: Sequence[Probe | str] = (),
    solver: str = "auto",
    newton: Newton | None = None,
    most_stretch: float = 20.0,
    most_growth: float = MOST_GROWTH,
    memory: Memory | None = None,
    report: Callable[[StepInfo], None] = lambda info: None,
    rows: int = ROWS,
    time_error: str = "sampled",
) -> Result:
    """March to `t_end` and return the last state with the energy ledger and the probes' paths.

    The other arguments are as for `march`.

    A run has a row for each step. Where its steps can be fused, a run of more steps than `rows`
    has about that many rows, evenly spread, and the rows that the error in time needs. This is
    so for `CentralDifference` at a fixed or stable dt, with terms and pins that need no Python.
    The steps, and the sums in the ledger, are the same as with single steps.

    The error in time is estimated from samples of the run (`time_error` "sampled", see
    `SampledError`), or by a second run beside it ("companion", see `Companion`), which costs
    about as much as the run again and also tells what becomes of small errors that grow; or
    not at all ("none").

    The run also fails after two rows in a row that deform with more kinetic energy than
    `most_growth` times what the start, the loads and the pins have supplied (see `Balance`).
    The `StepFailed` of a run that fails has its `result` so far, without the accounts of its
    end. Reasons to doubt the result are its `doubts`. Doubts that spoil an answer are its
    `warnings`: for example an error in time above 10 %, or an energy balance that does not close.
    Each warning is issued as a `FeclothWarning`, and so is a likely mistake in the set-up.

    Raises
    ------
    InputError, StepFailed
        As `march`; also for a run that makes energy, as above.

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
    validation.whole("rows", rows, 1, "run")
    validation.known(f"time_error = {time_error!r}", time_error, (*ESTIMATES, "none"), "run")
    validation.function("report", report, "lambda info: print(info.t)", "run")
    opening = state
    if memory:
        opening = replace(state, t=memory.start)
    steps = choose_steps(method, dt)
    stops = with_releases(system, steps, opening.t, t_end, stops)
    ends = steps.end_times(opening.t, t_end, stops)  # refuses wrong times
    end = float(ends[-1])
    records = memory.term_history if memory else system.start_history(state)
    known = system.with_history(records)
    ledger = Ledger.open(known, state)
    observer = Observer.bind(system, state, probes)
    steps, chosen, why = resolve(system, steps, opening, end, solver, newton, stops)
    check_offers(steps.method, ("numerical",), "run")
    planned = PlannedRun(system, opening, steps, ends)
    refuse_undefined(planned)
    foreseen = tuple(find_doubts(planned))
    _warn(foreseen)
    if memory is None:  # `march` checks and warns only without a memory
        steps.check_start(system, state)
    before = memory or Memory(0, state.t, None)
    states = march(
        system,
        steps,
        state,
        t_end=t_end,
        stops=stops,
        solver=chosen,
        most_stretch=most_stretch,
        memory=before,
    )
    result = collect(
        states,
        system,
        method_to_report(steps),
        ledger,
        observer,
        why,
        end,
        most_growth=most_growth,
        report=report,
        foreseen=foreseen,
        next_row=recording.rows_at_least(rows, opening.t, end),
        step=before.step,
        interest=places_of(probes),
        time_error=time_error,
    )
    _warn(result.doubts[len(foreseen) :])
    return result


def _warn(doubts: Iterable[Doubt]) -> None:
    """Warn of each doubt that is no note, at the line that calls `run`."""
    for doubt in doubts:
        if doubt.kind.label != NOTE:
            warnings.warn(str(doubt), FeclothWarning, stacklevel=4)


def collect(
    steps: Iterable[tuple[State, StepInfo]],
    system: System,
    method,
    ledger: Ledger,
    observer: Observer,
    why: str,
    t_end: float,
    most_growth: float = MOST_GROWTH,
    report: Callable[[StepInfo], None] = lambda info: None,
    foreseen: tuple[Doubt, ...] = (),
    next_row: Callable[[StepInfo], Wanted] | None = None,
    step: int = 0,
    interest: Iterable[Quantity] = (),
    measured: Mapping[str, tuple[float, float]] | None = None,
    time_error: str = "sampled",
) -> Result:
    """Take all steps of `march` and return what was recorded of them.

    The ledger and the observer are at the state before the first step, of the number `step` + 1.
    `why` is the linear solver and why it was chosen, `foreseen` are the doubts from before the
    first step, and `t_end` is the end of the run [s]. `interest` and `measured` are as for
    `answer_quantities`. The other arguments are as for `run` and `record_steps`.
    """
    begin = time.perf_counter()
    seconds = Counter[str]()
    of_run = Run(system, method, observer.start, step, most_growth, t_end, time_error)
    kinds = list_accounts(is_static=isinstance(method, LoadSteps))
    accounts = Accounts.begin(kinds, of_run, ledger)
    state = observer.start
    rows = [accounts.rows(observer.row(None, None))]
    raised = list[Doubt]()

    def result_so_far() -> Result:
        return Result(
            state=state,
            times=np.array([row["energies"]["t"] for row in rows]),
            energies=columns([row["energies"] for row in rows]),
            observed=columns([row["observed"] for row in rows]),
            seconds={**seconds, "total": time.perf_counter() - begin},
            solver=why,
            method=method,
            doubts=(*foreseen, *raised),
            accounts=accounts,
        )

    try:
        for record in recording.record_steps(steps, of_run, observer, accounts, next_row):
            state = record.state
            of_run = record.run
            accounts = record.accounts
            step = record.info.step
            raised += accounts.new_doubts(raised)
            if not record.info.is_part:
                rows.append(record.rows)
            seconds.update(record.info.counts.seconds)
            report(record.info)
    except StepFailed as failure:
        failure.result = result_so_far()
        raise
    accounts = accounts.finish(of_run, End(state, step))
    raised += accounts.new_doubts(raised)
    result = result_so_far()
    whole = record_of(observer, state, result.times, result.energies, result.observed)
    answers = answer_quantities(interest, whole, accounts, measured or {})
    return replace(result, quantities=answers)


def record_of(
    observer: Observer,
    end: State,
    times: np.ndarray,
    energies: Mapping[str, np.ndarray],
    observed: Mapping[str, np.ndarray],
) -> RunRecord:
    """Return what the quantities of a run are computed from.

    `observer` is at its start and `end` is its last state; the columns have a row for each of
    the `times`.
    """
    return RunRecord(
        times=times,
        columns={**energies, **observed},
        cloth=observer.system.cloth,
        fields={"displacement": end.x - observer.start.x, "velocity": end.v},
        probes=tuple(observer.probes),
        energies=energies.keys(),
    )


def columns(rows: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
    """Return rows of equal keys as one array for each key."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0] if key != "t"}
