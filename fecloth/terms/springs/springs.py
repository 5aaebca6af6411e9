"""Springs as a discrete model of a cloth: along its edges, or in its triangles."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import Array, inner
from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import PER_WIDTH, TIME
from fecloth.terms.loops import bound_condition
from fecloth.terms.loops.bound_condition import LengthCondition, mean_ratio, spring_modulus
from fecloth.terms.springs import biquadratic
from fecloth.terms.springs.networks import Net, edges, structural
from fecloth.terms.traits import MEMBRANE, TermTraits

KINDS = ("structural", "van_gelder", "biquadratic")


@dataclass(frozen=True, eq=False)
class KnownSprings:
    """Springs between known nodes, as the description of a term.

    Attributes
    ----------
    nodes
        The two nodes (s, 2) of each spring.
    length
        Rest lengths (s,) [m].
    k
        Stiffness (s,) [N/m].
    damping
        τ [s], with k_d = τ k.
    tangent
        As of `Springs`.
    """

    nodes: np.ndarray
    length: np.ndarray
    k: np.ndarray
    damping: float
    tangent: str

    traits = TermTraits(elements=("P1", "P2"))

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return self.nodes

    def bind(self, panel: Panel, slots) -> LengthCondition:
        """Bind each spring as a condition with one component, its lengthening."""
        return BoundSprings.bind(
            "Springs",
            KERNELS,
            convex=(1,),
            panel=panel,
            slots=slots,
            nodes=self.nodes,
            constants=self.length[:, None],
            stiffness=self.k,
            damping=self.damping * self.k,
            tangent=self.tangent,
        )


class BoundSprings(LengthCondition):
    """Springs between two nodes; the constant of each is its rest length."""

    differences = np.array([[-1.0, 1.0]])

    def rest_over_step(self, e0: Array, e: Array) -> Array:
        return self.constants * mean_ratio(e0, e)

    def moduli_over_step(self, e0: Array, e: Array) -> Array:
        k: Array = self.stiffness[..., None, None]
        return k * spring_modulus(self.constants, e0, e)[:, :, None]


@dataclass(frozen=True)
class Springs:
    """A network of springs in place of a membrane.

    ``kind = "structural"``: springs with the energy ½ k (l − l₀)² each. On a grid ("right" and
    "cross") its classes are

        stretch  along the sides of the cells: k = Y A_e / l², Y of the warp or the weft
        shear    both diagonals (their halves on "cross"): k = G A_e / (l² c² s²)
        bend     from a node to the next but one along the sides: no k follows from a fabric,
                 for on a flat cloth they resist bending to fourth order only

    A_e is the share of a spring in the area of the cloth, which the springs of one direction
    (for shear: all shear springs) divide among them. c and s are the cosine and sine of the
    direction. The shear springs stiffen stretch as well. On all other meshes there are the
    edges only, all with k = √3/2 Y, as an equilateral lattice needs.

    ``kind = "van_gelder"``: the edges, with k = Y Σ A / l² over the triangles at the edge. Its
    error is that the fabric's ν has no influence. It has the fabric's Y and ν = 1/3 on an
    equilateral mesh. On "right" it has C11 = C22 = 5/4 Y and C12 = C33 = Y/4, and stretch and
    shear are coupled as much, C13 = C23 = Y/4.

    ``kind = "biquadratic"``: in each triangle with the angles α and area A the energy

        Σ_i ¼ k_i Δ_i² + Σ_{i<j} ½ c_ij Δ_i Δ_j,   Δ_i = l_i² − L_i²,  side i opposite angle i
        k_i  = (2 (λ + μ) cot² α_i + μ) / (16 A)
        c_ij = (2 (λ + μ) cot α_i cot α_j − μ) / (16 A)

    with λ = Y ν / (1 − ν²) and μ = Y / (1 + ν), twice the shear modulus. For isotropic fabrics
    this is exactly the energy of `StVK`.

    Source: Provot (1995), Deformation Constraints in a Mass-Spring Model, section 3.1
    ("structural"); Van Gelder (1998), Approximate Simulation of Elastic Membranes by
    Triangulated Spring Meshes, the formula in its simplest form ("van_gelder"); Delingette
    (2008), Triangular Springs for Modeling Nonlinear Membranes ("biquadratic").

    Valid: springs on edges, where only the tensile stiffness at small strains counts. None of
    these networks converges to the fabric under refinement, except for ν = 1/3 on equilateral
    triangles; `fecloth.plane_moduli` says which material a network is. A spring in compression
    is unstable against rotation, so that a net gives way like a truss; `definite` drops that
    part of its tangent. "biquadratic" is valid where `StVK` is.

    Cost of force and tangent relative to `StVK`: 1.2 times for the edges, 2.5 and 3.5 for
    "biquadratic".

    Parameters
    ----------
    kind
        "structural", "van_gelder" or "biquadratic".
    stiffness, shear, bend
        k [N/m] of the springs of a structural network: `stiffness` of its stretch springs,
        `shear` of its shear springs, `bend` of its bend springs. With 0 there are no such
        springs. Left out: stretch and shear springs follow from the fabric, and there are no
        bend springs.
    damping
        τ [s]: each spring resists its own lengthening with k_d = τ k; 0 for none.
    tangent
        Of the damping: "symmetric" (its non-symmetric part dropped) or "exact".

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.Springs(), fc.Gravity()], pins=["top"])
    """

    kind: str = "structural"
    stiffness: Annotated[float | None, PER_WIDTH] = None
    shear: Annotated[float | None, PER_WIDTH] = None
    bend: Annotated[float | None, PER_WIDTH] = None
    damping: Annotated[float, TIME] = 0.0
    tangent: str = "symmetric"

    traits = replace(MEMBRANE, elements=("P1",), cheaper=())

    def __post_init__(self):
        """Raise `InputError` for a wrong parameter, or for one that the kind does not have."""
        validation.one_of("kind", self.kind, KINDS, "Springs")
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), "Springs")
        for name in ("stiffness", "shear", "bend", "damping"):
            value = getattr(self, name)
            if value is None:
                continue
            if not (is_number(value) and value >= 0):
                unit = {"damping": "s"}.get(name, "N/m")
                raise InputError(f"{name} = {value!r}", f"must be >= 0 [{unit}]", "Springs")
            if name != "damping" and self.kind != "structural":
                allowed = f"the fabric gives the springs of kind {self.kind!r}"
                raise InputError(f"{name} = {value!r}", allowed, "Springs", "Leave it out.")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        if self.kind == "biquadratic":
            return cloth.stencil
        return self._net(cloth).nodes

    def _net(self, cloth: Cloth) -> Net:
        if self.kind == "van_gelder":
            return edges(cloth)
        return structural(cloth, self.shear, self.bend)

    def _stiffness(self, net: Net, panel: Panel) -> np.ndarray:
        if self.kind == "van_gelder":
            return net.van_gelder_stiffness(panel)
        return net.structural_stiffness(panel, (self.stiffness, self.shear, self.bend))

    def bind(self, panel: Panel, slots) -> LengthCondition:
        if self.kind == "biquadratic":
            return biquadratic.bind(panel, slots, self.damping, self.tangent)
        return self.springs(panel).bind(panel, slots)

    def springs(self, panel: Panel) -> KnownSprings:
        """The springs of a panel's net."""
        net = self._net(panel.cloth)
        length = np.linalg.norm(net.vectors, axis=1)
        k = self._stiffness(net, panel)
        return KnownSprings(net.nodes, length, k, self.damping, self.tangent)


