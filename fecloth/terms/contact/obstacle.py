"""Rigid obstacles that the cloth cannot enter: shapes, and surfaces of triangles."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.read import read_surface
from fecloth.quantities.rotation import Rotation
from fecloth.quantities.time_function import VectorOfTime
from fecloth.quantities.units import LENGTH, PRESSURE
from fecloth.terms.contact import barrier
from fecloth.terms.contact.bound_obstacle import BoundObstacle
from fecloth.terms.contact.inside import starts_inside
from fecloth.terms.contact.near_points import NearPoints
from fecloth.terms.contact.points import MOST_PARTS, divisions, longest_edges, points_of
from fecloth.terms.contact.shape import NO_EDGES, Shape, Skeleton
from fecloth.terms.contact.surfaces import Triangles, surface_of
from fecloth.terms.contact.toolkit import ContactSets, is_installed
from fecloth.terms.contact.triangle_contact import BoundTriangleContact
from fecloth.terms.traits import CONTACT


@dataclass(frozen=True, eq=False)
class BoundSkeleton(BoundTriangleContact):
    """An `Obstacle` on a cloth that acts by the `Skeleton` of its shape."""

    body: Shape

    def least_distance(self, x: np.ndarray, t: float) -> float:
        return self.sets.least_distance(self.place(x, t)) - self.sets.thickness

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        return surface_of(self.body, t, place, reach)

    def room(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.body.distance(self.place(x, t), t)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        if not self.allows(x, t):
            depth = -self.room(x, t)
            nodes = np.flatnonzero(depth >= 0.0)
            raise starts_inside(self.body, self.gap, where, nodes, depth[nodes])


# The width of a shape, with the gap on both sides, over the distance of the points of a divided
# edge, an eighth of it: a narrower shape acts by its skeleton. Chosen: some points then meet it.
LEAST_WIDTH_OVER_PART = 4.0
LARGEST_GAP_OVER_EXTENT = 0.1  # of the cloth; the gap is an error, and this one can be seen


@dataclass(frozen=True)
class Obstacle:
    """Nodes at the distance d < gap from a rigid shape are pushed off: f = −κ A b′(d/gap) ∇d.

    A is the area around a node, and the potential is Σ κ gap A b(d/gap) with the barrier

        b(s) = −(s − 1)² ln s for 0 < s < 1, 0 from s = 1 on, +∞ for s ≤ 0

    so that no node ever enters the shape. The cloth rests near the gap, not on the shape
    itself: that is an error of up to one gap, and half of the gap is half of the error. In each
    step of Newton's iteration a node comes nearer by four fifths of its distance at most.

    Between its nodes a triangle dips into a shape that curves. Where it would dip in by more
    than a quarter of the gap, the barrier also acts on points inside the triangles; a P2
    triangle counts as four flat ones. A shape with edges, and one that is thinner than half of
    the longest edge with the gap on both sides, would pass between such points. It acts by its
    own points, edges and faces (`Skeleton`), as a `MeshObstacle` does, with the package
    ``ipctk``. Without it a `Box` and a `Disk` act on the points, too, and may cut into triangles.

    With a coefficient of friction μ a spring ties each place that touches to an anchor on the
    shape. With its stretch e along the surface and the normal force λ = −κ A b′ |∇d|, it holds
    the cloth by −k e where k |e| ≤ μ λ, and by −μ λ e/|e| beyond; there the anchor follows at the
    end of the step. So a cloth at rest does not creep: it gives way by F/k with k = 100 κ A/gap,
    and also goes with a shape that moves and turns. Anchors are in restart files, and a run from
    an `Equilibrium` begins with its anchors. Over a step λ and ∇d are taken at its begin, so that
    friction has a potential; over a load step of `equilibrium`, at its end.

    An impact leaves the part e = `restitution` of the speed at which a node closes, at any dt:
    at the end of a step impulses in the mass of the cloth decide with what speed all nodes that
    touch open (`fecloth.integrators.impacts`; Moreau 1988). A speed that the forces of two steps
    explain does not bounce, so that a cloth at rest stays.

    K = κ A (b″/gap ∇d ∇dᵀ + b′ ∇²d). Its second part is negative for a convex shape; the
    definite tangent leaves it out.

    Source: Li et al. (2020), Incremental Potential Contact: Intersection- and Inversion-free,
    Large-Deformation Dynamics, ACM Trans. Graph. 39(4), with areas as weights as in the IPC
    Toolkit (`barrier`); friction by Cundall and Strack (1979), A Discrete Numerical Model for
    Granular Assemblies, Géotechnique 29(1), and Simo and Laursen (1992), An Augmented Lagrangian
    Treatment of Contact Problems Involving Friction, Computers & Structures 42(1) (`friction`).

    Valid for any speed and any deformation, with `BackwardEuler`, `BDF2` and `equilibrium`.
    Other methods are refused: they are explicit, or balance the forces before the end of a
    step, so that the barrier need not hold at the end. `SelfContact` keeps the cloth off
    itself.

    Cost: 2 % of a Newton iteration; 19 % with four points more for each triangle.

    Parameters
    ----------
    shape
        One of `fecloth.shapes`: Plane, Sphere, Cylinder, Capsule, Box, Disk or Sdf.
    gap
        Distance at which the barrier begins [m].
    friction
        Coefficient μ of Coulomb's friction.
    stiffness
        κ [Pa], or "auto": from the weight and stiffness of the fabric, and the gap.
    restitution
        Part of the speed that an impact leaves, 0 (no bounce) … 1.

    Raises
    ------
    InputError
        For numbers out of their range. When bound to a cloth: for a gap above a tenth of its
        extent, a cloth that starts inside, and a shape that fits between the points if ``ipctk``
        is missing.

    Examples
    --------
    >>> import fecloth as fc
    >>> ball = fc.shapes.Sphere((0, 0, "-12 cm"), "10 cm")
    >>> table = fc.Obstacle(fc.shapes.Plane((0, 0, -0.3), (0, 0, 1)), gap="2 mm")
    >>> terms = [fc.StVK(), fc.Gravity(), fc.Obstacle(ball), table]
    """

    shape: Shape
    gap: Annotated[float, LENGTH] = 1e-3
    friction: float = 0.0
    stiffness: Annotated[barrier.Stiffness, PRESSURE] = "auto"
    restitution: float = 0.0

    traits = CONTACT

    def __post_init__(self):
        """Raise `InputError` for a parameter that is wrong whatever the cloth is."""
        if not isinstance(self.shape, Shape):
            allowed = "must be a shape, such as fc.shapes.Sphere(center, radius)"
            raise InputError(f"shape = {self.shape!r}", allowed, "Obstacle")
        barrier.check_numbers("Obstacle", self.gap, self.friction, self.stiffness)
        barrier.check_restitution("Obstacle", self.restitution)

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        """Return the nodes of each triangle if the obstacle acts on points inside triangles.

        Such a point couples the nodes of its triangle. Otherwise it returns None: a force on a
        node couples nothing, and contact by a skeleton is outside of the pattern (`coupling`).
        """
        parts = divisions(self.shape, self.gap, cloth)
        if parts > 1 and not self._skeleton(cloth):
            return cloth.stencil
        return None

    def _skeleton(self, cloth: Cloth) -> Skeleton | None:
        """Return the skeleton of a shape with edges, or of one that fits between the points.

        None for a wide round shape, for a shape without a skeleton, and without the package ipctk.
        """
        part = float(longest_edges(cloth).max()) / MOST_PARTS  # the largest distance of points
        width = self.shape.width + 2 * self.gap  # the barrier acts on both sides
        has_edges = self.shape.radius_of_curvature == 0.0
        is_thin = width < LEAST_WIDTH_OVER_PART * part
        if not (has_edges or is_thin) or not is_installed():
            return None
        return self.shape.skeleton(cloth.extent)

    def bind(self, panel: Panel, slots) -> BoundObstacle | BoundSkeleton:
        """Bind the obstacle: by its points, or by its skeleton if it has edges or is thin.

        Raises `InputError` for a gap that is too large for the cloth, and for a thin shape that
        has no skeleton or needs the package ipctk.
        """
        cloth = panel.cloth
        largest_gap = LARGEST_GAP_OVER_EXTENT * cloth.extent
        if self.gap > largest_gap:
            remedy = "The cloth rests about a gap away from the obstacle."
            allowed = f"must be at most {largest_gap:.3g} m, a tenth of the extent of the cloth"
            raise InputError(f"gap = {self.gap:g} m", allowed, "Obstacle", remedy)
        if skeleton := self._skeleton(cloth):
            return self._bind_skeleton(skeleton, panel)
        self._refuse_thin(cloth)
        parts = min(divisions(self.shape, self.gap, cloth), MOST_PARTS)
        return BoundObstacle(
            near=NearPoints(self.shape, float(self.gap), points_of(cloth, parts, slots)),
            stiffness=barrier.stiffness_of(self.stiffness, panel, self.gap),
            friction=float(self.friction),
            restitution=float(self.restitution),
        )

    def _bind_skeleton(self, skeleton: Skeleton, panel: Panel) -> BoundSkeleton:
        """Return the bound term of a shape that acts by its own points, edges and faces."""
        sets = ContactSets.bind(
            "Obstacle",
            panel.cloth,
            gap=float(self.gap),
            thickness=skeleton.thickness,
            stiffness=barrier.stiffness_of(self.stiffness, panel, self.gap),
            fixed=skeleton,
        )
        return BoundSkeleton(
            name="Obstacle",
            sets=sets,
            friction=self.friction,
            body=self.shape,
            restitution=self.restitution,
        )

    def _refuse_thin(self, cloth: Cloth) -> None:
        """Raise `InputError` for a shape that fits between the points of the triangles.

        The points of a divided edge are farthest apart on the longest edge. A shape that is
        narrower than their distance, with the gap on both sides, may meet none of them.
        """
        thinnest = self.shape.thinnest
        part = float(longest_edges(cloth).max()) / MOST_PARTS
        width = thinnest + 2 * self.gap
        if width < part:
            own_width = f"the {type(self.shape).__name__} is {1e3 * thinnest:.3g} mm wide"
            what = f"{own_width}, {1e3 * width:.3g} mm with the gap on both sides"
            allowed = f"must be at least {1e3 * part:.3g} mm, an eighth of the longest edge"
            remedy = "Take a smaller h, or install ipctk: pip install '.[contact]'."
            raise InputError(what, allowed, "Obstacle", remedy)


class RigidMesh(Shape):
    """The motion of a mesh; its distance is the toolkit's."""


