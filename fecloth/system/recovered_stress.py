"""The stress of the membranes, smoothed between triangles: at the nodes, and at a point.

The stress of the mesh jumps between triangles. Here a smooth Green strain is recovered
(`fecloth.mesh.recovered_strain`), apart on each side of a seam between two fabrics, and the laws
give the stress of it.
Inside the cloth its error falls with h² on P1 (orders of 1.7 to 2.3 on four patterns of a
rectangle) and with h³ on P2 or faster; at a straight border with h^1.6 to h^1.8 and h^2.7.

It is S, the second Piola–Kirchhoff stress resultant [N/m], along the axes X and Y of the flat
cloth, also where the warp has another direction. Damping adds no stress.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.fabric.panel import Panel
from fecloth.mesh.norms import containing
from fecloth.mesh.recovered_strain import Places, place_in_triangle, places_at_nodes
from fecloth.system.system import System
from fecloth.terms.kinematics import green_strains

COMPONENTS = ("xx", "yy", "xy")
LEAST_STRETCH = 0.1
_nodal_places: WeakKeyDictionary[Panel, Places] = WeakKeyDictionary()


def along_axes(S: np.ndarray, grain: np.ndarray) -> np.ndarray:
    """Return S_xx, S_yy, S_xy (r, 3) from S11, S22, S12 (r, 3) along warp and weft.

    `grain` (r,) are the angles from X to the warp [rad]: S_xy = R S Rᵀ with its rotation R.
    """
    c = np.cos(grain)
    s = np.sin(grain)
    S11, S22, S12 = S.T
    xx = c * c * S11 + s * s * S22 - 2 * c * s * S12
    yy = s * s * S11 + c * c * S22 + 2 * c * s * S12
    xy = c * s * (S11 - S22) + (c * c - s * s) * S12
    return np.stack([xx, yy, xy], axis=-1)


@dataclass(frozen=True, eq=False)
class RecoveredStress:
    """The recovered stress of a system at some places; call it with positions.

    Attributes
    ----------
    system
        The cloth and its terms.
    places
        Where the stress is computed.
    """

    system: System
    places: Places

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return S_xx, S_yy, S_xy (places, 3) [N/m] for positions x (n, 3) [m]."""
        triangles = self.places.triangles
        grain = self.system.panel.grain[triangles]
        F = _gradient_of(along_axes(self.strain(x), -grain))
        membranes = [term for term in self.system.bound if term.has_stress]
        S = sum(term.stress_of(F, triangles) for term in membranes)
        stress: np.ndarray = self.places.mean @ along_axes(S, grain)
        return stress

    def strain(self, x: np.ndarray) -> np.ndarray:
        """E_XX, E_YY, E_XY (r, 3) of the rows of the places."""
        matrices = self.places.matrices
        first, last = self.places.edges.T
        if not len(first):  # P2
            return green_strains(np.stack([matrix @ x for matrix in matrices], axis=-1))
        X = self.system.cloth.X
        squares = [((y[last] - y[first]) ** 2).sum(axis=1) for y in (x, X)]
        strains = (squares[0] / squares[1] - 1) / 2
        return np.stack([matrix @ strains for matrix in matrices], axis=-1)


def _gradient_of(E: np.ndarray) -> np.ndarray:
    """Return a deformation gradient (r, 3, 2) of strains E11, E22, E12 (r, 3).

    It is the upper triangle U with UᵀU = I + 2E (Cholesky); its turn in space has no stress.
    Polynomials overshoot where a cloth is rough: no stretch is less than `LEAST_STRETCH`.
    """
    F = np.zeros((len(E), 3, 2))
    F[:, 0, 0] = np.sqrt(np.maximum(1 + 2 * E[:, 0], LEAST_STRETCH**2))
    F[:, 0, 1] = 2 * E[:, 2] / F[:, 0, 0]
    F[:, 1, 1] = np.sqrt(np.maximum(1 + 2 * E[:, 1] - F[:, 0, 1] ** 2, LEAST_STRETCH**2))
    return F


def without_stress(system: System) -> str:
    """Why a system has no recovered stress, or ""."""
    membranes = [(name, term.gives_stress) for name, term in system.named if term.has_stress]
    if not membranes:
        return f"needs a membrane: no term of {', '.join(system.names) or '(none)'} has a stress"
    if not system.is_whole:
        return "is not offered by several processes"
    if silent := [name for name, gives_stress in membranes if not gives_stress]:
        return f"{' and '.join(silent)} does not tell the stress of a deformation gradient"
    return ""


def stress_at_nodes(system: System) -> RecoveredStress | None:
    """Return the recovered stress at all nodes; None for a system without one.

    Where fabrics meet it is the mean of their stresses.
    """
    if without_stress(system):
        return None
    return RecoveredStress(system, nodal_places(system.panel))


def nodal_places(panel: Panel) -> Places:
    """Return the nodes of a panel as places; they are made once, for all frames of a run."""
    if panel not in _nodal_places:
        cloth = panel.cloth
        _nodal_places[panel] = places_at_nodes(cloth.X, cloth.stencil, panel.material)
    return _nodal_places[panel]


def stress_at_point(
    system: System, point: Sequence[float], region: str | None = None
) -> RecoveredStress:
    """Return the recovered stress at a point (X, Y) [m] of the flat cloth.

    `region` is the name of a region of triangles, where pieces overlap or fabrics meet. Raises
    `InputError` for a point outside the cloth or the region, for a point on two pieces or two
    fabrics without a region, and for a system without a recovered stress.
    """
    cloth = system.cloth
    place = np.asarray(point, float)
    where = f"stress at ({place[0]:g}, {place[1]:g})"
    if why := without_stress(system):
        raise InputError(where, why, "", "Add StVK or another membrane.")
    corners = cloth.triangles
    chosen = np.arange(len(corners)) if region is None else cloth.region(region)
    try:
        cells = chosen[containing(cloth.X, corners[chosen], place)]
    except MeshError:
        X = cloth.X[corners[chosen].ravel()]
        low, high = X.min(axis=0), X.max(axis=0)
        allowed = (
            f"must be a point of {region or 'the flat cloth'}, which lies in "
            f"{low[0]:g} <= X <= {high[0]:g} m, {low[1]:g} <= Y <= {high[1]:g} m"
        )
        raise InputError(where, allowed) from None
    group = system.panel.material
    of_one_piece = set[int].intersection(*(set(nodes) for nodes in corners[cells].tolist()))
    if not of_one_piece or len(np.unique(group[cells])) > 1:
        allowed = "needs a region: two pieces overlap there, or two fabrics meet"
        names = [name for name, own in cloth.triangle_sets.items() if np.isin(own, cells).any()]
        remedy = f"Write stress.xx of REGION at (X, Y), with one of {', '.join(sorted(names))}."
        raise InputError(where, allowed, "", remedy)
    cell = int(cells[0])
    return RecoveredStress(system, place_in_triangle(cloth.X, cloth.stencil, group, cell, place))
