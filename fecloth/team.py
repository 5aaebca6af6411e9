"""The threads that share the loops of a run, to the same bits for every number of them.

A `Team` belongs to a `System`; its terms and the matrices of its steps use it. All loops are
compiled and release Python's lock, so plain threads of Python share them: each is called with
its own part of the elements or nodes, and the thread that asks takes the first part itself.

Two rules keep the bits. Forces and tangents: every node has one owner, and the owner adds up all
that the node gets, in the order in which one thread would (`SharedLoop`). Sums over all nodes:
they are made of blocks of a fixed size, and the sums of the blocks are added in order.

Loops that iterate, as conjugate gradients and explicit steps do, keep their threads from begin to
end. The threads wait for each other by `meet`: a thread that waits gives its core to others after
a microsecond, so that on a busy machine it does not keep the core from the thread it waits for.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fecloth.errors import InputError, brief
from fecloth.jit import Array, inner, kernel
from fecloth.thread_choice import ThreadChoice

Result = TypeVar("Result")

SMALL = 1000  # elements or nodes below which one thread does a loop
MOST = 256  # threads
SPIN = 256  # looks at the counter before a waiting thread gives its core to others
ATTENTIVE = 300  # times that, before a thread without work sleeps
GIVE_UP = 2**62  # the counter when a thread has failed: nobody waits any longer


def number_of_threads(threads: Any, where: str = "System") -> int:
    """Number of threads for "auto", which means all that Numba may start, or a number.

    Numba may start one on each core that the process may use, or ``NUMBA_NUM_THREADS``.

    Raises
    ------
    InputError
        For anything but "auto" and a whole number from 1 to 256.
    """
    if isinstance(threads, str) and threads == "auto":
        config: Any = numba.config  # its types lack the settings
        return int(config.NUMBA_NUM_THREADS)
    whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if not (whole and 1 <= threads <= MOST):
        allowed = f'must be "auto" or a whole number from 1 to {MOST}'
        raise InputError(f"threads = {brief(threads)}", allowed, where)
    return int(threads)


class Team:
    """The threads of a system.

    Parameters
    ----------
    threads
        A number; or "auto": one or all, whichever was faster lately, see `thread_choice`.
    clock
        Time [s], for "auto".
    """

    def __init__(self, threads: int | str = 1, clock: Callable[[], float] = time.perf_counter):
        self.threads, self.clock = threads, clock
        self.count = number_of_threads(threads)
        self.has_shared = False  # a loop with a given number of threads
        self.choices: dict[object, ThreadChoice] = {}
        self._work: dict[tuple, np.ndarray] = {}

    def __reduce__(self) -> tuple:
        return Team, (self.threads,)

    @contextmanager
    def pinned(self) -> Iterator[None]:
        """Let one thread do all loops inside."""
        before, self.count = self.count, 1
        try:
            yield
        finally:
            self.count = before

    def shares(self, size: int) -> bool:
        """Whether a loop over that many elements or nodes may be shared."""
        return self.count > 1 and size >= SMALL

    def do(
        self,
        name: object,
        alone: Callable[[], Result],
        together: Callable[[], Result],
        units: float = 1.0,
        count: Callable[[Result], float] = lambda result: 1.0,
    ) -> Result:
        """Return alone(), or together(), which calls `run`; both must have the same result.

        Parameters
        ----------
        name
            Of the loop, whose times are compared.
        units, count
            Of work to which the time is proportional: at most `units`, and count(result) after the
            call.
        """
        if self.count == 1:
            return alone()
        if self.threads != "auto":
            self.has_shared = True
            return together()
        choice = self.choices.setdefault(name, ThreadChoice())
        on_all, begin = choice.ask(units), self.clock()
        result = together() if on_all else alone()
        choice.tell(on_all, self.clock() - begin, max(1.0, count(result)))
        return result

    def portion(self, name: object, most: int) -> int:
        """Units of work to do in the next call of `do`, at most `most`."""
        if self.threads != "auto" or self.count == 1:
            return most
        return min(most, self.choices.setdefault(name, ThreadChoice()).portion)

    def run(self, part: Callable[[int], Result], meeting: Array | None = None) -> Result:
        """Call part(p) for each thread p at once; return part(0), which the caller's thread does.

        `meeting` is the counter of `meet`, if the parts wait for each other. If another Python
        thread uses the workers, they are waited for.
        """

        if self.count == 1:
            return part(0)

        def guarded(p: int) -> Result:
            try:
                return part(p)
            except BaseException:
                if meeting is not None:
                    meeting[0] = GIVE_UP
                raise

        workers, lock = _workers(self.count - 1, os.getpid())
        with lock:
            for p, worker in enumerate(workers, 1):
                worker.begin(partial(guarded, p))
            try:
                result = guarded(0)
            finally:
                errors = _end(workers)
        for error in filter(None, errors):
            raise error
        return result

    def work(self, p: int, shape: tuple[int, ...]) -> np.ndarray:
        """An array of thread p, of which only the entries that are used take memory."""
        array = self._work.get((p, shape))
        if array is None:
            array = self._work[p, shape] = np.zeros(shape)
        return array

    def words(self, size: int) -> str:
        """How many threads share a loop of that size, in words."""
        if not self.shares(size):
            return "one thread"
        if self.threads == "auto":
            return f"one or {self.count} threads, whichever is faster"
        return f"{self.count} threads"

    @property
    def used(self) -> int:
        """Threads that were used: all, or one if most of the time was spent with one."""
        on_all = sum(choice.on_all for choice in self.choices.values())
        alone = sum(choice.spent for choice in self.choices.values()) - on_all
        return self.count if self.has_shared or on_all > alone else 1


ALONE = Team(1)


# --- threads that wait for each other, for kernels only -------------------------------------------


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


@inner
def meet(meeting: Array, threads: int, round_: int) -> int:
    """Wait until all threads have come to this round, from 1 on; return the next round.

    `meeting` is an array of one int64, zero before the first round. What a thread wrote before is
    seen by the others afterwards.
    """
    if threads > 1:
        _arrive(meeting)
        looks = 0
        while _look(meeting) < threads * round_:
            looks += 1
            if looks % SPIN == 0:
                _give_core()
    return round_ + 1


@kernel
def meet_again(meeting: Array, threads: int, round_: Array) -> None:
    """As `meet`, for an array with the round of this thread."""
    round_[0] = meet(meeting, threads, round_[0])


@kernel
def _attend(counter: Array, known: int) -> None:
    """Return when the counter is no longer the known number, or after 0.1 ms."""
    for look in range(ATTENTIVE * SPIN):
        if _look(counter) != known:
            return
        if look % SPIN == SPIN - 1:
            _give_core()


# --- the threads besides the caller's -------------------------------------------------------------


class _Worker:
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
        _attend(self._ended, self._begun[0] - 1)
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
            _attend(self._begun, calls)


def _end(workers: list[_Worker]) -> list[BaseException | None]:
    """Wait for all workers; if that is interrupted, the next call gets others."""
    try:
        return [worker.end() for worker in workers]
    except BaseException:
        _workers.cache_clear()
        raise


@cache
def _workers(count: int, process: int) -> tuple[list[_Worker], Lock]:
    """The threads of this process besides the caller's, and who may use them."""
    return [_Worker() for _ in range(count)], Lock()
