"""The progress lines of a study, with the predicted time left."""

import sys
import time
from collections.abc import Callable, Sequence

from fecloth.study.workload import in_words

LONGEST_CAUSE = 100  # characters


class Progress:
    """Prints a line for each finished case."""

    def __init__(
        self,
        costs: Sequence[float],  # predicted, of the cases to run
        stored: int = 0,  # number of cases that an earlier run has finished
        at_once: int = 1,  # number of cases that run side by side
        in_seconds: bool = False,  # whether the costs are CPU seconds; they may have any unit
        quiet: bool = False,  # whether nothing is printed
        clock: Callable[[], float] = time.perf_counter,  # seconds since any time
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
