"""Whether an equilibrium is stable, by the least eigenvalue of its stiffness."""

import math

from fecloth.errors import SolveFailed
from fecloth.nonlinear.eigenpairs import least_eigenpairs
from fecloth.system.state import State
from fecloth.system.system import System


def least_stiffness(system: System, state: State) -> tuple[float, float]:
    """Return the least eigenvalue of K on the free directions, and what round-off may be [N/m]."""
    # It is NaN for a cloth that is held whole, and for a stiffness that is not finite.
    if not system.is_whole or system.admissible.shape[1] < 2:
        return math.nan, 0.0
    try:
        pairs = least_eigenpairs(system, state, 1, unit_mass=True)
    except SolveFailed:
        return math.nan, 0.0
    return float(pairs.values[0]), pairs.zero


def describe_instability(least: float, zero: float) -> str:
    """Return a sentence if the least eigenvalue is below round-off, or else ""."""
    if not least < -zero:
        return ""
    return (
        f"the equilibrium is unstable: the least eigenvalue of K is {least:.3g} N/m, so "
        "that a cloth which is disturbed leaves it; bend the start a little, as the first mode "
        "of `fecloth modes` does, to find a stable one"
    )
