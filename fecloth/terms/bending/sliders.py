"""The law of friction in bending: sliders on the curvature, at each of m places.

With the moments M₁, M₂ = HB at which threads of warp and weft slip [N], half of the 2HB that
instruments print, the curvature κ and the slid curvature κ_s, both along warp and weft,

    e = κ − κ_s,   z = (M₁ e₁₁, M₂ e₂₂, √(2 M₁M₂) e₁₂),   s = ‖z‖ [N/m],   s_y = M₁M₂/(m √(B₁B₂))

the energy per area over a step is, convex and with a continuous slope,

    φ = s²/(2 s_y)  where s ≤ s_y,   s − s_y/2  beyond.

Before it slips, a slider is m times as stiff as the fabric; then its moment is M. At the end
of the step κ_s moves, z along itself, until s = s_y: what is left is stored, s²/(2 s_y), and
the rest is heat, s − s_y per area. In one direction it is an elastic spring in series with dry
friction (Iwan 1966, A Distributed-Element Model for Hysteresis and Its Steady-State Dynamic
Response, J. Appl. Mech. 33), and φ is Huber's function.

Where both are 0 there is no slider.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.compiled.jit import kernel
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric

EXAMPLES = {"bending_rigidity": "1e-5 [N m]", "bending_hysteresis": "1e-3 [N]"}
ROUND_OFF = 1e-9  # of s
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Sliders:
    """The sliders at m places; e (m, 3) are differences (e₁₁, e₂₂, 2e₁₂) of curvature [1/m]."""

    moments: np.ndarray  # (m, 3) M₁, M₂ and √(M₁M₂/2) [N]
    limit: np.ndarray  # (m,) s_y [N/m]

    @classmethod
    def of_fabric(cls, fabric: Fabric, stiffness: float) -> Self:
        """The slider of a fabric, m = 1.

        Raises `InputError` if it has no bending rigidity or no hysteresis, or no hysteresis in
        one of warp and weft only.
        """
        where = "BendingFriction"
        for name in ("bending_rigidity", "bending_hysteresis"):
            if getattr(fabric, name) is None:
                remedy = f"Give it in the fabric, one number or (warp, weft), as {EXAMPLES[name]}."
                raise InputError(f"the fabric has no {name}", f"{where} needs it", where, remedy)
        M1, M2 = (0.5 * each for each in fabric.hysteresis or ())
        if (M1 == 0.0) != (M2 == 0.0):
            what = f"bending_hysteresis = {fabric.bending_hysteresis!r}"
            allowed = "must be > 0 for warp and weft, or 0 for both"
            remedy = "A tenth of the larger number stands for a direction that hardly rubs."
            raise InputError(what, allowed, where, remedy)
        limit = M1 * M2 / (stiffness * np.sqrt(np.prod(fabric.bending or ())))
        return cls(np.array([[M1, M2, np.sqrt(0.5 * M1 * M2)]]), np.array([limit]))

    def weakened(self, factor: float) -> Self:
        """The sliders with `factor` times the moments M₁ and M₂, and the stiffness as before."""
        return type(self)(factor * self.moments, factor**2 * self.limit)

    def _stretch(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z (m, 3) and s (m,) [N/m]."""
        z = self.moments * e
        return z, np.sqrt(np.einsum("ei,ei->e", z, z))

    def energy(self, e: np.ndarray) -> np.ndarray:
        """(m,) φ [J/m²]."""
        _, s = self._stretch(e)
        elastic = 0.5 * s**2 / np.maximum(self.limit, TINY)
        return np.where(s <= self.limit, elastic, s - 0.5 * self.limit)

    def heat(self, e: np.ndarray) -> np.ndarray:
        """(m,) what is dissipated in the step, s − s_y or 0 [J/m²]."""
        return np.maximum(self._stretch(e)[1] - self.limit, 0.0)

    def moment(self, e: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """(m, 3) ∂φ/∂κ on (κ₁₁, κ₂₂, 2κ₁₂) [N], times a weight (m,)."""
        out = np.empty_like(e)
        fill_moments(
            self.moments, self.limit, np.ones(len(e)) if weight is None else weight, e, out
        )
        return out

    def tangent(self, e: np.ndarray) -> np.ndarray:
        """(m, 3, 3) ∂²φ/∂κ∂κ [N m], positive semi-definite."""
        z, s = self._stretch(e)
        larger = np.maximum(np.maximum(s, self.limit), TINY)
        slides = s > self.limit * (1 + ROUND_OFF)  # at the limit, after a step, it sticks
        n = np.where(slides, 1.0, 0.0)[:, None] * z / larger[:, None]
        H = (np.eye(3) - n[:, :, None] * n[:, None, :]) / larger[:, None, None]
        return self.moments[:, :, None] * H * self.moments[:, None, :]

    def left(self, e: np.ndarray) -> np.ndarray:
        """(m, 3) e after the sliders have slid, s = s_y where it was above [1/m]."""
        _, s = self._stretch(e)
        return e * np.minimum(1.0, self.limit / np.maximum(s, TINY))[:, None]


@kernel
def fill_moments(moments, limit, weight, e, out):
    """out (m, 3) = weight ∂φ/∂κ = weight M z/max(s, s_y)."""
    for i in range(len(e)):
        M1, M2, M3 = moments[i, 0], moments[i, 1], moments[i, 2]
        z1, z2, z3 = M1 * e[i, 0], M2 * e[i, 1], M3 * e[i, 2]
        larger = max(np.sqrt(z1 * z1 + z2 * z2 + z3 * z3), limit[i])
        scale = weight[i] / larger if larger > 0.0 else 0.0
        out[i, 0] = scale * M1 * z1
        out[i, 1] = scale * M2 * z2
        out[i, 2] = scale * M3 * z3
