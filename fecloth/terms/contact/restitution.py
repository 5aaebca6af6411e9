"""How a contact dissipates: its pressure is multiplied by max(0, 1 − c ḋ), with the distance d.

Over a step, ḋ is (d − d₀)/dt with the distance d₀ at its begin. So the pressure of a point
depends on d alone, and has a potential over the step. With s = d/gap, s₀ = d₀/gap and
a = c gap/dt these are

    pressure   p(s) w(s)       with w = max(0, 1 − a (s − s₀))
    potential  ∫_s^m p w dσ    with m = min(1, s₀ + 1/a)

where p = −b′ is the pressure of the barrier b. An approach raises the pressure and a retreat
lowers it. It is never negative, so that nothing sticks.

Without other forces the equation m d̈ = p(d) (1 − c ḋ) can be integrated, for any pressure p. Of
the speed v₁ of the first touch it leaves the speed e v₁, where y = c v₁ follows from

    y − ln(1 + y) = −e y − ln(1 − e y)

Source: Hunt and Crossley (1975), Coefficient of Restitution Interpreted as Damping in
Vibroimpact, J. Appl. Mech. 42(2).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from fecloth.terms.contact import barrier

# A restitution of 0 leaves 5 % of this speed of the first touch [m/s], and less than 5 % of
# larger speeds. Chosen: no c is infinite, so a slowest speed must be taken.
SLOWEST_IMPACT = 0.05
MOST_DAMPING = 20.0 / SLOWEST_IMPACT  # c [s/m]; y = c v₁ = 20 leaves 5 %


def damping(restitution: float) -> float:
    """Return y = c v₁ with which an impact leaves the part e = `restitution` of the speed.

    c [s/m] is the damping and v₁ the speed of the first touch; y solves

        y − ln(1 + y) = −e y − ln(1 − e y)

    and is infinite for e = 0, and 0 for e = 1.
    """
    e = restitution
    if e == 0.0:
        return np.inf
    if e == 1.0:
        return 0.0

    def residual(y: float) -> float:
        """Left minus right side of y − ln(1 + y) = −e y − ln(1 − e y)."""
        return y - np.log1p(y) + e * y + np.log1p(-e * y)

    largest_y = (1 - np.finfo(float).eps) / e  # y < 1/e, where the logarithm of 1 − e y ends
    if residual(largest_y) > 0:  # the solution is nearer to 1/e than round-off
        return largest_y
    return float(scipy.optimize.brentq(residual, 0.5 * (1 - e), largest_y))


def rates(restitution: float, speeds: np.ndarray) -> np.ndarray:
    """Return c (p,) [s/m] for the speeds (p,) [m/s] of the first touch, at most `MOST_DAMPING`.

    A speed of 0 gets `MOST_DAMPING`. For the restitution 1, all c are 0.
    """
    y = damping(restitution)
    if y == 0.0:
        return np.zeros(np.shape(speeds))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(speeds > 0, np.minimum(y / speeds, MOST_DAMPING), MOST_DAMPING)


@dataclass(frozen=True, eq=False)
class Approach:
    """How p points come nearer to an obstacle over a step.

    Attributes
    ----------
    s0
        Distances (p,) over the gap at the begin of the step.
    a
        c gap/dt (p,); 0 without damping.
    """

    s0: np.ndarray
    a: np.ndarray

    def factor(self, s: np.ndarray) -> np.ndarray:
        """w (p,) at the distances s (p,) over the gap."""
        return np.maximum(0.0, 1 - self.a * (s - self.s0))

    def value(self, s: np.ndarray) -> np.ndarray:
        """Return the potential ∫ p w dσ from s to m (p,), at the distances s (p,) over the gap.

        It is +∞ for s ≤ 0. By parts, with w′ = −a, it is b(s) w(s) − a ∫ b dσ, as b or w is 0
        at m.
        """
        with np.errstate(divide="ignore"):
            m = np.minimum(1.0, self.s0 + 1 / self.a)
        w = self.factor(s)
        damped = self.a * (barrier.integral(m) - barrier.integral(s))
        return np.where(w > 0, barrier.value(s) * w - np.where(s > 0, damped, 0.0), 0.0)

    def curvature(self, s: np.ndarray) -> np.ndarray:
        """−(p w)′ ≥ 0 (p,)."""
        w = self.factor(s)
        return np.where(w > 0, barrier.curvature(s) * w + self.a * barrier.pressure(s), 0.0)

    def lost(self, s: np.ndarray) -> np.ndarray:
        """p (w − 1)(s₀ − s) ≥ 0 (p,): the pressure that damping adds, times the way."""
        return barrier.pressure(s) * (self.factor(s) - 1) * (self.s0 - s)
