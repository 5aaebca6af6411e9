"""The rotation of clamped nodes about an axis."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import transform

from fecloth import validation
from fecloth.errors import InputError
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.time_function import OfTime, TimeFunction, scalar


def rotation_matrix(vector: np.ndarray) -> np.ndarray:
    """(3, 3) matrix of the rotation about a vector (3,) by its length [rad]."""
    matrix: np.ndarray = transform.Rotation.from_rotvec(vector).as_matrix()
    return matrix


@checks_arguments
@dataclass(frozen=True)
class Rotation:
    """x(t) = p + R(t) R(t₀)ᵀ (x(t₀) − p): nodes turn by an angle about an axis through a point p.

    Raises `InputError` for a point or an axis that is not three finite numbers, an axis of zero
    length, and an angle that is neither a formula of t nor a function.

    Parameters
    ----------
    point
        A point p of the axis, three numbers [m]. With a motion u of the pin the axis goes
        through p + u(t).
    axis
        Direction of the axis, three numbers. Its length does not matter.
    angle
        Angle [rad], a formula of t [s] such as ``"2*pi*t"``; in Python also a function
        ``angle(t)``. Only its changes count. The turn is right-handed about the axis.

    Examples
    --------
    >>> turn = Rotation((0, 0, 0), (0, 0, 2), "pi*t")
    >>> turn.matrix(0.5).round(12) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    >>> turn.rate(0.5).round(6)
    array([0.      , 0.      , 3.141593])
    """

    point: Sequence[float]
    axis: Sequence[float]
    angle: OfTime

    def __post_init__(self) -> None:
        validation.point("point", self.point, "Rotation")
        _ = self._unit
        if not callable(self.angle) and not re.search(r"\bt\b", str(self.angle)):
            allowed = "must depend on t: only changes of the angle turn a pin"
            remedy = 'Write "0.5 * t", or start from positions that are turned.'
            raise InputError(f"angle = {self.angle!r}", allowed, "Rotation", remedy)
        _ = self._angle  # here, so that an error is raised where the rotation is written

    @cached_property
    def _angle(self) -> TimeFunction:
        return scalar(self.angle, "angle", "Rotation")

    @cached_property
    def _unit(self) -> np.ndarray:
        return validation.direction("axis", self.axis, "Rotation")

    def at(self, t: float) -> float:
        """Return the angle at the time t [s], in rad."""
        return float(self._angle(t))

    def matrix(self, t: float, since: float | None = None) -> np.ndarray:
        """(3, 3) rotation by the angle at the time t [s], or by its change `since` a time."""
        angle = self._angle(t)
        if since is not None:
            angle = angle - self._angle(since)
        return rotation_matrix(angle * self._unit)

    def rate(self, t: float) -> np.ndarray:
        """(3,) angular velocity [rad/s] at the time t [s]."""
        rate: np.ndarray = self._angle.rate(t) * self._unit
        return rate
