"""Bending at the hinges of the mesh: the condition is the dihedral angle of an interior edge."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots, add_mass, find_entries
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.terms.bending.dihedral_angle import angles, condition
from fecloth.terms.loops import bound_condition
from fecloth.terms.loops.array_updates import subtract_product
from fecloth.terms.loops.bound_condition import RigidCondition
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import HINGES


@dataclass(frozen=True)
class HingeBending:
    """½ k (θ − θ₀)² at every interior edge, k = B l²/(A₁ + A₂).

    θ is the angle between the two triangles (`dihedral_angle`), l the rest length of the edge,
    A₁ and A₂ the rest areas, B the fabric's bending rigidity [N m]; k is in N m.

    Nodes on a cylinder z = κ y²/2 give an edge along its axis the angle θ = κ (h₁ + h₂)/2 = κ
    (A₁ + A₂)/l. On equilateral triangles a third of the edges lie so, and the others have
    none, as θ is proportional to κ_nn − κ_tt/3 with n along the curvature and t along the
    edge: the sum is the integral of ½ B κ². Bergou et al. (2006), A Quadratic Bending Model
    for Inextensible Surfaces, have 3 times this factor, and Grinspun et al. (2003), Discrete
    Shells, 6 times: their stiffnesses are not B.

    Across an edge whose normal makes the angle φ with the warp

        B(φ) = (√B₁ cos²φ + √B₂ sin²φ)²

    which is Huber's orthotropic plate in cylindrical bending (Timoshenko and Woinowsky-Krieger
    1959, Theory of Plates and Shells, section 86: H = √(D_x D_y)). Where the two triangles
    differ in fabric or grain, they bend in series under one moment: (A₁ + A₂)/B = A₁/B(1) +
    A₂/B(2).

    **The cloth does not have the rigidity B, and refinement does not help.** Its rigidity B_eff
    depends on the mesh, and on what keeps the cloth from curving across. On the regular
    patterns B_eff is known (`bending_tensor`), on others it must be measured. B_eff/B along X:

        pattern                             right    cross    equilateral    unstructured
        derived: narrow strip, free edges   0.80     1.00     0.89           -
        derived: cylindrical, no twist      1.00     1.33     1.00           -
        cantilever, width/length 0.25       0.83     1.11     0.93           0.93
        cantilever, width/length 2          0.92     1.29     0.99           0.98

    (`studies/models/hinge_bias.py`). The pattern "right" also couples bending and twist. On
    equilateral meshes, and nearly on meshes of Gmsh, Poisson's ratio of bending is −1/3,
    whatever ratio the fabric has: a simply supported disk sags 40 % too far for ν = 0.
    `PlateBending` has neither fault.

    Source: the factor as derived above; the angle and its derivatives as in `dihedral_angle`.

    Valid from flat to nearly folded: at θ = ±π the angle, and the energy, jump. Its tangent is
    exact; `definite` leaves out the part with ∂²θ, which is indefinite. Where a triangle has no
    height the angle has no meaning: the membrane must keep triangles from collapsing.

    Cost of a triangle relative to `StVK`: force 4, tangent 6, also if `definite`.

    Parameters
    ----------
    rest
        θ₀ [rad] of all hinges, or of each in the order of ``cloth.hinges``; `hinge_angles`
        computes them for a shape. Left out: flat.
    """

    rest: float | tuple[float, ...] | None = None

    traits = replace(HINGES, cheaper=("QuadraticBending",))

    def __post_init__(self):
        """Make `rest` a float or a tuple; raise `InputError` for what is not angles within ±π."""
        if self.rest is None:
            return
        rest = np.asarray(self.rest)
        if rest.ndim > 1 or rest.dtype.kind not in "iuf" or not (np.abs(rest) < np.pi).all():
            allowed = "must be one angle, or one for each hinge, between -π and π [rad]"
            raise InputError(f"rest = {self.rest!r}", allowed, "HingeBending")
        angles = tuple(rest.tolist()) if rest.ndim else float(rest)
        object.__setattr__(self, "rest", angles)

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.hinges.nodes

    def bind(self, panel: Panel, slots) -> RigidCondition:
        """Return the term on a panel.

        Raises `InputError` for another number of angles at rest than hinges, and for a fabric
        without a bending rigidity.
        """
        hinges = panel.cloth.hinges
        rest = np.atleast_1d(0.0 if self.rest is None else self.rest)
        if rest.size not in (1, len(hinges.nodes)):
            allowed = f"must be one angle or {len(hinges.nodes)}, one for each hinge"
            raise InputError(f"rest has {rest.size} angles", allowed, "HingeBending")
        stiffness = hinge_stiffness(panel, "HingeBending")
        return bind("HingeBending", panel, slots, rest=rest, stiffness=stiffness, damping=0.0)


def hinge_stiffness(panel: Panel, where: str) -> np.ndarray:
    """Stiffness k = B(φ) l²/(A₁ + A₂) (h,) of the hinges [N m], for the term `where`.

    B(φ) = (√B₁ cos²φ + √B₂ sin²φ)² is the rigidity of the fabric in the direction across the
    edge, at the angle φ to the warp. Where it differs between the two triangles, 1/B is the mean
    of both by area. Raises `InputError` for a fabric without a bending rigidity.
    """

    def roots(fabric):
        """√B along warp and weft [√(N m)]."""
        if fabric.bending is None:
            presets = [name for name in Fabric.presets() if Fabric.preset(name).bending]
            remedy = "Give it in the fabric, one number or (warp, weft); these presets have it:"
            what = "the fabric has no bending_rigidity"
            allowed = f"{where} needs it, > 0 [N m]"
            raise InputError(what, allowed, where, f"{remedy} {', '.join(presets)}.")
        return np.sqrt(fabric.bending)

    hinges = panel.cloth.hinges
    normal = np.arctan2(hinges.vector[:, 0], -hinges.vector[:, 1])  # angle to X, across the edge
    root = panel.each(roots)[hinges.sides]  # (h, 2 sides, 2 directions)
    phi = normal[:, None] - panel.grain[hinges.sides]
    B = (root[..., 0] * np.cos(phi) ** 2 + root[..., 1] * np.sin(phi) ** 2) ** 2
    return hinges.length**2 / np.sum(hinges.areas / B, axis=1)


def hinge_angles(cloth: Cloth, x: np.ndarray) -> np.ndarray:
    """Dihedral angles (h,) [rad] at x (n, 3), in the order of ``cloth.hinges``.

    On P2 they are the angles between the four parts of the triangles.
    """
    nodes = cloth.edge_slopes.edges.hinges.nodes
    out = np.empty(len(nodes))
    angles(nodes, np.ascontiguousarray(x, dtype=float), out)
    return out


class BoundHinges(RigidCondition):
    """Hinges of a cloth; the constant of each is its angle at rest."""

    def between(self, start, x):
        """The hinges for which θ − θ₀ at x is the mean of θ − θ₀ at both ends of the step."""
        rest = self.constants.copy()
        angle = np.empty(len(self.nodes))
        for y, weight in ((start, -0.5), (x, 1.0), (2.0 * x - start, -0.5)):
            angles(self.nodes, y, angle)
            rest[:, 0] += weight * angle
        return replace(self, constants=rest)


def bind(name, panel, slots, rest, stiffness, damping, tangent="symmetric"):
    """Return the condition θ − θ₀ on the hinges of a panel.

    `rest` is θ₀ [rad], `stiffness` k_s [N m] and `damping` k_d [N m s]; each is one number, or
    (h,) with one for each hinge. `tangent` is that of the damping, see `BoundCondition`.
    """
    nodes = panel.cloth.hinges.nodes
    return BoundHinges.bind(
        name,
        KERNELS,
        convex=(False,),  # ∂²θ is indefinite
        panel=panel,
        slots=slots,
        nodes=nodes,
        constants=np.broadcast_to(rest, len(nodes))[:, None],
        stiffness=stiffness,
        damping=damping,
        tangent=tangent,
    )


KERNELS = bound_condition.ConditionKernels(condition)


@dataclass(frozen=True)
class QuadraticBending:
    """½ x·Q x with Q = Σ k g gᵀ over the interior edges, the isometric bending model.

    g_a are the four coefficients of θ ≈ Σ g_a z_a of a hinge about flat [1/m],
    k = B l²/(A₁ + A₂) [N m] is `HingeBending`'s, and the three components of x do not couple.

    At flat, Q is the stiffness of `HingeBending` out of the plane, with the same B_eff and
    Poisson's ratio of bending on each mesh.

    While the triangles keep their shape, Σ g_a x_a is the sum of the two unit vectors in them
    that point from the edge: the energy is 2 k sin²(θ/2), softer than ½ k θ² when folded.

    Source: Bergou et al. (2006), A Quadratic Bending Model for Inextensible Surfaces, section 2.
    There l g = −K₀ (cotangents of the angles at the edge), and Q = 3/(A₁ + A₂) K₀ᵀK₀ is the one
    here for B = 3 N m: their stiffness is not B (see `HingeBending`).

    Valid for cloth that is flat at rest, hardly stretches and is folded by less than a right
    angle between two triangles: there the moment is greatest, and it is none at a full fold. A
    stretch that differs between the two triangles makes Σ g_a x_a as well: the form adds about
    B/h² [N/m] to the stiffness in the plane, for fabrics much less than Y. Its tangent is
    constant and positive semi-definite, there is no angle that could jump.

    Cost: a triangle costs 0.7 of `StVK`'s force and 0.3 of its tangent.
    """

    traits = HINGES
    stencil = HingeBending.stencil

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the term on a panel; raise `InputError` for a fabric without rigidity."""
        hinges = panel.cloth.hinges
        n = len(panel.cloth.X)
        g = hinges.flat_gradient
        k = hinge_stiffness(panel, "QuadraticBending")[:, None, None]
        Q = k * g[:, :, None] * g[:, None, :]  # (h, 4, 4)
        i = np.broadcast_to(hinges.nodes[:, :, None], Q.shape)
        j = np.broadcast_to(hinges.nodes[:, None, :], Q.shape)
        # The constructor adds up entries with the same row and column.
        matrix = sparse.csr_matrix((Q.ravel(), (i.ravel(), j.ravel())), shape=(n, n))
        return BoundQuadratic(matrix, slots, panel)


@dataclass(frozen=True, eq=False)
class BoundQuadratic(BoundTerm):
    """`QuadraticBending` on a cloth.

    Attributes
    ----------
    matrix
        (n, n) Q of one component of the positions [N/m].
    find_slots
        Finds the blocks of its entries in the system matrix, at the first tangent.
    panel
        The cloth with its fabrics.
    """

    matrix: sparse.csr_matrix
    find_slots: FindSlots
    panel: Panel

    name = "QuadraticBending"
    symmetric = has_energy = True
    conserves = True

    @cached_property
    def blocks(self) -> np.ndarray:
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
