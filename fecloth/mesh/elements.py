"""Linear and quadratic triangles: shape functions, nodes and quadrature rules.

    element   nodes                           quadrature of the energy   errors of x: L2, H1
    P1        3 corners                       1 point, F is constant     h², h
    P2        3 corners and 3 edge midpoints  6 points, exact to degree  h³, h²
                                              4: F is linear in X and
                                              StVK's energy quartic in F

The triangles of the flat cloth have straight edges, but for those of P2 along the border of a
disk, which are parabolas through three points of the circle. With straight edges a round border
has an error of order h². `add_midpoints` appends the midpoints in scikit-fem's order of the edges.
Source of the six points: Dunavant (1985), High degree efficient symmetrical Gaussian
quadrature rules for the triangle, Int. J. Numer. Meth. Engng 21, 1129–1148, as implemented in
scikit-fem.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import skfem

from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.validation import known

# scikit-fem has no rule with fewer than 3 points.
CENTROID_RULE = (np.array([[1 / 3], [1 / 3]]), np.array([0.5]))

STRAIGHT = 1e-9  # bulge of an edge over its length, below which the edge is straight


@dataclass(frozen=True, eq=False)
class EdgeRule:
    """Quadrature along the edge from corner 0 to corner 1 of a triangle, for any function.

    The local coordinate ξ is 0 at corner 0 and 1 at corner 1, and η is 0 on the edge and 1 at
    corner 2. The nodes are in VTK's order (`oriented_cells`).

    Attributes
    ----------
    weights
        (q,) weights of the points; their sum is 1.
    values
        (q, k) shape functions N_a at the points.
    along, across
        (q, k) their derivatives by ξ and by η.
    """

    weights: np.ndarray
    values: np.ndarray
    along: np.ndarray
    across: np.ndarray


@dataclass(frozen=True, eq=False)
class Element:
    """A triangular element.

    Attributes
    ----------
    name
        "P1" or "P2".
    shapes
        scikit-fem's element.
    degree
        Degree of the shape functions. A mass matrix needs a rule of twice this degree.
    rule
        Points (2, q) and weights (q,) of the quadrature of the energy on the unit triangle.
    parts
        Triangles between neighbouring nodes, in VTK's order of the nodes (`oriented_cells`).
    """

    name: str
    shapes: skfem.Element
    degree: int
    rule: tuple[np.ndarray, np.ndarray]
    parts: tuple[tuple[int, int, int], ...]

    @cached_property
    def reference_mass(self) -> np.ndarray:
        """(k, k) ∫ N_a N_b dA over a triangle of area 1; times A for a triangle of area A."""
        basis = skfem.Basis(skfem.MeshTri.init_refdom(), self.shapes, intorder=2 * self.degree)
        return skfem.BilinearForm(lambda u, v, w: 2 * u * v).elemental(basis).tolocal()[0]

    @cached_property
    def scaled_diagonal(self) -> np.ndarray:
        """(k,) diagonal of `reference_mass`, scaled to a sum of 1, > 0; source: `Cloth.mass`."""
        diagonal = np.diag(self.reference_mass)
        return diagonal / diagonal.sum()

    @cached_property
    def least_mass(self) -> float:
        """Largest c with `reference_mass` ≥ c `scaled_diagonal`: ¼ for P1, 0.248 for P2."""
        root = np.sqrt(self.scaled_diagonal)
        return float(np.linalg.eigvalsh(self.reference_mass / np.outer(root, root))[0])

    @cached_property
    def values(self) -> np.ndarray:
        """(q, k) shape functions N_a at the points of the rule, equal in all triangles."""
        k = len(self.reference_mass)
        return np.stack([self.shapes.lbasis(self.rule[0], a)[0] for a in range(k)], axis=-1)

    @cached_property
    def slopes(self) -> np.ndarray:
        """(q, 2, k) derivatives of N_a by ξ and η, at the points of the rule."""
        return self.slopes_at(self.rule[0])

    def slopes_at(self, points: np.ndarray) -> np.ndarray:
        """(p, 2, k) derivatives of N_a by ξ and η, at points (2, p) of the unit triangle."""
        k = len(self.reference_mass)
        slopes = [self.shapes.lbasis(points, a)[1] for a in range(k)]
        return np.stack([s + 0 * points for s in slopes], axis=-1).swapaxes(0, 1)

    @cached_property
    def edge_rule(self) -> EdgeRule:
        """Gauss points on an edge: exact to degree 1 on P1, and to degree 5 on P2."""
        points, weights = np.polynomial.legendre.leggauss(2 * self.degree - 1)
        xi = (1 + points) / 2
        places = np.stack([xi, np.zeros_like(xi)])
        shapes = [self.shapes.lbasis(places, a) for a in range(len(self.reference_mass))]
        values = np.stack([N + 0 * xi for N, _ in shapes], axis=-1)
        along, across = (
            np.stack([slope[i] + 0 * xi for _, slope in shapes], axis=-1) for i in range(2)
        )
        return EdgeRule(weights / 2, values, along, across)

    def basis(self, mesh: skfem.MeshTri, order: int) -> skfem.CellBasis:
        """Scalar scikit-fem basis whose quadrature is exact to polynomial degree `order`."""
        return skfem.Basis(mesh, self.shapes, intorder=order)

    def arrays(self, mesh: skfem.MeshTri) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return nodes (m, k) int32, ∂N_a/∂X (m, q, k, 2) [1/m] and weights (m, q) [m²].

        These are the arrays that kernels take, for the quadrature of the energy.
        """
        dofs = skfem.Dofs(mesh, self.shapes)
        nodes = np.ascontiguousarray(dofs.element_dofs.T, dtype=np.int32)
        m, k = nodes.shape
        q = len(self.rule[1])
        gradients = np.empty((m, q, k, 2))
        weights = np.empty((m, q))
        for part in blocks(m):  # because a basis of all triangles would take much memory
            triangles = np.arange(part.start, part.stop)
            basis = skfem.Basis(
                mesh,
                self.shapes,
                _mapping(mesh, triangles),
                dofs=dofs,
                elements=triangles,
                quadrature=self.rule,
                disable_doflocs=True,
            )
            for a, phi in enumerate(basis.basis):
                gradients[part, :, a] = np.moveaxis(phi[0].grad, 0, -1)
            weights[part] = basis.dx
        return nodes, gradients, weights


