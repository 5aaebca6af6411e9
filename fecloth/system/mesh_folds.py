"""Whether a cloth folds at the size of its triangles."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.cloth import Cloth
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.kinematics import deformation_gradient
from fecloth.terms.recovered_error import green_strains

ROUGH = 0.7  # share of the angles that no curvature explains; random angles have 0.87
HIDDEN = 0.01  # strain that the folds take up, over the rms strain; below it they do not matter
ENOUGH = 8  # fewest hinges around a node, for three components of curvature


def folds_at_mesh_size(cloth: Cloth, x: np.ndarray) -> bool:
    """Whether the folds of a cloth at positions x (n, 3) are as fine as its triangles, and matter.

    Folds are as fine as the triangles if no smooth curvature explains the angles θ of the hinges
    (`roughness`). They matter if the strain that they take up, θ²/8, is more than a hundredth of
    the strain of the triangles.
    """
    angles = hinge_angles(cloth, x)
    E = green_strains(deformation_gradient(cloth, x))
    strain = np.sqrt(np.mean(E**2) * 3)
    hidden = np.mean(angles**2) / 8 if len(angles) else 0.0
    return bool(hidden > HIDDEN * strain) and roughness(cloth, angles) > ROUGH


def roughness(cloth: Cloth, angles: np.ndarray) -> float:
    """Share of the hinge angles (h,) that a constant curvature around each node does not explain.

    At a node, κ minimises Σ (θ − Λ κ)² over the hinges of its triangles, with the angles Λ κ of a
    flat sheet that is bent to κ. The share is the root of these sums over that of Σ θ², both over
    all nodes: 0 for a constant curvature, of the order of h where it is smooth, near 1 for folds as
    fine as the triangles.
    """
    edges = cloth.edge_slopes.edges
    hinges, n = edges.hinges, len(edges.X)
    angle = angles_of_curvature(edges.X, hinges)
    h = len(angles)
    place = hinges.nodes.ravel(), np.repeat(np.arange(h), 4)
    around = sparse.csr_matrix((np.ones(4 * h), place), shape=(n, h))
    around = around[np.diff(around.indptr) >= ENOUGH]
    products = angle[:, :, None] * angle[:, None, :]
    gram = (around @ products.reshape(h, 9)).reshape(-1, 3, 3)
    gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    right, total = around @ (angle * angles[:, None]), float((around @ angles**2).sum())
    explained = np.einsum("ni,ni->", right, np.linalg.solve(gram, right[:, :, None])[:, :, 0])
    return float(np.sqrt(max(total - explained, 0.0) / total)) if total else 0.0


def angles_of_curvature(X: np.ndarray, hinges) -> np.ndarray:
    """(h, 3) Λ with θ = Λ κ for the deflection ½ (κ₁₁ x² + κ₂₂ y² + 2κ₁₂ xy), 2κ₁₂ the third."""
    x, y = np.moveaxis(X[hinges.nodes] - X[hinges.nodes[:, :1]], -1, 0)
    shapes = np.stack([x * x, y * y, x * y], axis=-1)
    Lambda: np.ndarray = 0.5 * np.einsum("ha,hac->hc", hinges.flat_gradient, shapes)
    return Lambda
