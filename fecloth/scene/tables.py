"""The tables [cloth], [[terms]] and [solver] of a scene file."""

import dataclasses
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict

from fecloth import terms
from fecloth.errors import InputError, brief
from fecloth.nonlinear.options import Newton
from fecloth.quantities.rotation import Rotation
from fecloth.scene.cloth_tables import Disk, MeshFile, Pieces, Rectangle
from fecloth.scene.field_types import File
from fecloth.scene.placement import RotationTable
from fecloth.scene.table_model import Made, one_of, table_of
from fecloth.terms.contact import shapes
from fecloth.terms.protocol import is_description

Shape: Any = one_of(
    "shape", {"rectangle": Rectangle, "disk": Disk, "file": MeshFile, "join": Pieces}
)


_SHAPES = {name: getattr(shapes, name) for name in shapes.__all__ if name != "Shape"}
_TURNED: dict[Any, Any] = {Rotation | None: (RotationTable | None, None)}


def _more(cls: type, tables: Mapping[Any, Any]) -> dict[str, Any]:
    """The fields of a class that hold tables of their own, or a file beside the scene."""
    hints = typing.get_type_hints(cls, include_extras=True)
    found = ((name, kind) for name, hint in hints.items() for kind in tables if kind == hint)
    return {name: tables[kind] for name, kind in found}


SHAPE_TABLES = {name: table_of(cls, name, **_more(cls, _TURNED)) for name, cls in _SHAPES.items()}
ShapeTable: Any = one_of("type", SHAPE_TABLES)
_FIELDS = _TURNED | {shapes.Shape: (ShapeTable, ...), str | Path: (File, ...)}

_NewtonFields: Any = table_of(Newton)  # a base class made at run time


class SolverTable(_NewtonFields):
    """Newton's iteration, the linear solver, and threads."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    linear: Literal["auto", "direct", "pardiso", "superlu", "pcg", "multigrid"] = "auto"
    """The linear solver."""
    threads: int | Literal["auto"] = "auto"
    """Threads that share all loops: a number, or "auto"."""


_TERMS: dict[str, Any] = {
    name: cls
    for name, cls in ((name, getattr(terms, name)) for name in terms.__all__)
    if dataclasses.is_dataclass(cls) and is_description(cls)
}


def terms_with(own: Mapping[str, type]) -> tuple[dict[str, type[Made]], Any]:
    """Return the tables of the package's terms and the user's own by name, and their union."""
    # A term may hold another term (the law of a damping), so the tables refer to their union by the
    # name "Term", which is resolved at the end.
    for name, cls in own.items():
        if name in _TERMS:
            raise InputError(
                f"terms: {name!r}", "must not be the name of a term of the package", "load_scene"
            )
        is_class = isinstance(cls, type) and dataclasses.is_dataclass(cls)
        if not (is_class and is_description(cls)):
            allowed = "must be the class of a term: a dataclass with stencil and bind"
            raise InputError(f"terms: {name!r} = {brief(cls)}", allowed, "load_scene")
    tables = {
        name: table_of(cls, name, **_more(cls, _FIELDS))
        for name, cls in (_TERMS | dict(own)).items()
    }
    term = one_of("type", tables)
    for table in tables.values():
        table.model_rebuild(_types_namespace={"Term": term})
    return tables, term


TERM_TABLES: dict[str, type[Made]]
Term: Any
TERM_TABLES, Term = terms_with({})
