"""Whether a loop runs on one thread or on all: what was faster lately (``threads="auto"``).

On an idle machine two threads halve the time of a long loop; on a busy one they wait for each
other, and one thread is faster. So both are measured while the run goes on. The slower one is
tried again from time to time, as the machine may have become idle or busy. A trial is made only
if what the trials of this loop have lost so far, and are about to lose, is below `BUDGET` of the
time that the loop has taken.

On a machine whose cores are all busy, threads that wait for each other lose milliseconds each time:
a loop of 2,000 triangles took 20 to 500 times as long. So loops that are done in `SHORTEST` are
left to one thread, and a loop that iterates is timed in portions of `PORTION`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

ONE, ALL = False, True
BUDGET = 0.03  # of the time of a loop, for trials
GAIN = 0.95  # all threads must take less than this share of the time of one
RECENT = 4  # calls that count
LEAST_LOSS = 0.25, 4e-3  # of a call, and [s]: what a trial counts at least
SHORTEST = 1e-4  # [s] of a unit of work
PORTION = 2e-3  # [s] of the units that are timed at once
MOST_UNITS = 64  # in a portion


@dataclass
class ThreadChoice:
    """The choice for one loop.

    One thread counts with the shortest of its recent times and all threads with their mean: a
    thread that was interrupted by another process says nothing about one thread, but it is what
    makes all threads slow.

    Attributes
    ----------
    spent, on_all, lost
        Seconds of all calls, of those on all threads, and by which calls took longer than in the
        other mode.

    Examples
    --------
    >>> choice, seconds = ThreadChoice(), {ONE: 2.0, ALL: 1.0}
    >>> for call in range(100):
    ...     mode = choice.ask()
    ...     choice.tell(mode, seconds[mode])
    >>> choice.best is ALL, choice.lost < 2 * BUDGET * choice.spent
    (True, True)
    """

    spent: float = 0.0
    on_all: float = 0.0
    lost: float = 0.0
    times: dict[bool, deque] = field(default_factory=lambda: {m: _recent() for m in (ONE, ALL)})
    set_up: set = field(default_factory=set)  # modes that were called once
    loss: float = 0.0  # of the last trial [s a unit]

    @property
    def best(self) -> bool:
        """The mode that was faster lately; one thread as long as all were not measured."""
        if not self.times[ONE] or not self.times[ALL]:
            return ONE
        return self._seconds(ALL) < GAIN * self._seconds(ONE)

    def ask(self, units: float = 1.0) -> bool:
        """Return the mode of the next call, which has that many units of work."""
        best = self.best
        if not self.times[ONE] or self._seconds(ONE) < SHORTEST:
            return ONE
        loss = max(units * self.loss, self._least_loss(units * self._seconds(ONE)))
        allowed = self.lost + loss <= BUDGET * self.spent
        return not best if allowed else best

    @property
    def portion(self) -> int:
        """Units of work to do in the next call of a loop that iterates."""
        if not self.times[ONE]:
            return 1
        return min(MOST_UNITS, math.ceil(PORTION / max(self._seconds(ONE), 1e-9)))

    def tell(self, mode: bool, seconds: float, units: float = 1.0) -> None:
        """Record a call; the first of each mode sets up the loop, and its time is not compared."""
        best, other = self.best, not mode
        self.spent += seconds
        self.on_all += seconds if mode == ALL else 0.0
        if self.times[other]:
            usual = units * self._seconds(other)
            excess = max(0.0, seconds - usual)
            if mode != best:
                self.loss = excess / units if mode in self.set_up else self.loss
                excess = max(excess, self._least_loss(usual))
            self.lost += excess
        if mode in self.set_up:
            self.times[mode].append(seconds / units)
        self.set_up.add(mode)

    def _least_loss(self, seconds: float) -> float:
        part, least = LEAST_LOSS
        return max(part * seconds, least)

    def _seconds(self, mode: bool) -> float:
        times = self.times[mode]
        return min(times) if mode == ONE else sum(times) / len(times)


def _recent() -> deque:
    return deque(maxlen=RECENT)
