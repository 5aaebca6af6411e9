"""The tables [[pins]] of a scene file: which nodes are held or moved, and how."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from pydantic import PrivateAttr, model_validator

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula, Motion, Region
from fecloth.scene.field_types import Name, OfTimeAndPlace, Vector, Where
from fecloth.scene.table_model import Table, exactly_one
from fecloth.system.pins import Pin, Slide


class PinTable(Table):
    """Nodes of a set (`where`) or with ``inside`` true, held fixed or moved by formulas of t.

    The formulas may also depend on X and Y of each node. With a `direction` the nodes slide along
    that line, with a `normal` in that plane.
    """

    where: str | None = None
    inside: Where | None = None
    motion: tuple[OfTimeAndPlace, OfTimeAndPlace, OfTimeAndPlace] | None = None
    name: Name | None = None
    direction: Vector | None = None
    normal: Vector | None = None

    _pin: Pin = PrivateAttr()

    @model_validator(mode="after")
    def _one_place(self):
        exactly_one(self, "where", "inside")
        if self.direction and self.normal:
            exactly_one(self, "direction", "normal")
        self._pin = pin = self._made()
        if self.motion and not self._names("t") and (self.by_place or pin.motion(0).any()):
            allowed = "must depend on t: only changes of a motion move a pin"
            remedy = 'Write "0.1 * t", or move the cloth by shift in [start].'
            raise InputError(f"motion = {list(self.motion)}", allowed, "", remedy)
        return self

    @property
    def by_place(self) -> bool:
        """Whether the motion depends on X or Y."""
        return self._names("X") or self._names("Y")

    def _names(self, variable: str) -> bool:
        return any(re.search(rf"\b{variable}\b", text) for text in self.motion or ())

    @property
    def pin(self) -> Pin:
        """The pin, made when the table was read; a motion that names X or Y waits for `pin_at`."""
        return self._pin

    def pin_at(self, X: np.ndarray) -> Pin:
        """Return the pin with its motion at the material points X (k, 2) of its nodes."""
        if not self.by_place:
            return self._pin
        return replace(self._pin, motion=replace(self._pin.motion, X=X))

    def _made(self) -> Pin:
        inside = self.inside and Region(Formula(self.inside, ("X", "Y"), True))
        where, motion = inside if self.where is None else self.where, None
        if self.motion:
            variables = ("t", "X", "Y") if self.by_place else ("t",)
            motion = Motion(tuple(Formula(text, variables) for text in self.motion))
        if self.direction or self.normal:
            across = {"direction": self.direction, "normal": self.normal}
            return Slide(where, motion, name=self.name, **across)
        return Pin(where, motion, name=self.name)
