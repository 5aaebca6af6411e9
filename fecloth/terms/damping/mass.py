"""Damping proportional to mass and velocity."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy.sparse as sparse

from fecloth import validation
from fecloth.compiled.calls import Calls
from fecloth.compiled.jit import kernel
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots, add_mass, find_entries
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import RATE
from fecloth.terms.loops.array_updates import subtract_scaled
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import DAMPING


@dataclass(frozen=True)
class MassDamping:
    """Damping force d_a = −α m_a v_a with the lumped masses m_a; on P2 d = −α M v.

    There M is the consistent mass, unless the system has a lumped one. The dissipated power is
    α Σ m_a |v_a|².

    This is the mass-proportional part of Rayleigh damping. A mode of angular frequency ω has the
    damping ratio ζ = α / (2 ω). The momentum of a free cloth decreases as e^(−α t): use
    `StrainRateDamping` for damping that conserves momentum, and `Drag` for air.

    Source: Rayleigh (1877), The Theory of Sound, volume I, sections 81–82. The tangent in v is
    exact and symmetric; the tangent in x is zero.

    Valid at any deformation, as a means to reach a state of rest; no model of air or fabric.

    Cost: one loop over the nodes.

    Parameters
    ----------
    rate
        α [1/s], > 0.
    """

    rate: Annotated[float, RATE]

    def __post_init__(self):
        validation.positive("rate", self.rate, "1/s", "MassDamping")

    traits = replace(DAMPING, damps="motion")

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        if cloth.element == "P1":
            return None
        return cloth.stencil

    def bind(self, panel: Panel, slots) -> BoundTerm:
        if panel.cloth.element != "P1" and panel.mass == "consistent":
            matrix = self.rate * panel.cloth.mass("consistent", panel.density)
            return BoundConsistentMassDamping(matrix, slots, panel)
        return BoundMassDamping(self.rate * panel.nodal_mass[:, None], panel)


@dataclass(frozen=True, eq=False)
class BoundMassDamping(BoundTerm):
    """`MassDamping` on a cloth: `coefficient` (n, 1) is α m_a [N s/m]."""

    coefficient: np.ndarray
    panel: Panel

    name = "MassDamping"
    symmetric = dissipative = velocity_dependent = damps_linearly = True
    has_energy = False

    def power(self, x, v, t) -> float:
        """α Σ m_a |v_a|² [W]."""
        return dot(self.panel.count(self.coefficient * v), v)

    def add_force(self, x, v, t, f) -> None:
        """f −= α m_a v_a [N]."""
        f -= self.coefficient * v

    def force_calls(self, x, v, t, f) -> Calls:
        return [(subtract_scaled, (self.coefficient, v, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wv α m_a I."""
        add_diagonal(J.pattern.diagonal, wv, self.coefficient, J.values)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return [(add_diagonal, (J.pattern.diagonal, wv, self.coefficient, J.values))]


@dataclass(frozen=True, eq=False)
class BoundConsistentMassDamping(BoundTerm):
    """`MassDamping` on a cloth of P2 triangles with a consistent mass.

    Attributes
    ----------
    matrix
        (n, n) α M [N s/m].
    find_slots
        Finds the blocks of its entries in the system's matrix, at the first tangent.
    panel
        The cloth with its fabrics.
    """

    matrix: sparse.csr_matrix
    find_slots: FindSlots
    panel: Panel

    name = "MassDamping"
    symmetric = dissipative = velocity_dependent = damps_linearly = True
    has_energy = False

    @cached_property
    def blocks(self) -> np.ndarray:
        return find_entries(self.matrix, self.find_slots)

    def power(self, x, v, t) -> float:
        """α v · M v [W]."""
        return dot(self.panel.count(v), self.matrix @ v)

    def add_force(self, x, v, t, f) -> None:
        """f −= α M v [N]."""
        f -= self.matrix @ v

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wv α M ⊗ I₃."""
        add_mass(self.blocks, self.matrix.data, wv, J.values)


@kernel
def add_diagonal(diagonal, scale, coefficient, J):
    """J_aa += scale c_a I."""
    for a in range(len(diagonal)):
        for i in range(3):
            J[diagonal[a], i, i] += scale * coefficient[a, 0]
