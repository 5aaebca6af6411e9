"""Nodal fields on a cloth: their values anywhere, and how far they lie apart."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.interpolation import locate


def nodal(cloth, values) -> np.ndarray:
    """A nodal field (n,) or (n, d) as an array; raises `InputError` if it is not one."""
    values = np.asarray(values, dtype=float)
    if values.ndim not in (1, 2) or len(values) != len(cloth.X):
        allowed = f"must be ({len(cloth.X)},) or ({len(cloth.X)}, d)"
        raise InputError(f"a nodal field of shape {values.shape}", allowed, "Cloth")
    return values


def interpolator(cloth, points: np.ndarray) -> sparse.csr_matrix:
    """(p, n) matrix that evaluates a nodal field at material points (p, 2) [m]."""
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    cells = locate(cloth.X, cloth.triangles, points)
    basis = cloth.basis(1)
    local = basis.mapping.invF(points.T[:, :, None], tind=cells)
    values = [
        basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0].ravel()
        for a in range(basis.Nbfun)
    ]
    columns = basis.element_dofs[:, cells]
    rows = np.broadcast_to(np.arange(len(points)), columns.shape)
    shape = (len(points), basis.N)
    return sparse.csr_matrix((np.ravel(values), (rows.ravel(), columns.ravel())), shape=shape)


# --- against another cloth ------------------------------------------------------------------------


def l2_difference(cloth, other, a, b) -> float:
    """√∫ |a − b|² dA."""
    weights, (value_a, *_), (value_b, *_) = _on_common_points(cloth, a, other, b)
    return float(np.sqrt(np.sum(weights[:, None] * (value_a - value_b) ** 2)))


def h1_difference(cloth, other, a, b) -> float:
    """√∫ |∇a − ∇b|² dA."""
    weights, (_, *grad_a), (_, *grad_b) = _on_common_points(cloth, a, other, b)
    squares = sum(np.sum((p - q) ** 2, axis=1) for p, q in zip(grad_a, grad_b, strict=True))
    return float(np.sqrt(np.sum(weights * squares)))


def _on_common_points(cloth, a, other, b):
    """Weights, and value, ∂/∂X₁, ∂/∂X₂ of both fields, at the finer cloth's quadrature points."""
    a, b = nodal(cloth, a), nodal(other, b)
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
        at = values[basis.element_dofs[a, cells]]
        value += phi.reshape(-1, 1) * at
        d1 += phi.grad[0].reshape(-1, 1) * at
        d2 += phi.grad[1].reshape(-1, 1) * at
    return value, d1, d2


# --- against a function ---------------------------------------------------------------------------


def l2_error(cloth, values, exact, order: int) -> float:
    """√∫ |u − exact(X)|² dA."""
    basis, values = cloth.basis(order), nodal(cloth, values)
    u = np.stack([np.asarray(basis.interpolate(c)) for c in _columns(values)], axis=-1)
    known = at_points(exact, basis, values.shape[1:], "l2_error")
    return float(np.sqrt(np.sum(basis.dx[..., None] * (u - known.reshape(u.shape)) ** 2)))


def h1_error(cloth, values, exact_gradient, order: int) -> float:
    """√∫ |∂u/∂X − exact_gradient(X)|² dA."""
    basis, values = cloth.basis(order), nodal(cloth, values)
    slopes = [basis.interpolate(c).grad.transpose(1, 2, 0) for c in _columns(values)]
    u = np.stack(slopes, axis=-2)  # (m, q, d, 2)
    known = at_points(exact_gradient, basis, (*values.shape[1:], 2), "h1_error")
    return float(np.sqrt(np.sum(basis.dx[..., None, None] * (u - known.reshape(u.shape)) ** 2)))


def load(cloth, density, order: int) -> np.ndarray:
    """(n,) or (n, d), ∫ ρ N_a dA of a function of X."""
    basis = cloth.basis(order)
    values = at_points(density, basis, None, "load")
    columns = values.reshape(*values.shape[:2], -1)
    shapes = np.stack([np.broadcast_to(phi[0], basis.dx.shape) for phi in basis.basis])
    parts = np.einsum("amq,mq,mqd->amd", shapes, basis.dx, columns, optimize=True)
    total = np.zeros((len(cloth.X), columns.shape[2]))
    np.add.at(total, basis.element_dofs.ravel(), parts.reshape(-1, columns.shape[2]))
    return total.reshape(len(cloth.X), *values.shape[2:])


def at_points(function, basis, shape, name: str) -> np.ndarray:
    """(m, q, ...) of ``function(X (p, 2)) -> (p, ...)`` at the quadrature points, checked."""
    points = basis.global_coordinates()  # (2, m, q)
    flat = points.reshape(2, -1).T
    values = np.asarray(function(flat), dtype=float)
    fits = (
        values.shape[:1] == (len(flat),) if shape is None else values.shape == (len(flat), *shape)
    )
    if not fits or not np.isfinite(values).all():
        wanted = ", ".join(["p", *map(str, shape or ("...",))])
        what = f"the function's values of shape {values.shape} at {flat.shape} points"
        raise InputError(what, f"must be finite and ({wanted})", f"Cloth.{name}")
    return values.reshape(*points.shape[1:], *values.shape[1:])


def _columns(values):
    return values.reshape(len(values), -1).T
