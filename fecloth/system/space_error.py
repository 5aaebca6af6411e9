"""The error in space of a state, from the jumps of stress and moment between its triangles.

Where a cloth folds at the size of its triangles there is no estimate.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.cloth import Cloth
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.kinematics import deformation_gradient, green_strains
from fecloth.terms.traits import has_kind, traits_of

LARGEST_ERROR = 0.5  # that the estimate can tell
NO_STRAIN_BELOW = 1e-12  # such a strain of a cloth is round-off
NO_STRAIN = "no term stores energy of strain"
AT_REST = "the cloth is not strained"
FOLDS = "the cloth folds at the size of its triangles, which decide its shape"
FINER = "take a smaller h"
WITHOUT_BENDING = "add PlateBending: where no term resists bending, folds are as fine as any mesh"
COARSE = f"it is above {100 * LARGEST_ERROR:.0f} % of stress and moment"


@dataclass(frozen=True, eq=False)
class SpaceError:
    """An estimate of the error in space of a state; see `space_error`.

    Attributes
    ----------
    relative
        Root of the energy of the error over the energy of the strain; NaN without an
        estimate.
    density
        (m,) energy of the error per reference area of each triangle [J/m²]; NaN where a
        term has none.
    reason
        Why there is no estimate, or "".
    remedy
        What gives one, or "".
    """

    relative: float
    density: np.ndarray
    reason: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        return name_space_error(self.relative, self.reason, self.remedy)

    def __repr__(self) -> str:
        return f"<SpaceError: {self}>"


def name_space_error(relative: float, reason: str = "", remedy: str = "") -> str:
    """An error in space in words, or why there is no estimate, and what to do."""
    words = f"error in space about {100 * relative:.2g} % of stress and moment"
    if math.isnan(relative):
        words = f"error in space: no estimate, as {reason}"
    return f"{words}; {remedy}" if remedy else words


def space_error(system: System, state: State) -> SpaceError:
    """Return an estimate of the error in space: how far stress and moment are from smooth ones.

    The exact strain E and curvature κ are nearly smooth; the mesh's E and κ jump between
    triangles. Smooth ones E*, κ* are recovered from them (`fecloth.mesh.recovery`), apart on
    each side of a seam between two fabrics. In the norm of the energy

        ‖e‖² = ∫ ½ (E* − E):ℂ:(E* − E) + ½ (κ* − κ):D:(κ* − κ) dA

    estimates the error, with the same formula for the exact E and κ; ℂ are the moduli at the
    state. The relative error is ‖e‖ over the root of the energy of the membranes and plates.
    It falls with h on P1 and for plates, with h² for P2 membranes; errors of positions with
    its square.

    Of the exact error it is between 0.6 and 1.2 (`studies/convergence/space_error.md`).

    There is no estimate (NaN, with the reason) where a term with an energy states no stress or
    moment (springs, `BaraffWitkin`, a `Condition`), where its limit depends on the mesh
    (`HingeBending`, `QuadraticBending`), for `TensionField`, whose strain across wrinkles is
    open, for a cloth without strain, where it folds at the size of its triangles
    (`fecloth.system.space_error`), and above 50 %.

    It does not see what is smooth and wrong: a wrong equilibrium, errors that grew during a
    motion, the polygon of a curved border, or, where stress and moment are nearly constant,
    errors below a few per cent. In a motion it is the error of the present stress.

    Source: Zienkiewicz and Zhu (1987), A simple error estimator and adaptive procedure for
    practical engineering analysis, for stress; here for stress and moment together.

    Raises `InputError` for a state of another cloth.

    Parameters
    ----------
    system, state
        The state must be one of the system's cloth.
    """
    check_system(system, state, "space_error", starts=False)
    m = len(system.cloth.triangles)
    if reason := _refusal(system):
        return SpaceError(math.nan, np.full(m, math.nan), reason)
    strained = [term for term in system.bound if term.recovers_strain]
    error = sum((term.strain_error(state.x, state.t) for term in strained), np.zeros(m))
    stored = system.sums.total(sum(term.energy(state.x, state.t) for term in strained))
    density = error / system.cloth.weights.sum(axis=1)  # over the areas of the triangles
    if not strained:
        return SpaceError(math.nan, density, NO_STRAIN)
    stiffness = max(max(fabric.tensile) for fabric in system.panel.fabrics)
    energy_of_round_off = stiffness * system.sums.total(system.cloth.area) * NO_STRAIN_BELOW**2
    if stored <= energy_of_round_off:
        return SpaceError(math.nan, np.zeros(m), AT_REST)
    relative = math.sqrt(system.sums.total(float(error.sum())) / stored)
    if folds_at_mesh_size(system.cloth, state.x):
        remedy = FINER if has_kind(system.terms, "bending") else WITHOUT_BENDING
        return SpaceError(math.nan, density, FOLDS, remedy)
    if not relative < LARGEST_ERROR:
        return SpaceError(math.nan, density, COARSE, FINER)
    return SpaceError(relative, density)


def _refusal(system: System) -> str:
    """Why the terms of a system have no estimate, or ""."""
    for term, bound, name in zip(system.terms, system.bound, system.names, strict=True):
        if why := traits_of(term).space_error:
            return f"{name} {why}"
        has_strain = bound.has_energy and bound.stores_strain and not bound.load
        if has_strain and not bound.recovers_strain:
            return f"{name} states no stress or moment"
    return ""


# Folds are as fine as the triangles if no curvature explains this share of the angles between
# them; of random angles it explains less: the share is 0.87.
ROUGH_SHARE = 0.7
# Strain that the folds take up, over the rms strain of the triangles: less does not matter.
HIDDEN_STRAIN = 0.01
FEWEST_HINGES = 8  # around a node, for the three components of its curvature


def folds_at_mesh_size(cloth: Cloth, x: np.ndarray) -> bool:
    """Whether the folds of a cloth at x (n, 3) are as fine as its triangles, and matter.

    Folds are as fine as the triangles if no smooth curvature explains the angles θ of the hinges
    (`roughness`). They matter if the strain that they take up, θ²/8, is more than a hundredth of
    the strain of the triangles.
    """
    angles = hinge_angles(cloth, x)
    strain = np.sqrt(np.mean(green_strains(deformation_gradient(cloth, x)) ** 2) * 3)
    hidden = np.mean(angles**2) / 8 if len(angles) else 0.0
    return bool(hidden > HIDDEN_STRAIN * strain) and roughness(cloth, angles) > ROUGH_SHARE


def roughness(cloth: Cloth, angles: np.ndarray) -> float:
    """Return the share of the hinge angles (h,) that no constant curvature explains.

    Around each node another curvature may explain them: there κ minimises Σ (θ − Λ κ)² over the
    hinges of its triangles, with the angles Λ κ of a flat sheet that is bent to κ. The share is
    the root of these sums over the root of Σ θ², both over all nodes: 0 for a constant
    curvature, of the order of h where it is smooth, near 1 for folds as fine as the triangles.
    It is 0 if all angles are 0.
    """
    edges = cloth.edge_slopes.edges
    hinges = edges.hinges
    n = len(edges.X)
    angle = angles_of_curvature(edges.X, hinges)
    h = len(angles)
    # around[i, e] is 1 if node i is one of the four nodes of hinge e
    place = hinges.nodes.ravel(), np.repeat(np.arange(h), 4)
    around = sparse.csr_matrix((np.ones(4 * h), place), shape=(n, h))
    around = around[np.diff(around.indptr) >= FEWEST_HINGES]
    # the normal equations (Σ ΛᵀΛ) κ = Σ Λᵀθ of each node, which a small part of the diagonal
    # keeps solvable
    gram = (around @ (angle[:, :, None] * angle[:, None, :]).reshape(h, 9)).reshape(-1, 3, 3)
    gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    right = around @ (angle * angles[:, None])
    total = float((around @ angles**2).sum())
    explained = np.einsum("ni,ni->", right, np.linalg.solve(gram, right[:, :, None])[:, :, 0])
    if total:
        return float(np.sqrt(max(total - explained, 0.0) / total))
    return 0.0


def angles_of_curvature(X: np.ndarray, hinges) -> np.ndarray:
    """(h, 3) Λ with θ = Λ κ for the deflection ½ (κ₁₁ x² + κ₂₂ y² + 2κ₁₂ xy), 2κ₁₂ the third."""
    x, y = np.moveaxis(X[hinges.nodes] - X[hinges.nodes[:, :1]], -1, 0)
    shapes = np.stack([x * x, y * y, x * y], axis=-1)
    Lambda: np.ndarray = 0.5 * np.einsum("ha,hac->hc", hinges.flat_gradient, shapes)
    return Lambda
