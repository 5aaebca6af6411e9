"""The stress of the membranes, smoothed between triangles: at the nodes, and at a point.

The stress of the mesh jumps between triangles. Here a smooth deformation gradient F is recovered
from the positions (`fecloth.mesh.recovered_gradient`), apart on each side of a seam between two
fabrics, and the laws give the stress of it. Inside the cloth its error falls with h² on P1 and
with about h³ on P2; at the border it falls more slowly.

It is S, the second Piola–Kirchhoff stress resultant [N/m], along the axes X and Y of the flat
cloth, also where the warp has another direction. Damping adds no stress.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.mesh.norms import locate
from fecloth.mesh.recovered_gradient import RecoveredGradient, Rows, recover_gradient
from fecloth.system.system import System

COMPONENTS = ("xx", "yy", "xy")
WITHOUT = "BaraffWitkin, springs and conditions have none, nor has a cloth in several processes"
EDGES = ((0, 1), (1, 2), (0, 2))  # corners of the midpoints 3, 4 and 5 of a triangle of P2


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


def membranes_of(system: System) -> list[Any]:
    """Return the bound membranes that give the stress of a deformation gradient."""
    return [term for term in system.bound if hasattr(term, "stress_of")]


@dataclass(frozen=True, eq=False)
class RecoveredStress:
    """Places of the flat cloth, and how the recovered stress there is computed.

    Attributes
    ----------
    system
        The cloth and its terms.
    gradient
        The recovered gradients, one for each row.
    triangles
        (r,) a triangle of each row, whose fabric and grain count.
    place
        (r,) number of the place of each row.
    share
        (r,) weight of the row in the mean at its place.
    """

    system: System
    gradient: RecoveredGradient
    triangles: np.ndarray
    place: np.ndarray
    share: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return S_xx, S_yy, S_xy (places, 3) [N/m] for positions x (n, 3) [m]."""
        F = self.gradient(x)
        grain = self.system.panel.grain[self.triangles]
        c = np.cos(grain)[:, None]
        s = np.sin(grain)[:, None]
        turned = np.stack([c * F[..., 0] + s * F[..., 1], c * F[..., 1] - s * F[..., 0]], axis=-1)
        S = sum(term.stress_of(turned, self.triangles) for term in membranes_of(self.system))
        weighted = self.share[:, None] * along_axes(S, grain)
        sums = np.zeros((int(self.place.max()) + 1, 3))
        np.add.at(sums, self.place, weighted)
        return sums


def stress_at_nodes(system: System) -> RecoveredStress | None:
    """Return the recovered stress at all nodes; None without a membrane that has a stress.

    At the midpoint of an edge it is the mean of the polynomials of both ends. Where fabrics
    meet it is the mean of their stresses.
    """
    if not membranes_of(system):
        return None
    cloth = system.cloth
    group = system.panel.material
    triangle, corner, at = [], [], []
    for a in range(cloth.stencil.shape[1]):
        for end in (a,) if a < 3 else EDGES[a - 3]:
            triangle.append(np.arange(len(group)))
            corner.append(cloth.stencil[:, end])
            at.append(cloth.stencil[:, a])
    triangles, corners, places = map(np.concatenate, (triangle, corner, at))
    keys = np.stack([places, corners, group[triangles]], axis=1)
    _, first = np.unique(keys, axis=0, return_index=True)
    triangles, corners, places = triangles[first], corners[first], places[first]
    rows = Rows(corners, group[triangles], cloth.X[places])
    gradient = recover_gradient(cloth.X, cloth.stencil, group, rows)
    share = 1.0 / np.bincount(places, minlength=len(cloth.X))[places]
    return RecoveredStress(system, gradient, triangles, places, share)


def stress_at_point(system: System, point: Sequence[float]) -> RecoveredStress:
    """Return the recovered stress at a point (X, Y) [m] of the flat cloth.

    Raises `InputError` for a point outside the cloth, and for a system without a membrane that
    has a stress.
    """
    cloth = system.cloth
    place = np.asarray(point, float)
    where = f"stress at ({place[0]:g}, {place[1]:g})"
    if not membranes_of(system):
        remedy = "Add StVK or another membrane."
        raise InputError(where, f"needs a membrane with a stress: {WITHOUT}", "", remedy)
    corners = cloth.stencil[:, :3]
    try:
        cell = int(locate(cloth.X, corners, place[None])[0])
    except MeshError:
        low, high = cloth.X.min(axis=0), cloth.X.max(axis=0)
        allowed = (
            "must be a point of the flat cloth, which lies in "
            f"{low[0]:g} <= X <= {high[0]:g} m, {low[1]:g} <= Y <= {high[1]:g} m"
        )
        raise InputError(where, allowed) from None
    group = system.panel.material
    rows = Rows(corners[cell], np.full(3, group[cell]), np.tile(place, (3, 1)))
    gradient = recover_gradient(cloth.X, cloth.stencil, group, rows)
    share = np.linalg.solve(np.vstack([cloth.X[corners[cell]].T, np.ones(3)]), [*place, 1.0])
    return RecoveredStress(system, gradient, np.full(3, cell), np.zeros(3, int), share)
