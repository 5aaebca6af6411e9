"""The stress of the membranes, smoothed between triangles: at the nodes, and at a point.

The stress of the mesh jumps between triangles. A smooth one is recovered from it by polynomials
fitted around each node (`fecloth.mesh.recovery`), apart on each side of a seam between two
fabrics. Inside the cloth its error falls with h² on P1 and with h³ on P2; at the border it
falls more slowly.

It is S, the second Piola–Kirchhoff stress resultant [N/m], along the axes X and Y of the flat
cloth, also where the warp has another direction. Damping adds no stress.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.mesh.elements import blocks
from fecloth.mesh.norms import locate
from fecloth.mesh.recovery import (
    AT_MIDDLES,
    CONSTANT,
    RecoveryAtPoint,
    Samples,
    recover_at_nodes,
    to_middles,
)
from fecloth.system.system import System

COMPONENTS = ("xx", "yy", "xy")
WITHOUT = "BaraffWitkin, springs and conditions have none, nor has a cloth in several processes"


def along_axes(S: np.ndarray, grain: np.ndarray) -> np.ndarray:
    """Return S_xx, S_yy, S_xy (m, q, 3) from S11, S22, S12 (m, q, 3) along warp and weft.

    `grain` (m,) are the angles from X to the warp [rad]: S_xy = R S Rᵀ with its rotation R.
    """
    c = np.cos(grain)[:, None]
    s = np.sin(grain)[:, None]
    S11, S22, S12 = np.moveaxis(S, -1, 0)
    xx = c * c * S11 + s * s * S22 - 2 * c * s * S12
    yy = s * s * S11 + c * c * S22 + 2 * c * s * S12
    xy = c * s * (S11 - S22) + (c * c - s * s) * S12
    return np.stack([xx, yy, xy], axis=-1)


def stress_at_nodes(system: System, x: np.ndarray) -> np.ndarray | None:
    """Return S_xx, S_yy, S_xy (n, 3) [N/m] at the nodes for positions x (n, 3) [m].

    Where fabrics meet it is the mean of both sides. None for a system without a membrane whose
    stress can be sampled.
    """
    cloth = system.cloth
    membranes = membranes_of(system)
    if not membranes:
        return None
    smooth = np.zeros((len(cloth.X), 3))
    for membrane in membranes:
        parts = [_sampled(system, membrane, x, part) for part in _parts(system)]
        smooth += recover_at_nodes(
            cloth.X,
            cloth.stencil[:, :3],
            system.panel.material,
            np.concatenate(parts),
            _samples(system),
            cloth.stencil,
        )
    return smooth


def membranes_of(system: System) -> list[Any]:
    """Return the bound membranes whose stress can be sampled at points."""
    return [term for term in system.bound if hasattr(term, "sampled_stress")]


def _parts(system: System) -> list[np.ndarray]:
    """Return the numbers of all triangles in parts, whose arrays take less memory."""
    m = len(system.cloth.triangles)
    return [np.arange(m)[part] for part in blocks(m, 1 << 14)]


def _sampled(system: System, membrane: Any, x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the stress (k, q, 3) of a membrane in triangles (k,) along X and Y [N/m].

    The points are those of `_samples`.
    """
    S = membrane.sampled_stress(x, triangles)
    if system.cloth.element == "P2":
        S = np.einsum("qp,kpc->kqc", to_middles(membrane.strain.points), S)
    return along_axes(S, system.panel.grain[triangles])


def _samples(system: System) -> Samples:
    """Return the points of a triangle from which the stress is recovered."""
    return AT_MIDDLES if system.cloth.element == "P2" else CONSTANT


@dataclass(frozen=True, eq=False)
class StressAtPoint:
    """The recovered stress at a point of the flat cloth.

    Attributes
    ----------
    system
        The cloth and its terms.
    recoveries
        For each membrane its weights around the point.
    """

    system: System
    recoveries: tuple[tuple[Any, RecoveryAtPoint], ...]

    @classmethod
    def of(cls, system: System, point: Sequence[float]) -> "StressAtPoint":
        """Return the stress at a point (X, Y) [m].

        Raises `InputError` for a point outside the cloth, and for a system without a membrane
        whose stress can be sampled.
        """
        cloth = system.cloth
        place = np.asarray(point, float)
        where = f"stress at ({place[0]:g}, {place[1]:g})"
        membranes = membranes_of(system)
        if not membranes:
            remedy = "Add StVK or another membrane."
            raise InputError(where, f"needs a membrane with a stress: {WITHOUT}", "", remedy)
        try:
            cell = int(locate(cloth.X, cloth.triangles, place[None])[0])
        except MeshError:
            low, high = cloth.X.min(axis=0), cloth.X.max(axis=0)
            allowed = (
                "must be a point of the flat cloth, which lies in "
                f"{low[0]:g} <= X <= {high[0]:g} m, {low[1]:g} <= Y <= {high[1]:g} m"
            )
            raise InputError(where, allowed) from None
        recoveries = []
        corners = cloth.stencil[:, :3]  # in the order of the points of the samples
        for membrane in membranes:
            samples = _samples(system)
            recovery = RecoveryAtPoint.of(
                cloth.X, corners, system.panel.material, samples, place, cell
            )
            recoveries.append((membrane, recovery))
        return cls(system, tuple(recoveries))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return S_xx, S_yy, S_xy (3,) [N/m] for positions x (n, 3) [m]."""
        parts = [
            recovery(_sampled(self.system, membrane, x, recovery.triangles))
            for membrane, recovery in self.recoveries
        ]
        total: np.ndarray = np.sum(parts, axis=0)
        return total
