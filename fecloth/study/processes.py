"""Run cases in processes of this machine, which are killed when they are late."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

from fecloth.study import status, threads


def load_function(file: str, name: str):
    """Import a file as a module of its package or folder, and return its function `name`."""
    root, module = module_of(Path(file))
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    return getattr(importlib.import_module(module), name)


def module_of(file: Path) -> tuple[Path, str]:
    """Return the folder to import a file from, and the dotted name of its module."""
    folder, names = file.parent, [file.stem]
    while (folder / "__init__.py").exists():
        names.insert(0, folder.name)
        folder = folder.parent
    return folder, ".".join(names)


def run_case(file: str, name: str, settings: dict, time_limit: float | None = None) -> dict:
    """Import the function and run one case in the current process."""
    return status.attempt(load_function(file, name), settings, time_limit)


def run_in_processes(
    cases: Sequence[Any], count: int, time_limit: float | None
) -> Iterator[tuple[Any, dict]]:
    """Yield (case, result) as they finish in `count` processes; replace each stopped process."""
    first, context = cases[0], multiprocessing.get_context("spawn")
    pool = ProcessPool(count, 0, _start_worker, (first.file, first.name), context)
    with _one_thread_environment():
        try:
            case_of: dict[Future, Any] = {}
            for case in cases:
                task = case.file, case.name, dict(case.settings)
                case_of[pool.schedule(run_case, task, timeout=time_limit)] = case
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


def _result_of(future: Future, time_limit: float | None) -> dict:
    """Return the result of a case, or the status of a late case and of a dead process."""
    try:
        return future.result()
    except TimeoutError:
        return {"status": status.LATE, "cause": status.describe_time_limit(time_limit or 0.0)}
    except ProcessExpired as error:
        cause = f"its process ended with code {error.exitcode}"
        return {"status": status.KILLED, "cause": cause}
    except BrokenProcessPool as error:
        raise RuntimeError("a worker could not start: its process has ended") from error


@contextmanager
def _one_thread_environment() -> Iterator[None]:
    """Set the environment so that a process started inside uses one thread in every library."""
    before = {name: os.environ.get(name) for name in threads.ONE}
    os.environ.update(threads.ONE)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            os.environ.update({} if value is None else {name: value})
