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

# For each cloth: a digest of its last panel, with R and Q of `panel_plate` for that panel
_last: WeakKeyDictionary[EdgeSlopes, tuple[bytes, Any, Any]] = WeakKeyDictionary()


def plate_rigidity(panel: Panel, where: str) -> np.ndarray:
    """(m, 3, 3) D of each triangle [N m], in X and Y, on curvatures (κ₁₁, κ₂₂, 2κ₁₂).

    Raises `InputError`, for the term `where`, for a fabric without a bending rigidity.
    """

    def constants(fabric: Fabric) -> np.ndarray:
        if fabric.bending is None:
            remedy = "Give it in the fabric, one number or (warp, weft)."
            what = "the fabric has no bending_rigidity"
            raise InputError(what, f"{where} needs it, > 0 [N m]", where, remedy)
        return fabric.plate().ravel()

    D = panel.each(constants).reshape(-1, 3, 3)
    R = turn_curvature(panel.grain)
    return np.einsum("eki,ekl,elj->eij", R, D, R, optimize=True)


def panel_plate(panel: Panel, where: str) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Return the matrices R and Q of a panel; raise `InputError` as `plate_rigidity` does.

    R (3m, h + c) [1/m] gives the curvatures (κ₁₁, κ₂₂, 2κ₁₂) along X and Y from the angles of
    the h hinges and c clamped edges, see `angle_curvature`; Q [N m] couples the angles. On P2
    the triangles are the four parts of each. Both are kept for the last panel of a cloth.
    """
    slopes = panel.cloth.edge_slopes
    D = of_parts(panel, plate_rigidity(panel, where))
    material = of_parts(panel, panel.material)
    clamped = np.empty(0, int)
    if panel.clamps is not None:
        clamped = panel.clamps.half_edges
    # All that R and Q depend on, beside the cloth.
    key = blake2b(b"".join(array.tobytes() for array in (D, material, clamped))).digest()
    if key != _last.get(slopes, (b"",))[0]:
        R = angle_curvature(slopes, D, material, clamped)
        _last[slopes] = key, R, angle_stiffness(R, D, slopes.edges.area)
    return _last[slopes][1:]


def of_parts(panel: Panel, values: np.ndarray) -> np.ndarray:
    """Values of each triangle (m, …), on P2 of the four parts of each."""
    parts = len(panel.cloth.edge_slopes.edges.triangles) // len(panel.cloth.triangles)
    return np.repeat(values, parts, axis=0)


def panel_curvatures(panel: Panel, change: np.ndarray, where: str) -> tuple:
    """κ (m, 3) [1/m] from changes (h + c,) of the angles, and D (m, 3, 3) [N m].

    κ is (κ₁₁, κ₂₂, 2κ₁₂). Both are along X and Y, and on P2 for the four parts of each triangle.
    """
    R, _ = panel_plate(panel, where)
    return (R @ change).reshape(-1, 3), of_parts(panel, plate_rigidity(panel, where))


def angle_curvature(
    slopes: EdgeSlopes, rigidity: np.ndarray, material: np.ndarray, clamped: np.ndarray
) -> sparse.csr_matrix:
    """(3m, h + c) R with the curvature κ = R Δθ of each triangle along X and Y [1/m].

    κ = B α with the slopes α = C Δθ. A free edge has the slope for which it has no moment: the
    rows of BᵀDB for the free edges, times α, are zero. `rigidity` is D (m, 3, 3) [N m];
    `material` (m,) and `clamped` (c,) are as in `EdgeSlopes.of_plate`.
    """
    C, hinge = slopes.of_plate(rigidity, material, clamped)
    m = len(rigidity)
    B = slopes.edges.curvature_of_slopes
    K = np.einsum("eki,ekl,elj->eij", B, rigidity, B, optimize=True)
    K /= np.trace(K, axis1=1, axis2=2)[:, None, None]  # of the size of the rows of the identity
    is_free = (hinge < 0).reshape(m, 3)
    # Three equations for α of a triangle: no moment on a free edge, a known α on each other.
    matrix = np.where(is_free[:, :, None], K, np.eye(3))
    known = np.eye(3) * ~is_free[:, None, :]
    return (block_diagonal(B @ np.linalg.solve(matrix, known)) @ C).tocsr()


def angle_stiffness(R: sparse.csr_matrix, rigidity: np.ndarray, area: np.ndarray):
    """(h + c, h + c) Q = Σ A Rᵀ D R [N m] with the energy ½ θᵀ Q θ of small angles."""
    Q = R.T @ (block_diagonal(area[:, None, None] * rigidity) @ R)
    Q = (0.5 * (Q + Q.T)).tocsr()
    Q.sort_indices()
    return Q


def block_diagonal(blocks: np.ndarray) -> sparse.csr_matrix:
    """The matrix with the blocks (m, k, k) on its diagonal."""
    m, k = blocks.shape[:2]
    columns = np.arange(m)
    pointers = np.arange(m + 1)
    return sparse.bsr_matrix((blocks, columns, pointers), shape=(k * m, k * m)).tocsr()
