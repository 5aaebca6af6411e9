"""Mass matrices of a cloth: consistent, and lumped by scaling the diagonal of that."""

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
    """(n, n) mass matrix ∫ ρ N_a N_b dA, consistent or lumped; see `Cloth.mass`."""
    if kind not in ("lumped", "consistent"):
        raise InputError(f"mass = {kind!r}", 'must be "lumped" or "consistent"', "Cloth.mass")
    if kind == "lumped":
        return sparse.diags(diagonal(cloth, density), format="csr")
    basis = cloth.basis(2 * cloth.kind.degree)
    rho = np.broadcast_to(density[:, None], basis.dx.shape)
    form = skfem.BilinearForm(lambda u, v, w: w["rho"] * u * v)
    return form.assemble(basis, rho=rho).tocsr()


def diagonal(cloth, density: np.ndarray) -> np.ndarray:
    """(n,) the scaled diagonal of the consistent mass; see `Cloth.diagonal_mass`."""
    triangle_mass = cloth.weights.sum(axis=1) * density
    nodal_parts = triangle_mass[:, None] * cloth.kind.scaled_diagonal
    return np.bincount(cloth.stencil.ravel(), nodal_parts.ravel(), len(cloth.X))
