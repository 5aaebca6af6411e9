"""Where cases run: processes of this machine that can be killed, or a Dask cluster."""

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
from pathlib import Path

from fecloth.errors import InputError
from fecloth.study import status as failures
from fecloth.study import threads


def load(file: str, name: str):
    """The function of that name in that file, imported as a module of its package or folder."""
    root, module = module_of(Path(file))
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    return getattr(importlib.import_module(module), name)


def module_of(file: Path) -> tuple[Path, str]:
    """The folder to import a file from, and its dotted name there."""
    folder, names = file.parent, [file.stem]
    while (folder / "__init__.py").exists():
        names.insert(0, folder.name)
        folder = folder.parent
    return folder, ".".join(names)


def remote(file: str, name: str, settings: dict, time_limit: float | None) -> dict:
    """Run one case in whatever process this is."""
    return failures.attempt(load(file, name), settings, time_limit)


def serve(pipe: Connection, file: str, name: str) -> None:
    """The life of a process: load the function, then answer settings with results.

    Ctrl-C is for whoever started it, and ends it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        function = load(file, name)
    except BaseException as error:
        pipe.send(error)
        raise
    pipe.send(None)
    with suppress(EOFError, BrokenPipeError):  # whoever asks is gone
        while True:
            pipe.send(failures.attempt(function, pipe.recv()))


@dataclass
class Worker:
    """A process, what it works on, and when it must be done."""

    process: multiprocessing.Process
    pipe: Connection
    case: object = None
    end: float | None = None
    ready: bool = False

    @classmethod
    def start(cls, file: str, name: str) -> Worker:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, file, name), daemon=True)
        with _one_thread():
            process.start()
        theirs.close()
        return cls(process, ours)

    def give(self, case, time_limit: float | None) -> None:
        self.pipe.send(dict(case.settings))
        self.case = case
        self.end = None if time_limit is None else time.perf_counter() + time_limit

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def in_processes(cases, count: int, time_limit: float | None) -> Iterator[tuple]:
    """(case, result) as they finish in `count` processes; each stopped process is replaced."""
    waiting, workers = deque(cases), []
    try:
        while waiting or any(worker.case for worker in workers):
            busy = sum(worker.case is not None for worker in workers)
            while len(workers) < min(count, busy + len(waiting)):
                workers.append(Worker.start(cases[0].file, cases[0].name))
            for worker in workers:
                if worker.ready and worker.case is None and waiting:
                    worker.give(waiting.popleft(), time_limit)
            heard = wait([worker.pipe for worker in workers], _patience(workers))
            for worker in list(workers):
                case, result = worker.case, _answer(worker, worker.pipe in heard, time_limit)
                if result is None:
                    continue
                if result["status"] in (failures.LATE, failures.KILLED):
                    worker.stop()
                    workers.remove(worker)
                yield case, result
    finally:
        for worker in workers:
            worker.stop()


def _patience(workers: list[Worker]) -> float | None:
    """Seconds until the first of them is late."""
    ends = [worker.end for worker in workers if worker.end is not None]
    return max(0.0, min(ends) - time.perf_counter()) if ends else None


def _answer(worker: Worker, heard: bool, time_limit: float | None) -> dict | None:
    """The result that a process has come to, None if it has none yet."""
    if not heard:
        late = worker.end is not None and time.perf_counter() >= worker.end
        return {"status": failures.LATE, "cause": failures.late(time_limit)} if late else None
    try:
        answer = worker.pipe.recv()
    except (EOFError, ConnectionResetError):
        worker.process.join()
        cause = f"its process ended with code {worker.process.exitcode}"
        if worker.case is None:
            raise RuntimeError(f"a worker could not start: {cause}") from None
        return {"status": failures.KILLED, "cause": cause}
    if worker.ready:
        worker.case = worker.end = None
        return answer
    if answer is not None:
        raise answer
    worker.ready = True
    return None


@contextmanager
def _one_thread() -> Iterator[None]:
    """The environment of a process that is started inside: one thread for every library."""
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


def on_cluster(cases, scheduler: str, time_limit: float | None) -> Iterator[tuple]:
    """(case, result) as they finish on a Dask cluster."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        what, remedy = f"scheduler = {scheduler}", "pip install 'fecloth[dask]', or use --jobs."
        raise InputError(what, "needs Dask distributed", "run_cases", remedy) from error
    with Client(scheduler) as client:
        asked = {}
        for case in cases:
            task = (case.file, case.name, dict(case.settings), time_limit)
            asked[client.submit(_entry, str(Path(__file__).parents[1]), *task, pure=False)] = case
        for future in as_completed(asked):
            yield asked[future], _outcome(future)


def _entry(studies: str, *task) -> dict:
    """`remote`, after the folder of the studies has been made importable."""
    if studies not in sys.path:
        sys.path.insert(0, studies)
    return remote(*task)


def _outcome(future) -> dict:
    error = future.exception()
    if error is None:
        return future.result()
    killed = type(error).__name__ == "KilledWorker"
    status = failures.KILLED if killed else failures.ERROR
    return {"status": status, "cause": f"{type(error).__name__}: {error}"}
