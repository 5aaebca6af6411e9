"""Forces on edges, by length: in a direction in space, or along the normal and the edge."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Self

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.errors import InputError, flag
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot as node_dot
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.elements import EdgeRule
from fecloth.quantities.time_function import (
    OfTime,
    TimeFunction,
    VectorOfTime,
    scalar,
    vector,
)
from fecloth.quantities.units import PER_WIDTH
from fecloth.terms.bending.dihedral_angle import cross, dot
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class EdgeForce:
    """f_a = ∫ N_a q dl along edges, with a force q per length: F, or p n + s τ.

    F is a vector in space. n is the outward normal of the edge in the plane of the cloth, and τ
    = ν × n its direction, where ν is the normal of the oriented triangles: on a flat cloth of
    the plane xy, τ leads counter-clockwise around the cloth.

    A dead force is per length of the edge on the flat cloth, and keeps its direction: n and τ
    are those where the run starts (`System(start=...)`, and flat without it). With `follow` the
    length, n and τ are those of the deformed edge. With the local coordinates ξ along the edge
    and η into the triangle, t = ∂x/∂ξ, g = ∂x/∂η, m = t × g and ν = m/|m|,

        f_a = ∫ N_a (|t| F + p t × ν + s t) dξ
        K_ab = −∫ N_a (∂_ξ N_b A + ∂_η N_b B) dξ                       not symmetric
        A = F tᵀ/|t| + s I − p [ν]× + p (t · g)/|m| ν νᵀ,   B = −p |t|²/|m| ν νᵀ

    On P1 one point is exact; on P2 the three Gauss points are exact for a dead force, and for s.

    Source: virtual work q · δx of a traction on a boundary, as in Belytschko, Liu, Moran and
    Elkhodary (2014), Nonlinear Finite Elements for Continua and Structures, 2nd ed., section
    4.5; a uniform stress passes the patch test to round-off on any mesh. The tangents are of
    the kind of Hibbitt (1979), Some follower forces and load stiffness, Int. J. Numer. Meth.
    Engng 14, 937–941.

    Its work is ``work:EdgeForce`` in the energy ledger.

    Valid at any deformation, for a prescribed load. A load that follows needs a linear solver
    for general matrices.

    Cost: proportional to the number of loaded edges.

    Parameters
    ----------
    where
        The name of an edge set, such as a side or a curve of a mesh file. Or the name of a node
        set, node indices, or a predicate on X: then the edges of the border both of whose ends
        are among the nodes.
    force
        F: three numbers [N/m], formulas of t as text, or a function of t.
    normal, tangent
        p and s in place of F: numbers [N/m], formulas of t as text, or functions of t. One that
        is left out is 0. p > 0 pulls outward. Only edges of the border have a normal.
    follow
        Whether the force is per length of the deformed edge, and n and τ turn with the cloth.

    Examples
    --------
    >>> import fecloth as fc
    >>> pull = fc.EdgeForce("right", ("50 * t", 0, 0))
    >>> taut = fc.EdgeForce("boundary", normal=20.0, follow=True)
    """

    where: str | list[int] | Callable[[np.ndarray], np.ndarray]
    force: Annotated[VectorOfTime | None, PER_WIDTH] = None
    normal: Annotated[OfTime | None, PER_WIDTH] = None
    tangent: Annotated[OfTime | None, PER_WIDTH] = None
    follow: bool = False

    traits = LOAD

    def __post_init__(self):
        """Raise `InputError` for wrong values, and unless F or one of p and s is given."""
        flag("follow", self.follow, "EdgeForce")
        by_components = self.normal is not None or self.tangent is not None
        if (self.force is not None) == by_components:
            what = "force and normal or tangent" if by_components else "no force"
            allowed = "needs either a force, or a normal or a tangent component or both"
            remedy = 'Write EdgeForce("right", (50, 0, 0)) or EdgeForce("right", normal=50).'
            raise InputError(what, allowed, "EdgeForce", remedy)
        _ = self._per_length

    @property
    def _per_length(self) -> TimeFunction:
        """F (3,), or p and s (2,), as a function of time."""
        if self.force is not None:
            return vector(self.force, "force", "EdgeForce")
        given = {"normal": self.normal, "tangent": self.tangent}
        p, s = (
            scalar(0.0 if value is None else value, name, "EdgeForce")
            for name, value in given.items()
        )
        if callable(p.parts) or callable(s.parts):
            return TimeFunction(lambda t: np.array([p(t), s(t)]), (2,), "force", "EdgeForce")
        return TimeFunction((*p.parts, *s.parts), (2,), "force", "EdgeForce")

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        if not self.follow:
            return None
        return self.known(cloth).stencil(cloth)

    def known(self, cloth: Cloth) -> "KnownEdges":
        """The force on the half-edges of a cloth.

        Raises `InputError` for edges that the cloth does not have, and for a normal or tangent
        component on an edge inside the cloth, which has two sides.
        """
        half_edges, on_border = cloth.half_edges(self.where)
        if self.force is None and not on_border.all():
            t, i = divmod(int(half_edges[~on_border][0]), 3)
            X, Y = cloth.X[cloth.triangles[t, [i, (i + 1) % 3]]].mean(axis=0)
            what = f"normal or tangent on the edge at ({X:.6g}, {Y:.6g}) m"
            allowed = "must be on the border: an edge inside the cloth has two sides"
            raise InputError(what, allowed, "EdgeForce", "Give a force in space.")
        return KnownEdges(half_edges, self._per_length, self.follow)

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the force on the edges of a panel."""
        return self.known(panel.cloth).bind(panel, slots)


