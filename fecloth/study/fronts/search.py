"""The search for the cheapest setting: settings run in the order of their cost."""

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.limit import Limit
from fecloth.study.fronts.settings import Line, Setting
from fecloth.study.status import LATE, OK, REFUSED

FIRST_SECONDS = 0.01  # CPU seconds of the coarsest setting of each line, before it has run
PATIENCE = 4.0  # time that a setting may take over its expected time, before others come first
GROWTH = 1.6  # expected time of a setting over the time of its coarser neighbour
# A refinement that changed the error by less than this part of it does not help, while the error
# is above this multiple of the tolerance.
UNCHANGED = 0.05
NEAR = 2.0


@dataclass(eq=False)
class Search:
    """A search for the cheapest setting within a tolerance.

    The setting that could lead to the cheapest of all is run next. Its neighbours with a finer h
    and a shorter dt follow, with an expected time by its own, and with a promise: the least time
    in which their line may meet the tolerance, as each halving of dt divides an error of second
    order by four. The search is at its end when all promises left are longer than the cheapest
    setting that meets the tolerance.

    Attributes
    ----------
    bench
        Where settings run.
    limit
        To which errors are distances.
    tolerance
        Largest relative error.
    longest
        CPU seconds that a setting may take [s].
    queue
        Settings to run: their promise [s], a number that keeps their order, their expected
        seconds, and the setting.
    seen
        The settings that were taken from the queue.
    by_chance
        Settings that do not count, because a finer neighbour of theirs has a larger error.
    distances
        The relative distances (q,) to the limit of settings that were asked for.
    number
        The number of the next setting in the queue.
    report
        Is told each setting that is the cheapest so far, in words.
    """

    bench: Bench
    limit: Limit
    tolerance: float
    longest: float = math.inf
    queue: list[tuple[float, int, float, Setting]] = field(default_factory=list)
    seen: set[Setting] = field(default_factory=set)
    by_chance: set[Setting] = field(default_factory=set)
    distances: dict[Setting, np.ndarray] = field(default_factory=dict)
    number: Iterator[int] = field(default_factory=count)
    report: Callable[[str], None] = lambda words: None

    def add_lines(self, lines: Sequence[Line]) -> None:
        """Add the coarsest settings of lines."""
        for line in lines:
            self._push(FIRST_SECONDS, FIRST_SECONDS, Setting(line))

    def _push(self, promise: float, seconds: float, setting: Setting) -> None:
        heapq.heappush(self.queue, (promise, next(self.number), seconds, setting))

    @property
    def cheapest(self) -> Setting | None:
        """The cheapest setting with error and U within the tolerance; None if there is none."""
        settings = [setting for setting in self.bench.rows if self.meets(setting)]
        return min(settings, key=self.bench.took, default=None)

    def meets(self, setting: Setting) -> bool:
        """Whether a setting has run, and meets tolerance and time."""
        if not self.bench.is_ok(setting) or self.bench.took(setting) > self.longest:
            return False
        if setting in self.by_chance:
            return False
        return self.bound(setting) <= self.tolerance

    def bound(self, setting: Setting) -> float:
        """Return error and U of a setting; infinite if it did not run to its end."""
        return float((self._distance(setting) + self.limit.uncertainty).max())

    def error(self, setting: Setting) -> float:
        """Return the largest relative distance to the limit."""
        return float(self._distance(setting).max())

    def _distance(self, setting: Setting) -> np.ndarray:
        """Return the (q,) relative distances to the limit; infinite for what has not run."""
        if not self.bench.is_ok(setting):
            return np.full(len(self.bench.quantities), math.inf)
        if setting not in self.distances:
            self.distances[setting] = self.limit.error(self.bench.rows[setting])
        return self.distances[setting]

    @property
    def next(self) -> Setting | None:
        """The setting to run next; None where no setting left can be cheaper."""
        limit = self.longest
        if self.cheapest:
            limit = min(limit, self.bench.took(self.cheapest))
        while self.queue and self.queue[0][3] in self.seen:
            heapq.heappop(self.queue)
        if not self.queue or self.queue[0][0] > limit:
            return None
        return self.queue[0][3]

    def run(self, reserve: float = 0.0) -> str:
        """Run settings until none can be cheaper; return why it ended before, or "".

        The cheapest setting must not be within the tolerance by chance, as where its errors in
        space and time cancel: its neighbours with a finer h, and with a shorter dt, run too, and
        must meet the tolerance. `reserve` is the CPU time that is kept, beside three runs of the
        cheapest setting [s].
        """
        while True:
            why = self._run_queue(reserve)
            cheapest = self.cheapest
            if why or cheapest is None or not self._is_by_chance(cheapest):
                return why
            self.by_chance.add(cheapest)

    def _is_by_chance(self, setting: Setting) -> bool:
        """Whether a neighbour with a finer h, or a shorter dt, does not meet the tolerance.

        A neighbour that does not run to its end, or would take too long, says nothing.
        """
        refine_h, refine_dt = self.bench.settings.can_be_finer(setting)
        neighbours = [setting.finer(i=1)] * refine_h + [setting.finer(j=1)] * refine_dt
        for neighbour in neighbours:
            expected = GROWTH * self.bench.took(setting)
            if self.bench.allows(2 * expected):
                self.bench.run(neighbour, PATIENCE * expected)
            if self.bench.is_ok(neighbour) and self.bound(neighbour) > self.tolerance:
                return True
        return False

    def _run_queue(self, reserve: float) -> str:
        """Run settings of the queue until none can be cheaper; return why it ended before."""
        while setting := self.next:
            promise, _, expected, _ = self.queue[0]
            kept = reserve
            if self.cheapest:
                kept += 3 * self.bench.took(self.cheapest)
            if self.bench.left < kept + expected or not self.bench.allows(expected):
                return "the time is up"
            heapq.heappop(self.queue)
            most = PATIENCE * expected
            self.bench.run(setting, most)
            if self.cheapest == setting:
                words = f"error + U of {100 * self.bound(setting):.2g} %"
                self.report(f"{words} in {self.bench.took(setting):.2g} s")
            if setting in self.bench.rows:
                self.seen.add(setting)
                self._add_finer(setting, expected)
            else:  # it takes longer, so that cheaper ones come before it
                self._push(max(promise, most), most, setting)
        return ""

    def _add_finer(self, setting: Setting, expected: float) -> None:
        """Add the neighbours of a setting that has run, where they can help."""
        row = self.bench.rows[setting]
        if row["status"] == LATE:  # finer ones take longer
            return
        took = expected
        if row["status"] == OK:
            took = max(self.bench.took(setting), FIRST_SECONDS)
        ratio = max(self.error(setting) / self.tolerance, 4.0)
        halvings = math.log(ratio, 4)
        if math.isinf(halvings):  # it failed, and nothing is known of its error
            halvings = 1.0
        promise = GROWTH**halvings * took
        refine_h, refine_dt = self.bench.settings.can_be_finer(setting)
        if refine_h and self._helps(setting, setting.finer(i=-1)):
            self._push(promise, GROWTH * took, setting.finer(i=1))
        if refine_dt and self._helps(setting, setting.finer(j=-1)):
            self._push(promise, GROWTH * took, setting.finer(j=1))

    def _helps(self, setting: Setting, coarser: Setting) -> bool:
        """Whether a further refinement, after the one from `coarser`, may help."""
        status = self.bench.rows[setting]["status"]
        before = self.bench.rows.get(coarser)
        if status == REFUSED:  # a mesh may be too coarse for its shape, but twice is enough
            return before is None or before["status"] != REFUSED
        error = self.error(setting)
        if before is None or math.isinf(error) or error <= NEAR * self.tolerance:
            return True
        return abs(error - self.error(coarser)) > UNCHANGED * error
