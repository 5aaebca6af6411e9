"""The threads of a process besides the caller's, which make the calls of a `Team`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from queue import SimpleQueue
from threading import Lock, Thread

import numpy as np

from fecloth.compiled.thread_meeting import attend


class Worker:
    """A thread that makes one call after another.

    It takes 60 µs to wake a thread that sleeps, as long as the forces of 3000 triangles. So it, and
    who waits for it, look at a counter for 0.1 ms before they sleep.
    """

    def __init__(self) -> None:
        self._tasks: SimpleQueue = SimpleQueue()
        self._errors: SimpleQueue = SimpleQueue()
        self._begun, self._ended = np.zeros((2, 1), np.int64)
        Thread(target=self._serve, name="fecloth", daemon=True).start()

    def begin(self, task: Callable[[], object]) -> None:
        """Let the thread make a call."""
        self._tasks.put(task)
        self._begun[0] += 1

    def end(self) -> BaseException | None:
        """Wait for the end of the call; return its error, if any."""
        attend(self._ended, self._begun[0] - 1)
        error: BaseException | None = self._errors.get()
        return error

    def _serve(self) -> None:
        calls = 0
        while True:
            error: BaseException | None = None
            try:
                self._tasks.get()()
            except BaseException as raised:  # for the caller
                error = raised
            calls += 1
            self._errors.put(error)
            self._ended[0] = calls
            attend(self._begun, calls)


def end_all(workers: list[Worker]) -> list[BaseException | None]:
    """Wait for all workers; if that is interrupted, the next call gets others."""
    try:
        return [worker.end() for worker in workers]
    except BaseException:
        workers_of.cache_clear()
        raise


@cache
def workers_of(process: int, count: int) -> tuple[list[Worker], Lock]:
    """The threads of a process besides the caller's, and who may use them."""
    return [Worker() for _ in range(count)], Lock()
