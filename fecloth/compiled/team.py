"""The threads that share the loops of a run, to the same bits for every number of them.

A `Team` belongs to a `System`; its terms and the matrices of its steps use it. All loops are
compiled and release Python's lock. So plain threads of Python share them: each thread is called
with its own part of the elements or nodes, and the calling thread takes the first part.

Two rules keep the bits. In forces and tangents every node has one owner, which adds up all
contributions to the node, in the order in which one thread would add them (`SharedLoop`). Sums
over all nodes are made of blocks of a fixed size, and the sums of the blocks are added in
order. Loops that iterate keep their threads from begin to end: see `threads`.
"""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
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

# A loop over fewer elements or nodes is done by one thread: it takes less time than to wake
# another thread.
SMALLEST_SHARED_LOOP = 1000
# Largest number of threads that a user may ask for.
MOST_THREADS = 256


def number_of_threads(threads: Any, where: str = "System") -> int:
    """Return the number of threads that "auto" or a number stands for.

    "auto" means all that Numba may start: one on each core that the process may use, or
    ``NUMBA_NUM_THREADS``. Raises `InputError`, with the place `where`, for any other value.
    """
    if isinstance(threads, str) and threads == "auto":
        config: Any = numba.config  # its types lack the settings
        return int(config.NUMBA_NUM_THREADS)
    # True is a number for Python
    is_whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if not (is_whole and 1 <= threads <= MOST_THREADS):
        allowed = f'must be "auto" or a whole number from 1 to {MOST_THREADS}'
        raise InputError(f"threads = {brief(threads)}", allowed, where)
    return int(threads)


class Mode(Enum):
    """The threads that do a loop: one of them, or all."""

    ONE = "one"
    ALL = "all"


# Calls in each mode that a calibration compares: the median of three ignores one interruption.
TRIALS = 3
# All threads are taken if their time is less than this share of the time of one thread.
LARGEST_TIME_RATIO = 0.95
# Share of the time of a loop that calibrations, and calls on all threads, may lose.
LARGEST_LOSS = 0.08
# [s] time of a loop from a calibration to the next one, at the least.
SHORTEST_REST = 0.5
# [s] a shorter unit of work is done by one thread: threads would spend much of it on waiting for
# each other.
SHORTEST_UNIT = 1e-4
# [s] time of a call of a loop that iterates, between calibrations. The trials of a calibration
# take this time together.
PORTION = 1e-2


@dataclass
class ThreadChoice:
    """Whether a loop runs on one thread or on all (``threads="auto"``), by a calibration.

    On an idle machine two threads halve the time of a long loop; on a busy one they wait for
    each other, many times as long. So a few calls in each mode are timed in turn, after one call
    in each mode that sets up the loop. The smaller median decides: one call that was interrupted
    changes nothing.

    After that, one thread takes over when the calls on all threads have lost more than two
    calls, and more than `LARGEST_LOSS` of a `SHORTEST_REST`. The loop is calibrated again when
    the lost time is `LARGEST_LOSS` of the time since.

    Attributes
    ----------
    best
        The mode between calibrations.
    spent
        Time of all calls in each mode [s].
    time_of_one
        Time that one thread takes for a unit of work [s]; 0 before the first calibration.
    """

    best: Mode = Mode.ONE
    spent: dict[Mode, float] = field(default_factory=lambda: dict.fromkeys(Mode, 0.0))
    time_of_one: float = 0.0
    _times: dict[Mode, list[float]] = field(default_factory=lambda: {mode: [] for mode in Mode})
    _set_up: set[Mode] = field(default_factory=set)
    _tried_seconds: float = 0.0  # in this calibration
    _tried_units: float = 0.0
    _lost: float = 0.0  # [s] by all threads, compared with one thread
    _rest: float = 0.0  # [s] until the next calibration

    def ask(self) -> Mode:
        """The mode for the next call."""
        if self._rest > 0:
            return self.best
        if len(self._times[Mode.ALL]) < len(self._times[Mode.ONE]):
            return Mode.ALL
        return Mode.ONE

    def tell(self, mode: Mode, seconds: float, units: float = 1.0) -> None:
        """Take note of a call in a mode: its time [s] and its units of work.

        Between calibrations it counts the time that all threads have lost, compared with one
        thread, and lets one thread take over if that is much. In a calibration it is a trial.
        """
        self.spent[mode] += seconds
        if self._rest > 0:
            self._rest -= seconds
            time_of_one = units * self.time_of_one
            if mode is Mode.ALL:
                self._lost = max(self._lost + seconds - time_of_one, 0.0)
            if self._lost > max(2 * time_of_one, LARGEST_LOSS * SHORTEST_REST):
                self._begin_rest(Mode.ONE, self._lost)
            return
        self._tried_seconds += seconds
        self._tried_units += units
        if mode in self._set_up:  # the first call in a mode sets up the loop, and is no trial
            self._times[mode].append(seconds / units)
            self._conclude()
        self._set_up.add(mode)

    def _conclude(self) -> None:
        """End the calibration if there are enough trials, or the units are too short.

        Then take the faster mode, until the time that the calibration has lost is
        `LARGEST_LOSS` of the time since.
        """
        trials = self._times[Mode.ALL]
        self.time_of_one = median(self._times[Mode.ONE])
        is_short = self.time_of_one < SHORTEST_UNIT
        if len(trials) < TRIALS and not is_short:
            return
        on_all = median(trials) if trials else math.inf
        best = Mode.ONE
        if on_all < LARGEST_TIME_RATIO * self.time_of_one and not is_short:
            best = Mode.ALL
        lost = self._tried_seconds - self._tried_units * min(self.time_of_one, on_all)
        self._begin_rest(best, lost)

    def _begin_rest(self, mode: Mode, lost: float) -> None:
        """Take a mode until the seconds that were lost are `LARGEST_LOSS` of the time."""
        self.best = mode
        self._rest = max(lost / LARGEST_LOSS, SHORTEST_REST)
        self._lost = 0.0
        self._tried_seconds = 0.0
        self._tried_units = 0.0
        self._times = {either: [] for either in Mode}

    @property
    def portion(self) -> int:
        """Units of work to do in the next call of a loop that iterates."""
        if not self.time_of_one:
            return 1
        seconds = PORTION
        if self._rest <= 0:
            seconds = PORTION / TRIALS
        return math.ceil(seconds / self.time_of_one)


