"""Recording of each step for `run`, `fecloth run` and `fecloth check`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import InputError
from fecloth.simulation.energy_balance import ROUND_OFF, Balance
from fecloth.simulation.energy_ledger import Ledger, negligible_energy
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.march import Problem, StepInfo, step_failed
from fecloth.simulation.probes import Observer
from fecloth.simulation.time_error import NEVER, TimeError
from fecloth.system.state import State
from fecloth.system.system import System

LATE = 1.5  # times the distance of rows: the most by which two are apart
ROWS = 1000  # of a run whose steps can be fused
MOST_GROWTH = 4.0  # times the energy available: every usable step so far had less


@dataclass(frozen=True, eq=False)
class Record:
    """A step with its recorded quantities.

    Attributes
    ----------
    state, info
        As `march` yields them.
    ledger
        After the step.
    observed
        Row of the probes and the other observed quantities.
    balance, time_error
        Of the steps so far.
    seconds
        Wall time of the recording.
    """

    state: State
    info: StepInfo
    ledger: Ledger
    observed: dict[str, float]
    balance: Balance
    time_error: TimeError
    seconds: float


def record_steps(
    steps: Iterable[tuple[State, StepInfo]],
    system: System,
    method,
    ledger: Ledger,
    observer: Observer,
    balance: Balance | None = None,
    time_error: TimeError | None = None,
    *,
    most_growth: float = MOST_GROWTH,
    next_row: Callable[[StepInfo], Wanted] | None = None,
) -> Iterator[Record]:
    """Yield a `Record` for each step of `march`.

    Parameters
    ----------
    ledger, balance, time_error
        Before the first of these steps; None stands for an unstarted run.
    most_growth
        See `run`.
    next_row
        Says which step must be recorded next; those between may be left out. None: each.

    Raises
    ------
    StepFailed
        If two steps in a row deform with more kinetic energy than `most_growth` times what is
        available.
    """
    balance = balance or Balance.open(ledger)
    steps = iter(steps)
    taken = next(steps, None)
    while taken is not None:
        state, info = taken
        begin = time.perf_counter()
        time_error = time_error or TimeError.open(info.old, info.step - 1, ledger)
        ledger = update_ledger(system, method, ledger, info, most_growth)
        balance = balance.after(system, ledger, info.number)
        observed = observer.row(info.old, info.result)
        time_error = time_error.after(system, method, info, ledger)
        so_far = balance, time_error
        yield Record(state, info, ledger, observed, *so_far, time.perf_counter() - begin)
        taken = _advance(steps, info, next_row, time_error.due)


def _advance(steps, info: StepInfo, next_row: Callable[[StepInfo], Wanted] | None, due: int):
    """Return the next recorded step, or None.

    The step `due` for the error in time is always one, and takes the place of a row that is wanted
    shortly before.
    """
    if next_row is None or not isinstance(steps, Generator):
        return next(steps, None)
    wanted = next_row(info)
    if info.step + LATE * (wanted.t - info.t) / info.dt >= due:
        wanted = replace(wanted, t=math.inf)
    with suppress(StopIteration):
        return steps.send(replace(wanted, step=min(wanted.step, due)))
    return None


def check_rows(rows: object) -> None:
    """Raise `InputError` for what is no number of rows."""
    if not isinstance(rows, int) or isinstance(rows, bool) or rows < 1:
        raise InputError(f"rows = {rows!r}", "must be a whole number >= 1", "run")


def rows_at_least(rows: int, start: float, t_end: float) -> Callable[[StepInfo], Wanted]:
    """Return the rule by which a run has about that many `rows`, or one for each step if fewer."""
    spacing = (1 - 1e-6) * (t_end - start) / rows

    def next_row(info: StepInfo) -> Wanted:
        return Wanted(NEVER, info.t + spacing)

    return next_row


def trial_recorder(system: System, ledger: Ledger, observer: Observer) -> Callable:
    """Return ``record(method, old, step)``, which does the work of recording a trial step.

    `Auto` predicts the cost of a run with it.
    """

    def record(method, old, step):
        return ledger.after(system, method, old, step).row(), observer.row(old, step)

    return record


def update_ledger(
    system: System, method, ledger: Ledger, info: StepInfo, most: float = MOST_GROWTH
) -> Ledger:
    """Return the ledger after a step.

    Raise `StepFailed` if two steps in a row exceed the energy available. One step may: a load
    switched on transfers momentum before it has done work.
    """
    flows = info.skipped.flows if info.skipped and info.skipped.step else None
    after = ledger.after(system, method, info.old, info.result, flows)
    if info.skipped and flows is None:
        after = after.with_flows(info.skipped.flows)
    noise = _noise(system, info, after.kinetic)
    growths = [each.growth(most) if each.deforming > noise else "" for each in (ledger, after)]
    if all(growths):
        raise step_failed(system, info.old, info.step, info.dt, Problem(growths[1]))
    return after


def _noise(system: System, info: StepInfo, kinetic: float) -> float:
    """Kinetic energy [J] below which growth means nothing.

    `negligible_energy` or, if that is more, ½ m (64 ε |x|/dt)² and 64 ε of the kinetic energy: the
    round-off of positions, and of the rigid motion's energy.
    """
    speed = ROUND_OFF * np.abs(info.result.state.x).max() / info.dt
    rounded = 0.5 * system.total_mass * speed**2 + ROUND_OFF * kinetic
    return max(rounded, negligible_energy(system, info.t - info.memory.start))