@dataclass(frozen=True, eq=False)
class KnownEdges:
    """`EdgeForce` on known edges, as the description of a term.

    Attributes
    ----------
    half_edges
        (e,) half-edge 3 t + i leads from corner i of triangle t to the next corner.
    per_length
        F (3,), or p and s (2,), as a function of time [N/m].
    follow
        As of `EdgeForce`.
    """

    half_edges: np.ndarray
    per_length: TimeFunction
    follow: bool

    traits = LOAD

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """(e, k) the nodes of the triangle of each edge, in VTK's order, from the edge's begin."""
        triangles, first = np.divmod(self.half_edges, 3)
        corners = (first[:, None] + np.arange(3)) % 3
        places = corners if cloth.element == "P1" else np.hstack([corners, 3 + corners])
        nodes: np.ndarray = cloth.cells[triangles[:, None], places]
        return nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the force on the edges of a panel."""
        nodes = self.stencil(panel.cloth)
        rule = panel.cloth.kind.edge_rule
        if self.follow:
            loop = SharedLoop.over_elements(panel, nodes, slots)
            return FollowingEdgeForce(per_length=self.per_length, loop=loop, rule=rule, panel=panel)
        amounts = self._dead_shares(panel, nodes, rule)
        loaded, place = np.unique(nodes, return_inverse=True)
        shares = np.zeros((len(loaded), *amounts.shape[2:]))
        np.add.at(shares, place.reshape(nodes.shape), amounts)
        return DeadEdgeForce(nodes=loaded, shares=shares, per_length=self.per_length)

    def _dead_shares(self, panel: Panel, nodes: np.ndarray, rule: EdgeRule) -> np.ndarray:
        """(e, k, 3, c) integrals of N_a along each edge, times the directions of the force [m].

        The directions are the unit matrix for F, and the columns n and τ for p and s.
        """
        X = panel.cloth.X
        length = np.linalg.norm(rule.along @ X[nodes], axis=2)  # (e, q)
        if self.per_length.shape == (3,):
            directions = np.broadcast_to(np.eye(3), (*length.shape, 3, 3))
        else:
            x = panel.start
            if x is None:
                x = np.column_stack([X, np.zeros(len(X))])
            t = _unit(rule.along @ x[nodes])
            normal = _unit(np.cross(t, rule.across @ x[nodes]))
            directions = np.stack([np.cross(t, normal), t], axis=-1)
        return np.einsum("q,eq,qa,eqic->eaic", rule.weights, length, rule.values, directions)

    def cut(self, cells: np.ndarray) -> Self:
        """The edges of a part of the cloth that has the triangles `cells`, in its numbers."""
        triangles, first = np.divmod(self.half_edges, 3)
        order = np.argsort(cells)
        ranks = np.minimum(np.searchsorted(cells, triangles, sorter=order), len(cells) - 1)
        places = order[ranks]
        inside = cells[places] == triangles
        return type(self)(3 * places[inside] + first[inside], self.per_length, self.follow)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, 3) over their lengths."""
    units: np.ndarray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return units


