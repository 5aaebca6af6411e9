"""The tables [start] and [[pins]] of a scene: where nodes start, and which are held or moved."""

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from fecloth.errors import InputError
from fecloth.quantities import rotation
from fecloth.quantities.formula import Formula
from fecloth.quantities.rotation import rotation_matrix
from fecloth.quantities.units import LENGTH, TIME
from fecloth.scene.field_types import File, Name, OfPlace, OfTime, OfTimeAndPlace, Vector, Where
from fecloth.scene.table_model import Table, require_exactly_one, table_of
from fecloth.system.pins import Pin, Slide

_PLANES = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}  # the axes of warp and weft


class Rotation(Table):
    """A turn about an axis through the origin, right-handed."""

    axis: Vector
    """The axis of the turn."""
    degrees: float
    """The angle, right-handed."""

    @model_validator(mode="after")
    def _axis_has_a_direction(self):
        if not any(self.axis):
            raise InputError(f"axis = {list(self.axis)}", "must not be zero")
        return self

    def apply(self, x: np.ndarray) -> np.ndarray:
        """Rotate points (n, 3)."""
        axis = np.array(self.axis) / math.hypot(*self.axis)
        return x @ rotation_matrix(math.radians(self.degrees) * axis).T


class Start(Table):
    """The start: flat in a plane, as in the mesh file, by formulas of X and Y, or from a frame."""

    plane: Literal["xy", "xz", "yz"] | None = None
    """Flat in this plane, warp and weft along its axes. The default is xy, or the positions in
    space of a mesh file that has them beside flat coordinates."""
    position: tuple[OfPlace, OfPlace, OfPlace] | None = None
    """In place of `plane`: three formulas of X and Y [m]."""
    frame: File | None = None
    """In place of `plane`: a frame of an earlier run, with its velocity."""
    rotate: Rotation | None = None
    """A turn about an axis through the origin."""
    shift: Annotated[Vector | None, LENGTH] = None
    """A translation after the turn [m]."""
    velocity: tuple[OfPlace, OfPlace, OfPlace] | None = None
    """Three formulas of X and Y [m/s]. `rotate` does not turn the velocity."""
    disturb: Annotated[float | None, LENGTH] = Field(default=None, gt=0)
    """Height [m] of smooth waves that lift the free nodes out of the plane, the same each time."""
    mode: int | None = Field(default=None, ge=1)
    """Number of a mode by which the start is bent: about the equilibrium without it, or in a
    scene with [time] about the start."""
    amplitude: Annotated[float | None, LENGTH] = Field(default=None, gt=0)
    """The largest way of a node in this mode [m]."""

    @model_validator(mode="after")
    def _check_one_place(self):
        """Raise `InputError` for several places, or for a change of a frame's x or v."""
        if self.plane or self.position or self.frame:  # none of them is allowed, too
            require_exactly_one(self, "plane", "position", "frame")
        changed = [key for key in ("rotate", "shift", "velocity") if getattr(self, key)]
        if self.frame and changed:
            raise InputError(f"{changed[0]} is given", "a frame has its own x and v")
        if self.disturb and self.mode:
            raise InputError("disturb and mode are given", "takes one of them")
        if (self.mode is None) != (self.amplitude is None):
            given, missing = ("mode", "amplitude") if self.mode else ("amplitude", "mode")
            remedy = 'Write, for example: mode = 1, amplitude = "1 mm".'
            raise InputError(f"{given} is given", f"needs {missing}", remedy=remedy)
        return self

    @property
    def places(self) -> list[str]:
        """The keys that are given but for a disturbance."""
        given = self.model_dump(exclude_none=True, exclude={"disturb", "mode", "amplitude"})
        return list(given)

    @property
    def is_disturbed(self) -> bool:
        """Whether waves or a mode bend the start."""
        return bool(self.disturb or self.mode)

    def x(self, X: np.ndarray, in_file: np.ndarray | None = None) -> np.ndarray:
        """Return the positions (n, 3) [m] at the start of material points X (n, 2) [m].

        They are placed in the plane or by the formulas, or by default as `in_file` (n, 3) [m],
        then turned, then shifted. A table with a `frame` has no such positions: the frame itself
        must be read.
        """
        if self.position:
            x = _evaluate(self.position, X)
        elif in_file is not None and not self.plane:
            x = in_file
        else:
            x = np.zeros((len(X), 3))
            x[:, _PLANES[self.plane or "xy"]] = X
        if self.rotate:
            x = self.rotate.apply(x)
        if self.shift:
            x = x + self.shift
        return x

    def v(self, X: np.ndarray) -> np.ndarray:
        """Return the velocities (n, 3) [m/s] at the start of material points X (n, 2) [m]."""
        if self.velocity:
            return _evaluate(self.velocity, X)
        return np.zeros((len(X), 3))


