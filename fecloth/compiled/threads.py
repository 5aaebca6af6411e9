"""The threads of a process, and how threads that share a loop wait for each other.

Loops that iterate, as conjugate gradients and explicit steps do, keep their threads from begin
to end. The threads wait for each other by `wait`: a thread that waits gives its core to others
after a microsecond, so that on a busy machine it does not keep the core from the thread it
waits for.
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

SPIN = 256  # looks at the counter before a waiting thread gives its core to others
ATTENTIVE = 300  # times that, before a thread without work sleeps
GIVE_UP = 2**62  # the counter when a thread has failed: nobody waits any longer


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
    """One of the threads that share a loop, for kernels."""

    # Number of this thread, from 0 on, and of all.
    thread: int
    threads: int
    # (1,) int64: the counter of all threads, and the round of this one, from 1 on.
    meeting: np.ndarray
    round_: np.ndarray


def members(threads: int) -> list[Member]:
    """Return the threads of a loop, before they meet for the first time."""
    meeting = np.zeros(1, np.int64)
    return [Member(p, threads, meeting, np.ones(1, np.int64)) for p in range(threads)]


ONLY = members(1)[0]  # a thread that shares its loop with none


@kernel
def wait(member: Member) -> None:
    """Wait until all threads have come here; for kernels and for Python."""
    # What a thread wrote before is seen by the others afterwards.
    if member.threads > 1:
        _arrive(member.meeting)
        arrivals = member.threads * member.round_[0]
        looks = 0
        while _look(member.meeting) < arrivals:
            looks += 1
            if looks % SPIN == 0:
                _give_core()
        member.round_[0] += 1


@inner
def part_of(member: Member, begin: int, end: int) -> tuple[int, int]:
    """Return the begin and the end of a thread's part of the numbers begin … end − 1."""
    size = end - begin
    p = member.thread
    threads = member.threads
    return begin + size * p // threads, begin + size * (p + 1) // threads


@kernel
def attend(counter: Array, known: int) -> None:
    """Return when the counter is no longer the known number, or after 0.1 ms."""
    for look in range(ATTENTIVE * SPIN):
        if _look(counter) != known:
            return
        if look % SPIN == SPIN - 1:
            _give_core()


class Worker:
    """A thread that makes one call after another.

    It takes 60 µs to wake a thread that sleeps, as long as the forces of 3000 triangles. So
    it, and who waits for it, look at a counter for 0.1 ms before they sleep.
    """

    def __init__(self) -> None:
        self._tasks: SimpleQueue = SimpleQueue()
        self._errors: SimpleQueue = SimpleQueue()
        self._begun, self._ended = np.zeros((2, 1), np.int64)
        Thread(target=self._serve, name="fecloth", daemon=True).start()

    def begin(self, task: Callable[[], object]) -> None:
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
