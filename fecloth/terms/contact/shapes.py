"""The shapes of obstacles, `fc.shapes`: their distance in closed form, with two derivatives.

The distance d of a point outside has |∇d| = 1. Lengths are in m, or texts such as "10 cm".
Every shape may move and turn: `Shape` says how.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import LENGTH
from fecloth.terms.contact.shape import NO_EDGES, NO_TRIANGLES, Sdf, Shape, Skeleton
from fecloth.validation import direction, point

__all__ = ["Box", "Capsule", "Cylinder", "Disk", "Plane", "Sdf", "Shape", "Sphere"]

Vector = tuple[float, float, float]
Place = Annotated[Vector, LENGTH]
Length = Annotated[float, LENGTH]
# Half of the length of an endless cylinder over the extent of the cloth, where it needs ends.
# Chosen: no cloth that starts near its point comes to them.
HALF_LENGTH_OVER_EXTENT = 100.0
# Sides of the polygon in place of a round plate, where it needs triangles. It lies within the
# circle by at most r (1 − cos(π/96)), that is 0.05 % of the radius.
SIDES_OF_DISK = 96
ROD = np.array([[0, 1]])
CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])  # of a box
FACES = np.array(  # of a box, each as two triangles
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)


@checks_arguments
@dataclass(frozen=True)
class Plane(Shape):
    """The half-space behind a plane: d = (x − point) · n.

    Parameters
    ----------
    point
        A point of the plane [m].
    normal
        Its normal n, of any length, towards the side on which the cloth is.
    """

    point: Place
    normal: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        point("point", self.point, "Plane")
        _ = self._normal

    @cached_property
    def _normal(self) -> np.ndarray:
        return direction("normal", self.normal, "Plane")

    @property
    def radius_of_curvature(self) -> float:
        return float("inf")

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        return (y - np.array(self.point, float)) @ self._normal

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.tile(self._normal, (len(y), 1)), np.zeros((len(y), 3, 3))


class Round:
    """All points within `radius` of a point or a line: d = |q| − radius.

    q leads from the nearest point of the line to the point y.
    """

    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()  # type: ignore[misc]  # of the `Shape` beside it
        validation.positive("radius", self.radius, "m", type(self).__name__)

    @property
    def radius_of_curvature(self) -> float:
        return self.radius

    @property
    def width(self) -> float:
        return 2 * self.radius

    def offset(self, y: np.ndarray) -> np.ndarray:
        """q (m, 3) of points y (m, 3)."""
        raise NotImplementedError

    def projector(self, y: np.ndarray) -> np.ndarray:
        """∂q/∂y, (3, 3) or (m, 3, 3)."""
        return np.eye(3)

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        return _length(self.offset(y)) - self.radius

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        return _around(self.offset(y), self.projector(y))


@checks_arguments
@dataclass(frozen=True)
class Sphere(Round, Shape):
    """A ball: d = |x − center| − radius.

    Parameters
    ----------
    center
        Its centre [m].
    radius
        Its radius [m].
    """

    center: Place
    radius: Length

    def __post_init__(self) -> None:
        point("center", self.center, "Sphere")
        super().__post_init__()

    def skeleton(self, extent: float) -> Skeleton:
        """Its centre, with the radius as the thickness."""
        points = np.array([self.center], float)
        return Skeleton(points, edges=NO_EDGES, triangles=NO_TRIANGLES, thickness=self.radius)

    def offset(self, y: np.ndarray) -> np.ndarray:
        return y - np.array(self.center, float)


@checks_arguments
@dataclass(frozen=True)
class Cylinder(Round, Shape):
    """A round cylinder without ends: d = |q| − radius.

    q is the part of x − point across the axis.

    Parameters
    ----------
    point
        A point of the axis [m].
    axis
        The direction of the axis, of any length.
    radius
        Its radius [m].
    """

    point: Place
    axis: Vector
    radius: Length

    def __post_init__(self) -> None:
        point("point", self.point, "Cylinder")
        super().__post_init__()
        _ = self._across

    @cached_property
    def _across(self) -> np.ndarray:
        """(3, 3) projector onto the plane across the axis."""
        axis = direction("axis", self.axis, "Cylinder")
        return np.eye(3) - np.outer(axis, axis)

    def skeleton(self, extent: float) -> Skeleton:
        """A piece of its axis around `point`, as long as a cloth of this `extent` [m] needs."""
        axis = direction("axis", self.axis, "Cylinder")
        half = HALF_LENGTH_OVER_EXTENT * extent * axis
        ends = np.array(self.point, float) + np.array([-half, half])
        return Skeleton(ends, edges=ROD, triangles=NO_TRIANGLES, thickness=self.radius)

    def offset(self, y: np.ndarray) -> np.ndarray:
        return (y - np.array(self.point, float)) @ self._across

    def projector(self, y: np.ndarray) -> np.ndarray:
        return self._across


@checks_arguments
@dataclass(frozen=True)
class Capsule(Round, Shape):
    """All points within `radius` of the segment from a to b: a rod with round ends.

    Parameters
    ----------
    a, b
        The ends of the segment [m].
    radius
        Its radius [m].
    """

    a: Place
    b: Place
    radius: Length

    def __post_init__(self) -> None:
        a = point("a", self.a, "Capsule")
        b = point("b", self.b, "Capsule")
        super().__post_init__()
        if (a == b).all():
            remedy = "Take a Sphere, with center and radius."
            raise InputError(f"a = b = {self.a!r}", "must differ", "Capsule", remedy)

    def skeleton(self, extent: float) -> Skeleton:
        """The segment from a to b, with the radius as the thickness."""
        ends = np.array([self.a, self.b], float)
        return Skeleton(ends, edges=ROD, triangles=NO_TRIANGLES, thickness=self.radius)

    def _parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return y − a (m, 3), the part (m,) for each point, and b − a (3,).

        The part is the place of the point along the axis: 0 beside a, 1 beside b.
        """
        a = np.array(self.a, float)
        way = np.array(self.b, float) - a
        return y - a, (y - a) @ way / (way @ way), way

    def offset(self, y: np.ndarray) -> np.ndarray:
        q, part, way = self._parts(y)
        return q - np.clip(part, 0, 1)[:, None] * way

    def projector(self, y: np.ndarray) -> np.ndarray:
        _, part, way = self._parts(y)
        is_at_end = (part <= 0) | (part >= 1)  # there the capsule is a ball: the projector is I
        along_axis = np.outer(way, way) / (way @ way)
        return np.eye(3) - np.where(is_at_end, 0.0, 1.0)[:, None, None] * along_axis


