"""Whether an equilibrium is stable, by the least eigenvalue of its stiffness."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fecloth.errors import SolveFailed
from fecloth.nonlinear.eigenpairs import least_eigenpairs
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True)
class RestStability:
    """The least eigenvalue of K on the free directions of an equilibrium."""

    least: float  # [N/m]; NaN if it was not found
    zero: float  # size up to which it may be round-off [N/m]

    @classmethod
    def of(cls, system: System, state: State) -> RestStability:
        """Find it; NaN for a cloth that is held whole, or a stiffness that is not finite."""
        if not system.is_whole or system.admissible.shape[1] < 2:
            return cls(math.nan, 0.0)
        try:
            found = least_eigenpairs(system, state, 1, unit_mass=True)
        except SolveFailed:
            return cls(math.nan, 0.0)
        return cls(float(found.values[0]), found.zero)

    @property
    def words(self) -> str:
        """A sentence."""
        if math.isnan(self.least):
            return "equilibrium: not known whether it is stable"
        if abs(self.least) <= self.zero:
            return (
                "equilibrium: the least eigenvalue of K is 0 within round-off; there is a motion "
                "without stiffness"
            )
        kind = "stable" if self.least > 0 else "unstable"
        return f"equilibrium: {kind}; the least eigenvalue of K is {self.least:.4g} N/m"

    @property
    def warning(self) -> str:
        """A sentence if the equilibrium is unstable, or ""."""
        if not self.least < -self.zero:
            return ""
        return (
            f"the equilibrium is unstable: the least eigenvalue of K is {self.least:.3g} N/m, so "
            "that a cloth which is disturbed leaves it; bend the start a little, as the first mode "
            "of `fecloth modes` does, to find a stable one"
        )
