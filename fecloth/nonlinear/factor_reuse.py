"""The factor that modified Newton keeps: what it was made for, and whether keeping it pays.

The iteration with a tangent of earlier converges linearly: it pays while the solves that it needs
more cost less than a new factor. All is decided by counts, in solves with the factor; a run
repeats bit for bit. (Kelley 1995, Iterative Methods for Linear and Nonlinear Equations, algorithm
5.3.2, the chord method.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# A tangent and its factor in solves and residuals with it, one thread, meshes of 300, 1,200, 4,300
# and 16,000 nodes: PARDISO 3.6, 5.6, 7.1, 7.6, SuperLU 18, 26, 30. (PCG has no factor to keep.)
PRICES = {"pardiso": 5.0, "superlu": 20.0}
LONGEST_WAIT = 64


@dataclass
class Kept:
    """The state of a kept factor; the factor itself is the linear solver's.

    Attributes
    ----------
    key
        The system, the weights and the definiteness it was made for; None if there is none.
    number
        Of the linear solver's preparation that made it: another one has replaced it.
    steps, solves
        Steps since it was made, and iterations in them.
    failures, wait
        Times in a row that it served badly, and new factors until one is tried again.
    """

    key: tuple | None = None
    number: int = 0
    steps: int = 0
    solves: int = 0
    failures: int = 0
    wait: int = 0

    def fits(self, key: tuple, linear) -> bool:
        """Whether the linear solver's factor was made for this key, and is to be tried."""
        if self.wait or self.key is None or self.number != linear.prepared:
            return False
        return self.key[0] is key[0] and self.key[1:] == key[1:]

    def made(self, key: tuple, linear) -> None:
        """There is a new factor."""
        kept = linear.name in PRICES
        self.key, self.number = (key if kept else None), linear.prepared
        self.steps = self.solves = 0
        self.wait = max(0, self.wait - 1)

    def served(self, contraction: float, to_go: float, linear) -> None:
        """An iteration reduced the residual by `contraction`; `to_go` is goal over residual.

        ln(to_go)/ln(contraction) more are to come; the factor goes if that is dearer than a new
        one. One that served badly is answered with 1, 2, 4, … new ones that are not tried again.
        """
        self.solves += 1
        cheap = contraction == 0.0 or to_go >= 1.0
        if not cheap and contraction < 1.0:
            cheap = math.log(to_go) / math.log(contraction) < PRICES[linear.name]
        if cheap:
            self.failures = 0
        else:
            self.failures += 1
            self.key, self.wait = None, min(2 ** (self.failures - 1), LONGEST_WAIT)

    def step_ends(self, solves: int, linear) -> None:
        """A step took so many solves in all; a factor dearer than its average so far goes."""
        if self.key is None:
            return
        average = (PRICES[linear.name] + self.solves - solves) / max(self.steps, 1)
        if self.steps and solves > average:
            self.key = None
        self.steps += 1

    def drop(self) -> None:
        """Forget everything: what follows does not depend on the past."""
        self.key = None
        self.number = self.steps = self.solves = self.failures = self.wait = 0