@checks_arguments
@dataclass(frozen=True)
class Box(Shape):
    """A box with edges along x, y and z; `rotate` turns it.

    Parameters
    ----------
    center
        Its centre [m].
    size
        The lengths of its edges [m].
    """

    center: Place
    size: Place

    def __post_init__(self) -> None:
        super().__post_init__()
        point("center", self.center, "Box")
        if not (point("size", self.size, "Box") > 0).all():
            raise InputError(f"size = {self.size!r}", "must be > 0 [m]", "Box")

    def _from_faces(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the signs (m, 3) of y − center, and distances q (m, 3) from the faces' planes.

        q is negative between the two planes of an axis.
        """
        y = y - np.array(self.center, float)
        return np.sign(y), abs(y) - 0.5 * np.array(self.size, float)

    @property
    def width(self) -> float:
        return float(np.median(self.size))  # of a bar the thicker side; a plate has wide faces

    @property
    def thinnest(self) -> float:
        return float(min(self.size))

    def skeleton(self, extent: float) -> Skeleton:
        corners = np.array(self.center, float) + 0.5 * CORNERS * np.array(self.size, float)
        return Skeleton(corners, edges=NO_EDGES, triangles=FACES)

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        _, q = self._from_faces(y)
        farthest = np.maximum(np.maximum(q[:, 0], q[:, 1]), q[:, 2])
        return _length(np.maximum(q, 0.0)) + np.minimum(farthest, 0.0)

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        sign, q = self._from_faces(y)
        # The distance is |max(q, 0)|: only the components count that are beyond a face.
        is_beyond = (q > 0).astype(float)
        n, H = _around(np.maximum(q, 0.0), is_beyond[:, :, None] * np.eye(3))
        return sign * n, sign[:, :, None] * H * sign[:, None, :]


@checks_arguments
@dataclass(frozen=True)
class Disk(Shape):
    """A round plate: a cylinder of finite height, which is its thickness.

    Parameters
    ----------
    center
        Its centre [m].
    normal
        The direction of its axis, of any length.
    radius
        Its radius [m].
    thickness
        Its height along the axis [m].
    """

    center: Place
    normal: Vector
    radius: Length
    thickness: Length

    def __post_init__(self) -> None:
        super().__post_init__()
        point("center", self.center, "Disk")
        validation.positive("radius", self.radius, "m", "Disk")
        validation.positive("thickness", self.thickness, "m", "Disk")
        _ = self._axis

    @cached_property
    def _axis(self) -> np.ndarray:
        return direction("normal", self.normal, "Disk")

    def _cylindrical(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q (m, 3) across the axis, its length, and the height (m,) along the axis."""
        y = y - np.array(self.center, float)
        height = y @ self._axis
        q = y - height[:, None] * self._axis
        return q, _length(q), height

    def _beyond(self, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how far (m,) [m] points are beyond the rim and beyond the faces; < 0 inside."""
        return radius - self.radius, abs(height) - 0.5 * self.thickness

    @property
    def width(self) -> float:
        return 2 * self.radius

    @property
    def thinnest(self) -> float:
        return min(self.width, self.thickness)

    def skeleton(self, extent: float) -> Skeleton:
        """Return a closed surface: two polygons of `SIDES_OF_DISK` sides, and the rim between.

        The corners of the polygons lie on the edges of the faces. `extent` is not used, as the
        disk has an end.
        """
        n = SIDES_OF_DISK
        angle = 2 * np.pi / n * np.arange(n)
        # The coordinate axis farthest from the disk's axis, so that their product is not 0.
        coordinate_axis = np.eye(3)[abs(self._axis).argmin()]
        first = direction("across", np.cross(self._axis, coordinate_axis), "")
        second = np.cross(self._axis, first)
        unit_circle = np.column_stack([np.cos(angle), np.sin(angle)])
        circle = self.radius * unit_circle @ np.stack([first, second])
        up = 0.5 * self.thickness * self._axis
        points = np.array(self.center, float) + np.vstack([circle - up, circle + up, [-up, up]])
        # Numbers of points: the polygon below, the polygon above, and the two middles.
        low = np.arange(n)
        low_after = np.roll(low, -1)
        high = low + n
        high_after = low_after + n
        middle_low = np.full(n, 2 * n)
        middle_high = np.full(n, 2 * n + 1)
        triangles = [
            (low_after, low, middle_low),  # the lower face
            (high, high_after, middle_high),  # the upper face
            (low, low_after, high),  # the rim, in two triangles a side
            (low_after, high_after, high),
        ]
        corners = np.concatenate([np.stack(corner, axis=1) for corner in triangles])
        return Skeleton(points, edges=NO_EDGES, triangles=corners)

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        rim, face = self._beyond(*self._cylindrical(y)[1:])
        outside = np.hypot(np.maximum(rim, 0.0), np.maximum(face, 0.0))
        return outside + np.minimum(np.maximum(rim, face), 0.0)

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient n and Hessian of the distance d = √(rim² + face²) of points outside.

        rim and face say how far a point is beyond the rim and beyond a face; they count as 0
        where it is not. The surfaces of equal distance curve around the axis and, where both
        are > 0, around the edge with the curvature 1/d.
        """
        q, radius, height = self._cylindrical(y)
        rim, face = self._beyond(radius, height)
        radius = _or_one(radius)  # on the axis, where q is zero
        radial = q / radius[:, None]
        axial = np.sign(height)[:, None] * self._axis
        d = _or_one(np.hypot(np.maximum(rim, 0.0), np.maximum(face, 0.0)))
        radial_part = np.maximum(rim, 0.0) / d  # of n
        axial_part = np.maximum(face, 0.0) / d
        n = radial_part[:, None] * radial + axial_part[:, None] * axial
        around_axis = np.cross(radial, axial)
        around_edge = axial_part[:, None] * radial - radial_part[:, None] * axial
        curvature_of_edge = np.where((rim > 0) & (face > 0), 1 / d, 0.0)[:, None, None]
        curvature_of_rim = (radial_part / radius)[:, None, None]
        hessian = curvature_of_edge * _outer(around_edge, around_edge)
        hessian = hessian + curvature_of_rim * _outer(around_axis, around_axis)
        return n, hessian


def _length(q: np.ndarray) -> np.ndarray:
    """(m,) |q|."""
    return np.sqrt(np.einsum("mi,mi->m", q, q))


def _or_one(length: np.ndarray) -> np.ndarray:
    """(m,) lengths by which vectors can be divided: 1 in place of 0, of a vector of zeros."""
    return np.where(length > 0.0, length, 1.0)


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(m, 3, 3) a bᵀ."""
    return a[:, :, None] * b[:, None, :]


def _around(q: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradient n = q/|q| (m, 3) and the Hessian (P − n nᵀ)/|q| (m, 3, 3) of |q|.

    `across` is the projector P = ∂q/∂x, (3, 3) or (m, 3, 3). Where q is 0, n is 0.
    """
    r = _or_one(_length(q))
    n = q / r[:, None]
    return n, (across - _outer(n, n)) / r[:, None, None]
