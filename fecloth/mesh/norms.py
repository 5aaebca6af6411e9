"""Integrals over a cloth: norms of nodal fields, loads, consistent or diagonal mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
import skfem

from fecloth.errors import InputError
from fecloth.mesh.interpolation import locate, nodal_values

# --- differences between two cloths ---------------------------------------------------------------


def l2_difference(cloth, other, a, b) -> float:
    """√∫ |a − b|² dA; see `Cloth.l2_difference`."""
    weights, (value_a, *_), (value_b, *_) = _on_common_points(cloth, a, other, b)
    return float(np.sqrt(np.sum(weights[:, None] * (value_a - value_b) ** 2)))


def h1_difference(cloth, other, a, b) -> float:
    """√∫ |∇a − ∇b|² dA; see `Cloth.h1_difference`."""
    weights, (_, *grad_a), (_, *grad_b) = _on_common_points(cloth, a, other, b)
    squares = sum(np.sum((p - q) ** 2, axis=1) for p, q in zip(grad_a, grad_b, strict=True))
    return float(np.sqrt(np.sum(weights * squares)))


def _on_common_points(cloth, a, other, b):
    """Evaluate both fields at the quadrature points of the finer cloth.

    Returns the weights, and for each field the value and its derivatives ∂/∂X₁ and ∂/∂X₂.
    """
    a, b = nodal_values(cloth, a), nodal_values(other, b)
    if a.shape[1:] != b.shape[1:]:
        what = f"fields of shapes {a.shape} and {b.shape}"
        allowed = "must have the same number of components"
        raise InputError(what, allowed, "Cloth.l2_difference")
    finer = cloth if len(cloth.triangles) >= len(other.triangles) else other
    basis = finer.basis(4)
    points = basis.global_coordinates()  # (2, m, q)
    return (
        basis.dx.ravel(),
        _value_and_gradient(cloth, a, points, finer is cloth),
        _value_and_gradient(other, b, points, finer is other),
    )


def _value_and_gradient(cloth, values, points, is_own_points):
    """Value and derivatives of a field at points (2, m, q) of this cloth or of another one."""
    values = values.reshape(len(cloth.X), -1)
    flat = points.reshape(2, -1)
    if is_own_points:
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


# --- errors against a function, and loads ---------------------------------------------------------


def l2_error(cloth, values, exact, order: int) -> float:
    """√∫ |u − exact(X)|² dA; see `Cloth.l2_error`."""
    basis, values = cloth.basis(order), nodal_values(cloth, values)
    u = np.stack([np.asarray(basis.interpolate(c)) for c in _columns(values)], axis=-1)
    reference = at_points(exact, basis, values.shape[1:], "l2_error")
    return float(np.sqrt(np.sum(basis.dx[..., None] * (u - reference.reshape(u.shape)) ** 2)))


def h1_error(cloth, values, exact_gradient, order: int) -> float:
    """√∫ |∂u/∂X − exact_gradient(X)|² dA; see `Cloth.h1_error`."""
    basis, values = cloth.basis(order), nodal_values(cloth, values)
    slopes = [basis.interpolate(c).grad.transpose(1, 2, 0) for c in _columns(values)]
    u = np.stack(slopes, axis=-2)  # (m, q, d, 2)
    reference = at_points(exact_gradient, basis, (*values.shape[1:], 2), "h1_error")
    squares = (u - reference.reshape(u.shape)) ** 2
    return float(np.sqrt(np.sum(basis.dx[..., None, None] * squares)))


def load(cloth, density, order: int) -> np.ndarray:
    """∫ ρ N_a dA, (n,) or (n, d), of a function ρ of X; see `Cloth.load`."""
    basis = cloth.basis(order)
    values = at_points(density, basis, None, "load")
    columns = values.reshape(*values.shape[:2], -1)
    shapes = np.stack([np.broadcast_to(phi[0], basis.dx.shape) for phi in basis.basis])
    parts = np.einsum("amq,mq,mqd->amd", shapes, basis.dx, columns, optimize=True)
    total = np.zeros((len(cloth.X), columns.shape[2]))
    np.add.at(total, basis.element_dofs.ravel(), parts.reshape(-1, columns.shape[2]))
    return total.reshape(len(cloth.X), *values.shape[2:])


def at_points(function, basis, shape, name: str) -> np.ndarray:
    """Values (m, q, ...) of ``function(X (p, 2)) -> (p, ...)`` at the quadrature points."""
    points = basis.global_coordinates()  # (2, m, q)
    flat = points.reshape(2, -1).T
    values = np.asarray(function(flat), dtype=float)
    if shape is None:
        has_shape = values.shape[:1] == (len(flat),)
    else:
        has_shape = values.shape == (len(flat), *shape)
    if not has_shape or not np.isfinite(values).all():
        expected = ", ".join(["p", *map(str, shape or ("...",))])
        what = f"the function's values of shape {values.shape} at {flat.shape} points"
        raise InputError(what, f"must be finite and ({expected})", f"Cloth.{name}")
    return values.reshape(*points.shape[1:], *values.shape[1:])


def _columns(values):
    return values.reshape(len(values), -1).T


def weighted_load(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) ∫ ρ N_a dA for one ρ per triangle (m,)."""
    basis = cloth.basis(2)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    return skfem.LinearForm(lambda v, w: w["rho"] * v).assemble(basis, rho=rho)


def mass_matrix(cloth, kind: str, density: np.ndarray) -> sparse.csr_matrix:
    """(n, n) mass matrix ∫ ρ N_a N_b dA, consistent or lumped; see `Cloth.mass`."""
    if kind not in ("lumped", "consistent"):
        raise InputError(f"mass = {kind!r}", 'must be "lumped" or "consistent"', "Cloth.mass")
    if kind == "lumped":
        return sparse.diags(diagonal_mass(cloth, density), format="csr")
    basis = cloth.basis(2 * cloth.kind.degree)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    form = skfem.BilinearForm(lambda u, v, w: w["rho"] * u * v)
    return form.assemble(basis, rho=rho).tocsr()


def diagonal_mass(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) the scaled diagonal of the consistent mass; see `Cloth.diagonal_mass`."""
    triangle_mass = cloth.weights.sum(axis=1) * density
    nodal_parts = triangle_mass[:, None] * cloth.kind.scaled_diagonal
    return np.bincount(cloth.stencil.ravel(), nodal_parts.ravel(), len(cloth.X))
