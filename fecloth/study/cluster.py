"""Run cases on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fecloth.errors import InputError
from fecloth.study import status
from fecloth.study.command import require_packages
from fecloth.study.fingerprint import source_hash
from fecloth.study.processes import run_case

PATIENCE = 10.0  # s to reach the scheduler and its first worker


def run_on_cluster(cases, scheduler: str, time_limit: float | None) -> Iterator[tuple]:
    """Yield (case, result) as the cases finish on a Dask cluster.

    The workers need fecloth installed, and the file of the study under the same path; they import
    the study's function from that file.
    """
    require_packages("distributed")
    from distributed import as_completed

    with _connect(scheduler) as client:
        for file, source in {(case.file, case.source) for case in cases}:
            _check_workers(client, scheduler, file, source)
        case_of = {}
        for case in cases:
            task = (case.file, case.name, case.source, dict(case.settings), time_limit)
            case_of[client.submit(run_checked_case, *task, pure=False)] = case
        for future in as_completed(case_of):
            yield case_of[future], _result_of(future)


def run_checked_case(
    file: str, name: str, source: str, settings: dict, time_limit: float | None
) -> dict:
    """Run one case on a worker, unless its sources are others than those of the study."""
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
    """Return a client of a scheduler that has a worker."""
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
    """Raise `InputError` if a worker cannot run the cases of a file."""
    try:
        mistakes = client.run(find_mistake, file, source)
    except Exception as error:  # a worker raises whatever its import of fecloth raises
        mistakes = {"a worker": f"cannot import fecloth: {type(error).__name__}: {error}"}
    for worker, mistake in mistakes.items():
        if mistake:
            remedy = "Workers need this fecloth installed, and this clone under the same path."
            raise InputError(f"--scheduler {scheduler}: {worker}", mistake, "", remedy)


def _result_of(future) -> dict:
    error = future.exception()
    if error is None:
        return future.result()
    was_killed = type(error).__name__ == "KilledWorker"
    word = status.KILLED if was_killed else status.ERROR
    return {"status": word, "cause": f"{type(error).__name__}: {error}"}
