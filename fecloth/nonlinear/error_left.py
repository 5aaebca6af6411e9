"""The error that Newton's iteration has left in a step, against the error in time of the step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fecloth.system.system import System

ALLOWED = 0.1  # of a step's error in time: the error that Newton's iteration may leave
SHARE = 0.5 * ALLOWED  # of the estimate, which may be too small by a factor of two


@dataclass(frozen=True)
class StepError:
    """The error in time of a step over dt, factor × dt^power [m]."""

    factor: float
    power: int

    def over(self, dt: float) -> float:
        """The error [m] of a step over dt [s]."""
        return self.factor * dt**self.power


@dataclass
class ErrorLeft:
    """The error that is left after each iteration, estimated from the corrections so far.

    A correction s of the unknown changes the velocity by wv s, and the cloth is then by dt wv s
    further on after one more step. The length of s is the mass-weighted root mean square of this
    over the nodes. With the contraction θ, the length of the last correction over the length of the
    correction before, the error left is about

        θ / (1 − θ) × the last length

    Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8.
    """

    unit: float = 1.0  # dt wv
    in_time: float = 0.0  # the error in time of the step [m]; 0 where it is not known
    length: float = 0.0  # of the last correction [m]
    # The error left [m]. It is infinite after fewer than two iterations, where the corrections
    # grow, after a shortened step, and where mass was added to the matrix: then the corrections are
    # short because they are held back.
    error: float = math.inf

    def correct(self, system: System, correction: np.ndarray, whole: bool) -> None:
        """Record a correction (n, 3); `whole` is whether Newton's step was taken as it is."""
        before, self.error = self.length, math.inf
        self.length = self.measure(system, correction)
        if whole and self.length < before:
            contraction = self.length / before
            self.error = contraction / (1 - contraction) * self.length

    def measure(self, system: System, correction: np.ndarray) -> float:
        """Return the length of a correction (n, 3) [m]."""
        return self.unit * float(system.sums.rms(system.diagonal_mass, correction))

    def to_go(self, error: float) -> float:
        """Return the allowed error over this one [m]; at least 1 means that it is reached."""
        return SHARE * self.in_time / error if error else 1.0

    @property
    def is_small(self) -> bool:
        """Whether the error left is small against the error in time."""
        return self.in_time > 0.0 and self.error <= SHARE * self.in_time
