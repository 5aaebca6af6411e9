"""The law of dry friction: a spring that slides, at each of m places.

In bending it acts on the curvature of a fabric, in contact on the way along a surface
(`Sliders.of_contact`). In bending,

With the moments M₁, M₂ = HB at which threads of warp and weft slip [N], half of the 2HB that
instruments print, the curvature κ and the slid curvature κ_s, both along warp and weft,

    e = κ − κ_s,   z = (M₁ e₁₁, M₂ e₂₂, √(2 M₁M₂) e₁₂),   s = ‖z‖ [N/m],   s_y = M₁M₂/(m √(B₁B₂))

the energy per area over a step is, convex and with a continuous slope,

    φ = s²/(2 s_y)  where s ≤ s_y,   s − s_y/2  beyond.

Before it slips, a slider is m times as stiff as the fabric; then its moment is M. At the end
of the step κ_s moves towards κ until s = s_y, and z keeps its direction. The energy s²/(2 s_y)
stays stored, and the rest, s − s_y per area, is heat. In one direction the slider is an elastic
spring in series with dry friction (Iwan 1966, A Distributed-Element Model for Hysteresis and Its
Steady-State Dynamic Response, J. Appl. Mech. 33), and φ is Huber's function.

Where M₁ and M₂ are 0 there is no slider.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.compiled.jit import kernel
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric

EXAMPLES = {"bending_rigidity": "1e-5 [N m]", "bending_hysteresis": "1e-3 [N]"}
SLIDING_MARGIN = 1e-9
"""How far s must exceed s_y for the tangent to be the sliding one, relative to s_y.

After a step s is s_y up to round-off, and the slider sticks.
"""
FAR = 4.0
"""Where the tangent takes the place of the secant, over s_y.

Newton iterations of a curtain in wind, and of a sheet that begins to slip, with 2, 4 and the
secant alone: 466, 348, 264 and 177, 202, 963; with the tangent alone 762 and 165.
"""
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Sliders:
    """The sliders at m places.

    The methods take e (m, 3) = (e₁₁, e₂₂, 2e₁₂), the differences of curvature [1/m].

    Attributes
    ----------
    moments
        (m, 3) M₁, M₂ and √(M₁M₂/2) [N].
    limit
        (m,) s_y, where a slider begins to slide [N/m].
    """

    moments: np.ndarray
    limit: np.ndarray

    @classmethod
    def of_fabric(cls, fabric: Fabric, stiffness: float) -> Self:
        """The slider of a fabric, at one place; `stiffness` is the factor m of the module.

        Raises `InputError` if the fabric has no bending rigidity or no hysteresis, or a
        hysteresis in one of warp and weft only.
        """
        where = "BendingFriction"
        for name in ("bending_rigidity", "bending_hysteresis"):
            if getattr(fabric, name) is None:
                example = EXAMPLES[name]
                remedy = f"Give it in the fabric, one number or (warp, weft), as {example}."
                raise InputError(f"the fabric has no {name}", f"{where} needs it", where, remedy)
        M1, M2 = (0.5 * height for height in fabric.hysteresis or ())  # not None, see above
        if (M1 == 0.0) != (M2 == 0.0):
            what = f"bending_hysteresis = {fabric.bending_hysteresis!r}"
            allowed = "must be > 0 for warp and weft, or 0 for both"
            remedy = "A tenth of the larger number stands for a direction that hardly rubs."
            raise InputError(what, allowed, where, remedy)
        limit = M1 * M2 / (stiffness * np.sqrt(np.prod(fabric.bending or ())))
        return cls(np.array([[M1, M2, np.sqrt(0.5 * M1 * M2)]]), np.array([limit]))

    @classmethod
    def of_contact(cls, limit: np.ndarray, stiffness: np.ndarray) -> Self:
        """Springs (m,) of `stiffness` k [N/m] on ways e (m, 3) [m], that slide at `limit` μλ [N].

        φ is k |e|²/2 where k |e| ≤ μλ, and else μλ |e| − (μλ)²/(2k), in J.
        """
        moments = np.repeat(limit[:, None], 3, axis=1)
        return cls(moments, limit**2 / stiffness)

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
        """(m,) the heat of the step, s − s_y where the slider slid and else 0 [J/m²]."""
        return np.maximum(self._stretch(e)[1] - self.limit, 0.0)

    def moment(self, e: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """(m, 3) ∂φ/∂κ on (κ₁₁, κ₂₂, 2κ₁₂) [N], times a weight (m,) if there is one."""
        if weight is None:
            weight = np.ones(len(e))
        out = np.empty_like(e)
        fill_moments(self.moments, self.limit, weight, e, out)
        return out

    def tangent(self, e: np.ndarray) -> np.ndarray:
        """(m, 3, 3) ∂²φ/∂κ∂κ [N m], positive semi-definite."""
        z, s = self._stretch(e)
        larger = np.maximum(np.maximum(s, self.limit), TINY)
        slides = s > self.limit * (1 + SLIDING_MARGIN)
        n = np.where(slides, 1.0, 0.0)[:, None] * z / larger[:, None]
        H = (np.eye(3) - n[:, :, None] * n[:, None, :]) / larger[:, None, None]
        return self.moments[:, :, None] * H * self.moments[:, None, :]

    def secant(self, e: np.ndarray) -> np.ndarray:
        """(m, 3, 3) M²/max(s, s_y) [N m], or the tangent where s is above `FAR` times s_y.

        φ lies below the parabola with this curvature, so that Newton's iteration does not leap
        to and fro between sliding and sticking (Hunter and Lange 2004, A Tutorial on MM
        Algorithms, Am. Stat. 58(1)). It is slow where a slider goes far: there the tangent is fast.
        """
        _, s = self._stretch(e)
        larger = np.maximum(np.maximum(s, self.limit), TINY)
        H = (self.moments**2 / larger[:, None])[:, :, None] * np.eye(3)
        is_far = s > FAR * self.limit
        tangents: np.ndarray = np.where(is_far[:, None, None], self.tangent(e), H)
        return tangents

    def left(self, e: np.ndarray) -> np.ndarray:
        """(m, 3) e after the sliders have slid, s = s_y where it was above [1/m]."""
        _, s = self._stretch(e)
        return e * np.minimum(1.0, self.limit / np.maximum(s, TINY))[:, None]


@kernel
def fill_moments(moments, limit, weight, e, out):
    """Fill out (m, 3) = weight ∂φ/∂κ = weight M z/max(s, s_y), with z = M e and s = |z|.

    φ is the energy of the sliders, and κ the curvature. `moments` (m, 3), M, and `limit` (m,),
    s_y, are as in `Sliders`; e (m, 3) = (e₁₁, e₂₂, 2e₁₂) are differences of curvature [1/m].
    """
    for i in range(len(e)):
        M1, M2, M3 = moments[i, 0], moments[i, 1], moments[i, 2]
        z1, z2, z3 = M1 * e[i, 0], M2 * e[i, 1], M3 * e[i, 2]
        larger = max(np.sqrt(z1 * z1 + z2 * z2 + z3 * z3), limit[i])
        scale = 0.0
        if larger > 0.0:  # zero where there is no slider
            scale = weight[i] / larger
        out[i, 0] = scale * M1 * z1
        out[i, 1] = scale * M2 * z2
        out[i, 2] = scale * M3 * z3
