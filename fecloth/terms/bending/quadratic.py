"""Bending as a constant quadratic form of the positions, for cloth that is flat at rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Calls
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots, add_mass, find_entries
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.terms.bending.hinge import hinge_stiffness
from fecloth.terms.loops.array_updates import subtract_product
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import HINGES


@dataclass(frozen=True)
class QuadraticBending:
    """½ x·Q x with Q = Σ k g gᵀ over the interior edges, the isometric bending model.

    g_a are the four coefficients of θ ≈ Σ g_a z_a of a hinge about flat [1/m],
    k = B l²/(A₁ + A₂) [N m] is `HingeBending`'s, and the three components of x do not couple.

    At flat, Q is the stiffness of `HingeBending` out of the plane, so its B_eff on each mesh is
    the same, and so is its Poisson's ratio of bending: −1/3 on equilateral meshes, and nearly on
    those of Gmsh, whatever the fabric's. `PlateBending` has the fabric's own.

    While the triangles keep their shape, Σ g_a x_a is the sum of the two unit vectors in them that
    point from the edge: the energy is 2 k sin²(θ/2), softer than ½ k θ² when folded.

    Source: Bergou et al. (2006), A Quadratic Bending Model for Inextensible Surfaces, section 2.
    There l g = −K₀ (cotangents of the angles at the edge), and Q = 3/(A₁ + A₂) K₀ᵀK₀ is the one
    here for B = 3 N m: their stiffness is not B (see `HingeBending`).

    Valid for cloth that is flat at rest, hardly stretches and is folded by less than a right angle
    between two triangles: there the moment is greatest, and it is none at a full fold. A stretch
    that differs between the two triangles makes Σ g_a x_a as well: the form adds about B/h² [N/m]
    to the stiffness in the plane, for fabrics much less than Y. Its tangent is constant and
    positive semi-definite, there is no angle that could jump.

    Cost: a triangle costs 0.7 of `StVK`'s force and 0.3 of its tangent.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    >>> fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5)
    >>> system = fc.System(cloth, fabric, [fc.QuadraticBending()])
    >>> system.energies(system.rest())["QuadraticBending"] < 1e-18
    True
    """

    traits = HINGES

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.hinges.nodes

    def bind(self, panel: Panel, slots) -> BoundQuadratic:
        hinges, n = panel.cloth.hinges, len(panel.cloth.X)
        g = hinges.flat_gradient
        k = hinge_stiffness(panel, "QuadraticBending")[:, None, None]
        Q = k * g[:, :, None] * g[:, None, :]
        i = np.broadcast_to(hinges.nodes[:, :, None], Q.shape)
        j = np.broadcast_to(hinges.nodes[:, None, :], Q.shape)
        matrix = sparse.csr_matrix((Q.ravel(), (i.ravel(), j.ravel())), shape=(n, n))
        return BoundQuadratic(matrix, slots, panel)


@dataclass(frozen=True, eq=False)
class BoundQuadratic(BoundTerm):
    """`QuadraticBending` on a cloth."""

    matrix: sparse.csr_matrix  # (n, n) Q of one component [N/m]
    # Finds the blocks of its entries in the system matrix, at the first tangent.
    find_slots: FindSlots
    panel: Panel  # the cloth with its fabrics

    name = "QuadraticBending"
    symmetric = True
    has_energy = True
    conserves = True

    @cached_property
    def blocks(self) -> np.ndarray:
        """Blocks of the entries of `matrix` in the system's matrix."""
        return find_entries(self.matrix, self.find_slots)

    def energy(self, x, t) -> float:
        """½ x·Q x [J]."""
        return 0.5 * dot(self.panel.count(x), self.matrix @ x)

    def add_force(self, x, v, t, f) -> None:
        """f −= Q x [N]."""
        f -= self.matrix @ x

    def force_calls(self, x, v, t, f) -> Calls:
        Q = self.matrix
        return [(subtract_product, (Q.indptr, Q.indices, Q.data, x, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx Q ⊗ I₃."""
        add_mass(self.blocks, self.matrix.data, wx, J.values)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bound of the eigenvalues of M⁻¹K [1/s²]: the largest row sum of |Q|/m."""
        return float((abs(self.matrix).sum(axis=1).A1 / mass).max()), 0.0