@inner
def elongation(y, c, order, C, g, H):
    """Fill C = l − c₀, ∂C = ±n and ∂²C = ±(I − n nᵀ)/l of a spring.

    l is its length, n its unit vector from node 0 to node 1, and c₀ its length at rest. A spring
    of length 0 has n = 0, and so no force. The arguments are those of every family of
    conditions: see `loops.condition`.
    """
    d = (y[1, 0] - y[0, 0], y[1, 1] - y[0, 1], y[1, 2] - y[0, 2])
    l = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    C[0] = l - c[0]
    inverse = 0.0
    if l > 0.0:
        inverse = 1.0 / l
    if order > 0:
        n = (d[0] * inverse, d[1] * inverse, d[2] * inverse)
        for i in range(3):
            g[0, 0, i] = -n[i]
            g[0, 1, i] = n[i]
        if order > 1:
            for i in range(3):
                for j in range(3):
                    h = -n[i] * n[j] * inverse  # entry i, j of (I − n nᵀ)/l
                    if i == j:
                        h = (1.0 - n[i] * n[i]) * inverse
                    H[0, 0, i, 0, j] = H[0, 1, i, 1, j] = h
                    H[0, 0, i, 1, j] = H[0, 1, i, 0, j] = -h


KERNELS = bound_condition.ConditionKernels(elongation)
