"""The threads of a process, and how threads that share a loop wait for each other.

Loops that iterate, as conjugate gradients and explicit steps do, keep their threads from begin
to end. The threads wait for each other by `wait`. A waiting thread gives its core to others
after a microsecond: on a busy machine the thread for which it waits may need this core.
"""

import sys
from collections.abc import Callable
from functools import cache
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fecloth.compiled.jit import Array, inner, kernel

# Looks at the counter before a waiting thread gives its core to others: about a microsecond.
LOOKS_BEFORE_YIELD = 256
# Times that a thread without work gives its core to others before it sleeps: about 0.1 ms in all.
YIELDS_BEFORE_SLEEP = 300
# The value of the counter when a thread has failed: no thread waits any longer.
GIVE_UP = 2**62


def _add_one(typing: Any, counter: Any) -> Any:
    """Add 1 to counter[0] in one operation."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.atomic_rmw("add", array.data, ir.Constant(ir.IntType(64), 1), "seq_cst")

    return types.int64(counter), generate


def _look_at(typing: Any, counter: Any) -> Any:
    """Read counter[0] as other threads have written it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load_atomic(array.data, "acquire", 8)

    return types.int64(counter), generate


_arrive: Any = intrinsic(_add_one)
_look: Any = intrinsic(_look_at)
_yield_name = "SwitchToThread" if sys.platform == "win32" else "sched_yield"
_give_core: Any = types.ExternalFunction(_yield_name, types.int32())


class Member(NamedTuple):
    """One of the threads that share a loop, for kernels.

    Attributes
    ----------
    thread, threads
        Number of this thread, from 0 on, and number of all threads.
    meeting
        (1,) int64 counter of the arrivals of all threads at `wait`.
    round_
        (1,) int64 number of the next meeting of this thread, from 1 on.
    """

    thread: int
    threads: int
    meeting: np.ndarray
    round_: np.ndarray


def members(threads: int) -> list[Member]:
    """The members of a loop on a number of threads, before they meet for the first time."""
    meeting = np.zeros(1, np.int64)
    return [Member(p, threads, meeting, np.ones(1, np.int64)) for p in range(threads)]


ONLY = members(1)[0]  # a thread that shares its loop with none


@kernel
def wait(member: Member) -> None:
    """Wait until all threads have called this function; for kernels and for Python.

    Afterwards each thread sees what the others wrote before.
    """
    if member.threads > 1:
        _arrive(member.meeting)
        arrivals = member.threads * member.round_[0]  # of all threads, since the loop began
        looks = 0
        while _look(member.meeting) < arrivals:
            looks += 1
            if looks % LOOKS_BEFORE_YIELD == 0:
                _give_core()
        member.round_[0] += 1


@inner
def part_of(member: Member, begin: int, end: int) -> tuple[int, int]:
    """The begin and the end of a thread's part of the numbers begin … end − 1."""
    size = end - begin
    p = member.thread
    threads = member.threads
    return begin + size * p // threads, begin + size * (p + 1) // threads


@kernel
def attend(counter: Array, known: int) -> None:
    """Return when the counter is no longer the known number, or after 0.1 ms."""
    for look in range(YIELDS_BEFORE_SLEEP * LOOKS_BEFORE_YIELD):
        if _look(counter) != known:
            return
        if look % LOOKS_BEFORE_YIELD == LOOKS_BEFORE_YIELD - 1:
            _give_core()


class Worker:
    """A thread that makes one call after another.

    It takes 60 µs to wake a thread that sleeps, as long as the forces of 3000 triangles. So the
    worker, and the thread that waits for it, look at a counter for 0.1 ms before they sleep.
    """

    def __init__(self) -> None:
        self._tasks: SimpleQueue = SimpleQueue()
        self._errors: SimpleQueue = SimpleQueue()
        self._begun, self._ended = np.zeros((2, 1), np.int64)
        Thread(target=self._serve, name="fecloth", daemon=True).start()

    def begin(self, task: Callable[[], object]) -> None:
        """Begin a call; it must be ended before the next one begins."""
        self._tasks.put(task)
        self._begun[0] += 1

    def end(self) -> BaseException | None:
        """Wait for the end of the call; return its error, if any."""
        attend(self._ended, self._begun[0] - 1)
        error: BaseException | None = self._errors.get()
        return error

    def _serve(self) -> None:
        """Make all calls, one after another: this is what the thread does, without an end.

        The error of a call, or None, is put in a queue, from which `end` takes it.
        """
        calls = 0
        while True:
            error: BaseException | None = None
            try:
                self._tasks.get()()
            except BaseException as raised:  # `end` returns it to the calling thread
                error = raised
            calls += 1
            self._errors.put(error)
            self._ended[0] = calls
            attend(self._begun, calls)


def end_all(workers: list[Worker]) -> list[BaseException | None]:
    """Wait for all workers; return their errors.

    If the wait is interrupted, `workers_of` makes new workers for the next call.
    """
    try:
        return [worker.end() for worker in workers]
    except BaseException:
        workers_of.cache_clear()
        raise


@cache
def workers_of(process: int, count: int) -> tuple[list[Worker], Lock]:
    """The workers of a process besides the calling thread, and the lock for their use."""
    return [Worker() for _ in range(count)], Lock()
