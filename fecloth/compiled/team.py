"""The threads that share the loops of a run, to the same bits for every number of them.

A `Team` belongs to a `System`; its terms and the matrices of its steps use it. All loops are
compiled and release Python's lock, so plain threads of Python share them: each is called with
its own part of the elements or nodes, and the thread that asks takes the first part itself.

Two rules keep the bits. Forces and tangents: every node has one owner, and the owner adds up
all that the node gets, in the order in which one thread would (`SharedLoop`). Sums over all
nodes: they are made of blocks of a fixed size, and the sums of the blocks are added in order.
Loops that iterate keep their threads from begin to end: see `threads`.
"""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import Any, TypeVar

import numba
import numpy as np

from fecloth.compiled.jit import Array
from fecloth.compiled.threads import GIVE_UP, end_all, workers_of
from fecloth.errors import InputError, amount, brief

Result = TypeVar("Result")
Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A kernel and its arguments."""

SMALL = 1000  # elements or nodes below which one thread does a loop
MOST = 256  # threads


def number_of_threads(threads: Any, where: str = "System") -> int:
    """Number of threads for "auto", which means all that Numba may start, or a number."""
    # Numba may start one on each core that the process may use, or ``NUMBA_NUM_THREADS``.
    if isinstance(threads, str) and threads == "auto":
        config: Any = numba.config  # its types lack the settings
        return int(config.NUMBA_NUM_THREADS)
    whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if not (whole and 1 <= threads <= MOST):
        allowed = f'must be "auto" or a whole number from 1 to {MOST}'
        raise InputError(f"threads = {brief(threads)}", allowed, where)
    return int(threads)


ONE, ALL = False, True  # thread or threads
TRIALS = 3  # calls of each that a calibration compares
GAIN = 0.95  # all threads must take less than this share of the time of one
WORST = 2.0  # times the time of one thread: most trials above it end a calibration
BUDGET = 0.08  # of the time of a loop, that may be lost
CREDIT = 0.2  # [s] that all threads have gained and may lose again
REST = 0.5  # [s] of a loop, from a calibration to the next one, at least
SHORTEST = 1e-4  # [s] of a unit of work, below which one thread does it
PORTION = 2e-3, 1e-2  # [s] of the units that are timed at once, in calibrations and between them
MOST_UNITS = 64  # in a portion


@dataclass
class ThreadChoice:
    """Whether a loop runs on one thread or on all (``threads="auto"``), by a calibration.

    On an idle machine two threads halve the time of a long loop; on a busy one they wait for
    each other, many times as long. So a few calls of each are timed in turn, after one of each
    that sets up the loop. The smaller median decides: one call that was interrupted changes
    nothing. Then one thread takes over when the calls on all threads have lost more than two
    calls, or `BUDGET` of a `REST`, and what they had gained, up to `CREDIT`. The loop is
    calibrated again when what was lost is `BUDGET` of the time since.
    """

    # The mode between calibrations, and the seconds of all calls in each mode.
    best: bool = ONE
    spent: dict[bool, float] = field(default_factory=lambda: {ONE: 0.0, ALL: 0.0})
    usual: float = 0.0  # of one thread [s a unit]
    _times: dict[bool, list[float]] = field(default_factory=lambda: {ONE: [], ALL: []})
    _set_up: set[bool] = field(default_factory=set)
    _tried: tuple[float, float] = 0.0, 0.0  # seconds and units of this calibration
    _lost: float = 0.0  # by all threads since one thread rested [s]; negative where they gain
    _rest: float = 0.0  # until the next one [s]

    def ask(self) -> bool:
        if self._rest > 0:
            return self.best
        return len(self._times[ALL]) < len(self._times[ONE])

    def tell(self, mode: bool, seconds: float, units: float = 1.0) -> None:
        self.spent[mode] += seconds
        if self._rest > 0:
            self._rest -= seconds
            if mode == ALL:
                self._lost = max(self._lost + seconds - units * self.usual, -CREDIT)
            if self._lost > max(2 * units * self.usual, BUDGET * REST):
                self._begin_rest(ONE, self._lost)
            return
        self._tried = self._tried[0] + seconds, self._tried[1] + units
        if mode in self._set_up:
            self._times[mode].append(seconds / units)
            self._conclude()
        self._set_up.add(mode)

    def _conclude(self) -> None:
        """End the calibration if enough is known."""
        one = self._times[ONE]
        all_ = self._times[ALL]
        self.usual = median(one)
        is_slow = 2 * sum(each > WORST * self.usual for each in all_) > TRIALS
        is_hopeless = self.usual < SHORTEST or is_slow
        if len(all_) < TRIALS and not is_hopeless:
            return
        on_all = median(all_) if all_ else math.inf
        lost = self._tried[0] - self._tried[1] * min(self.usual, on_all)
        self._begin_rest(not is_hopeless and on_all < GAIN * self.usual, lost)

    def _begin_rest(self, mode: bool, lost: float) -> None:
        """Take a mode until the seconds that were lost are `BUDGET` of the time."""
        self.best, self._rest = mode, max(lost / BUDGET, REST)
        self._lost = min(self._lost, 0.0)
        self._tried = (0.0, 0.0)
        self._times = {ONE: [], ALL: []}

    @property
    def portion(self) -> int:
        """Units of work to do in the next call of a loop that iterates."""
        seconds = PORTION[self._rest > 0]
        if self.usual:
            return min(MOST_UNITS, math.ceil(seconds / self.usual))
        return 1


class Team:
    """The threads of a system: a number, or "auto", for which `ThreadChoice` asks the clock [s]."""

    def __init__(self, threads: int | str = 1, clock: Callable[[], float] = time.perf_counter):
        self.threads = threads
        self.clock = clock
        self.count = number_of_threads(threads)
        self.has_shared = False  # a loop with a given number of threads
        self.choices: dict[object, ThreadChoice] = {}
        self._work: dict[tuple, np.ndarray] = {}

    def __reduce__(self) -> tuple:
        return Team, (self.threads,)

    @contextmanager
    def pinned(self) -> Iterator[None]:
        """Let one thread do all loops inside."""
        before = self.count
        self.count = 1
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
        count: Callable[[Result], float] = lambda result: 1.0,
    ) -> Result:
        """Return alone(), or together(), which calls `run`; both must have the same result.

        The times of a loop are compared by its `name`, and by its units of work, which `count`
        takes from the result.
        """
        if self.count == 1:
            return alone()
        if self.threads != "auto":
            self.has_shared = True
            return together()
        choice = self.choices.setdefault(name, ThreadChoice())
        on_all = choice.ask()
        begin = self.clock()
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
        """Make call(part), the kernel and its arguments for a range of `size` elements.

        It writes only what belongs to its elements, of which each `unit` must stay together.
        `name` is as for `do`.
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
        return amount(self.count, "thread")

    @property
    def used(self) -> int:
        """Threads that were used: all, or one if most of the time was spent with one."""
        spent = [choice.spent for choice in self.choices.values()]
        alone, on_all = (sum(each[mode] for each in spent) for mode in (ONE, ALL))
        if self.has_shared or on_all > alone:
            return self.count
        return 1


ALONE = Team(1)
