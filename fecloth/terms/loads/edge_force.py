"""Forces on edges, by length: in a direction in space, or along the normal and the edge."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from fecloth.errors import InputError, flag
from fecloth.fabric.panel import Panel
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
from fecloth.terms.loads.bound_edge_force import DeadEdgeForce, FollowingEdgeForce
from fecloth.terms.loops.shared_loop import SharedLoop
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class EdgeForce:
    """f_a = ∫ N_a q dl along edges, with a force q per length: F, or p n + s τ.

    F is a vector in space. n is the outward normal of the edge in the plane of the cloth, and τ
    = ν × n its direction, where ν is the normal of the oriented triangles: on a flat cloth of
    the plane xy, τ leads counter-clockwise around the cloth.

    A dead force is per length of the edge on the flat cloth, and keeps its direction: n and τ
    are taken where the run starts (`System(start=...)`, and flat without it). With `follow` the
    force is per length of the deformed edge, and follows its n and τ. With the local coordinates ξ
    along the edge and η into the triangle, t = ∂x/∂ξ, g = ∂x/∂η, m = t × g and ν = m/|m|,

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
            remedy = "Give force, as [50, 0, 0], or normal, as 50: both in N/m."
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
