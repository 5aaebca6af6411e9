"""Damping of the angles of hinges: moments proportional to the rates of the angles."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.calls import Calls
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import TIME
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.hinge import HingeBending, bind, hinge_stiffness
from fecloth.terms.bending.plate import PlateBending
from fecloth.terms.bending.plate_angles import PlateAngles, bind_angles
from fecloth.terms.loops.array_updates import clear, scale
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.traits import DAMPING


@dataclass(frozen=True)
class BendingDamping:
    """Moments −τ Q θ̇ at the hinges, with the stiffness Q of a bending law.

    The force is d = −τ (∂θ/∂x)ᵀ Q θ̇ with θ̇ = ∂θ/∂x · v. The dissipated power is τ θ̇ᵀ Q θ̇.
    Both are zero in rigid motion and do not depend on the angle at rest. For `HingeBending` Q is
    diagonal, k = B l²/(A₁ + A₂). For `PlateBending` it couples neighbouring hinges, and the
    measure μ of `fold_measure` stands in place of θ.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 11–13, for the
    condition θ; "symmetric" drops the non-symmetric part of ∂d/∂x, as they do.

    Valid where the law is valid. With `HingeBending` the damping depends on the pattern of the
    mesh, as the rigidity does. The damping grows with frequency; the hysteresis of a fabric
    does not.

    Cost of a triangle relative to `StVK`: force 4, tangent 6; "exact" also needs a linear
    solver for general matrices.

    Parameters
    ----------
    time
        τ [s], > 0: a bending motion of angular frequency ω is damped at the ratio ζ = ω τ/2.
    tangent
        "symmetric" (the non-symmetric part dropped) or "exact".
    law
        The bending law whose stiffness is Q, `HingeBending` or `PlateBending`. Default:
        ``HingeBending()``, and on P2, which has no hinges of its own, ``PlateBending()``.
        Beside a `PlateBending` term take ``PlateBending()``: with hinges ζ is wrong by the
        pattern of the mesh, on a cantilever of the pattern "right" by 20 %.
    """

    time: Annotated[float, TIME]
    tangent: str = "symmetric"
    law: object = None

    traits = replace(DAMPING, reach=8, damps="bending")

    def __post_init__(self):
        """Raise `InputError` for a parameter that is not allowed."""
        where = "BendingDamping"
        validation.positive("time", self.time, "s", where)
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), where)
        if not isinstance(self.law, HingeBending | PlateBending | None):
            allowed = "must be HingeBending() or PlateBending()"
            raise InputError(f"law = {self.law!r}", allowed, where)

    def _is_plate(self, cloth: Cloth) -> bool:
        return isinstance(self.law, PlateBending) or (self.law is None and cloth.element != "P1")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        if self._is_plate(cloth):
            return cloth.edge_slopes.pairs
        return cloth.hinges.nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the term on a panel; raise `InputError` for a fabric without rigidity."""
        if self._is_plate(panel.cloth):
            angles = bind_angles(panel, slots, "BendingDamping")
            return BoundPlateDamping(angles, self.time, self.tangent == "symmetric")
        damping = self.time * hinge_stiffness(panel, "BendingDamping")
        return bind(
            "BendingDamping",
            panel,
            slots,
            rest=0.0,  # damping does not depend on it
            stiffness=0.0,
            damping=damping,
            tangent=self.tangent,
        )


@dataclass(frozen=True, eq=False)
class BoundPlateDamping(BoundTerm):
    """`BendingDamping` of a plate on a cloth; `time` is τ [s]."""

    plate: PlateAngles
    time: float
    symmetric: bool

    name = "BendingDamping"
    nbytes = taken_from("plate.nbytes")
    has_energy = False
    dissipative = velocity_dependent = True

    def power(self, x, v, t) -> float:
        """Dissipated power τ μ̇ᵀ Q μ̇ [W]."""
        rate, moment, _ = self._moments(x, v, t)
        return plate_loops.sum_products(self.plate.loop.select(rate), moment)

    def add_force(self, x, v, t, f) -> None:
        """f_a −= Σ m ∂μ/∂x_a with the moments m = τ Q μ̇ [N]."""
        _, g = self.plate.gradients(x, t)
        self.plate.add_force(self.time * self.plate.rates(g, v), g, f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        """The calls of `add_force`; None where clamps move, whose normals depend on t."""
        plate = self.plate
        if plate.moved is not None:
            return None
        # Work arrays: the calls, in this order, fill them anew each time.
        mu, g = plate.gradients(x, t)
        rate = plate.rates(g, v)
        return [
            plate.gradient_call(x, t, mu, g),
            (clear, (rate,)),  # `rate_call` adds to it
            plate.rate_call(g, v, rate),
            (scale, (self.time, rate)),
            plate.force_call(rate, g, f),
        ]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D.

        D = τ GᵀQG with G = ∂μ/∂x, and K = Σ m ∂²μ/∂x∂x + τ GᵀQ ∂μ̇/∂x. A symmetric tangent
        leaves out the second part of K, a definite one both parts.
        """
        _, moment, g = self._moments(x, v, t)
        right = wv * self.time * g
        if not (self.symmetric or definite):
            plate_loops.add_gradient_rates(*self.plate.at(t), x, v, wx * self.time, right)
        self.plate.add_products(g, right, 1.0, J)
        if not definite:
            self.plate.add_curvatures(x, t, moment, wx, J)

    def _moments(self, x, v, t) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """μ̇ (h,), m (h,) and ∂μ/∂x (h, 4, 3)."""
        _, g = self.plate.gradients(x, t)
        rate = self.plate.rates(g, v)
        return rate, self.time * (self.plate.stiffness @ rate), g
