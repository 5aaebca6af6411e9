"""Errors of strains and curvatures: the energy of their distance from recovered ones."""

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.mesh.recovery import CONSTANT, Samples, recovery_gap

VOIGT = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # ℂ as a matrix on (E11, E22, 2 E12)


def membrane_error(
    panel: Panel, strain: np.ndarray, moduli: np.ndarray, samples: Samples
) -> np.ndarray:
    """(m,) ∫ ½ (E* − E):ℂ:(E* − E) dA [J] of each triangle, with the recovered strain E*.

    Parameters
    ----------
    strain
        E11, E22, E12 (m, q, 3) along warp and weft, at the points of `samples`.
    moduli
        ℂ (m, 6) [N/m].
    samples
        The points of the quadrature, with their weights.
    """
    cloth = panel.cloth
    gap = recovery_gap(cloth.X, cloth.stencil[:, :3], panel.material, strain, samples)
    gap[..., 2] *= 2
    return energy_of_gap(gap, voigt_matrix(moduli), samples, cloth.weights.sum(axis=1))


def plate_error(panel: Panel, curvature: np.ndarray, rigidity: np.ndarray) -> np.ndarray:
    """(m,) ∫ ½ (κ* − κ):D:(κ* − κ) dA [J], with the recovered curvature κ*.

    κ and D are as `panel_curvatures` gives them.
    """
    edges = panel.cloth.edge_slopes.edges
    m = len(panel.cloth.triangles)
    copies = len(edges.triangles) // m
    group = np.repeat(panel.material, copies)
    gap = recovery_gap(edges.X, edges.triangles, group, curvature[:, None], CONSTANT)
    return energy_of_gap(gap, rigidity, CONSTANT, edges.area).reshape(m, copies).sum(axis=1)


def voigt_matrix(moduli: np.ndarray) -> np.ndarray:
    """(m, 3, 3) the moduli (m, 6), in the order of `membrane`, on E11, E22 and 2 E12."""
    return moduli[:, VOIGT]


def energy_of_gap(
    gap: np.ndarray, stiffness: np.ndarray, samples: Samples, area: np.ndarray
) -> np.ndarray:
    """(m,) ∫ ½ gap · stiffness gap dA [J] of each triangle.

    The gaps (m, r, 3) are at the points of `samples`, the stiffness is (m, 3, 3).
    """
    density = np.einsum("tri,tij,trj,r->t", gap, stiffness, gap, samples.weights, optimize=True)
    return 0.5 * area * density