def _mapping(mesh: skfem.MeshTri, triangles: np.ndarray) -> skfem.mapping.Mapping:
    """Return the mapping from the unit triangle to these triangles."""
    if isinstance(mesh, skfem.MeshTri2):
        return mesh.mapping()
    return skfem.MappingAffine(mesh, triangles)  # the mesh would keep a mapping of all triangles


def blocks(m: int, size: int = 1 << 16) -> Iterator[slice]:
    """Yield slices of at most `size` of m triangles, for work whose arrays would be large."""
    for start in range(0, m, size):
        yield slice(start, min(start + size, m))


DEGREE_4 = skfem.quadrature.get_quadrature(skfem.ElementTriP2.refdom, 4)
QUARTERS = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))

ELEMENTS = {
    "P1": Element("P1", skfem.ElementTriP1(), 1, CENTROID_RULE, ((0, 1, 2),)),
    "P2": Element("P2", skfem.ElementTriP2(), 2, DEGREE_4, QUARTERS),
}


def find_element(name: str, where: str) -> Element:
    """Return the element with this name; raise `InputError` for an unknown name."""
    known(f"element = {name!r}", name, ELEMENTS, where)
    return ELEMENTS[name]


def skfem_mesh(X: np.ndarray, triangles: np.ndarray) -> skfem.MeshTri:
    """Return scikit-fem's mesh with corners X (n, 2); it sorts the vertices of each triangle."""
    corners = np.ascontiguousarray(triangles.T, dtype=np.int64)
    return skfem.MeshTri(np.ascontiguousarray(X.T), corners)


def skfem_quadratic_mesh(X: np.ndarray, triangles: np.ndarray) -> skfem.MeshTri:
    """Return scikit-fem's mesh with nodes X (n, 2): the corners, then the midpoints of the edges.

    It is a `skfem.MeshTri2` if edges are curved, and a mesh of the corners alone if not, for
    which scikit-fem works faster.
    """
    straight = skfem_mesh(X[: int(triangles.max()) + 1], triangles)
    first, second = (straight.p.T[ends] for ends in straight.facets)
    bulge = np.linalg.norm(X[straight.nvertices :] - 0.5 * (first + second), axis=1)
    if (bulge <= STRAIGHT * np.linalg.norm(second - first, axis=1)).all():
        return straight
    return skfem.MeshTri2(np.ascontiguousarray(X.T), straight.t, sort_t=False)


def add_midpoints(mesh: FlatMesh, corner_sets: Collection[str] = ()) -> FlatMesh:
    """Return the mesh with a node at the midpoint of each edge; midpoints follow the corners.

    A node set gets the midpoints of its edges. If there is an edge set with its name, these are
    its edges; else, if there is a region with its name, the edges of the region's triangles;
    else all edges with both ends in the set. The sets named in `corner_sets` get no midpoints.
    """
    n = len(mesh.X)
    edges = skfem_mesh(mesh.X, mesh.triangles).facets.T
    X = np.concatenate([mesh.X, mesh.X[edges].mean(axis=1)])

    def with_midpoints(name, nodes):
        """Return the nodes of the set with this name, and the midpoints of its edges."""
        if name in corner_sets:
            return nodes
        if name in mesh.edge_sets:
            midpoints = edge_midpoints(edges, n, pairs=mesh.edge_sets[name])
        elif name in mesh.triangle_sets:
            corners = mesh.triangles[mesh.triangle_sets[name]]
            pairs = _triangle_edges(corners).reshape(-1, 2)
            midpoints = edge_midpoints(edges, n, pairs)
        else:
            midpoints = n + np.flatnonzero(np.isin(edges, nodes).all(axis=1))
        return np.union1d(nodes, midpoints)

    sets = {name: with_midpoints(name, nodes) for name, nodes in mesh.node_sets.items()}
    start = mesh.start
    if start is not None:
        start = np.concatenate([start, start[edges].mean(axis=1)])
    return replace(mesh, X=X, node_sets=sets, start=start)


def oriented_cells(mesh: skfem.MeshTri, triangles: np.ndarray) -> np.ndarray:
    """(m, 6) corners as in `triangles`, then the midpoints of the edges 01, 12 and 20."""
    pairs = _triangle_edges(triangles).reshape(-1, 2)
    midpoints = edge_midpoints(mesh.facets.T, mesh.nvertices, pairs)
    return np.concatenate([triangles, midpoints.reshape(-1, 3)], axis=1).astype(np.int32)


def edge_midpoints(edges: np.ndarray, n: int, pairs: np.ndarray) -> np.ndarray:
    """Node numbers (p,) of the midpoints between pairs (p, 2) of corners.

    Each pair must be one of the `edges` (e, 2) of a mesh with n corners.
    """
    edge_keys, pair_keys = (
        np.sort(ends, axis=1).astype(np.int64) @ [n, 1] for ends in (edges, pairs)
    )
    order = np.argsort(edge_keys)
    return n + order[np.searchsorted(edge_keys[order], pair_keys)]


def _triangle_edges(triangles):
    """(m, 3, 2) the edges 01, 12 and 20 of each triangle."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
