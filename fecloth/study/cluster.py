"""Run cases on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator

from fecloth.errors import InputError
from fecloth.study import status
from fecloth.study.processes import run_case


def run_on_cluster(cases, scheduler: str, time_limit: float | None) -> Iterator[tuple]:
    """Yield (case, result) as the cases finish on a Dask cluster.

    fecloth must be installed on the workers.

    Raises
    ------
    InputError
        If the package `distributed` is not installed.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        what, remedy = (
            f"scheduler = {scheduler}",
            "In the clone, pip install '.[dask]', or use --jobs.",
        )
        raise InputError(what, "needs Dask distributed", "run_cases", remedy) from error
    with Client(scheduler) as client:
        case_of = {}
        for case in cases:
            task = (case.file, case.name, dict(case.settings), time_limit)
            case_of[client.submit(run_case, *task, pure=False)] = case
        for future in as_completed(case_of):
            yield case_of[future], _result_of(future)


def _result_of(future) -> dict:
    error = future.exception()
    if error is None:
        return future.result()
    was_killed = type(error).__name__ == "KilledWorker"
    word = status.KILLED if was_killed else status.ERROR
    return {"status": word, "cause": f"{type(error).__name__}: {error}"}
