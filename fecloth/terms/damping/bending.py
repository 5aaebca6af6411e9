"""Damping of the angles of hinges: a moment proportional to the rate of the angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import TIME
from fecloth.terms.bending.hinge import bind, hinge_stiffness
from fecloth.terms.loops import bound_condition


@dataclass(frozen=True)
class BendingDamping:
    """A moment −τ k θ̇ at every hinge, k = B l²/(A₁ + A₂) as in `HingeBending`.

    Force d = −τ k ∂θ/∂x θ̇ with θ̇ = ∂θ/∂x · v, dissipated power τ k θ̇²; zero in rigid motion, and
    whatever the rest angle is.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 11–13, for the
    condition θ; "symmetric" drops the non-symmetric part of ∂d/∂x, as they do.

    Valid where `HingeBending` is, with the same ratio of the rigidity that the pattern carries to
    that of the fabric. The damping grows with frequency; the hysteresis of a fabric does not.

    Cost of a triangle relative to `StVK`: force 4, tangent 6; "exact" takes a solver for general
    matrices besides.

    Parameters
    ----------
    time
        τ [s], > 0: a bending motion of angular frequency ω is damped at the ratio ζ = ω τ/2.
    tangent
        "symmetric" (the non-symmetric part dropped) or "exact".
    """

    time: Annotated[float, TIME]
    tangent: str = "symmetric"

    def __post_init__(self):
        where = "BendingDamping"
        if not (is_number(self.time) and self.time > 0):
            raise InputError(f"time = {self.time!r}", "must be finite and > 0 [s]", where)
        if self.tangent not in ("symmetric", "exact"):
            allowed = 'must be "symmetric" or "exact"'
            raise InputError(f"tangent = {self.tangent!r}", allowed, where)

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.hinges.nodes

    def bind(self, panel: Panel, slots) -> bound_condition.RigidCondition:
        damping = self.time * hinge_stiffness(panel, "BendingDamping")
        return bind("BendingDamping", panel, slots, 0.0, 0.0, damping, self.tangent)
