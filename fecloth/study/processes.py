"""Run cases in processes of this machine, which end when they are late, or on a cluster."""

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.study import status, threads
from fecloth.study.command import require_packages
from fecloth.study.fingerprint import load_function, source_hash

# The CPU time at which the system ends a late process over its limit: a case that looks at its
# limit by itself ends before it.
LATE_OVER_LIMIT = 1.2
# The time by the clock at which a process counts as hanging over its limit of CPU time, and the
# least such time [s]: a busy machine may take that long.
HANGING_OVER_LIMIT = 30.0
LEAST_HANGING = 60.0
ENDED_BY_TIMER = -signal.SIGPROF if os.name == "posix" else None


def run_case(file: str, name: str, settings: dict, time_limit: float | None = None) -> dict:
    """Import the function and run one case in the current process."""
    return status.attempt(load_function(file, name), settings, time_limit)


def run_in_processes(
    cases: Sequence[Any], count: int, time_limit: float | None
) -> Iterator[tuple[Any, dict]]:
    """Yield pairs of a case and its result, in the order in which the cases finish.

    The cases run in `count` processes, each with one thread. A process that ended or was stopped
    is replaced. `time_limit` is the CPU time of a case [s]. A process that hangs takes no CPU
    time, so it is also stopped after a long time by the clock.
    """
    from pebble import ProcessPool  # which loads asyncio

    clock_limit = None
    if time_limit is not None:
        clock_limit = max(HANGING_OVER_LIMIT * time_limit, LEAST_HANGING)
    first = cases[0]  # all cases of a study have the same function
    context = multiprocessing.get_context("spawn")  # does not copy the threads of this process
    pool = ProcessPool(
        max_workers=count,
        max_tasks=0,  # any number for each process
        initializer=_start_worker,
        initargs=(first.file, first.name),
        context=context,
    )
    with _one_thread_environment():
        try:
            case_of: dict[Future, Any] = {}
            for case in cases:
                task = case.file, case.name, dict(case.settings), time_limit
                case_of[pool.schedule(_run_limited, task, timeout=clock_limit)] = case
            for future in as_completed(case_of):
                yield case_of[future], _result_of(future, time_limit)
        finally:
            pool.stop()
            pool.join()


