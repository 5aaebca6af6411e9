"""Gravity: a uniform acceleration on the mass of the cloth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import ACCELERATION
from fecloth.terms.loops.array_updates import add
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class Gravity:
    """f_a = Σ_b M_ab g = ρ g ∫ N_a dA, potential −Σ f_a · x_a [J] (zero at the origin).

    Source: virtual work of the weight ρ g of the reference area, exact on P1 and P2. On P2 with a
    lumped mass it is m_a g with the lumped masses m_a, so that a cloth in free fall stays flat;
    a P2 strip at rest under it converges as P1 does, h² in L2 in place of h³.

    Valid at any deformation, in a uniform gravity field. Over the height of a cloth the field is
    uniform.

    Cost: a fiftieth of the force of `StVK`; there is no tangent.

    Parameters
    ----------
    acceleration
        g, three components [m/s²].
    """

    acceleration: Annotated[tuple[float, float, float], ACCELERATION] = (0.0, 0.0, -9.81)

    def __post_init__(self):
        g = np.asarray(self.acceleration)
        if g.shape != (3,) or g.dtype.kind not in "iuf" or not np.isfinite(g).all():
            allowed = "must be three finite numbers [m/s²]"
            raise InputError(f"acceleration = {self.acceleration!r}", allowed, "Gravity")

    traits = replace(LOAD, several_places=False)

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundGravity:
        return BoundGravity(np.outer(panel.nodal_mass, self.acceleration))


@dataclass(frozen=True, eq=False)
class BoundGravity(BoundTerm):
    """`Gravity` on a cloth: `weight` (n, 3) [N]."""

    weight: np.ndarray

    name = "Gravity"
    load = True
    symmetric = True
    has_energy = True
    conserves = True

    def energy(self, x, t) -> float:
        """−Σ f_a · x_a [J]."""
        return -dot(self.weight, x)

    def add_force(self, x, v, t, f) -> None:
        f += self.weight

    def force_calls(self, x, v, t, f) -> Calls:
        return [(add, (self.weight, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force is constant."""

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        return 0.0, 0.0
