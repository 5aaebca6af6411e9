"""The progress lines of a study, with the predicted time left."""

import sys
import time
from collections.abc import Callable, Sequence

from fecloth.study.workload import in_words

LONGEST_CAUSE = 100  # characters


class Progress:
    """Prints a line for each finished case.

    Parameters
    ----------
    costs
        Predicted costs of the cases to run.
    stored
        Number of cases that an earlier run has finished.
    at_once
        Number of cases that run side by side.
    in_seconds
        Whether the costs are CPU seconds; they may have any unit.
    quiet
        Whether nothing is printed.
    clock
        Seconds since any time.

    Examples
    --------
    >>> clock = iter([0.0, 9.0, 11.0, 13.0]).__next__
    >>> progress = Progress([1.0, 1.0, 2.0], in_seconds=True, clock=clock)
    >>> progress.add(1.0), progress.seconds_left  # the first case also compiles: it says little
    (None, 3.0)
    >>> progress.add(1.0), progress.seconds_left
    (None, 4.0)
    """

    def __init__(
        self,
        costs: Sequence[float],
        stored: int = 0,
        at_once: int = 1,
        in_seconds: bool = False,
        quiet: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ):
        self.count, self.cost, self.at_once, self.clock = len(costs), sum(costs), at_once, clock
        self.in_seconds, self.quiet = in_seconds, quiet
        self.done, self.spent, self.elapsed = 0, 0.0, 0.0
        self.warm = 0.0, 0.0  # cost and time of the cases that imported and compiled
        self.begin = clock()
        if stored and not quiet:
            print(f"cases already stored: {stored} of {stored + self.count}", file=sys.stderr)

    def add(self, cost: float) -> None:
        """Count a finished case."""
        self.done, self.spent = self.done + 1, self.spent + cost
        self.elapsed = self.clock() - self.begin
        if self.done <= self.at_once:
            self.warm = self.spent, self.elapsed

    @property
    def seconds_left(self) -> float:
        """Predicted time left [s]: from the finished cases, without the first of each process."""
        left, (spent, elapsed) = self.cost - self.spent, self.warm
        if self.spent > spent:
            return left * (self.elapsed - elapsed) / (self.spent - spent)
        return left / self.at_once if self.in_seconds else left * elapsed / spent

    def print(self, words: str, result: dict, cost: float) -> None:
        """Count a finished case and print its line."""
        self.add(cost)
        if self.quiet:
            return
        times = f"{self.elapsed:.0f} s"
        if self.done < self.count:
            times += f", about {in_words(self.seconds_left)} left"
        line = f"[{self.done}/{self.count}, {times}] {words}: {_describe(result)}"
        print(line, file=sys.stderr, flush=True)


def _describe(result: dict) -> str:
    """Return the status, and of a failure the first words of its cause."""
    cause = result["cause"].splitlines()[0] if result["cause"] else ""
    if len(cause) > LONGEST_CAUSE:
        cause = f"{cause[:LONGEST_CAUSE].rpartition(' ')[0]} …"
    return f"{result['status']}: {cause}" if cause else result["status"]
