"""What all shapes of obstacles have in common, and the shape whose distance is a formula."""

import math
import re
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, errors_of
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.formula import Formula
from fecloth.quantities.rotation import Rotation
from fecloth.quantities.time_function import TimeFunction, VectorOfTime, vector
from fecloth.quantities.units import LENGTH


@dataclass(frozen=True, eq=False)
class Pose:
    """The place of a rigid body at one time: its point y of its own frame is at x in space.

        x = p + u + R (y − p)

    Attributes
    ----------
    R
        Rotation (3, 3) about the point p.
    p
        Point (3,) of the axis [m].
    u
        Displacement (3,) [m].
    """

    R: np.ndarray
    p: np.ndarray
    u: np.ndarray

    def to_body(self, x: np.ndarray) -> np.ndarray:
        """Points (m, 3) of space in the frame of the body."""
        return (x - self.p - self.u) @ self.R + self.p

    def to_space(self, y: np.ndarray) -> np.ndarray:
        """Points (m, 3) of the body in space."""
        return (y - self.p) @ self.R.T + self.p + self.u


class AtRest(Pose):
    """The pose of a body that does not move."""

    def __init__(self):
        super().__init__(np.eye(3), np.zeros(3), np.zeros(3))

    def to_body(self, x: np.ndarray) -> np.ndarray:
        return x

    def to_space(self, y: np.ndarray) -> np.ndarray:
        return y


class Skeleton(NamedTuple):
    """Points, edges and triangles: the body is all that lies within a distance of them.

    Attributes
    ----------
    points
        Points (k, 3) [m].
    edges
        Edges (e, 2), as numbers of points, without the edges of the triangles.
    triangles
        Triangles (m, 3), as numbers of points.
    thickness
        The distance [m].
    """

    points: np.ndarray
    edges: np.ndarray
    triangles: np.ndarray
    thickness: float = 0.0


NO_EDGES = np.zeros((0, 2), int)
NO_TRIANGLES = np.zeros((0, 3), int)


@dataclass(frozen=True)
class Shape:
    """A rigid body that stands as it is written at t = 0, and may move and turn from there.

    A point y of the body is at p + u(t) − u(0) + R(t) R(0)ᵀ (y − p) at the time t, with the
    point p of the axis, the rotation R and the motion u. The motion may be a function
    ``motion(t) -> (3,)``.

    Parameters
    ----------
    motion
        Displacement [m], three formulas of t; only its changes count.
    rotate
        `Rotation` about an axis that moves along; only the changes of its angle count.
    """

    _: KW_ONLY
    motion: Annotated[VectorOfTime | None, LENGTH] = None
    rotate: Rotation | None = None

    convex: ClassVar[bool] = True  # whether the distance is a convex function of the place
    deforms: ClassVar[bool] = False  # whether the distance depends on t

    def __post_init__(self) -> None:
        """Raise `InputError` for a motion or a rotation that is none."""
        _ = self._motion  # a mistake in it is refused where the shape is written
        if self.rotate is not None and not isinstance(self.rotate, Rotation):
            allowed = "must be a Rotation(point, axis, angle)"
            raise InputError(f"rotate = {self.rotate!r}", allowed, type(self).__name__)

    @property
    def moves(self) -> bool:
        """Whether it moves, turns or deforms."""
        return self.motion is not None or self.rotate is not None or self.deforms

    @property
    def radius_of_curvature(self) -> float:
        """The least radius [m] with which its surface curves outwards; 0 for an edge."""
        return 0.0

    @property
    def width(self) -> float:
        """The width [m] of a hole through which the shape fits; infinite by default."""
        return math.inf

    @property
    def thinnest(self) -> float:
        """The least width [m] of its edges: a plate has sharp ones, where it is wide."""
        return self.width

    def skeleton(self, extent: float) -> Skeleton | None:
        """Its `Skeleton`, or None. An endless shape has one for a cloth of this extent [m]."""
        return None

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        """(m,) distance [m] of points (m, 3) in the frame of the body; negative inside."""
        raise NotImplementedError

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (m, 3) and Hessian (m, 3, 3) [1/m] of the distance, outside the body."""
        raise NotImplementedError

    def gradient(self, y: np.ndarray, t: float) -> np.ndarray:
        """(m, 3) gradient of the distance."""
        return self.slopes(y, t)[0]

    @cached_property
    def _motion(self) -> TimeFunction:
        motion = self.motion
        if motion is None:
            motion = (0.0, 0.0, 0.0)
        return vector(motion, "motion", type(self).__name__)

    @cached_property
    def _start(self) -> np.ndarray:
        return self._motion(0.0)

    def pose(self, t: float) -> Pose:
        """Where the body is at the time t."""
        if self.motion is None and self.rotate is None:
            return AT_REST
        u = self._motion(t) - self._start  # only changes of the motion count
        if self.rotate is None:
            return Pose(np.eye(3), np.zeros(3), u)
        return Pose(self.rotate.matrix(t, since=0.0), np.array(self.rotate.point, float), u)

    def rates(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the velocity of one point of the body, the angular velocity, and this point.

        Each is (3,), in space at the time t: in m/s, in 1/s and in m. The point lies on the axis
        of rotation. Without a rotation all points have this velocity, and the point is 0.
        """
        velocity = self._motion.rate(t)
        if self.rotate is None:
            return velocity, np.zeros(3), np.zeros(3)
        point_on_axis = self.pose(t).to_space(np.array(self.rotate.point))
        return velocity, self.rotate.rate(t), point_on_axis

    def velocity(self, x: np.ndarray, t: float) -> np.ndarray:
        """(m, 3) velocity [m/s] of the rigid body at points x (m, 3) of space."""
        velocity, omega, point_on_axis = self.rates(t)
        return velocity + np.cross(omega, x - point_on_axis)


