"""The threads that share the loops of a run, to the same bits for every number of them.

A `Team` belongs to a `System`; its terms and the matrices of its steps use it. All loops are
compiled and release Python's lock, so plain threads of Python share them: each is called with
its own part of the elements or nodes, and the thread that asks takes the first part itself.

Two rules keep the bits. Forces and tangents: every node has one owner, and the owner adds up all
that the node gets, in the order in which one thread would (`SharedLoop`). Sums over all nodes:
they are made of blocks of a fixed size, and the sums of the blocks are added in order.

Loops that iterate, as conjugate gradients and explicit steps do, keep their threads from begin to
end, and these wait for each other: see `threads`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

import numba
import numpy as np

from fecloth.compiled.jit import Array
from fecloth.compiled.thread_choice import ThreadChoice
from fecloth.compiled.threads import GIVE_UP, end_all, workers_of
from fecloth.errors import InputError, brief

Result = TypeVar("Result")
Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A kernel and its arguments."""

SMALL = 1000  # elements or nodes below which one thread does a loop
MOST = 256  # threads


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

    def each(
        self, size: int, call: Callable[[slice], Call], name: object = None, unit: int = 1
    ) -> None:
        """Make call(part), which writes only what belongs to its elements.

        Parameters
        ----------
        size
            Number of elements.
        call
            Gives the kernel and the arguments for a range of them.
        name
            Of the loop, as for `do`.
        unit
            Elements that must stay together.
        """
        function, arguments = call(slice(0, size))
        if not self.shares(size):
            function(*arguments)
            return

        def part(p: int) -> None:
            one, its_arguments = call(self.share_of(p, size, unit))
            one(*its_arguments)

        self.do((function, name), lambda: function(*arguments), lambda: self.run(part))

    def share_of(self, p: int, size: int, unit: int = 1) -> slice:
        """Return the range of a number of elements that belongs to thread p."""
        units = -(-size // unit)
        begin, end = (units * q // self.count * unit for q in (p, p + 1))
        return slice(begin, min(end, size))

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

        workers, lock = workers_of(os.getpid(), self.count - 1)
        with lock:
            for p, worker in enumerate(workers, 1):
                worker.begin(partial(guarded, p))
            try:
                result = guarded(0)
            finally:
                errors = end_all(workers)
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
