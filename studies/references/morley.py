"""Thin plates by Morley's element of scikit-fem: no code in common with `PlateBending`.

Morley (1968), The triangular equilibrium element in the solution of plate bending problems. The
unknowns are the deflections of the nodes and one slope for each edge.
"""

from __future__ import annotations

import numpy as np
import skfem
from skfem.helpers import dd


def deflection(
    X: np.ndarray, triangles: np.ndarray, D: np.ndarray, held: np.ndarray, clamp: bool
) -> np.ndarray:
    """Return w (n,) [m] of the nodes X (n, 2) under the load 1 N/m².

    Parameters
    ----------
    triangles
        (m, 3) corners.
    D
        (m, 3, 3) bending stiffness on (κ₁₁, κ₂₂, 2κ₁₂) [N m].
    held
        (n,) whether a node has no deflection.
    clamp
        Whether the slope is zero on the edges of the boundary.
    """
    order = np.argsort(triangles, axis=1)
    mesh = skfem.MeshTri(X.T.copy(), np.take_along_axis(triangles, order, axis=1).T.copy())
    basis = skfem.Basis(mesh, skfem.ElementTriMorley(), intorder=2)

    @skfem.BilinearForm
    def energy(u, v, w):
        kappa, other = ((dd(f)[0, 0], dd(f)[1, 1], 2 * dd(f)[0, 1]) for f in (u, v))
        return sum(w["D"][i, j] * kappa[i] * other[j] for i in range(3) for j in range(3))

    stiffness = np.moveaxis(D, 0, -1)[..., None]
    K = energy.assemble(basis, D=np.broadcast_to(stiffness, (3, 3, len(D), basis.X.shape[1])))
    load = skfem.LinearForm(lambda v, _: v).assemble(basis)
    fixed = basis.nodal_dofs[0, held]
    if clamp:
        fixed = np.concatenate([fixed, basis.facet_dofs[0, mesh.boundary_facets()]])
    w = skfem.solve(*skfem.condense(K, load, D=fixed))
    return w[basis.nodal_dofs[0]]