@dataclass(frozen=True)
class MeshObstacle:
    """The cloth and the triangles of a rigid mesh push each other apart, as `SelfContact` does.

    The potential is Σ κ gap A b(d²) over pairs of a node and a triangle and over pairs of edges,
    one of the cloth and one of the mesh, with

        b(d²) = −(s² − 1)² ln s², s = d/gap < 1; 0 from s = 1 on; +∞ for s = 0

    The mesh may be open or closed, coarse or fine. It keeps the cloth on the side on which the
    cloth starts. It stands as its file says at t = 0, and may move and turn from there. A
    plane, a sphere and the other shapes of `fecloth.shapes` are much cheaper as an `Obstacle`,
    and exact.

    Source: Li et al. (2020), Incremental Potential Contact: Intersection- and Inversion-free,
    Large-Deformation Dynamics, ACM Trans. Graph. 39(4), computed by the IPC Toolkit, the package
    ``ipctk``.

    Valid for any speed and any deformation, with `BackwardEuler`, `BDF2` and, without friction,
    `equilibrium`.

    Cost: as for `SelfContact`; a large mesh of few triangles costs more than many small ones.

    Parameters
    ----------
    path
        A file with triangles that meshio reads, such as .stl, .obj, .ply or .vtu. Equal nodes
        are united.
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
    restitution
        Part of the speed that an impact leaves, 0 (no bounce) … 1.

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
    restitution: float = 0.0

    traits = CONTACT

    def __post_init__(self):
        _ = self._body  # a mistake in it is refused where the obstacle is written
        barrier.check_restitution("MeshObstacle", self.restitution)
        validation.positive("scale", self.scale, "", "MeshObstacle")
        barrier.check_numbers("MeshObstacle", self.gap, self.friction, self.stiffness)

    @property
    def _body(self) -> RigidMesh:
        return RigidMesh(motion=self.motion, rotate=self.rotate)

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundTriangleContact:
        """Read the file of the mesh, and bind the contact of the cloth with it."""
        nodes, triangles = read_surface(self.path)
        cloth = panel.cloth
        stiffness = barrier.stiffness_of(self.stiffness, panel, self.gap)
        fixed = Skeleton(points=self.scale * nodes, edges=NO_EDGES, triangles=triangles)
        sets = ContactSets.bind(
            "MeshObstacle",
            cloth,
            gap=float(self.gap),
            thickness=0.0,
            stiffness=stiffness,
            fixed=fixed,
        )
        body = None  # a mesh that stands still has no frame of its own
        if self._body.moves:
            body = self._body
        return BoundMeshObstacle(
            name="MeshObstacle",
            sets=sets,
            friction=self.friction,
            body=body,
            restitution=self.restitution,
        )


@dataclass(frozen=True, eq=False)
class BoundMeshObstacle(BoundTriangleContact):
    """`MeshObstacle` on a cloth."""

    def least_distance(self, x: np.ndarray, t: float) -> float:
        return self.sets.least_distance(self.place(x, t))

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        """Return the whole fixed mesh at the time t, wherever the place is."""
        faces = np.asarray(self.sets.mesh.faces)
        # The nodes of the cloth come first in the mesh of the toolkit.
        cloth_node_count = len(self.sets.mesh.rest_positions) - len(self.sets.fixed)
        nodes = self.sets.fixed
        if self.body is not None:
            nodes = self.body.pose(t).to_space(nodes)
        fixed_faces = faces[faces.min(axis=1) >= cloth_node_count]
        return Triangles(nodes, fixed_faces - cloth_node_count)

    def crossing(self, x: np.ndarray) -> tuple[str, str]:
        """The words of an error for a cloth that passes through the mesh, and what is allowed."""
        return "the cloth passes through the mesh at the start", "must start on one side"
