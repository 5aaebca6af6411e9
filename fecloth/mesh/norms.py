"""Nodal fields: values at material points, norms of differences, loads and masses."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse
import skfem
from scipy.spatial import cKDTree

from fecloth import validation
from fecloth.errors import InputError, MeshError

CANDIDATES = 12  # nearest triangles that are searched for a point before all others


def nodal_values(cloth, values) -> np.ndarray:
    """Return a nodal field (n,) or (n, d) as an array; raise `InputError` for other shapes."""
    values = np.asarray(values, dtype=float)
    if values.ndim not in (1, 2) or len(values) != len(cloth.X):
        allowed = f"must be ({len(cloth.X)},) or ({len(cloth.X)}, d)"
        raise InputError(f"a nodal field of shape {values.shape}", allowed, "Cloth")
    return values


def interpolator(cloth, points: np.ndarray) -> sparse.csr_matrix:
    """(p, n) matrix that evaluates a nodal field at material points (p, 2) [m].

    A point may lie outside the mesh by less than an edge length, as between two polygons of one
    disk; there the polynomial of the nearest triangle is used. Raises `MeshError` if a point
    lies farther outside or is not finite.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    return _evaluators(cloth, points, locate(cloth.X, cloth.triangles, points))[0]


def _evaluators(cloth, points: np.ndarray, cells: np.ndarray) -> list[sparse.csr_matrix]:
    """Return three (p, n) matrices that give a nodal field, ∂/∂X₁ and ∂/∂X₂ of it at points.

    `points` (p, 2) are material points [m], and `cells` (p,) the triangle of each of them.
    """
    element = cloth.kind.shapes
    mapping = cloth.mesh.mapping()
    local = mapping.invF(points.T[:, :, None], tind=cells)  # coordinates on the unit triangle
    columns = cloth.stencil[cells].T
    shapes = [element.gbasis(mapping, local, a, tind=cells)[0] for a in range(len(columns))]
    place = np.tile(np.arange(len(points)), len(columns)), columns.ravel()
    size = len(points), len(cloth.X)
    entries_of_matrices = [
        shapes,
        [phi.grad[0] for phi in shapes],
        [phi.grad[1] for phi in shapes],
    ]
    return [
        sparse.csr_matrix((np.ravel(entries), place), shape=size) for entries in entries_of_matrices
    ]


