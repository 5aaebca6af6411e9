"""The error that Newton's iteration has left.

In a step it is compared with the error in time, in an equilibrium with the displacement.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from fecloth.linalg.reductions import longest
from fecloth.system.system import System

# The error that Newton's iteration may leave, as a part of the estimated error in time of the
# step: a tenth, and half of that because the estimate may be too small by a factor of two.
ALLOWED_OF_ERROR_IN_TIME = 0.05
# The error that an equilibrium may have by default, as a part of the largest displacement …
ALLOWED_OF_DISPLACEMENT = 1e-6
# … and the residual that must come with it, as a part of the forces, unless round-off is more.
ALLOWED_OF_FORCES = 1e-9
# Of the forces of contact: they change much over a small part of the gap.
ALLOWED_OF_CONTACT_FORCES = 0.1
# Corrections converge if each is at most this part of the one before; others may be round-off.
SLOWEST_CONTRACTION = 0.5


@dataclass(frozen=True)
class StepError:
    """The error in time of a step over dt [s], which is factor × dt^power [m]."""

    factor: float
    power: int

    def over(self, dt: float) -> float:
        """The error [m] of a step over dt [s]."""
        return self.factor * dt**self.power


@dataclass
class ErrorLeft:
    """The error that is left after each iteration, estimated from the corrections so far.

    A correction s of the unknown changes the velocity by wv s. After one more step this moves
    the cloth by dt wv s. The length of s is the root mean square of this way over the nodes,
    weighted by their mass. With the contraction θ, the length of the last correction over the
    length of the correction before, the error left is about

        θ / (1 − θ) × the last length

    Where contacts push, this says little: their forces change much over a hundredth of the
    gap. So the error counts as unknown there while the residual is above a tenth of their size.

    Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8.

    Attributes
    ----------
    unit
        dt wv, the way [m] for a correction of 1.
    in_time
        The error in time of the step [m]; 0 where it is not known.
    length
        Length of the last correction [m].
    push
        Size of the forces of contact [N] at an unknown; None without contact.
    error
        The error left [m]. It is infinite after fewer than two iterations and where the
        corrections grow. It is also infinite after a shortened step and where mass was added
        to the matrix, as such corrections are short because they are held back.
    goal
        Relative residual at which the iteration ends, in place of the option's; None for that.
    """

    unit: float = 1.0
    in_time: float = 0.0
    length: float = 0.0
    push: Callable[[np.ndarray], float] | None = None
    goal: ClassVar[float | None] = None
    error: float = math.inf

    def correct(self, system: System, correction: np.ndarray, whole: bool) -> None:
        """Record a correction (n, 3); `whole` says whether Newton's step was taken as it is."""
        before = self.length
        self.error = math.inf
        self.length = self.measure(system, correction)
        if whole and self.length < before:
            contraction = self.length / before
            self.error = contraction / (1 - contraction) * self.length

    def measure(self, system: System, correction: np.ndarray) -> float:
        """The length of a correction (n, 3) [m]."""
        return self.unit * float(system.sums.rms(system.diagonal_mass, correction))

    def to_go(self, error: float) -> float:
        """The allowed error over an error [m]; at least 1 means that the goal is reached."""
        if error:
            return ALLOWED_OF_ERROR_IN_TIME * self.in_time / error
        return 1.0

    @property
    def is_small(self) -> bool:
        """Whether the error left is small against the error in time."""
        return self.in_time > 0.0 and self.error <= ALLOWED_OF_ERROR_IN_TIME * self.in_time

    def move(self, y: np.ndarray, norm: float, scale: float) -> None:
        """Record the unknown (n, 3), its residual and the sum of all forces [N]."""
        if self.push and math.isfinite(self.error):
            push = self.push(y)
            if push and norm > ALLOWED_OF_CONTACT_FORCES * push:
                self.error = math.inf

    @property
    def is_needed(self) -> bool:
        """Whether a small residual is not enough: the next correction may still count."""
        return False

    @property
    def stagnates(self) -> bool:
        """Whether the corrections no longer shrink, as at round-off."""
        return False


@dataclass
class ErrorInPlace(ErrorLeft):
    """The error left in the positions of an equilibrium, against the largest displacement.

    A length is here the largest of all nodes. The iteration ends where the error left is below
    1e-6 of the largest displacement since the start, or where the corrections no longer shrink
    and the residual is round-off: `length` is then what round-off leaves.

    Attributes
    ----------
    start
        (n, 3) positions at the start [m].
    moved
        The largest displacement since then [m].
    before
        Length of the correction before the last one [m].
    residual
        The residual after the last step, relative to the forces.
    whole
        Whether the last step was Newton's step as it is.
    """

    goal: ClassVar[float] = ALLOWED_OF_FORCES
    start: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    moved: float = 0.0
    before: float = math.inf
    residual: float = math.inf
    whole: bool = True

    def correct(self, system: System, correction: np.ndarray, whole: bool) -> None:
        """Record a correction (n, 3); the error is known after two that shrank in a row.

        One alone may be short by chance where a stiff sheet turns.
        """
        shrank = self.whole and self.length < SLOWEST_CONTRACTION * self.before < math.inf
        self.before = self.length or math.inf
        self.whole = whole
        super().correct(system, correction, whole)
        if not shrank:
            self.error = math.inf

    def measure(self, system: System, correction: np.ndarray) -> float:
        """The longest way of a node in a correction (n, 3) [m]."""
        return longest(correction)

    def move(self, y: np.ndarray, norm: float, scale: float) -> None:
        """Record positions (n, 3) [m], their residual and the sum of all forces [N]."""
        self.moved = longest(y - self.start)
        self.residual = norm / scale if scale else 0.0

    @property
    def is_small(self) -> bool:
        """Whether the error left is small against the largest displacement, and the residual."""
        is_balanced = self.residual <= ALLOWED_OF_FORCES
        return self.error <= ALLOWED_OF_DISPLACEMENT * self.moved and is_balanced

    @property
    def is_needed(self) -> bool:
        """Whether a small residual is not enough: the corrections still shrink."""
        return self.whole and not self.stagnates

    @property
    def stagnates(self) -> bool:
        """Whether the corrections no longer shrink, as at round-off."""
        return self.whole and self.length > SLOWEST_CONTRACTION * self.before

    @property
    def left(self) -> float:
        """The error [m] at the end, or what round-off leaves if that is more; NaN if unknown."""
        if self.stagnates:
            return max(self.length, self.before)
        rounded = float(np.finfo(float).eps) * longest(self.start)
        if math.isfinite(self.error):
            return max(self.error, rounded)
        return math.nan
