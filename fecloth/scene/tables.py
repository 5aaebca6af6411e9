"""The tables of a scene file, one class for each; see `scene` for the file as a whole.

[fabric] is in `scenefabric`, [start] in `scenestart`, [time] and [output] are in `scenetime`.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from fecloth import terms
from fecloth.errors import InputError, brief
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.options import Newton
from fecloth.quantities.formula import Formula
from fecloth.quantities.units import LENGTH, TIME, is_quantity
from fecloth.scene import toml_text
from fecloth.scene.region import Region
from fecloth.scene.table_model import Table, exactly_one, one_of, table_of
from fecloth.simulation.probes import Probe
from fecloth.system.pins import Pin, Slide

_TAKEN = ("mean_displacement", "reaction")  # columns that no probe may be called


def _formula(*variables: str, condition: bool = False) -> Any:
    def check(text: str) -> str:
        try:
            Formula(text, variables, condition)
        except InputError as error:
            remedy = "A formula is in SI and has no units." if is_quantity(text) else error.remedy
            raise InputError(error.what, error.allowed, error.where, remedy) from None
        return text

    def text(value: Any) -> Any:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return repr(value) if number and not condition else value

    return Annotated[str, BeforeValidator(text), AfterValidator(check)]


def _named(name: str) -> str:
    if not name or not all(c.isalnum() or c in "_- " for c in name):
        raise InputError("", "must consist of letters, digits, spaces, _ and -")
    return name


def _located(value: str, info: ValidationInfo) -> str:
    path = Path((info.context or {}).get("folder", ".")) / value
    if problem := toml_text.file_problem(path):
        raise InputError("", f"{path}: {problem[0]}", "", problem[1])
    return str(path.resolve())


Name = Annotated[str, AfterValidator(_named)]
File = Annotated[str, AfterValidator(_located)]  # absolute, so that a copy of the scene finds it
OfTimeAndPlace = _formula("t", "X", "Y")
OfPlace = _formula("X", "Y")
Where = _formula("X", "Y", condition=True)
Vector = tuple[float, float, float]
Length = Annotated[float, LENGTH]
Element = Literal["P1", "P2"]


class Rectangle(Table):
    """``shape = "rectangle"``: [0, width] × [0, height], meshed with edge length h [m]."""

    shape: Literal["rectangle"]
    width: Length
    height: Length
    h: Length
    pattern: str = "unstructured"
    element: Element = "P1"

    def cloth(self) -> Cloth:
        return Cloth.rectangle(self.width, self.height, self.h, self.pattern, self.element)


class Disk(Table):
    """``shape = "disk"``: around the origin, meshed with edge length h [m]."""

    shape: Literal["disk"]
    radius: Length
    h: Length
    element: Element = "P1"

    def cloth(self) -> Cloth:
        return Cloth.disk(self.radius, self.h, self.element)


class MeshFile(Table):
    """``shape = "file"``: a mesh, or a .geo file with an edge length h [m]."""

    shape: Literal["file"]
    path: File
    h: Annotated[float | None, LENGTH] = None
    element: Element = "P1"

    def cloth(self) -> Cloth:
        return Cloth.read(self.path, self.h, self.element)


Shape = one_of("shape", {"rectangle": Rectangle, "disk": Disk, "file": MeshFile})


class PinTable(Table):
    """Nodes of a set (`where`) or with ``inside`` true, held fixed or moved by formulas of t.

    The formulas may name the nodes' X and Y too; each node then moves by its own.
    With a `direction` they slide along that line, with a `normal` in that plane.
    """

    where: str | None = None
    inside: Where | None = None
    motion: tuple[OfTimeAndPlace, OfTimeAndPlace, OfTimeAndPlace] | None = None
    name: Name | None = None
    direction: Vector | None = None
    normal: Vector | None = None

    @model_validator(mode="after")
    def _one_place(self):
        exactly_one(self, "where", "inside")
        if self.direction and self.normal:
            exactly_one(self, "direction", "normal")
        pin = self.pin()
        if self.motion and not self._names("t") and (pin.motion.by_place or pin.motion(0).any()):
            allowed = "must depend on t: a pin is moved by the changes of its motion only"
            remedy = 'Write "0.1 * t", or move the cloth by shift in [start].'
            raise InputError(f"motion = {list(self.motion)}", allowed, "", remedy)
        return self

    def _names(self, variable: str) -> bool:
        return any(re.search(rf"\b{variable}\b", text) for text in self.motion or ())

    def pin(self) -> Pin:
        """The pin or slide."""
        inside = self.inside and Region(Formula(self.inside, ("X", "Y"), True))
        where = inside if self.where is None else self.where
        if self.direction or self.normal:
            across = {"direction": self.direction, "normal": self.normal}
            return Slide(where, self.motion, name=self.name, **across)
        return Pin(where, self.motion, name=self.name)


class ProbeTable(Table):
    """A named path: the mean of a node set, or a material point (X, Y) [m]."""

    name: Name
    where: str | None = None
    point: Annotated[tuple[float, float] | None, LENGTH] = None

    @model_validator(mode="after")
    def _one_place(self):
        exactly_one(self, "where", "point")
        if self.name in _TAKEN:
            raise InputError(f"name = {self.name!r}", "is the name of a column of every run")
        return self

    def probe(self) -> Probe:
        return Probe(self.name, self.where, self.point)


class Expectation(Table):
    """A value within a relative or absolute tolerance, at the end or at a time [s]."""

    value: float
    relative: float | None = Field(None, gt=0)
    absolute: float | None = Field(None, gt=0)
    at: Annotated[float | None, TIME] = Field(None, ge=0)

    @model_validator(mode="before")
    @classmethod
    def _quoted(cls, data: Any) -> Any:
        for key, value in data.items() if isinstance(data, dict) else ():
            if isinstance(value, dict):
                remedy = f'A name with a dot needs quotes, as in "mean_displacement.{key}".'
                raise InputError(f"{key} = {value}", "unknown key", "", remedy)
        return data

    @model_validator(mode="after")
    def _one_tolerance(self):
        exactly_one(self, "relative", "absolute")
        if self.relative and self.value == 0:
            raise InputError("relative is given", "nothing is relative to 0", "", "Use absolute.")
        return self

    @property
    def tolerance(self) -> float:
        """Allowed difference, in the unit of the value."""
        return self.absolute or self.relative * abs(self.value)


class Interest(Table):
    """What a scene is run for; `studies/simplify/` holds simpler scenes against it.

    Names of probes and of columns, such as ``"tip"`` and ``"sag"``: their values at the `end`,
    where also ``"displacement"``, the field, may stand, their course over the run as a `path`, and
    the `period` of their swing. With nothing but `end` the way there does not matter.
    """

    end: tuple[str, ...] = ()
    path: tuple[str, ...] = ()
    period: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _something(self):
        if not (self.end or self.path or self.period):
            raise InputError("interest is empty", "must name a quantity under end, path or period")
        return self


def _listed(value: Any) -> Any:
    if isinstance(value, dict):
        return (value,)
    if not (isinstance(value, tuple) and value):
        raise InputError("", "must be a table { value = ... }, or a list of such tables")
    return value


Expectations = Annotated[tuple[Expectation, ...], BeforeValidator(_listed)]


# --- the tables of dataclasses: their fields are the keys -----------------------------------------


_LINEAR = Literal["auto", "direct", "pardiso", "superlu", "pcg"]
SolverTable = table_of(Newton, linear=(_LINEAR, "auto"))
_TERMS = {
    name: cls
    for name, cls in ((name, getattr(terms, name)) for name in terms.__all__)
    if dataclasses.is_dataclass(cls) and hasattr(cls, "bind")
}


def terms_with(own: Mapping[str, type]) -> Any:
    """The table of a term, of a type of the package's or of one's own.

    Raises
    ------
    InputError
        For an own type whose name is taken, or that is no dataclass with a `bind`.
    """
    for name, cls in own.items():
        if name in _TERMS:
            raise InputError(f"terms: {name!r}", "must not be a type of the package's", "load")
        if not (isinstance(cls, type) and dataclasses.is_dataclass(cls) and hasattr(cls, "bind")):
            allowed = "must be the class of a term: a dataclass with stencil and bind"
            raise InputError(f"terms: {name!r} = {brief(cls)}", allowed, "load")
    tables = {name: table_of(cls, name) for name, cls in (_TERMS | dict(own)).items()}
    term = one_of("type", tables)
    for table in tables.values():  # now that it is known, to those that hold another term
        table.model_rebuild(_types_namespace={"Term": term})
    return term


Term = terms_with({})
