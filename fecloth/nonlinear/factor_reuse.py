"""Reuse of a direct solver's factor in modified Newton: what it belongs to, and when to drop it.

With the factor of an earlier tangent Newton's iteration converges linearly. That pays while the
additional solves cost less than a new factor. The decisions use counts of solves and no clock, so
that a run repeats bit for bit. (Kelley 1995, Iterative Methods for Linear and Nonlinear Equations,
algorithm 5.3.2, the chord method.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# A tangent and its factor in solves and residuals with it, one thread, meshes of 300, 1,200, 4,300
# and 16,000 nodes: PARDISO 3.6, 5.6, 7.1, 7.6, SuperLU 18, 26, 30. (PCG has no factor to keep.)
PRICES = {"pardiso": 5.0, "superlu": 20.0}
LONGEST_WAIT = 64


@dataclass
class FactorReuse:
    """The record of a factor for reuse; the linear solver holds the factor itself."""

    # The system, the weights and the definiteness of the factor's matrix; None without a factor.
    key: tuple | None = None
    # `prepared` of the linear solver when it made the factor; a later one replaces it.
    number: int = 0
    # Steps since then, and iterations in them.
    steps: int = 0
    solves: int = 0
    # Consecutive failures of reuse, and the number of new factors before the next attempt.
    failures: int = 0
    wait: int = 0

    def is_usable(self, key: tuple, linear) -> bool:
        """Return whether the linear solver's factor has this key and reuse is not suspended."""
        if self.wait or self.key is None or self.number != linear.prepared:
            return False
        return self.key[0] is key[0] and self.key[1:] == key[1:]

    def record_factor(self, key: tuple, linear) -> None:
        """Record a new factor; solvers without a price have none to reuse."""
        self.key, self.number = (key if linear.name in PRICES else None), linear.prepared
        self.steps = self.solves = 0
        self.wait = max(0, self.wait - 1)

    def record_iteration(self, contraction: float, to_go: float, linear) -> None:
        """Record an iteration, and drop the factor if the remaining ones cost more than a new one.

        `contraction` is the new residual over the old one, and `to_go` the goal over the new
        residual: ln(to_go)/ln(contraction) iterations remain. After each consecutive failure
        reuse is suspended for 1, 2, 4, … new factors.
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

    def end_step(self, solves: int, linear) -> None:
        """Record the solves of a step; drop the factor if they exceed its average cost per step."""
        if self.key is None:
            return
        average = (PRICES[linear.name] + self.solves - solves) / max(self.steps, 1)
        if self.steps and solves > average:
            self.key = None
        self.steps += 1

    def drop(self) -> None:
        """Forget all steps, so that later ones do not depend on them."""
        self.key = None
        self.number = self.steps = self.solves = self.failures = self.wait = 0
