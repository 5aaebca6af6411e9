"""Pins and slides as a user writes them: which nodes, along what they are free, how they move."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fecloth.errors import FeclothError, InputError
from fecloth.mesh.cloth import Where

DERIVATIVE_STEP = 1e-5  # s; a central difference of a motion is then good to about 1e-10


@dataclass(frozen=True)
class Pin:
    """x(t) = x(t₀) + motion(t) − motion(t₀): nodes held where the run finds them, or moved.

    Source: the filter of Baraff and Witkin (1998), Large Steps in Cloth Simulation, section 5, in
    the form P A P + (I − P) with the projector P onto a node's free directions (Ascher and
    Boxerman 2003, On the modified conjugate gradient method in cloth simulation).

    Valid at any deformation, for a support that does not give way. One pinned node holds a
    membrane the more softly the finer the mesh is, as `PointForce` says: hold edges. Steps must
    sample a motion; what happens between two of them is not seen.

    Parameters
    ----------
    where
        A node set's name, node indices, or a predicate on X.
    motion
        Displacement as a function of time, ``motion(t) -> (3,)`` for all nodes or ``(k, 3)``, in
        the order of ``cloth.nodes(where)`` [m]; only its changes count:
        x(t) = x(t₀) + motion(t) − motion(t₀). None: fixed.
    velocity
        Its time derivative ``velocity(t)`` [m/s]; left out, a central difference over 2e-5 s,
        one-sided where it would reach back beyond the start of the step.
    name
        Name of the group in reactions; left out, the set's name.
    """

    where: Where
    motion: Callable[[float], np.ndarray] | None = None
    velocity: Callable[[float], np.ndarray] | None = None
    name: str | None = None

    @property
    def projector(self) -> np.ndarray:
        """(3, 3), onto the directions that stay free: none."""
        return np.zeros((3, 3))

    def displacement(self, t: float) -> np.ndarray:
        """(3,) or (k, 3) [m]."""
        if self.motion is None:
            return np.zeros(3)
        return self._checked(self.motion, t, "motion")

    def speed(self, t: float, since: float = -math.inf) -> np.ndarray:
        """(3,) or (k, 3) [m/s]; a difference asks for no motion before `since`.

        There it is (−3 u(t) + 4 u(t + h) − u(t + 2h))/(2h), of second order too.
        """
        if self.motion is None:
            return np.zeros(3)
        if self.velocity is not None:
            return self._checked(self.velocity, t, "velocity")
        u, h = self.displacement, DERIVATIVE_STEP
        if t - h < since:
            return (4 * u(t + h) - 3 * u(t) - u(t + 2 * h)) / (2 * h)
        return (u(t + h) - u(t - h)) / (2 * h)

    def __post_init__(self):
        for name in ("motion", "velocity"):
            value = getattr(self, name)
            if value is not None and not callable(value):
                allowed = "must be a function of t, as in lambda t: [0, 0, 0.1 * t]"
                raise InputError(f"{name} = {value!r}", allowed, f"Pin({self.where!r})")
        if self.velocity is not None and self.motion is None:
            raise InputError("velocity without a motion", "needs both", f"Pin({self.where!r})")

    def fits(self, value: np.ndarray, nodes: int) -> None:
        """Refuse a motion of another number of rows than the pin has nodes."""
        if value.ndim == 2 and len(value) not in (1, nodes):
            allowed = f"must be (3,) or ({nodes}, 3), a row for each node"
            raise InputError(f"a motion of shape {value.shape}", allowed, f"Pin({self.where!r})")

    def _checked(self, function, t, name):
        where, allowed = f"Pin({self.where!r})", "must be three finite numbers for a time t [s]"
        try:
            given = function(t)
            value = np.asarray(given, dtype=float)
        except FeclothError:  # a formula's own words
            raise
        except Exception as error:  # whatever a user's function may raise
            raise InputError(f"{name}({t:g}): {error}", allowed, where) from error
        if value.shape[-1:] != (3,) or value.ndim > 2 or not np.isfinite(value).all():
            raise InputError(
                f"{name}({t:g}) = {value!r}",
                "must be three finite numbers (or three for each node)",
                f"Pin({self.where!r})",
            )
        return value


@dataclass(frozen=True)
class Slide(Pin):
    """Nodes that slide without friction along a line or in a plane, from where the run finds them.

    The free directions of each node are the image of a projector P, and the reaction lies in that
    of I − P:

        P = d dᵀ             along the line of direction d     (rank 1)
        P = I − n nᵀ         in the plane of normal n          (rank 2)

    Source: as for `Pin`.

    Valid where `Pin` is; the line or plane keeps its direction and has no friction.

    Parameters
    ----------
    where, motion, velocity, name
        As for `Pin`; a motion carries the line or plane along, so only its part across counts.
    direction
        Of the line, any length; give this or `normal`.
    normal
        Of the plane, any length.

    Examples
    --------
    >>> Slide("left", normal=(0, 0, 2)).projector
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 0.]])
    """

    direction: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None

    def __post_init__(self):
        super().__post_init__()
        where = f"Slide({self.where!r})"
        if (self.direction is None) == (self.normal is None):
            given = "neither" if self.normal is None else "both"
            raise InputError(f"{given} of direction and normal", "needs one of them", where)
        name = "direction" if self.normal is None else "normal"
        value = getattr(self, name)
        y = np.asarray(value)
        if y.shape != (3,) or y.dtype.kind not in "iuf" or not np.isfinite(y).all() or not y.any():
            allowed = "must be three finite numbers, not all zero"
            raise InputError(f"{name} = {value!r}", allowed, where)

    @property
    def projector(self) -> np.ndarray:
        """(3, 3), onto the line or the plane."""
        along = np.array(self.normal if self.direction is None else self.direction, dtype=float)
        along /= abs(along).max()  # so that no square overflows
        P = np.outer(along, along) / np.dot(along, along)
        return P if self.normal is None else np.eye(3) - P
