"""Recording of each step for `run`, `fecloth run` and `fecloth check`."""

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from fecloth.simulation.account import NEVER, Accounts, Run
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.probes import Observer
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State

LARGEST_DISTANCE = 1.5  # over the distance of rows: the most by which two rows are apart


@dataclass(frozen=True, eq=False)
class Record:
    """A step with what is recorded of it.

    Attributes
    ----------
    state, info
        The state after the step, and its figures.
    run
        The run, with the system that took the step.
    accounts
        The accounts after the step.
    rows
        Rows of the tables "energies", "observed" and "steps".
    wanted
        The step to record next; None: each.
    seconds
        Wall time of the recording.
    """

    state: State
    info: StepInfo
    run: Run
    accounts: Accounts
    rows: dict[str, dict[str, float]]
    wanted: Wanted | None
    seconds: float


def record_steps(
    steps: Iterable[tuple[State, StepInfo]],
    run: Run,
    observer: Observer,
    accounts: Accounts,
    next_row: Callable[[StepInfo], Wanted] | None = None,
) -> Iterator[Record]:
    """Yield a `Record` for each step of `march`; `accounts` are before the first of them.

    `next_row` says which step must be recorded next; steps between may be left out. None: each.
    Raises `StepFailed` if the run must not go on: see `Balance`.
    """
    steps = iter(steps)
    taken = next(steps, None)
    while taken is not None:
        state, info = taken
        begin = time.perf_counter()
        run = run.at(info.old.t)
        accounts = accounts.follow(run, info)
        released = run.at(state.t)
        if released is not run:
            accounts = accounts.release(released, info)
        rows = accounts.rows(observer.row(info.old, info.result, run.system))
        wanted = None
        if next_row:
            wanted = _with_due(next_row(info), info, accounts.due)
        yield Record(state, info, run, accounts, rows, wanted, time.perf_counter() - begin)
        taken = _advance(steps, wanted)


def _with_due(wanted: Wanted, info: StepInfo, due: int) -> Wanted:
    """Return the next step to record: the step `due` for an account is always recorded.

    It takes the place of a row that is wanted shortly before.
    """
    step = min(wanted.step, due)
    last_step_without_row = info.step + LARGEST_DISTANCE * (wanted.t - info.t) / info.dt
    if last_step_without_row >= due:
        return Wanted(step)
    return Wanted(step, wanted.t)


def _advance(steps, wanted: Wanted | None):
    """Return the next step of `march`, None at its end; tell it which step is `wanted`."""
    if wanted is None or not isinstance(steps, Generator):
        return next(steps, None)
    with suppress(StopIteration):
        return steps.send(wanted)
    return None


def rows_at_least(rows: int, start: float, t_end: float) -> Callable[[StepInfo], Wanted]:
    """Return the rule by which a run has about that many `rows`, or one for each step.

    It is a function of the last step that was recorded; `start` and `t_end` are times [s].
    """
    spacing = (1 - 1e-6) * (t_end - start) / rows
    return lambda info: Wanted(NEVER, info.t + spacing)