@dataclass(frozen=True, eq=False)
class DeadEdgeForce(BoundTerm):
    """A dead `EdgeForce`: f_a = B_a q(t), with B_a (k, 3, c) [m] of the nodes (k,)."""

    nodes: np.ndarray
    shares: np.ndarray
    per_length: TimeFunction

    name = "EdgeForce"
    load = True
    symmetric = True
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the force [W]."""
        return float(np.einsum("aic,ai,c", self.shares, v[self.nodes], self.per_length(t)))

    def add_force(self, x, v, t, f) -> None:
        """f_a += B_a q [N]."""
        add_dead_force(self.nodes, self.shares, self.per_length(t), f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        q = np.empty(self.per_length.shape)
        calls = self.per_length.calls(t, q)
        if calls is None:
            return None
        return [*calls, (add_dead_force, (self.nodes, self.shares, q, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force does not depend on x and v."""

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return []


@dataclass(frozen=True, eq=False)
class FollowingEdgeForce(BoundTerm):
    """An `EdgeForce` that follows the cloth.

    Attributes
    ----------
    per_length
        F (3,), or p and s (2,), as a function of time [N/m].
    loop
        The loop over the edges, with the nodes of their triangles.
    rule
        The quadrature on an edge.
    panel
        The cloth with its fabrics.
    """

    per_length: TimeFunction
    loop: SharedLoop
    rule: EdgeRule
    panel: Panel

    nodes = taken_from("loop.nodes")  # (e, k)
    name = "EdgeForce"
    load = True
    symmetric = False
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the force on the cloth [W]."""
        f = np.zeros_like(x)
        self.add_force(x, v, t, f)
        return node_dot(self.panel.count(f), v)

    def _room(self) -> tuple[np.ndarray, np.ndarray]:
        """The force (5,) with F, p and s, at first 0, and its part that changes with time."""
        q = np.zeros(5)
        return q, q[:3] if self.per_length.shape == (3,) else q[3:]

    def _at(self, t: float) -> np.ndarray:
        """(5,) F, p and s at a time [N/m]."""
        q, part = self._room()
        part[:] = self.per_length(t)
        return q

    def add_force(self, x, v, t, f) -> None:
        """f_a += ∫ N_a (|t| F + p t × ν + s t) dξ [N]."""
        self.loop.add(partial(self._force, self._at(t), x), f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        q, part = self._room()
        calls = self.per_length.calls(t, part)
        if calls is None:
            return None
        return [*calls, self.loop.shared_add(partial(self._force, q, x), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; do nothing if J must be `definite`, because K has no definite part."""
        if definite:
            return
        call = partial(self._tangent, self.loop.slots, self._at(t), x, float(wx))
        self.loop.add_blocks(call, J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls | None:
        if definite:
            return []
        q, part = self._room()
        calls = self.per_length.calls(t, part)
        if calls is None:
            return None
        call = partial(self._tangent, self.loop.slots, q, x, wx)
        return [*calls, self.loop.shared_add_blocks(call, J)]

    @cached_property
    def _shapes(self) -> tuple:
        """A tuple with a zero for each node, and the arrays of the rule, for the kernels."""
        rule = self.rule
        per_node = (0,) * rule.values.shape[1]
        return per_node, rule.weights, rule.values, rule.along, rule.across

    def _force(self, q, x, part, f) -> Call:
        return add_following_force, (*self._shapes, self.nodes[part], q, x, f)

    def _tangent(self, slots, q, x, wx, part, J) -> Call:
        arrays = cut((self.nodes, slots), part)
        return add_following_tangent, (*self._shapes, *arrays, q, x, wx, J)


@kernel
def add_dead_force(nodes, shares, q, f):
    """f_a += B_a q at the nodes (k,), with B (k, 3, c) [m] and q (c,) [N/m]."""
    for n in range(len(nodes)):
        i = nodes[n]
        for k in range(3):
            for c in range(len(q)):
                f[i, k] += shares[n, k, c] * q[c]


@inner
def slope(K, nodes, D, e, q, x):
    """Σ D_a x_a at point q of edge e, for the derivatives D (q, k) of the shape functions."""
    s0 = s1 = s2 = 0.0
    for a in range(len(K)):
        i = nodes[e, a]
        s0 += D[q, a] * x[i, 0]
        s1 += D[q, a] * x[i, 1]
        s2 += D[q, a] * x[i, 2]
    return s0, s1, s2


@inner
def inverse(value):
    """1/value, or 0 for 0: a collapsed triangle has no normal, and gives no force along it."""
    return 1.0 / value if value > 0.0 else 0.0


@kernel
def add_following_force(K, w, N, D, H, nodes, load, x, f):
    """f_a += Σ w N_a (|t| F + p t × ν + s t) over the points of each edge.

    K is a tuple with a zero for each node; w (q,), N, D and H (q, k) are those of the
    `EdgeRule`, `nodes` (e, k) the triangle of each edge, and `load` (5,) is F, p and s [N/m].
    """
    for e in range(len(nodes)):
        for q in range(len(w)):
            t = slope(K, nodes, D, e, q, x)
            m = cross(t, slope(K, nodes, H, e, q, x))
            outward = cross(t, m)
            length = math.sqrt(dot(t, t))
            p = load[3] * inverse(math.sqrt(dot(m, m)))
            for a in range(len(K)):
                i = nodes[e, a]
                scale = w[q] * N[q, a]
                for k in range(3):
                    f[i, k] += scale * (length * load[k] + p * outward[k] + load[4] * t[k])


@kernel
def add_following_tangent(K, w, N, D, H, nodes, slots, load, x, wx, J):
    """J_ab −= wx Σ w N_a (D_b A + H_b B) over the points of each edge; see `EdgeForce`.

    `slots` (e, k, k) are the blocks of J; the other arguments are as in `add_following_force`.
    """
    A = np.empty((3, 3))
    B = np.empty((3, 3))
    for e in range(len(nodes)):
        for q in range(len(w)):
            t = slope(K, nodes, D, e, q, x)
            g = slope(K, nodes, H, e, q, x)
            m = cross(t, g)
            over_m = inverse(math.sqrt(dot(m, m)))
            over_t = inverse(math.sqrt(dot(t, t)))
            nu = (m[0] * over_m, m[1] * over_m, m[2] * over_m)
            p = load[3]
            for i in range(3):
                for j in range(3):
                    A[i, j] = load[i] * t[j] * over_t + p * dot(t, g) * over_m * nu[i] * nu[j]
                    B[i, j] = -p * dot(t, t) * over_m * nu[i] * nu[j]
                A[i, i] += load[4]
            # −p [ν]×
            A[0, 1] += p * nu[2]
            A[0, 2] -= p * nu[1]
            A[1, 0] -= p * nu[2]
            A[1, 2] += p * nu[0]
            A[2, 0] += p * nu[1]
            A[2, 1] -= p * nu[0]
            for a in range(len(K)):
                scale = wx * w[q] * N[q, a]
                for b in range(len(K)):
                    s = slots[e, a, b]
                    for i in range(3):
                        for j in range(3):
                            J[s, i, j] -= scale * (D[q, b] * A[i, j] + H[q, b] * B[i, j])