AT_REST = AtRest()


VARIABLES = ("x", "y", "z", "t")


@checks_arguments
@dataclass(frozen=True)
class Sdf(Shape):
    """All points at which a formula φ(x, y, z, t) is negative.

    φ should be about the distance [m] outside, |∇φ| ≈ 1: elsewhere the gap is gap/|∇φ|. Its
    derivatives are exact, by the chain rule. It need not be convex.

    Parameters
    ----------
    formula
        Formula of x, y, z [m] and t [s]; a shape that deforms in time pushes along its normal.
    radius
        Least radius of curvature where the shape curves outwards [m]. It decides how many points
        inside triangles are needed. None for a shape with edges.
    """

    formula: str
    radius: Annotated[float | None, LENGTH] = None

    convex = False

    def __post_init__(self) -> None:
        """Raise `InputError` for a wrong motion, radius or formula."""
        super().__post_init__()
        if self.radius is not None:
            validation.positive("radius", self.radius, "m", "Sdf")
        with errors_of("Sdf"):
            _ = self._formula

    @cached_property
    def deforms(self) -> bool:  # type: ignore[override]  # constant in the base, here computed
        """Whether t occurs in the formula."""
        return re.search(r"\bt\b", self.formula) is not None

    @property
    def radius_of_curvature(self) -> float:
        return self.radius or 0.0

    @cached_property
    def _formula(self) -> Formula:
        if not isinstance(self.formula, str):
            allowed = f"must be a formula of {', '.join(VARIABLES)}"
            raise InputError(f"formula = {self.formula!r}", allowed, "Sdf")
        return Formula(self.formula, VARIABLES)

    @cached_property
    def _derivatives(self) -> tuple[list[Formula], list[list[Formula]]]:
        """The three first derivatives, and the second derivatives as rows of a matrix."""
        coordinates = VARIABLES[:3]  # without t
        first = [self._formula.derivative(coordinate) for coordinate in coordinates]
        second = [[slope.derivative(by) for by in coordinates] for slope in first]
        return first, second

    def distance(self, y: np.ndarray, t: float) -> np.ndarray:
        return _values(self._formula, y, t)

    def slopes(self, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        _, second = self._derivatives
        hessian = np.empty((len(y), 3, 3))
        for i, j in zip(*np.triu_indices(3), strict=True):  # it is symmetric
            hessian[:, i, j] = hessian[:, j, i] = _values(second[i][j], y, t)
        return self.gradient(y, t), hessian

    def gradient(self, y: np.ndarray, t: float) -> np.ndarray:
        first, _ = self._derivatives
        return np.stack([_values(derivative, y, t) for derivative in first], axis=-1)


def _values(formula: Formula, y: np.ndarray, t: float) -> np.ndarray:
    """(m,) values of a formula at points (m, 3) and the time t."""
    values_of_variables = dict(zip(VARIABLES, (*y.T, np.full(len(y), t)), strict=True))
    return np.asarray(formula(**values_of_variables))
