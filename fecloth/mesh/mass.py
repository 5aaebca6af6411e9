"""Mass matrices of a cloth: consistent, lumped, and the scaled diagonal."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
import skfem

from fecloth.errors import InputError


def weighted_load(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) ∫ ρ N_a dA for one ρ per triangle (m,)."""
    basis = cloth.basis(2)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    return skfem.LinearForm(lambda v, w: w["rho"] * v).assemble(basis, rho=rho)


def matrix(cloth, kind: str, density: np.ndarray) -> sparse.csr_matrix:
    """(n, n) mass matrix ∫ ρ N_a N_b dA, consistent or lumped by row sums; see `Cloth.mass`."""
    if kind not in ("lumped", "consistent"):
        raise InputError(f"mass = {kind!r}", 'must be "lumped" or "consistent"', "Cloth.mass")
    if kind == "lumped" and cloth.element == "P2":
        raise InputError(
            'mass = "lumped"',
            'must be "consistent" for element P2: the row sums of its corners are zero',
            "Cloth.mass",
            'Use mass = "consistent" with an implicit method, or element = "P1".',
        )
    if kind == "lumped":
        return sparse.diags(weighted_load(cloth, density), format="csr")
    basis = cloth.basis(2 * cloth.kind.degree)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    form = skfem.BilinearForm(lambda u, v, w: w["rho"] * u * v)
    return form.assemble(basis, rho=rho).tocsr()


def diagonal(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) the scaled diagonal of the consistent mass; see `Cloth.diagonal_mass`."""
    triangle_mass = cloth.weights.sum(axis=1) * density
    nodal_parts = triangle_mass[:, None] * cloth.kind.scaled_diagonal
    return np.bincount(cloth.stencil.ravel(), nodal_parts.ravel(), len(cloth.X))
