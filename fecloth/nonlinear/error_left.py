"""The error that Newton's iteration has left: in a step against the error in time, in an
equilibrium against the displacement."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from fecloth.linalg.reductions import longest
from fecloth.system.system import System

ALLOWED = 0.1  # of a step's error in time: the error that Newton's iteration may leave
SHARE = 0.5 * ALLOWED  # of the estimate, which may be too small by a factor of two
PLACE = 1e-6  # of the largest displacement: the error that an equilibrium may have by default
FORCES = 1e-9  # of the forces: the residual with that error, unless round-off is more
BALANCED = 0.01  # of the forces of contact: a larger residual gives or takes energy of an impact
SHRINKS = 0.5  # of the correction before: one that is longer shows no convergence


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

    A correction s of the unknown changes the velocity by wv s, and the cloth is then by dt wv
    s further on after one more step. The length of s is the mass-weighted root mean square of
    this over the nodes. With the contraction θ, the length of the last correction over the
    length of the correction before, the error left is about

        θ / (1 − θ) × the last length

    Where contacts push, this says little: their forces change much over a hundredth of the
    gap. So the error counts as unknown there while the residual is above 1 % of their size.

    Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8.
    """

    unit: float = 1.0  # dt wv
    in_time: float = 0.0  # the error in time of the step [m]; 0 where it is not known
    length: float = 0.0  # of the last correction [m]
    push: Callable[[np.ndarray], float] | None = None  # size of the forces of contact [N]
    goal: ClassVar[float | None] = None  # relative residual in place of the option's, or None
    # The error left [m]. It is infinite after fewer than two iterations, where the corrections
    # grow, after a shortened step, and where mass was added to the matrix: then the
    # corrections are short because they are held back.
    error: float = math.inf

    def correct(self, system: System, correction: np.ndarray, whole: bool) -> None:
        """Record a correction (n, 3); `whole` is whether Newton's step was taken as it is."""
        before = self.length
        self.error = math.inf
        self.length = self.measure(system, correction)
        if whole and self.length < before:
            contraction = self.length / before
            self.error = contraction / (1 - contraction) * self.length

    def measure(self, system: System, correction: np.ndarray) -> float:
        """Return the length of a correction (n, 3) [m]."""
        return self.unit * float(system.sums.rms(system.diagonal_mass, correction))

    def to_go(self, error: float) -> float:
        """Return the allowed error over this one [m]; at least 1 means that it is reached."""
        if error:
            return SHARE * self.in_time / error
        return 1.0

    @property
    def is_small(self) -> bool:
        return self.in_time > 0.0 and self.error <= SHARE * self.in_time

    def move(self, y: np.ndarray, norm: float, scale: float) -> None:
        """Record the unknown (n, 3), its residual and the sum of all forces [N]."""
        if self.push and math.isfinite(self.error):
            push = self.push(y)
            if push and norm > BALANCED * push:
                self.error = math.inf
            else:
                self.error = self.error

    @property
    def is_needed(self) -> bool:
        """Whether a small residual is not enough: the next correction may still count."""
        return False

    @property
    def stands(self) -> bool:
        """Whether the corrections no longer shrink, as at round-off."""
        return False


@dataclass
class ErrorInPlace(ErrorLeft):
    """The error that is left in the positions of an equilibrium, against the largest displacement.

    A length is here the largest of all nodes. The iteration ends where the error left is below
    1e-6 of the largest displacement since the start, or where the corrections no longer shrink
    and the residual is round-off: `length` is then what round-off leaves.
    """

    goal: ClassVar[float] = FORCES
    start: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) positions [m]
    moved: float = 0.0  # the largest displacement since then [m]
    before: float = math.inf  # length of the correction before the last one [m]
    residual: float = math.inf  # of the forces
    whole: bool = True  # whether the last step was Newton's step as it is

    def correct(self, system: System, correction: np.ndarray, whole: bool) -> None:
        """Record a correction (n, 3); the error is known after two that shrank in a row."""
        # One alone may be short by chance where a stiff sheet turns.
        shrank = self.whole and self.length < SHRINKS * self.before < math.inf
        self.before = self.length or math.inf
        self.whole = whole
        super().correct(system, correction, whole)
        if not shrank:
            self.error = math.inf

    def measure(self, system: System, correction: np.ndarray) -> float:
        return longest(correction)

    def move(self, y: np.ndarray, norm: float, scale: float) -> None:
        self.moved = longest(y - self.start)
        self.residual = norm / scale if scale else 0.0

    @property
    def is_small(self) -> bool:
        """Whether the error left is small against the largest displacement, and the residual."""
        return self.error <= PLACE * self.moved and self.residual <= FORCES

    @property
    def is_needed(self) -> bool:
        return self.whole and not self.stands

    @property
    def stands(self) -> bool:
        return self.whole and self.length > SHRINKS * self.before

    @property
    def left(self) -> float:
        """The error [m] at the end; what round-off leaves where that is more; NaN if not known."""
        if self.stands:
            return max(self.length, self.before)
        rounded = float(np.finfo(float).eps) * longest(self.start)
        if math.isfinite(self.error):
            return max(self.error, rounded)
        return math.nan
