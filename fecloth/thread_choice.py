"""Whether a loop runs on one thread or on all: what was faster lately (``threads="auto"``).

On an idle machine two threads halve the time of a long loop; on a busy one they wait for each
other, and one thread is faster. So both are measured while the run goes on. The slower one is
tried again from time to time, as the machine may have become idle or busy. A trial is made only
if what the trials of this loop have lost so far, and are about to lose, is below `BUDGET` of the
time that the loop has taken.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

ONE, ALL = False, True
BUDGET = 0.03  # of the time of a loop, for trials
GAIN = 0.95  # all threads must take less than this share of the time of one
RECENT = 4  # calls that count
LEAST_LOSS = 0.25  # of a call: what a trial counts at least, so that there are not too many


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
        if not self.times[ONE]:
            return ONE
        loss = max(self.loss, LEAST_LOSS * self._seconds(ONE))
        allowed = self.lost + units * loss <= BUDGET * self.spent
        return not best if allowed else best

    def tell(self, mode: bool, seconds: float, units: float = 1.0) -> None:
        """Record a call; the first of each mode is not compared, because it sets up the loop."""
        best, other = self.best, not mode
        self.spent += seconds
        self.on_all += seconds if mode == ALL else 0.0
        if mode not in self.set_up:
            self.set_up.add(mode)
            return
        if self.times[other]:
            excess = max(0.0, seconds - units * self._seconds(other))
            if mode != best:
                self.loss = excess / units
                excess = max(excess, LEAST_LOSS * seconds)
            self.lost += excess
        self.times[mode].append(seconds / units)

    def _seconds(self, mode: bool) -> float:
        times = self.times[mode]
        return min(times) if mode == ONE else sum(times) / len(times)


def _recent() -> deque:
    return deque(maxlen=RECENT)
