"""Rigid obstacles whose surface is a mesh of triangles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.read import read_surface
from fecloth.quantities.rotation import Rotation
from fecloth.quantities.time_function import VectorOfTime
from fecloth.quantities.units import LENGTH, PRESSURE
from fecloth.terms.contact import barrier
from fecloth.terms.contact.friction import CREEP
from fecloth.terms.contact.shape import Shape
from fecloth.terms.contact.surfaces import Triangles
from fecloth.terms.contact.toolkit import ContactSets
from fecloth.terms.contact.triangle_contact import BoundTriangleContact
from fecloth.terms.traits import CONTACT


class RigidMesh(Shape):
    """The motion of a mesh; its distance is the toolkit's."""


@dataclass(frozen=True)
class MeshObstacle:
    """The cloth and the triangles of a rigid mesh push each other apart, as `SelfContact` does.

    The potential is Σ κ gap A b(d²) over pairs of a node and a triangle and over pairs of edges,
    one of the cloth and one of the mesh, with

        b(d²) = −(s² − 1)² ln s², s = d/gap < 1; 0 from s = 1 on; +∞ for s = 0

    The mesh may be open or closed, coarse or fine; it has two sides, so that the cloth must start
    on the right one. It stands as its file says at t = 0, and may move and turn from there. A
    plane, a sphere and the other shapes of `fecloth.shapes` are much cheaper as an `Obstacle`, and
    exact.

    Source: Li et al. (2020), Incremental Potential Contact: Intersection- and Inversion-free,
    Large-Deformation Dynamics, ACM Trans. Graph. 39(4), computed by the IPC Toolkit, the package
    ``ipctk``.

    Valid for any speed and any deformation, with `BackwardEuler`, `BDF2` and, without friction,
    `equilibrium`.

    Cost: that of `SelfContact`; a large mesh of few triangles costs more than many small ones.

    Parameters
    ----------
    path
        A file with triangles that meshio reads, such as .stl, .obj, .ply or .vtu. Equal nodes are
        united.
    gap
        Distance at which the barrier begins [m].
    friction
        Coefficient μ of Coulomb's friction.
    stiffness
        κ [Pa], or "auto": as for `Obstacle`.
    scale
        What the coordinates are multiplied with: 0.001 for a file in millimetres.
    motion
        Displacement [m]: three formulas of t [s], or a function ``motion(t) -> (3,)``. Only its
        changes count.
    rotate
        `Rotation` about an axis that moves along; only the changes of its angle count.

    Examples
    --------
    >>> import fecloth as fc
    >>> table = fc.MeshObstacle("table.stl", gap="2 mm", scale=1e-3)
    """

    path: str | Path
    gap: Annotated[float, LENGTH] = 1e-3
    friction: float = 0.0
    stiffness: Annotated[barrier.Stiffness, PRESSURE] = "auto"
    scale: float = 1.0
    motion: Annotated[VectorOfTime | None, LENGTH] = None
    rotate: Rotation | None = None

    traits = CONTACT

    def __post_init__(self):
        _ = self._body  # its mistakes are refused where the obstacle is written
        if not (is_number(self.scale) and self.scale > 0):
            raise InputError(f"scale = {self.scale!r}", "must be finite and > 0", "MeshObstacle")
        barrier.check_numbers("MeshObstacle", self.gap, self.friction, self.stiffness)

    @property
    def _body(self) -> RigidMesh:
        return RigidMesh(motion=self.motion, rotate=self.rotate)

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundMeshObstacle:
        nodes, triangles = read_surface(self.path)
        cloth, stiffness = panel.cloth, barrier.stiffness_of(self.stiffness, panel, self.gap)
        fixed = self.scale * nodes, triangles
        sets = ContactSets.of("MeshObstacle", cloth, float(self.gap), 0.0, stiffness, fixed)
        body = self._body if self._body.moves else None
        return BoundMeshObstacle("MeshObstacle", sets, self.friction, CREEP * cloth.extent, body)


@dataclass(frozen=True, eq=False)
class BoundMeshObstacle(BoundTriangleContact):
    """`MeshObstacle` on a cloth."""

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] from the mesh; infinite beyond the gap."""
        return self.sets.least_distance(self.place(x, t))

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        """Its mesh, wherever the place is."""
        faces = np.asarray(self.sets.mesh.faces)
        first = len(self.sets.mesh.rest_positions) - len(self.sets.fixed)
        nodes = self.sets.fixed
        if self.body is not None:
            nodes = self.body.pose(t).to_space(nodes)
        return Triangles(nodes, faces[faces.min(axis=1) >= first] - first)

    def crossing(self, x: np.ndarray) -> tuple[str, str]:
        """What intersects at x, and what is allowed, for an error."""
        return "the cloth passes through the mesh at the start", "must start on one side"
