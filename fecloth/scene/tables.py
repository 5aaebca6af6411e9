"""The tables [cloth], [[terms]] and [solver] of a scene file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

from fecloth import terms
from fecloth.errors import InputError, brief
from fecloth.nonlinear.options import Newton
from fecloth.scene.field_types import File
from fecloth.scene.pieces import Pieces
from fecloth.scene.pin_table import RotationTable
from fecloth.scene.shape_tables import Disk, MeshFile, Rectangle
from fecloth.scene.table_model import one_of, table_of
from fecloth.terms.contact import shapes

Shape: Any = one_of(
    "shape", {"rectangle": Rectangle, "disk": Disk, "file": MeshFile, "join": Pieces}
)


# --- the tables of dataclasses: their fields are the keys -----------------------------------------

_SHAPES = {name: getattr(shapes, name) for name in shapes.__all__ if name != "Shape"}
_ROTATE: dict[str, Any] = {"rotate": (RotationTable | None, None)}
ShapeTable: Any = one_of(
    "type", {name: table_of(cls, name, **_ROTATE) for name, cls in _SHAPES.items()}
)
_MORE: dict[
    type, dict[str, Any]
] = {  # fields that hold tables of their own, or a file beside the scene
    terms.Obstacle: {"shape": (ShapeTable, ...)},
    terms.MeshObstacle: {"path": (File, ...), **_ROTATE},
}

_LINEAR = Literal["auto", "direct", "pardiso", "superlu", "pcg", "multigrid"]
_THREADS = int | Literal["auto"]
SolverTable: Any = table_of(Newton, linear=(_LINEAR, "auto"), threads=(_THREADS, "auto"))
_TERMS: dict[str, Any] = {
    name: cls
    for name, cls in ((name, getattr(terms, name)) for name in terms.__all__)
    if dataclasses.is_dataclass(cls) and hasattr(cls, "bind")
}


def terms_with(own: Mapping[str, type]) -> Any:
    """Return the type of a [[terms]] table, for the package's terms and the user's own.

    A term may hold another term (the law of a damping), so the tables refer to their union by the
    name "Term", which is resolved at the end.

    Raises
    ------
    InputError
        For an own type with a name of the package, or that is no dataclass with a `bind`.
    """
    for name, cls in own.items():
        if name in _TERMS:
            raise InputError(
                f"terms: {name!r}", "must not be the name of a term of the package", "load_scene"
            )
        if not (isinstance(cls, type) and dataclasses.is_dataclass(cls) and hasattr(cls, "bind")):
            allowed = "must be the class of a term: a dataclass with stencil and bind"
            raise InputError(f"terms: {name!r} = {brief(cls)}", allowed, "load_scene")
    tables = {
        name: table_of(cls, name, **_MORE.get(cls, {}))
        for name, cls in (_TERMS | dict(own)).items()
    }
    term = one_of("type", tables)
    for table in tables.values():
        table.model_rebuild(_types_namespace={"Term": term})
    return term


Term: Any = terms_with({})
