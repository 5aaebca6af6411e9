"""The reference mesh and its scikit-fem discretisation; knows nothing of materials or time."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
import skfem

from . import meshing
from .errors import InputError
from .hinges import Hinges
from .locate import locate

Where = str | np.ndarray | list[int] | Callable[[np.ndarray], np.ndarray]

CENTROID = (np.array([[1 / 3], [1 / 3]]), np.array([0.5]))

# element and the quadrature rule of its energy: F is constant on a P1 triangle, so one point is
# exact there (scikit-fem's own rules have three at least)
ELEMENTS = {"P1": (skfem.ElementTriP1(), CENTROID)}


@dataclass(frozen=True, eq=False)
class Cloth:
    """A flat cloth at rest, cut into oriented triangles.

    Made by `rectangle`, `disk`, `read` or `from_arrays`. Nodes and triangles are renumbered once
    so that neighbours lie close together in memory; `source_nodes` and `source_triangles` lead
    back to the numbering of the mesh that came in.

    Attributes
    ----------
    X
        (n, 2) reference coordinates along warp and weft [m].
    triangles
        (m, 3) int32, counter-clockwise; ``triangles`` and not scikit-fem's ``mesh.t`` holds the
        orientation.
    node_sets, edge_sets, triangle_sets
        Named node indices, (k, 2) node pairs, and triangles (regions).
    source_nodes, source_triangles
        ``X[i]`` came in as node ``source_nodes[i]``; likewise for triangles.

    Examples
    --------
    >>> cloth = Cloth.rectangle(width=1.0, height=1.0, h=0.5, pattern="right")
    >>> len(cloth.X), len(cloth.triangles), cloth.nodes("left").size
    (9, 8, 3)
    >>> round(cloth.area, 12)
    1.0
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
    def rectangle(cls, width: float, height: float, h: float, pattern: str = "unstructured"):
        """Rectangle [0, width] × [0, height] of edge length `h` [m].

        `pattern` is "unstructured" (Gmsh), "right" (every cell cut along the same diagonal),
        "cross" (every cell cut along both) or "equilateral". Sets: left, right, bottom, top,
        corners, boundary.
        """
        return cls._of(meshing.rectangle(width, height, h, pattern))

    @classmethod
    def disk(cls, radius: float, h: float):
        """Disk around the origin, meshed by Gmsh with edge length `h` [m]. Set: boundary."""
        return cls._of(meshing.disk(radius, h))

    @classmethod
    def read(cls, path: str | Path, h: float | None = None):
        """A .geo file meshed by Gmsh at size `h` [m], or any triangle mesh that meshio reads.

        Physical groups become node and edge sets. A mesh in space is accepted if it lies in a
        plane.
        """
        return cls._of(meshing.read(path, h))

    @classmethod
    def from_arrays(
        cls,
        X,
        triangles,
        sets: dict | None = None,
        renumber: bool = True,
        regions: dict | None = None,
    ):
        """A cloth from coordinates (n, 2) [m], triangles (m, 3), named nodes, named triangles."""
        where = "from_arrays"
        mesh = meshing.checked(X, triangles, sets, where=where, triangle_sets=regions)
        return cls._of(mesh, renumber)

    @classmethod
    def _of(cls, mesh: meshing.FlatMesh, renumber: bool = True):
        nodes, triangles = np.arange(len(mesh.X)), np.arange(len(mesh.triangles))
        if renumber:
            mesh, nodes, triangles = meshing.renumbered(mesh)
        return cls(
            mesh.X,
            mesh.triangles,
            mesh.node_sets,
            mesh.edge_sets,
            nodes,
            triangles,
            triangle_sets=mesh.triangle_sets,
        )

    # --- what it is ---------------------------------------------------------------------------

    def nodes(self, where: Where) -> np.ndarray:
        """Node indices of a named set, of a predicate on X, or the given indices themselves.

        They are distinct; given indices keep their order, others ascend.

        Raises
        ------
        InputError
            If the set is unknown, an index is out of range, or no node is chosen.
        """
        if isinstance(where, str):
            if where not in self.node_sets:
                raise InputError(
                    f"node set {where!r}",
                    f"must be one of {', '.join(sorted(self.node_sets)) or '(none)'}",
                    "Cloth.nodes",
                    _nearest(where, self.node_sets),
                )
            return self.node_sets[where]
        chosen = np.atleast_1d(where(self.X) if callable(where) else where)
        if not chosen.size:
            raise InputError("the choice of nodes is empty", "needs a node", "Cloth.nodes")
        if chosen.dtype == bool and chosen.shape == (len(self.X),):
            chosen = np.flatnonzero(chosen)
        if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer):
            raise InputError(
                f"nodes of type {chosen.dtype} and shape {chosen.shape}",
                f"must be a set's name, indices, or {len(self.X)} booleans",
                "Cloth.nodes",
            )
        if not chosen.size:
            raise InputError("the choice of nodes is empty", "needs a node", "Cloth.nodes")
        if chosen.min() < 0 or chosen.max() >= len(self.X):
            raise InputError(
                f"node indices {chosen.min()} … {chosen.max()}",
                f"must lie in 0 … {len(self.X) - 1}",
                "Cloth.nodes",
            )
        _, first = np.unique(chosen, return_index=True)
        return chosen[np.sort(first)]

    def region(self, where: Where) -> np.ndarray:
        """Triangle indices of a named region, or of a predicate on the centroids (m, 2).

        Raises
        ------
        InputError
            If the region is unknown or holds no triangle.
        """
        if callable(where):
            chosen = np.flatnonzero(where(self.X[self.triangles].mean(axis=1)))
        elif where in self.triangle_sets:
            chosen = self.triangle_sets[where]
        else:
            allowed = f"must be one of {', '.join(sorted(self.triangle_sets)) or '(none)'}"
            close = _nearest(where, self.triangle_sets)
            raise InputError(f"region {where!r}", allowed, "Cloth.region", close)
        if not len(chosen):
            raise InputError("the choice of triangles is empty", "needs one", "Cloth.region")
        return chosen

    @property
    def area(self) -> float:
        """Reference area [m²]."""
        return float(self.weights.sum())

    @cached_property
    def quality(self) -> np.ndarray:
        """(m,) shape of each reference triangle, 4√3 A / Σ l²: 1 equilateral, 0 degenerate."""
        return meshing.quality(self.X, self.triangles)

    @cached_property
    def hinges(self) -> Hinges:
        """The interior edges, each with its two triangles."""
        return Hinges.of(self.X, self.triangles)

    # --- scikit-fem ---------------------------------------------------------------------------

    @cached_property
    def mesh(self) -> skfem.MeshTri:
        """The scikit-fem mesh; it sorts the vertices inside each triangle."""
        return skfem.MeshTri(
            np.ascontiguousarray(self.X.T), np.ascontiguousarray(self.triangles.T, dtype=np.int64)
        )

    def basis(self, order: int) -> skfem.CellBasis:
        """A scalar scikit-fem basis whose quadrature is exact to polynomial degree `order`."""
        return skfem.Basis(self.mesh, ELEMENTS[self.element][0], intorder=order)

    @cached_property
    def _kernel_arrays(self):
        element, rule = ELEMENTS[self.element]
        basis = skfem.Basis(self.mesh, element, quadrature=rule)
        gradients = np.stack([phi[0].grad for phi in basis.basis])  # (k, 2, m, q)
        return (
            np.ascontiguousarray(basis.element_dofs.T, dtype=np.int32),
            np.ascontiguousarray(gradients.transpose(2, 3, 0, 1)),
            np.ascontiguousarray(basis.dx),
        )

    @property
    def stencil(self) -> np.ndarray:
        """(m, k) int32, the nodes of each triangle in scikit-fem's order."""
        return self._kernel_arrays[0]

    @property
    def gradients(self) -> np.ndarray:
        """(m, q, k, 2), ∂N_a/∂X at each quadrature point [1/m]."""
        return self._kernel_arrays[1]

    @property
    def weights(self) -> np.ndarray:
        """(m, q) quadrature weights, summing to the area [m²]."""
        return self._kernel_arrays[2]

    @property
    def shape(self) -> tuple[tuple, tuple]:
        """A zero for each node of a triangle, and for each quadrature point (see membrane.py)."""
        _, q, k, _ = self.gradients.shape
        return (0,) * k, (0,) * q

    @cached_property
    def load(self) -> np.ndarray:
        """(n,) ∫ N_a dA [m²], the load vector of a unit load."""
        return self.weighted_load(np.ones(len(self.triangles)))

    def weighted_load(self, density: np.ndarray) -> np.ndarray:
        """(n,) ∫ ρ N_a dA, with one ρ for each triangle (m,)."""
        basis = self.basis(2)
        rho = np.broadcast_to(density[:, None], basis.dx.shape)
        return skfem.LinearForm(lambda v, w: w["rho"] * v).assemble(basis, rho=rho)

    def mass(self, kind: str = "lumped", density: np.ndarray | None = None) -> sparse.csr_matrix:
        """(n, n) ∫ ρ N_a N_b dA, consistent or lumped by row sums; ρ (m,) is 1 if left out."""
        density = np.ones(len(self.triangles)) if density is None else density
        if kind == "lumped":
            return sparse.diags(self.weighted_load(density), format="csr")
        if kind == "consistent":
            basis = self.basis(2)
            rho = np.broadcast_to(density[:, None], basis.dx.shape)
            form = skfem.BilinearForm(lambda u, v, w: w["rho"] * u * v)
            return form.assemble(basis, rho=rho).tocsr()
        raise InputError(f"mass = {kind!r}", 'must be "lumped" or "consistent"', "Cloth.mass")

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
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        cells = locate(self.X, self.triangles, points)
        basis = self.basis(1)
        local = basis.mapping.invF(points.T[:, :, None], tind=cells)
        values = [
            basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0].ravel()
            for a in range(basis.Nbfun)
        ]
        columns = basis.element_dofs[:, cells]
        rows = np.broadcast_to(np.arange(len(points)), columns.shape)
        shape = (len(points), basis.N)
        return sparse.csr_matrix((np.ravel(values), (rows.ravel(), columns.ravel())), shape=shape)

    def interpolate(self, values: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values at material points (p, 2) of a nodal field (n,) or (n, d)."""
        return self.interpolator(points) @ self._field(values)

    def l2_norm(self, values: np.ndarray) -> float:
        """√∫ |u|² dA of a nodal field (n,) or (n, d)."""
        values = self._field(values)
        return float(np.sqrt(np.sum(values * (self.mass("consistent") @ values))))

    def _field(self, values) -> np.ndarray:
        """A nodal field as an array; raises `InputError` if it is not one."""
        values = np.asarray(values, dtype=float)
        if values.ndim not in (1, 2) or len(values) != len(self.X):
            allowed = f"must be ({len(self.X)},) or ({len(self.X)}, d)"
            raise InputError(f"a nodal field of shape {values.shape}", allowed, "Cloth")
        return values

    def l2_difference(self, other: Cloth, a: np.ndarray, b: np.ndarray) -> float:
        """√∫ |a − b|² dA for nodal fields a on this cloth and b on `other`.

        The integral runs over the cloth with more triangles, by a rule exact to degree 4 on
        each of them (exact altogether where the coarser mesh's edges are also edges of the finer).
        """
        weights, (value_a, *_), (value_b, *_) = _on_common_points(self, a, other, b)
        return float(np.sqrt(np.sum(weights[:, None] * (value_a - value_b) ** 2)))

    def h1_difference(self, other: Cloth, a: np.ndarray, b: np.ndarray) -> float:
        """√∫ |∇a − ∇b|² dA (the H1 seminorm) for a on this cloth and b on `other`."""
        weights, (_, *grad_a), (_, *grad_b) = _on_common_points(self, a, other, b)
        squares = sum(np.sum((p - q) ** 2, axis=1) for p, q in zip(grad_a, grad_b, strict=True))
        return float(np.sqrt(np.sum(weights * squares)))


def _on_common_points(cloth, a, other, b):
    """Weights, and value, ∂/∂X₁, ∂/∂X₂ of both fields, at the finer cloth's quadrature points."""
    a, b = cloth._field(a), other._field(b)
    if a.shape[1:] != b.shape[1:]:
        what = f"fields of shapes {a.shape} and {b.shape}"
        raise InputError(what, "must have as many components", "Cloth.l2_difference")
    finer = cloth if len(cloth.triangles) >= len(other.triangles) else other
    basis = finer.basis(4)
    points = basis.global_coordinates()  # (2, m, q)
    return (
        basis.dx.ravel(),
        _value_and_gradient(cloth, a, points, finer is cloth),
        _value_and_gradient(other, b, points, finer is other),
    )


def _value_and_gradient(cloth, values, points, own):
    values = values.reshape(len(cloth.X), -1)
    flat = points.reshape(2, -1)
    if own:
        cells = np.repeat(np.arange(points.shape[1]), points.shape[2])
    else:
        cells = locate(cloth.X, cloth.triangles, flat.T)
    basis = cloth.basis(1)
    local = basis.mapping.invF(flat[:, :, None], tind=cells)
    value, d1, d2 = np.zeros((3, flat.shape[1], values.shape[1]))
    for a in range(basis.Nbfun):
        phi = basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0]
        nodal = values[basis.element_dofs[a, cells]]
        value += phi.reshape(-1, 1) * nodal
        d1 += phi.grad[0].reshape(-1, 1) * nodal
        d2 += phi.grad[1].reshape(-1, 1) * nodal
    return value, d1, d2


def _nearest(name: str, names) -> str:
    close = difflib.get_close_matches(name, list(names), n=1)
    return f"Did you mean {close[0]!r}?" if close else ""
