"""The stiffness Q of a plate between the angles of its hinges."""

from hashlib import blake2b
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.mesh.edge_slopes import EdgeSlopes, turn_curvature

_last: WeakKeyDictionary[EdgeSlopes, Any] = WeakKeyDictionary()  # Q of the last panel of a cloth


def plate_rigidity(panel: Panel, where: str) -> np.ndarray:
    """(m, 3, 3) D of each triangle [N m], in X and Y, for the term `where`."""

    def constants(fabric: Fabric) -> np.ndarray:
        if fabric.bending is None:
            remedy = "Give it in the fabric, one number or (warp, weft)."
            what = "the fabric has no bending_rigidity"
            raise InputError(what, f"{where} needs it, > 0 [N m]", where, remedy)
        return fabric.plate().ravel()

    D = panel.each(constants).reshape(-1, 3, 3)
    R = turn_curvature(panel.grain)
    return np.einsum("eki,ekl,elj->eij", R, D, R, optimize=True)


def panel_stiffness(panel: Panel, where: str) -> sparse.csr_matrix:
    """Q of a panel, on P2 of the four parts of each triangle, for the term `where`."""
    slopes = panel.cloth.edge_slopes
    copies = len(slopes.edges.triangles) // len(panel.cloth.triangles)
    D = np.repeat(plate_rigidity(panel, where), copies, axis=0)
    given = D, np.repeat(panel.material, copies), clamped_edges(panel)
    key = blake2b(b"".join(array.tobytes() for array in given)).digest()
    if _last.get(slopes, (b"",))[0] != key:
        _last[slopes] = key, angle_stiffness(slopes, *given)
    return _last[slopes][1]


def clamped_edges(panel: Panel) -> np.ndarray:
    """(c,) half-edges whose slope pins hold."""
    return np.empty(0, int) if panel.clamps is None else panel.clamps.half_edges


def panel_curvatures(panel: Panel, change: np.ndarray, where: str) -> tuple:
    """κ (m, 3) [1/m] as (κ₁₁, κ₂₂, 2κ₁₂) from changes (h + c,) of the angles, and D (m, 3, 3)."""
    # Both in X and Y, on P2 of the four parts of each triangle. The slope of a free edge is that
    # without a moment.
    slopes = panel.cloth.edge_slopes
    edges, m = slopes.edges, len(slopes.edges.triangles)
    copies = m // len(panel.cloth.triangles)
    D = np.repeat(plate_rigidity(panel, where), copies, axis=0)
    material = np.repeat(panel.material, copies)
    C, hinge = slopes.of_plate(D, material, clamped_edges(panel))
    B, alpha = edges.curvature_of_slopes, (C @ change).reshape(m, 3)
    K = np.einsum("eki,ekl,elj->eij", B, D, B, optimize=True)
    K /= np.trace(K, axis1=1, axis2=2)[:, None, None]
    free = (hinge < 0).reshape(m, 3)
    matrix = np.where(free[:, :, None], K, np.eye(3))
    alpha = np.linalg.solve(matrix, np.where(free, 0.0, alpha)[:, :, None])
    return (B @ alpha)[:, :, 0], D


def angle_stiffness(
    slopes: EdgeSlopes, rigidity: np.ndarray, material: np.ndarray, clamped: np.ndarray
) -> sparse.csr_matrix:
    """(h + c, h + c) Q = Cᵀ K C [N m] with the energy ½ θᵀ Q θ of small angles."""
    # K has a block A Bᵀ D B for each triangle, from which the slopes of free edges are eliminated.
    # The arguments are as in `EdgeSlopes.of_plate`.
    edges = slopes.edges
    C, hinge = slopes.of_plate(rigidity, material, clamped)
    m, B = len(edges.triangles), edges.curvature_of_slopes
    K = np.einsum("eki,ekl,elj,e->eij", B, rigidity, B, edges.area, optimize=True)
    for i, free in enumerate((hinge < 0).reshape(m, 3).T):
        e = np.flatnonzero(free)
        column = K[e, :, i]
        K[e] -= column[:, :, None] * column[:, None, :] / column[:, i, None, None]
        K[e, :, i] = K[e, i, :] = 0.0
    blocks = sparse.bsr_matrix((K, np.arange(m), np.arange(m + 1)), shape=(3 * m, 3 * m))
    Q = C.T @ (blocks.tocsr() @ C)
    Q = (0.5 * (Q + Q.T)).tocsr()
    Q.sort_indices()
    return Q
