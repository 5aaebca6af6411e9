"""Run cases in processes of this machine, which can be killed when they are late."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

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


def run_case(file: str, name: str, settings: dict, time_limit: float | None) -> dict:
    """Import the function and run one case in the current process."""
    return status.attempt(load_function(file, name), settings, time_limit)


def serve(pipe: Connection, file: str, name: str) -> None:
    """Run in a worker process: import the function, then answer settings with results.

    The worker ignores Ctrl-C: the parent process handles it and stops the worker.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        function = load_function(file, name)
    except BaseException as error:
        pipe.send(error)
        raise
    pipe.send(None)
    with suppress(EOFError, BrokenPipeError):  # the parent process has ended
        while True:
            pipe.send(status.attempt(function, pipe.recv()))


@dataclass
class Worker:
    """A process, the case it runs, and the time at which the case is late."""

    process: BaseProcess
    pipe: Connection
    case: object = None
    end: float | None = None
    is_ready: bool = False

    @classmethod
    def start(cls, file: str, name: str) -> Worker:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, file, name), daemon=True)
        with _one_thread_environment():
            process.start()
        theirs.close()
        return cls(process, ours)

    def send(self, case, time_limit: float | None) -> None:
        self.pipe.send(dict(case.settings))
        self.case = case
        self.end = None if time_limit is None else time.perf_counter() + time_limit

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run_in_processes(cases, count: int, time_limit: float | None) -> Iterator[tuple]:
    """Yield (case, result) as they finish in `count` processes; replace each stopped process."""
    waiting = deque(cases)
    workers: list[Worker] = []
    try:
        while waiting or any(worker.case for worker in workers):
            busy = sum(worker.case is not None for worker in workers)
            while len(workers) < min(count, busy + len(waiting)):
                workers.append(Worker.start(cases[0].file, cases[0].name))
            for worker in workers:
                if worker.is_ready and worker.case is None and waiting:
                    worker.send(waiting.popleft(), time_limit)
            answered = wait([worker.pipe for worker in workers], _seconds_to_first_limit(workers))
            for worker in list(workers):
                case = worker.case
                result = _read_result(worker, worker.pipe in answered, time_limit)
                if result is None:
                    continue
                if result["status"] in (status.LATE, status.KILLED):
                    worker.stop()
                    workers.remove(worker)
                yield case, result
    finally:
        for worker in workers:
            worker.stop()


def _seconds_to_first_limit(workers: list[Worker]) -> float | None:
    """Return the time until the first worker is late [s]; None if no worker has a limit."""
    ends = [worker.end for worker in workers if worker.end is not None]
    return max(0.0, min(ends) - time.perf_counter()) if ends else None


def _read_result(worker: Worker, has_answered: bool, time_limit: float | None) -> dict | None:
    """Return the worker's result, or None if it has none yet."""
    if not has_answered:
        is_late = worker.end is not None and time.perf_counter() >= worker.end
        if time_limit is None or not is_late:
            return None
        return {"status": status.LATE, "cause": status.describe_time_limit(time_limit)}
    try:
        answer = worker.pipe.recv()
    except (EOFError, ConnectionResetError):
        worker.process.join()
        cause = f"its process ended with code {worker.process.exitcode}"
        if worker.case is None:
            raise RuntimeError(f"a worker could not start: {cause}") from None
        return {"status": status.KILLED, "cause": cause}
    if worker.is_ready:
        worker.case = worker.end = None
        return answer
    if answer is not None:
        raise answer
    worker.is_ready = True
    return None


@contextmanager
def _one_thread_environment() -> Iterator[None]:
    """Set the environment so that a process started inside uses one thread in every library."""
    before = {name: os.environ.get(name) for name in threads.ONE}
    os.environ.update(threads.ONE)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