def interpolate(cloth, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Interpolate a nodal field (n,) or (n, d) at material points (p, 2) [m]."""
    return interpolator(cloth, points) @ nodal_values(cloth, values)


def locate(X: np.ndarray, triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the triangle (p,) that contains each point (p, 2) [m], or else the nearest one.

    scikit-fem's finder is not used because it rejects points outside a polygonal border. The
    `CANDIDATES` triangles whose centroids are nearest are searched first. Raises `MeshError` for
    points that are not finite, or farther from the nearest triangle than its longest edge.
    """
    if not np.isfinite(points).all():
        first = int(np.argmin(np.isfinite(points).all(axis=1)))  # that is not finite
        what = f"material points[{first}] = {points[first].tolist()}"
        raise MeshError(what, "must be finite", "Cloth.interpolate")
    corners = X[triangles]
    count = min(CANDIDATES, len(triangles))
    _, candidates = cKDTree(corners.mean(axis=1)).query(points, count)
    candidates = candidates.reshape(len(points), count)
    depths = _depth(corners[candidates], points[:, None])
    cells = candidates[np.arange(len(points)), np.argmax(depths, axis=1)]
    depth = depths.max(axis=1)  # ≥ 0 inside of a triangle
    # A point in none of its candidates lies outside the mesh, or in a large triangle beside many
    # small ones, whose centroids are nearer: search all triangles. The limit [m] spares points
    # that only round-off puts outside.
    for p in np.flatnonzero(depth < -1e-12):
        all_depths = _depth(corners, points[p])
        if all_depths.max() < 0:
            # `_depth` measures to the lines of the edges, which go on beyond the triangle.
            all_depths = -_distance(corners, points[p])
        cells[p] = np.argmax(all_depths)
        depth[p] = all_depths.max()
    nearest = corners[cells]
    longest_edge = np.linalg.norm(nearest - np.roll(nearest, 1, axis=1), axis=2).max(axis=1)
    outside = np.flatnonzero(depth < -longest_edge)
    if outside.size:
        what = f"{outside.size} of {len(points)} material points, first {points[outside[0]]} m"
        allowed = "must lie on the cloth"
        remedy = f"The cloth spans {X.min(axis=0)} to {X.max(axis=0)} m."
        raise MeshError(what, allowed, "Cloth.interpolate", remedy)
    return cells


def containing(X: np.ndarray, triangles: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the triangles that contain a point (2,) [m]; at a node or on an edge there are more.

    Of a point outside it is the nearest triangle. The corners of `triangles` (m, 3) are
    counter-clockwise. Raises what `locate` raises.
    """
    corners = X[triangles]
    round_off = 1e-9 * np.ptp(corners, axis=1).max()
    inside = np.flatnonzero(_depth(corners, point) > -round_off)
    return inside if len(inside) else locate(X, triangles, point[None])


def _depth(corners, points):
    """Smallest signed distance [m] of points from the three edge lines, positive inside.

    The `corners` (..., 3, 2) are counter-clockwise.
    """
    tail = corners
    head = np.roll(corners, -1, axis=-2)
    edge = head - tail
    offset = points[..., None, :] - tail
    cross = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
    return (cross / np.linalg.norm(edge, axis=-1)).min(axis=-1)


def _distance(corners, point):
    """(m,) distance [m] of a point to the nearest edge of each triangle (m, 3, 2)."""
    edge = np.roll(corners, -1, axis=1) - corners
    offset = point - corners
    ratio = np.einsum("eai,eai->ea", offset, edge) / np.einsum("eai,eai->ea", edge, edge)
    nearest = np.clip(ratio, 0.0, 1.0)[..., None] * edge  # point of each edge, from its start
    return np.linalg.norm(offset - nearest, axis=2).min(axis=1)


def l2_norm(cloth, values: np.ndarray) -> float:
    """√∫ |u|² dA of a nodal field (n,) or (n, d)."""
    values = nodal_values(cloth, values)
    return float(np.sqrt(np.sum(values * (mass(cloth, "consistent") @ values))))


def l2_difference(cloth, other, a: np.ndarray, b: np.ndarray) -> float:
    """√∫ |a − b|² dA for nodal fields a on this cloth and b on `other`.

    The integral is over the cloth with more triangles, by a rule that is exact to degree 4. So
    it is exact if every edge of the coarser mesh consists of edges of the finer mesh.
    """
    weights, (value_a, *_), (value_b, *_) = _on_common_points(cloth, a, other, b)
    return float(np.sqrt(np.sum(weights[:, None] * (value_a - value_b) ** 2)))


def h1_difference(cloth, other, a: np.ndarray, b: np.ndarray) -> float:
    """√∫ |∇a − ∇b|² dA (the H1 seminorm) for a on this cloth and b on `other`."""
    weights, (_, *grad_a), (_, *grad_b) = _on_common_points(cloth, a, other, b)
    squares = sum(np.sum((p - q) ** 2, axis=1) for p, q in zip(grad_a, grad_b, strict=True))
    return float(np.sqrt(np.sum(weights * squares)))


def _on_common_points(cloth, a, other, b):
    """Evaluate the fields a on `cloth` and b on `other` at the points of the finer cloth.

    Return the quadrature weights (p,) [m²] at these points, and for each field a list of its
    values, ∂/∂X₁ and ∂/∂X₂ there, each (p, d). Raises `InputError` for fields with different
    numbers of components.
    """
    a = nodal_values(cloth, a)
    b = nodal_values(other, b)
    if a.shape[1:] != b.shape[1:]:
        what = f"fields of shapes {a.shape} and {b.shape}"
        raise InputError(what, "must have the same number of components", "Cloth.l2_difference")
    finer = cloth if len(cloth.triangles) >= len(other.triangles) else other
    basis = finer.basis(4)
    points = basis.global_coordinates()  # (2, m, q)
    of_a = _value_and_gradient(cloth, a, points, is_own_points=finer is cloth)
    of_b = _value_and_gradient(other, b, points, is_own_points=finer is other)
    return basis.dx.ravel(), of_a, of_b


def _value_and_gradient(cloth, values, points, is_own_points):
    """Value and derivatives of a field at points (2, m, q) of this cloth or of another one."""
    values = values.reshape(len(cloth.X), -1)
    flat = points.reshape(2, -1).T
    if is_own_points:
        cells = np.repeat(np.arange(points.shape[1]), points.shape[2])
    else:
        cells = locate(cloth.X, cloth.triangles, flat)
    return [evaluate @ values for evaluate in _evaluators(cloth, flat, cells)]


def l2_error(cloth, values: np.ndarray, exact: Callable, order: int = 8) -> float:
    """√∫ |u − exact|² dA of a nodal field (n,) or (n, d).

    `exact` is a function of material points (p, 2) [m] that returns (p,) or (p, d). `order` is
    the polynomial degree to which the square of the difference is integrated exactly.
    """
    basis = cloth.basis(order)
    values = nodal_values(cloth, values)
    u = np.stack([np.asarray(basis.interpolate(c)) for c in _columns(values)], axis=-1)
    reference = at_points(exact, basis, values.shape[1:], "l2_error")
    return float(np.sqrt(np.sum(basis.dx[..., None] * (u - reference.reshape(u.shape)) ** 2)))


def h1_error(cloth, values: np.ndarray, exact_gradient: Callable, order: int = 8) -> float:
    """√∫ |∂u/∂X − exact_gradient|² dA (the H1 seminorm) of a nodal field (n,) or (n, d).

    `exact_gradient` is a function of material points (p, 2) [m] that returns (p, 2) or (p,
    d, 2).
    """
    basis = cloth.basis(order)
    values = nodal_values(cloth, values)
    slopes = [basis.interpolate(c).grad.transpose(1, 2, 0) for c in _columns(values)]
    u = np.stack(slopes, axis=-2)  # (m, q, d, 2)
    reference = at_points(exact_gradient, basis, (*values.shape[1:], 2), "h1_error")
    squares = (u - reference.reshape(u.shape)) ** 2
    return float(np.sqrt(np.sum(basis.dx[..., None, None] * squares)))


def load(cloth, density=1.0, order: int = 6) -> np.ndarray:
    """Return consistent nodal forces ∫ ρ N_a dA, (n,) or (n, d), of a distributed load ρ.

    Raises `InputError` if a function returns values of another shape or that are not finite.

    Parameters
    ----------
    density
        ρ: a number, or a function of material points (p, 2) [m] that returns (p,) or (p, d).
    order
        Polynomial degree to which ρ N_a is integrated exactly.
    """
    if not callable(density):  # a number needs no quadrature of this order
        return density * weighted_load(cloth, np.ones(len(cloth.triangles)))
    basis = cloth.basis(order)
    values = at_points(density, basis, None, "load")
    columns = values.reshape(*values.shape[:2], -1)
    shapes = np.stack([np.broadcast_to(phi[0], basis.dx.shape) for phi in basis.basis])
    parts = np.einsum("amq,mq,mqd->amd", shapes, basis.dx, columns, optimize=True)
    total = np.zeros((len(cloth.X), columns.shape[2]))
    np.add.at(total, basis.element_dofs.ravel(), parts.reshape(-1, columns.shape[2]))
    return total.reshape(len(cloth.X), *values.shape[2:])


def at_points(function, basis, shape, name: str) -> np.ndarray:
    """Return the values (m, q, ...) of ``function(X (p, 2)) -> (p, ...)`` at a basis's points.

    `shape` is the shape of one value, or None where the function decides on it. Raises
    `InputError`, for the method `name` of a cloth, if the function returns another shape or
    values that are not finite.
    """
    points = basis.global_coordinates()  # (2, m, q)
    flat = points.reshape(2, -1).T
    values = np.asarray(function(flat), dtype=float)
    shape_of_one = shape
    if shape_of_one is None:
        shape_of_one = values.shape[1:]
    if values.shape != (len(flat), *shape_of_one) or not np.isfinite(values).all():
        expected = ", ".join(["p", *map(str, shape or ("...",))])
        what = f"the function's values of shape {values.shape} at {flat.shape} points"
        raise InputError(what, f"must be finite and ({expected})", f"Cloth.{name}")
    return values.reshape(*points.shape[1:], *values.shape[1:])


def _columns(values):
    return values.reshape(len(values), -1).T


def weighted_load(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) ∫ ρ N_a dA for one ρ per triangle (m,); zero at the corners of P2 triangles."""
    basis = cloth.basis(2)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    return skfem.LinearForm(lambda v, w: w["rho"] * v).assemble(basis, rho=rho)


def mass(cloth, kind: str | None = None, density: np.ndarray | None = None) -> sparse.csr_matrix:
    """Return the (n, n) mass matrix ∫ ρ N_a N_b dA [kg], consistent or lumped.

    The lumped mass is the diagonal of each triangle's consistent mass, scaled to the mass of
    the triangle. For P1 each node gets a third of it, as by row sums. For P2 a corner gets 1/19
    and a midpoint 16/57; row sums would be zero at the corners.

    The frequencies of a taut square converge with order 2 on P1 and on lumped P2 (with a third
    of the error of P1), and with order 4 on consistent P2.

    Source: Hinton, Rock and Zienkiewicz (1976), A note on mass lumping and related processes
    in the finite element method, Earthquake Engng Struct. Dyn. 4, 245–249.

    Raises `InputError` for another kind.

    Parameters
    ----------
    kind : str, optional
        "lumped" or "consistent". Default: "lumped" for P1, "consistent" for P2.
    density : (m,) array, optional
        ρ of each triangle [kg/m²]. Default: 1.
    """
    if density is None:
        density = np.ones(len(cloth.triangles))
    if kind is None:
        kind = cloth.usual_mass
    validation.one_of("mass", kind, ("lumped", "consistent"), "Cloth.mass")
    if kind == "lumped":
        return sparse.diags(diagonal_mass(cloth, density), format="csr")
    basis = cloth.basis(2 * cloth.kind.degree)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    return skfem.BilinearForm(lambda u, v, w: w["rho"] * u * v).assemble(basis, rho=rho).tocsr()


def diagonal_mass(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) the lumped masses [kg]; positive for both elements. See `mass`."""
    nodal_parts = (cloth.weights.sum(axis=1) * density)[:, None] * cloth.kind.scaled_diagonal
    return np.bincount(cloth.stencil.ravel(), nodal_parts.ravel(), len(cloth.X))
