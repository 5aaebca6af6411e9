"""Updates of arrays that several terms make, as kernels for `force_calls`.

Each product and sum is rounded by itself, as NumPy and SciPy do.
"""

from collections.abc import Callable

from fecloth.compiled.jit import Array, rounded_kernel


@rounded_kernel
def add(values: Array, f: Array) -> None:
    """f (n, 3) += values."""
    for i in range(len(f)):
        for k in range(3):
            f[i, k] += values[i, k]


@rounded_kernel
def add_shares(nodes: Array, share: Array, force: Array, f: Array) -> None:
    """f (n, 3) += share (k, 1) times the force (3,), at the nodes (k,)."""
    for n in range(len(nodes)):
        for k in range(3):
            f[nodes[n], k] += share[n, 0] * force[k]


@rounded_kernel
def add_scaled(scale: Array, values: Array, f: Array) -> None:
    """f (n, 3) += scale (n, 1) values."""
    for i in range(len(f)):
        for k in range(3):
            f[i, k] += scale[i, 0] * values[i, k]


@rounded_kernel
def subtract_scaled(scale: Array, v: Array, f: Array) -> None:
    """f (n, 3) −= scale (n, 1) v."""
    for i in range(len(f)):
        for k in range(3):
            f[i, k] -= scale[i, 0] * v[i, k]


@rounded_kernel
def subtract_product(indptr: Array, indices: Array, values: Array, x: Array, f: Array) -> None:
    """f (n, 3) −= A x of a sparse matrix A (n, n) by compressed rows, and x (n, 3)."""
    for i in range(len(f)):
        y1, y2, y3 = 0.0, 0.0, 0.0
        for s in range(indptr[i], indptr[i + 1]):
            a = values[s]
            j = indices[s]
            y1 += a * x[j, 0]
            y2 += a * x[j, 1]
            y3 += a * x[j, 2]
        f[i, 0] -= y1
        f[i, 1] -= y2
        f[i, 2] -= y3


@rounded_kernel
def subtract(a: Array, b: Array) -> None:
    """b (m,) −= a."""
    for e in range(len(b)):
        b[e] -= a[e]


@rounded_kernel
def clear(b: Array) -> None:
    """b (m,) = 0."""
    for e in range(len(b)):
        b[e] = 0.0


@rounded_kernel
def scale(factor: float, b: Array) -> None:
    """b (m,) *= factor."""
    for e in range(len(b)):
        b[e] *= factor


BY_ROWS: set[Callable[..., None]] = {add, add_scaled, subtract_scaled, subtract, clear, scale}
"""Kernels whose row i depends on row i of their arrays alone, so that threads can share them."""
