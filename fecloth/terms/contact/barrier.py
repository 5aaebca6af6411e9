"""The barrier that keeps the cloth off an obstacle, and its stiffness.

    b(s) = −(s − 1)² ln s  for 0 < s < 1,  0 for s ≥ 1,  +∞ for s ≤ 0,   s = d/gap

The energy per area is κ gap b(d/gap) with a stiffness κ in Pa, so that the pressure is −κ
b′(s). It is twice continuously differentiable at s = 1 and convex.

Source: Li et al. (2020), Incremental Potential Contact, ACM Trans. Graph. 39(4), the smoothly
clamped barrier −(d − d̂)² ln(d/d̂), here divided by gap² and weighted with areas, as in the
"physical barrier" of the IPC Toolkit: then it converges under refinement of the mesh.
"""

from typing import Literal

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.terms.loads.gravity import Gravity

# With the stiffness "auto" a fabric that is pulled over an obstacle by this strain ...
STRAIN_OF_TENSION = 0.01
# ... rests at this distance over the gap. Both are chosen: tests hold them, no measurement.
RESTING_DISTANCE_OVER_GAP = 0.9
Stiffness = float | Literal["auto"]


def value(s: np.ndarray) -> np.ndarray:
    """b(s), for s < 1; +∞ for s ≤ 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(s > 0, -((s - 1) ** 2) * np.log(s), np.inf)


def pressure(s: np.ndarray) -> np.ndarray:
    """−b′(s) ≥ 0, for s < 1; NaN for s ≤ 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(s > 0, 2 * (s - 1) * np.log(s) + (s - 1) ** 2 / s, np.nan)


def curvature(s: np.ndarray) -> np.ndarray:
    """b″(s) ≥ 0, for s < 1; NaN for s ≤ 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(s > 0, ((s - 1) / s) ** 2 - 4 * (s - 1) / s - 2 * np.log(s), np.nan)


def check_numbers(where: str, gap: float, friction: float, stiffness: Stiffness) -> None:
    """Raise `InputError` for a gap, friction or stiffness out of its range."""
    validation.positive("gap", gap, "m", where)
    validation.positive("friction", friction, "", where, or_zero=True)
    if stiffness != "auto" and not (is_number(stiffness) and stiffness > 0):
        allowed = 'must be finite and > 0 [Pa], or "auto"'
        raise InputError(f"stiffness = {stiffness!r}", allowed, where)


def check_restitution(where: str, restitution: float) -> None:
    """Raise `InputError` for a restitution outside of 0 … 1."""
    if not (is_number(restitution) and 0.0 <= restitution <= 1.0):
        raise InputError(f"restitution = {restitution!r}", "must be a number in 0 … 1", where)


def stiffness_of(stiffness: Stiffness, panel: Panel, gap: float) -> float:
    """Return κ [Pa]: the given number, or "auto" from the weight and stiffness of the fabric.

    "auto" is the larger of ρ g L/gap and Y ε/(L p(0.9)), with the extent L of the cloth,
    ε = 1 % and p = −b′. With the first one, a cloth that falls by its own extent still keeps
    about a fifth of the gap. With the second one, a cloth pulled by 1 % over an obstacle of its
    own size rests at nine tenths of the gap. g is the default of `Gravity`.
    """
    if stiffness != "auto":
        return float(stiffness)
    extent = panel.cloth.extent
    g = float(np.linalg.norm(Gravity().acceleration))
    weight_per_area = max(fabric.areal_density for fabric in panel.fabrics) * g
    tension = STRAIN_OF_TENSION * max(max(fabric.tensile) for fabric in panel.fabrics)
    resting_pressure = float(pressure(np.array(RESTING_DISTANCE_OVER_GAP)))  # over κ
    return max(weight_per_area * extent / gap, tension / extent / resting_pressure)
