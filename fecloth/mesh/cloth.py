"""The reference mesh and its scikit-fem discretisation; knows nothing of materials or time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
import skfem

from fecloth.mesh import elements, generate, mass, norms, selection
from fecloth.mesh.hinges import Hinges

Where = str | np.ndarray | list[int] | Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Cloth:
    """A flat cloth at rest, cut into oriented triangles.

    Made by `rectangle`, `disk`, `read` or `from_arrays`. Nodes and triangles are renumbered once
    so that neighbours lie close together in memory; `source_nodes` and `source_triangles` lead
    back to the numbering of the mesh that came in.

    Its `element` is "P1", linear triangles, or "P2", quadratic ones, whose nodes are the corners
    and, behind them, the middles of the edges (`fecloth.elements`). P2 has a consistent mass only,
    and so no explicit methods; each term says which elements it knows.

    Attributes
    ----------
    X
        (n, 2) reference coordinates of the nodes along warp and weft [m].
    triangles
        (m, 3) int32 corners, counter-clockwise; ``triangles`` and not scikit-fem's ``mesh.t``
        holds the orientation.
    node_sets, edge_sets, triangle_sets
        Named node indices, (k, 2) pairs of corners, and triangles (regions).
    source_nodes, source_triangles
        ``X[i]`` came in as node ``source_nodes[i]``, −1 for the middle of an edge; likewise for
        triangles.
    element
        "P1" or "P2".

    Examples
    --------
    >>> cloth = Cloth.rectangle(width=1.0, height=1.0, h=0.5, pattern="right")
    >>> len(cloth.X), len(cloth.triangles), cloth.nodes("left").size
    (9, 8, 3)
    >>> round(cloth.area, 12)
    1.0
    >>> cloth = Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right", element="P2")
    >>> len(cloth.X), cloth.stencil.shape, cloth.nodes("left").size
    (25, (8, 6), 5)
    """

    X: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    edge_sets: dict[str, np.ndarray] = field(default_factory=dict)
    source_nodes: np.ndarray | None = None
    source_triangles: np.ndarray | None = None
    element: str = "P1"
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)

    # --- where a cloth comes from -------------------------------------------------------------

    @classmethod
    def rectangle(
        cls,
        width: float,
        height: float,
        h: float,
        pattern: str = "unstructured",
        element: str = "P1",
    ):
        """Rectangle [0, width] × [0, height] of edge length `h` [m].

        `pattern` is "unstructured" (Gmsh), "right" (every cell cut along the same diagonal),
        "cross" (every cell cut along both) or "equilateral". Sets: left, right, bottom, top,
        corners, boundary. `element`: "P1" or "P2".
        """
        return cls._of(generate.rectangle(width, height, h, pattern), element, points=["corners"])

    @classmethod
    def disk(cls, radius: float, h: float, element: str = "P1"):
        """Disk around the origin, meshed by Gmsh with edge length `h` [m]. Set: boundary."""
        return cls._of(generate.disk(radius, h), element)

    @classmethod
    def read(cls, path: str | Path, h: float | None = None, element: str = "P1"):
        """A .geo file meshed by Gmsh at size `h` [m], or any triangle mesh that meshio reads.

        Physical groups become node and edge sets. A mesh in space is accepted if it lies in a
        plane.
        """
        return cls._of(generate.read(path, h), element)

    @classmethod
    def from_arrays(
        cls,
        X,
        triangles,
        sets: dict | None = None,
        renumber: bool = True,
        regions: dict | None = None,
        element: str = "P1",
    ):
        """A cloth from coordinates (n, 2) [m], triangles (m, 3), named nodes, named triangles.

        For P2 too these are the corners. A named set grows by the middles of the edges that have
        both ends in it; one with the name of a region by those of the region's triangles.
        """
        where = "from_arrays"
        mesh = generate.checked(X, triangles, sets, where=where, triangle_sets=regions)
        return cls._of(mesh, element, renumber)

    @classmethod
    def _of(cls, mesh: generate.FlatMesh, element: str, renumber: bool = True, points=()):
        elements.named(element, "Cloth")
        nodes, triangles = np.arange(len(mesh.X)), np.arange(len(mesh.triangles))
        if renumber:
            mesh, nodes, triangles = generate.renumbered(mesh)
        if element == "P2":
            mesh = elements.quadratic(mesh, points)
            nodes = np.append(nodes, np.full(len(mesh.X) - len(nodes), -1))
        return cls(
            mesh.X,
            mesh.triangles,
            mesh.node_sets,
            mesh.edge_sets,
            nodes,
            triangles,
            element,
            mesh.triangle_sets,
        )

    # --- what it is ---------------------------------------------------------------------------

    def nodes(self, where: Where) -> np.ndarray:
        """Node indices of a named set, of a predicate on X, or the given indices themselves.

        They are distinct; given indices keep their order, others ascend. A named curve or region
        of P2 triangles has the middles of its edges too.

        Raises
        ------
        InputError
            If the set is unknown, an index is out of range, or no node is chosen.
        """
        return selection.nodes(self, where)

    def region(self, where: Where) -> np.ndarray:
        """Triangle indices of a named region, or of a predicate on the centroids (m, 2).

        Raises
        ------
        InputError
            If the region is unknown or holds no triangle.
        """
        return selection.triangles(self, where)

    @property
    def area(self) -> float:
        """Reference area [m²]."""
        return float(self.weights.sum())

    @cached_property
    def quality(self) -> np.ndarray:
        """(m,) shape of each reference triangle, 4√3 A / Σ l²: 1 equilateral, 0 degenerate."""
        return generate.quality(self.X, self.triangles)

    @cached_property
    def hinges(self) -> Hinges:
        """The interior edges, each with its two triangles."""
        return Hinges.of(self.X, self.triangles)

    # --- scikit-fem ---------------------------------------------------------------------------

    @property
    def kind(self) -> elements.Element:
        """What there is to know of its element."""
        return elements.named(self.element, "Cloth")

    @cached_property
    def mesh(self) -> skfem.MeshTri:
        """The scikit-fem mesh of the corners; it sorts the vertices inside each triangle."""
        corners = len(self.X) if self.element == "P1" else int(self.triangles.max()) + 1
        return elements.skfem_mesh(self.X[:corners], self.triangles)

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, k) int32 as VTK numbers a cell: `triangles`, for P2 the middles of 01, 12, 20 too."""
        if self.element == "P1":
            return self.triangles
        return elements.oriented_cells(self.mesh, self.triangles)

    def basis(self, order: int) -> skfem.CellBasis:
        """A scalar scikit-fem basis whose quadrature is exact to polynomial degree `order`."""
        return self.kind.basis(self.mesh, order)

    @cached_property
    def _kernel_arrays(self):
        return self.kind.arrays(self.mesh)

    @property
    def stencil(self) -> np.ndarray:
        """(m, k) int32, the nodes of each triangle in scikit-fem's order.

        Corners by ascending number (whatever the orientation), then the middles of their edges
        01, 12 and 02.
        """
        return self._kernel_arrays[0]

    @property
    def gradients(self) -> np.ndarray:
        """(m, q, k, 2), ∂N_a/∂X at each quadrature point [1/m]."""
        return self._kernel_arrays[1]

    @property
    def values(self) -> np.ndarray:
        """(q, k), N_a at each quadrature point."""
        return self.kind.values

    @property
    def weights(self) -> np.ndarray:
        """(m, q) quadrature weights, summing to the area [m²]."""
        return self._kernel_arrays[2]

    @property
    def shape(self) -> tuple[tuple, tuple]:
        """A zero for each node of a triangle, and for each quadrature point (see membrane.py)."""
        _, q, k, _ = self.gradients.shape
        return (0,) * k, (0,) * q

    def load(self, density=1.0, order: int = 6) -> np.ndarray:
        """∫ ρ N_a dA: the forces (n,) or (n, d) on the nodes that do the work of a load ρ.

        Parameters
        ----------
        density
            ρ: a number, or a function that takes material points (p, 2) to (p,) or (p, d).
        order
            Polynomial degree to which ρ N_a is integrated exactly.

        Examples
        --------
        >>> cloth = Cloth.rectangle(2.0, 1.0, h=1.0, pattern="right", element="P2")
        >>> float(cloth.load(lambda X: X[:, 0] ** 3).sum().round(12))  # ∫ X³ dA, X < 2, Y < 1
        4.0
        """
        if not callable(density):
            return density * self.weighted_load(np.ones(len(self.triangles)))
        return norms.load(self, density, order)

    def weighted_load(self, density: np.ndarray) -> np.ndarray:
        """(n,) ∫ ρ N_a dA, with one ρ for each triangle (m,); zero at a P2 triangle's corners."""
        return mass.weighted_load(self, density)

    def mass(self, kind: str | None = None, density: np.ndarray | None = None) -> sparse.csr_matrix:
        """(n, n) ∫ ρ N_a N_b dA, consistent or lumped by row sums; ρ (m,) is 1 if left out.

        Left out, `kind` is "lumped" for P1 and "consistent" for P2.

        Raises
        ------
        InputError
            For another kind, and for P2 lumped: its row sums give the corners no mass.
        """
        density = np.ones(len(self.triangles)) if density is None else density
        return mass.matrix(self, self.usual_mass if kind is None else kind, density)

    @property
    def usual_mass(self) -> str:
        """The kind of mass where none is asked for: "lumped" for P1, "consistent" for P2."""
        return "lumped" if self.element == "P1" else "consistent"

    def diagonal_mass(self, density: np.ndarray) -> np.ndarray:
        """(n,) the consistent mass's diagonal, each triangle's scaled to its own mass [kg].

        Positive for either element, and P1's row sums. For norms, estimates and bounds: steps
        with it in place of the mass would not keep P2's order.
        """
        return mass.diagonal(self, density)

    @property
    def least_mass(self) -> float:
        """c with the consistent mass ≥ c `diagonal_mass`, whatever the shape of the triangles."""
        return self.kind.least_mass

    # --- fields on the cloth ------------------------------------------------------------------

    def interpolator(self, points: np.ndarray) -> sparse.csr_matrix:
        """(p, n) matrix that evaluates a nodal field at material points (p, 2) [m].

        A point outside the mesh by less than an edge length takes the nearest triangle's
        polynomial: two meshes of one disk are polygons that do not quite cover each other.

        Raises
        ------
        MeshError
            If a point lies farther outside.
        """
        return norms.interpolator(self, points)

    def interpolate(self, values: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values at material points (p, 2) of a nodal field (n,) or (n, d)."""
        return self.interpolator(points) @ norms.nodal(self, values)

    def l2_norm(self, values: np.ndarray) -> float:
        """√∫ |u|² dA of a nodal field (n,) or (n, d)."""
        values = norms.nodal(self, values)
        return float(np.sqrt(np.sum(values * (self.mass("consistent") @ values))))

    def l2_difference(self, other: Cloth, a: np.ndarray, b: np.ndarray) -> float:
        """√∫ |a − b|² dA for nodal fields a on this cloth and b on `other`.

        The integral runs over the cloth with more triangles, by a rule exact to degree 4 on
        each of them (exact altogether where the coarser mesh's edges are also edges of the finer).
        """
        return norms.l2_difference(self, other, a, b)

    def h1_difference(self, other: Cloth, a: np.ndarray, b: np.ndarray) -> float:
        """√∫ |∇a − ∇b|² dA (the H1 seminorm) for a on this cloth and b on `other`."""
        return norms.h1_difference(self, other, a, b)

    def l2_error(self, values: np.ndarray, exact: Callable, order: int = 8) -> float:
        """√∫ |u − exact|² dA of a nodal field (n,) or (n, d).

        ``exact`` takes material points (p, 2) to (p,) or (p, d); `order` is the polynomial degree
        to which the square is integrated exactly.
        """
        return norms.l2_error(self, values, exact, order)

    def h1_error(self, values: np.ndarray, exact_gradient: Callable, order: int = 8) -> float:
        """√∫ |∂u/∂X − exact_gradient|² dA (the H1 seminorm) of a nodal field (n,) or (n, d).

        ``exact_gradient`` takes material points (p, 2) to (p, 2) or (p, d, 2).

        Examples
        --------
        >>> cloth = Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right", element="P2")
        >>> cloth.h1_error(cloth.X[:, 0] ** 2, lambda X: 2 * X * (1, 0)) < 1e-14
        True
        """
        return norms.h1_error(self, values, exact_gradient, order)

    def __repr__(self) -> str:
        kind = f"{len(self.X)} nodes, {len(self.triangles)} {self.element} triangles"
        sets = ", ".join(sorted(self.node_sets)) or "none"
        return f"<Cloth of {kind}, {self.area:.4g} m²; node sets: {sets}>"
