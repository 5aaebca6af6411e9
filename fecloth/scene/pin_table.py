"""The tables [[pins]] of a scene file: which nodes are held or moved, and how."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, cast

import numpy as np
from pydantic import PrivateAttr, model_validator

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula
from fecloth.quantities.rotation import Rotation
from fecloth.quantities.units import LENGTH
from fecloth.scene.field_types import Name, OfTime, OfTimeAndPlace, Vector, Where
from fecloth.scene.table_model import Table, require_exactly_one, table_of
from fecloth.system.pins import Pin, Slide


@dataclass(frozen=True)
class Region:
    """A condition on X and Y as a predicate on material points (n, 2) [m]."""

    formula: Formula

    def __repr__(self) -> str:
        return repr(self.formula.text)  # as messages name it

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return np.asarray(self.formula(X=X[:, 0], Y=X[:, 1]))


RotationTable: Any = table_of(
    Rotation,
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
    """Hold also the normal of the cloth along the edges of the boundary that the pin covers."""
    rotate: RotationTable | None = None
    """Turn the nodes, and the normals of a clamp: a table, see below."""

    _pin: Pin = PrivateAttr()

    @model_validator(mode="after")
    def _one_place(self):
        require_exactly_one(self, "where", "inside")
        if self.direction and self.normal:
            require_exactly_one(self, "direction", "normal")
        self._pin = pin = self._make_pin()
        if self.motion and not self._uses("t") and (pin.motion.by_place or pin.motion(0).any()):
            allowed = "must depend on t: only changes of a motion move a pin"
            remedy = 'Write "0.1 * t", or move the cloth by shift in [start].'
            raise InputError(f"motion = {list(self.motion)}", allowed, "", remedy)
        return self

    def _uses(self, variable: str) -> bool:
        return any(re.search(rf"\b{variable}\b", text) for text in self.motion or ())

    @property
    def pin(self) -> Pin:
        """The pin or slide, made when the table was read."""
        return self._pin

    def _make_pin(self) -> Pin:
        where: str | Region
        if self.where is None:
            where = Region(Formula(cast(str, self.inside), ("X", "Y"), True))
        else:
            where = self.where
        rotate = self.rotate.make() if self.rotate else None
        if not (self.direction or self.normal):
            return Pin(where, self.motion, None, self.name, self.clamp, rotate)
        free = {"direction": self.direction, "normal": self.normal}
        return Slide(where, self.motion, None, self.name, self.clamp, rotate, **free)