def _start_worker(file: str, name: str) -> None:
    """Import the function before the time of the first case begins; let the worker be killed."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # also within compiled code
    with suppress(Exception):  # the first case raises it again
        load_function(file, name)


def _run_limited(file: str, name: str, settings: dict, time_limit: float | None) -> dict:
    """Run a case; if it takes longer than the limit [CPU s], the system ends this process.

    So a case ends that does not look at its time limit, as in compiled code. The timer exists on
    POSIX systems only.
    """
    if time_limit is None or os.name != "posix":
        return run_case(file, name, settings, time_limit)
    signal.setitimer(signal.ITIMER_PROF, LATE_OVER_LIMIT * time_limit)
    try:
        return run_case(file, name, settings, time_limit)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _result_of(future: Future, time_limit: float | None) -> dict:
    """Return the result of a case, or a row with its status if it was late or its process ended.

    Raise `RuntimeError` if no process could start.
    """
    from pebble import ProcessExpired

    try:
        return future.result()
    except TimeoutError:  # the process hung, and was stopped by the clock
        return {"status": status.LATE, "cause": status.describe_time_limit(time_limit or 0.0)}
    except ProcessExpired as error:
        # the timer of `_run_limited` ends a process that does not look at its limit itself
        if time_limit is not None and error.exitcode == ENDED_BY_TIMER:
            return {"status": status.LATE, "cause": status.describe_time_limit(time_limit)}
        cause = f"its process ended with code {error.exitcode}"
        return {"status": status.KILLED, "cause": cause}
    except BrokenProcessPool as error:
        raise RuntimeError("a worker could not start: its process has ended") from error


@contextmanager
def _one_thread_environment() -> Iterator[None]:
    """Set the environment so that a process started inside uses one thread in every library.

    Processes run side by side, so that more threads would only compete. At the end the
    environment of this process is as before.
    """
    old_values = {name: os.environ.get(name) for name in threads.ONE}
    os.environ.update(threads.ONE)
    try:
        yield
    finally:
        for name, old_value in old_values.items():
            del os.environ[name]
            if old_value is not None:
                os.environ[name] = old_value


PATIENCE = 10.0  # time to wait for the scheduler, and for its first worker [s]


def run_on_cluster(cases, scheduler: str, time_limit: float | None) -> Iterator[tuple]:
    """Yield pairs of a case and its result, in the order in which they finish on a Dask cluster.

    The workers need fecloth installed, and the file of the study under the same path; they
    import the study's function from that file. `scheduler` is the address of the scheduler,
    `time_limit` the CPU time of a case [s]. Raise `InputError` if the scheduler does not answer
    or has no worker, or if a worker cannot run the cases.
    """
    require_packages("distributed")
    from distributed import as_completed

    with _connect(scheduler) as client:
        for file, source in {(case.file, case.source) for case in cases}:
            _check_workers(client, scheduler, file, source)
        case_of = {}
        for case in cases:
            future = client.submit(
                run_checked_case,
                case.file,
                case.name,
                case.source,
                dict(case.settings),
                time_limit,
                pure=False,  # a case that is submitted again runs again
            )
            case_of[future] = case
        for future in as_completed(case_of):
            yield case_of[future], _result_of_task(future)


def run_checked_case(
    file: str, name: str, source: str, settings: dict, time_limit: float | None
) -> dict:
    """Run one case on a worker, unless the worker has other sources than the study."""
    if mistake := find_mistake(file, source):
        return {"status": status.ERROR, "cause": mistake}
    return run_case(file, name, settings, time_limit)


def find_mistake(file: str, source: str) -> str:
    """Return why this process cannot run the cases of a file; "" if it can.

    A worker that was started before an edit, or that has another fecloth installed, would give
    results of other sources. The hash is kept from the first call, as imported modules are.
    """
    if not Path(file).exists():
        return f"does not see the file {file}"
    if source_hash(file) != source:
        return "has other sources of fecloth or of the study: start it again"
    return ""


def _connect(scheduler: str):
    """Return a client of the scheduler.

    Raise `InputError` if it does not answer, or has no worker, within `PATIENCE` seconds.
    """
    from distributed import Client

    remedy = "studies/README.md says how to start a scheduler and workers."
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--scheduler {scheduler}", "does not answer", "", remedy) from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError as error:
        client.close()
        raise InputError(f"--scheduler {scheduler}", "has no worker", "", remedy) from error
    return client


def _check_workers(client, scheduler: str, file: str, source: str) -> None:
    """Raise `InputError` if a worker cannot run the cases of a file.

    `source` is the hash of the sources of this process, which all workers must have, too.
    """
    try:
        mistakes = client.run(find_mistake, file, source)
    except Exception as error:  # a worker raises whatever its import of fecloth raises
        mistakes = {"a worker": f"cannot import fecloth: {type(error).__name__}: {error}"}
    for worker, mistake in mistakes.items():
        if mistake:
            remedy = "Workers need this fecloth installed, and this clone under the same path."
            raise InputError(f"--scheduler {scheduler}: {worker}", mistake, "", remedy)


def _result_of_task(future) -> dict:
    """Return the result of a case, or a row with "error" or "killed" and the cause.

    Dask raises "KilledWorker" if several workers in turn ended while they ran the case.
    """
    error = future.exception()
    if error is None:
        return future.result()
    error_name = type(error).__name__
    case_status = status.ERROR
    if error_name == "KilledWorker":
        case_status = status.KILLED
    return {"status": case_status, "cause": f"{error_name}: {error}"}
