"""The elements: linear and quadratic triangles, their nodes and the rules that integrate them.

    element   nodes                                  rule of the energy         errors of x: L2, H1
    P1        the 3 corners                          1 point, F is constant     h², h
    P2        the corners, the middles of the edges  6 points, exact to degree  h³, h²
                                                     4: F is linear in X and
                                                     StVK's energy quartic in F

The triangles of the flat cloth are straight in either case, so that the orders of P2 hold on
polygons: along a curved edge the mesh itself is wrong by h². A mesh comes in with its corners;
`quadratic` adds the middles behind them, in scikit-fem's order of the edges, and scikit-fem's
degrees of freedom then are the nodes. Source of the six points: Dunavant (1985), High degree
efficient symmetrical Gaussian quadrature rules for the triangle, Int. J. Numer. Meth. Engng 21,
1129–1148, as scikit-fem has them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import skfem

from fecloth.errors import InputError
from fecloth.mesh.flat_mesh import FlatMesh

CENTROID = (np.array([[1 / 3], [1 / 3]]), np.array([0.5]))  # scikit-fem's rules have 3 at least


@dataclass(frozen=True, eq=False)
class Element:
    """One of `ELEMENTS`.

    Attributes
    ----------
    name
        "P1" or "P2".
    shapes
        scikit-fem's element.
    degree
        Of its polynomials; a mass or the product of two fields has twice that.
    rule
        Points and weights that integrate the energy.
    """

    name: str
    shapes: skfem.Element
    degree: int
    rule: tuple[np.ndarray, np.ndarray]

    @cached_property
    def reference_mass(self) -> np.ndarray:
        """(k, k) ∫ N_a N_b dA over a triangle of area 1; a straight triangle has A times that."""
        mesh = skfem.MeshTri.init_refdom()
        basis = skfem.Basis(mesh, self.shapes, intorder=2 * self.degree)
        form = skfem.BilinearForm(lambda u, v, w: 2 * u * v)
        return form.elemental(basis).tolocal()[0]

    @cached_property
    def scaled_diagonal(self) -> np.ndarray:
        """(k,) the diagonal of `reference_mass`, scaled to a sum of 1: positive for any element.

        Source: Hinton, Rock and Zienkiewicz (1976), A note on mass lumping and related processes
        in the finite element method, Earthquake Engng Struct. Dyn. 4, 245–249.
        """
        diagonal = np.diag(self.reference_mass)
        return diagonal / diagonal.sum()

    @cached_property
    def least_mass(self) -> float:
        """The largest c with `reference_mass` ≥ c `scaled_diagonal`: ¼ for P1, 0.248 for P2."""
        root = np.sqrt(self.scaled_diagonal)
        return float(np.linalg.eigvalsh(self.reference_mass / np.outer(root, root))[0])

    @cached_property
    def values(self) -> np.ndarray:
        """(q, k) N_a at the points of the rule, the same in every triangle."""
        k = len(self.reference_mass)
        return np.stack([self.shapes.lbasis(self.rule[0], a)[0] for a in range(k)], axis=-1)

    def basis(self, mesh: skfem.MeshTri, order: int) -> skfem.CellBasis:
        """Scalar, with a quadrature that is exact to polynomial degree `order`."""
        return skfem.Basis(mesh, self.shapes, intorder=order)

    def arrays(self, mesh: skfem.MeshTri) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the kernels take: nodes (m, k), ∂N_a/∂X (m, q, k, 2) [1/m], weights (m, q) [m²]."""
        basis = skfem.Basis(mesh, self.shapes, quadrature=self.rule)
        gradients = np.stack([phi[0].grad for phi in basis.basis])  # (k, 2, m, q)
        return (
            np.ascontiguousarray(basis.element_dofs.T, dtype=np.int32),
            np.ascontiguousarray(gradients.transpose(2, 3, 0, 1)),
            np.ascontiguousarray(basis.dx),
        )


def _degree_4():
    return skfem.quadrature.get_quadrature(skfem.ElementTriP2.refdom, 4)


ELEMENTS = {
    "P1": Element("P1", skfem.ElementTriP1(), 1, CENTROID),
    "P2": Element("P2", skfem.ElementTriP2(), 2, _degree_4()),
}


def named(name: str, where: str) -> Element:
    """The element of that name; raises `InputError` for another."""
    if name not in ELEMENTS:
        allowed = f"must be one of {', '.join(ELEMENTS)}"
        raise InputError(f"element = {name!r}", allowed, where)
    return ELEMENTS[name]


def skfem_mesh(X: np.ndarray, triangles: np.ndarray) -> skfem.MeshTri:
    """The mesh of corners X (n, 2); it sorts the vertices inside each triangle."""
    return skfem.MeshTri(
        np.ascontiguousarray(X.T), np.ascontiguousarray(triangles.T, dtype=np.int64)
    )


def quadratic(mesh: FlatMesh, points: Collection[str] = ()) -> FlatMesh:
    """The mesh with a node in the middle of each edge, behind the corners.

    A node set grows by the middles of the edges that belong to it: those of its curve where one
    bears its name, those of its triangles where a region does, else those with both ends in it.
    The sets named in `points` stay as they are.

    Examples
    --------
    >>> from fecloth.meshing import rectangle
    >>> mesh = quadratic(rectangle(1.0, 1.0, 1.0, "right"), points=["corners"])
    >>> mesh.X[4:].tolist()
    [[0.5, 0.0], [0.0, 0.5], [0.5, 0.5], [1.0, 0.5], [0.5, 1.0]]
    >>> mesh.node_sets["left"].tolist(), mesh.node_sets["corners"].tolist()
    ([0, 2, 5], [0, 1, 2, 3])
    """
    n, edges = len(mesh.X), skfem_mesh(mesh.X, mesh.triangles).facets.T
    X = np.concatenate([mesh.X, mesh.X[edges].mean(axis=1)])

    def grown(name, nodes):
        if name in points:
            return nodes
        if name in mesh.edge_sets:
            middles = edge_nodes(edges, n, mesh.edge_sets[name])
        elif name in mesh.triangle_sets:
            corners = mesh.triangles[mesh.triangle_sets[name]]
            middles = edge_nodes(edges, n, _sides(corners).reshape(-1, 2))
        else:
            middles = n + np.flatnonzero(np.isin(edges, nodes).all(axis=1))
        return np.union1d(nodes, middles)

    sets = {name: grown(name, nodes) for name, nodes in mesh.node_sets.items()}
    return replace(mesh, X=X, node_sets=sets)


def oriented_cells(mesh: skfem.MeshTri, triangles: np.ndarray) -> np.ndarray:
    """(m, 6) the corners as in `triangles`, then the middles of their edges 01, 12 and 20."""
    middles = edge_nodes(mesh.facets.T, mesh.nvertices, _sides(triangles).reshape(-1, 2))
    return np.concatenate([triangles, middles.reshape(-1, 3)], axis=1).astype(np.int32)


def edge_nodes(edges: np.ndarray, n: int, pairs: np.ndarray) -> np.ndarray:
    """(p,) the middle of each pair (p, 2) of corners, for the edges (e, 2) of n corners."""
    keys = [np.sort(ends, axis=1).astype(np.int64) @ [n, 1] for ends in (edges, pairs)]
    order = np.argsort(keys[0])
    return n + order[np.searchsorted(keys[0][order], keys[1])]


def _sides(triangles):
    """(m, 3, 2) the edges 01, 12, 20."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
