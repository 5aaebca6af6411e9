"""The error of a strain or curvature as the energy of its difference from the recovered one."""

from __future__ import annotations

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.mesh.recovery import CONSTANT, Samples, recovery_gap

VOIGT = ((0, 3, 4), (3, 1, 5), (4, 5, 2))


def green_strains(F: np.ndarray) -> np.ndarray:
    """(..., 3) E11, E22, E12 of deformation gradients F (..., 3, 2)."""
    C = np.einsum("...ij,...ik->...jk", F, F)
    return np.stack([(C[..., 0, 0] - 1) / 2, (C[..., 1, 1] - 1) / 2, C[..., 0, 1] / 2], axis=-1)


def membrane_error(
    panel: Panel, strain: np.ndarray, moduli: np.ndarray, samples: Samples
) -> np.ndarray:
    """(m,) ∫ ½ (E* − E):ℂ:(E* − E) dA [J] of each triangle.

    Parameters
    ----------
    strain
        (m, q, 3) E11, E22, E12 along warp and weft at the points of `samples`.
    moduli
        (m, 6) ℂ [N/m].
    """
    cloth = panel.cloth
    gap = recovery_gap(cloth.X, cloth.stencil[:, :3], panel.material, strain, samples)
    gap[..., 2] *= 2
    return energy_of_gap(gap, voigt_matrix(moduli), samples, cloth.weights.sum(axis=1))


def plate_error(panel: Panel, curvature: np.ndarray, rigidity: np.ndarray) -> np.ndarray:
    """(m,) ∫ ½ (κ* − κ):D:(κ* − κ) dA [J] of each triangle; on P2 of its four parts together.

    The arguments are those that `panel_curvatures` returns.
    """
    edges, m = panel.cloth.edge_slopes.edges, len(panel.cloth.triangles)
    copies = len(edges.triangles) // m
    group = np.repeat(panel.material, copies)
    gap = recovery_gap(edges.X, edges.triangles, group, curvature[:, None], CONSTANT)
    return energy_of_gap(gap, rigidity, CONSTANT, edges.area).reshape(m, copies).sum(axis=1)


def voigt_matrix(moduli: np.ndarray) -> np.ndarray:
    """(m, 3, 3) the moduli (m, 6), in the order of `membrane`, as matrices on (E11, E22, 2E12)."""
    matrix: np.ndarray = moduli[:, VOIGT]
    return matrix


def energy_of_gap(
    gap: np.ndarray, stiffness: np.ndarray, samples: Samples, area: np.ndarray
) -> np.ndarray:
    """(m,) ∫ ½ gap · stiffness gap dA [J] of gaps (m, r, 3) at the rule's points."""
    density = np.einsum("tri,tij,trj,r->t", gap, stiffness, gap, samples.weights, optimize=True)
    energy: np.ndarray = 0.5 * area * density
    return energy