class Team:
    """The threads of a system: a number, or "auto".

    For "auto" `ThreadChoice` decides between one thread and all, by the times of a `clock` [s].
    """

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
        """Whether a loop over `size` elements or nodes may be shared."""
        return self.count > 1 and size >= SMALLEST_SHARED_LOOP

    def do(
        self,
        name: object,
        alone: Callable[[], Result],
        together: Callable[[], Result],
        count: Callable[[Result], float] = lambda result: 1.0,
    ) -> Result:
        """Do a loop by alone() on one thread, or by together() on all; return the result.

        Both must have the same result; together() calls `run`. A given number of threads is
        always used. For "auto" a `ThreadChoice` for this `name` decides, from the times of a
        unit of work in earlier calls: `count` takes the number of units from the result.
        """
        if self.count == 1:
            return alone()
        if self.threads != "auto":
            self.has_shared = True  # for `used`
            return together()
        choice = self.choices.setdefault(name, ThreadChoice())
        mode = choice.ask()
        begin = self.clock()
        result = together() if mode is Mode.ALL else alone()
        choice.tell(mode, seconds=self.clock() - begin, units=max(1.0, count(result)))
        return result

    def portion(self, name: object, most: int) -> int:
        """Units of work to do in the next call of `do`, at most `most`."""
        if self.threads != "auto" or self.count == 1:
            return most
        return min(most, self.choices.setdefault(name, ThreadChoice()).portion)

    def each(
        self, size: int, call: Callable[[slice], Call], name: object = None, unit: int = 1
    ) -> None:
        """Call a kernel for all of `size` elements, on one thread or in one part for each.

        ``call(part)`` returns the kernel and its arguments for a range of elements. The kernel
        must write only what belongs to its elements. Parts begin at multiples of `unit`
        elements. `name` tells loops by the same kernel apart, whose times `do` compares.
        """
        function, arguments = call(slice(0, size))
        if not self.shares(size):
            function(*arguments)
            return

        def part(p: int) -> None:
            kernel, its_arguments = call(self.share_of(p, size, unit))
            kernel(*its_arguments)

        self.do((function, name), lambda: function(*arguments), lambda: self.run(part))

    def share_of(self, p: int, size: int, unit: int = 1) -> slice:
        """The range of `size` elements of thread p, from a multiple of `unit`."""
        units = -(-size // unit)
        begin, end = (units * q // self.count * unit for q in (p, p + 1))
        return slice(begin, min(end, size))

    def run(self, part: Callable[[int], Result], meeting: Array | None = None) -> Result:
        """Call part(p) for each thread p at once; return part(0), of the calling thread.

        `meeting` is the counter of `wait`, if the parts wait for each other. If another Python
        thread uses the workers, this call waits for them. An error of a part is raised when all
        parts have ended: the error of the calling thread, or else of the first other one.
        """
        if self.count == 1:
            return part(0)

        def guarded(p: int) -> Result:
            try:
                return part(p)
            except BaseException:
                if meeting is not None:  # the other parts would wait for this one for ever
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
        """A work array of thread p; only the entries that are used take memory."""
        array = self._work.get((p, shape))
        if array is None:
            array = self._work[p, shape] = np.zeros(shape)
        return array

    def words(self, size: int) -> str:
        """How many threads share a loop of `size` elements, in words."""
        if not self.shares(size):
            return "one thread"
        if self.threads == "auto":
            return f"one or {self.count} threads, whichever is faster"
        return amount(self.count, "thread")

    @property
    def used(self) -> int:
        """Threads that were used: all, or one if most of the time was spent with one."""
        alone = sum(choice.spent[Mode.ONE] for choice in self.choices.values())
        on_all = sum(choice.spent[Mode.ALL] for choice in self.choices.values())
        if self.has_shared or on_all > alone:
            return self.count
        return 1


ALONE = Team(1)