def _evaluate(texts: tuple[str, ...], X: np.ndarray) -> np.ndarray:
    """Return the values (n, 3) of three formulas at material points (n, 2)."""
    formulas = [Formula(text, ("X", "Y")) for text in texts]
    return np.stack([formula(X=X[:, 0], Y=X[:, 1]) for formula in formulas], axis=1)


@dataclass(frozen=True)
class Region:
    """A condition on X and Y as a predicate on material points (n, 2) [m].

    Its `repr` is the text of the condition, because messages name a pin by it.
    """

    formula: Formula

    def __repr__(self) -> str:
        return repr(self.formula.text)

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return np.asarray(self.formula(X=X[:, 0], Y=X[:, 1]))


RotationTable: Any = table_of(
    rotation.Rotation,
    point=(Annotated[Vector, LENGTH], (0.0, 0.0, 0.0)),
    axis=(Vector, ...),
    angle=(OfTime, ...),
)


class PinTable(Table):
    """Nodes that are held fixed, moved, or free to slide along a line or in a plane."""

    where: str | None = None
    """A node set of the mesh."""
    inside: Where | None = None
    """In place of `where`: a condition of X and Y."""
    motion: tuple[OfTimeAndPlace, OfTimeAndPlace, OfTimeAndPlace] | None = None
    """Three formulas of t, X and Y of each node [m]; only their changes count. Left out: fixed."""
    name: Name | None = None
    """Name of the reaction's columns."""
    direction: Vector | None = None
    """The nodes slide along this line."""
    normal: Vector | None = None
    """The nodes slide in the plane across this vector."""
    clamp: bool = False
    """Hold also the normal of the cloth along the edges of the boundary that the pin covers; with
    `normal`, at a right angle to the plane: a plane of symmetry."""
    rotate: RotationTable | None = None
    """Turn the nodes, and the normals of a clamp: a table, see below."""
    without: str | tuple[str, ...] | None = None
    """A node set of the mesh whose nodes the pin leaves out, or a list of node sets."""
    until: Annotated[float | None, TIME] = None
    """The time at which the pin lets go [s]. Left out: it holds for ever."""

    _pin: Pin = PrivateAttr()

    @model_validator(mode="after")
    def _check_and_make_pin(self):
        """Check the keys and make the pin, which the property `pin` returns.

        Raise `InputError` unless there is one place and at most one of direction and normal, for
        what `Pin` or `Slide` refuses, and for a motion that does not depend on t.
        """
        require_exactly_one(self, "where", "inside")
        if self.direction and self.normal:  # none of them is allowed, too
            require_exactly_one(self, "direction", "normal")
        self._pin = pin = self._make_pin()
        uses_t = any(re.search(r"\bt\b", text) for text in self.motion or ())
        # A motion of constants has no effect, because only its changes move a pin. Three zeros
        # are allowed: they say what happens.
        if self.motion and not uses_t and (pin.motion.by_place or pin.motion(0).any()):
            allowed = "must depend on t: only changes of a motion move a pin"
            remedy = 'Write "0.1 * t", or move the cloth by shift in [start].'
            raise InputError(f"motion = {list(self.motion)}", allowed, remedy=remedy)
        return self

    @property
    def pin(self) -> Pin:
        """The pin or slide, made when the table was read."""
        return self._pin

    def _make_pin(self) -> Pin:
        """Return the `Pin`, or the `Slide` of a table with a direction or a normal."""
        where: str | Region
        if self.where is None:
            condition = Formula(cast(str, self.inside), ("X", "Y"), condition=True)
            where = Region(condition)
        else:
            where = self.where
        common: dict[str, Any] = {
            "motion": self.motion,
            "name": self.name,
            "clamp": self.clamp,
            "rotate": self.rotate.make() if self.rotate else None,
            "without": self.without,
            "until": self.until,
        }
        if self.direction or self.normal:
            return Slide(where, direction=self.direction, normal=self.normal, **common)
        return Pin(where, **common)
