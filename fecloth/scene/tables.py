"""The tables [cloth], [fabric], [[terms]] and [solver] of a scene file.

The table [fabric] has constants, a preset, or readings of an instrument.
"""

import dataclasses
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ValidationInfo, WithJsonSchema, model_validator

from fecloth import terms
from fecloth.errors import InputError, brief, errors_of
from fecloth.fabric import presets
from fecloth.fabric.fabric import Fabric, constants_in
from fecloth.fabric.merging import merged
from fecloth.fabric.uncertainty import CONSTANTS, OF_CURVES, PAIRS, Uncertainty
from fecloth.nonlinear.options import Newton
from fecloth.quantities.rotation import Rotation
from fecloth.scene.cloth_tables import Disk, MeshFile, Pieces, Rectangle
from fecloth.scene.field_types import File, resolve_path
from fecloth.scene.placement import RotationTable
from fecloth.scene.table_model import TERM, Made, one_of, table_of
from fecloth.system.seams import Seam
from fecloth.terms.contact import shapes
from fecloth.terms.membranes.curves import CurveData, read_rows
from fecloth.terms.protocol import is_description
from fecloth.validation import file_problem

Shape: Any = one_of(
    "shape", {"rectangle": Rectangle, "disk": Disk, "file": MeshFile, "join": Pieces}
)
_SHAPES = {name: getattr(shapes, name) for name in shapes.__all__ if name != "Shape"}
_TURNED: dict[Any, Any] = {Rotation | None: (RotationTable | None, None)}


def _read_curve(value: Any, info: ValidationInfo) -> Any:
    """Replace the name of a file by its rows, which copies of the scene then contain."""
    if isinstance(value, str):
        return read_rows(info.field_name or "", resolve_path(value, info))
    return value


_Curve: Any = Annotated[
    str | dict[str, float | tuple[float, ...]] | tuple[tuple[float, float], ...] | None,
    AfterValidator(_read_curve),
]


def _find_nested(cls: type, tables: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the fields of a class whose type is a key of `tables`, with its value for them.

    They hold tables of their own, or a file beside the scene.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    pairs = ((name, kind) for name, hint in hints.items() for kind in tables if kind == hint)
    return {name: tables[kind] for name, kind in pairs}


SHAPE_TABLES = {
    name: table_of(cls, name, **_find_nested(cls, _TURNED)) for name, cls in _SHAPES.items()
}
ShapeTable: Any = one_of("type", SHAPE_TABLES)
_FIELDS = _TURNED | {shapes.Shape: (ShapeTable, ...), str | Path: (File, ...)}
_FIELDS |= {CurveData | None: (_Curve, None)}

SeamTable: Any = table_of(Seam, first=(str, ...), second=(str, ...))

_NewtonFields: Any = table_of(Newton)  # a base class made at run time


class SolverTable(_NewtonFields):
    """Newton's iteration, the linear solver, and threads."""

    model_config: ClassVar = {"use_attribute_docstrings": True}

    linear: Literal["auto", "direct", "pardiso", "rslab", "superlu", "pcg", "multigrid"] = "auto"
    """The linear solver."""
    threads: int | Literal["auto"] = "auto"
    """Threads that share all loops: a number, or "auto"."""


_TERMS: dict[str, Any] = {
    name: cls
    for name, cls in ((name, getattr(terms, name)) for name in terms.__all__)
    if dataclasses.is_dataclass(cls) and is_description(cls)
}


def terms_with(own: Mapping[str, type]) -> tuple[dict[str, type[Made]], Any]:
    """Return the table of each type of term by its name, and the type of a table of any term.

    The types of terms are those of the package and the user's `own`. Raise `InputError` for an
    own type with the name of a term of the package, or that is no class of a term.

    A term may hold another term (the law of a damping), so the tables refer to the type of any
    term by the name "Term", which is resolved at the end.
    """
    for name, cls in own.items():
        if name in _TERMS:
            raise InputError(
                f"terms: {name!r}", "must not be the name of a term of the package", "load_scene"
            )
        if not (isinstance(cls, type) and dataclasses.is_dataclass(cls) and is_description(cls)):
            allowed = "must be the class of a term: a dataclass with stencil and bind"
            raise InputError(f"terms: {name!r} = {brief(cls)}", allowed, "load_scene")
    tables = {
        name: table_of(cls, name, **_find_nested(cls, _FIELDS))
        for name, cls in (_TERMS | dict(own)).items()
    }
    term = one_of("type", tables)
    for table in tables.values():
        types = (typing.get_args(field.annotation) for field in table.model_fields.values())
        if any(TERM in of_field for of_field in types):
            table.model_rebuild(_types_namespace={"Term": term})
    return tables, term


TERM_TABLES: dict[str, type[Made]]
Term: Any
TERM_TABLES, Term = terms_with({})


def _check_uncertain(table: dict | None) -> dict | None:
    uncertainty = Uncertainty.read(table)
    if uncertainty is None:
        return None
    return uncertainty.table()


_KEYS = [
    *CONSTANTS,
    *(f"{key}.{i}" for key in PAIRS for i in "01"),
    "correlation",
    "source",
    *OF_CURVES,
]
_SCHEMA = {
    "type": "object",
    "properties": {key: {} for key in _KEYS},
    "additionalProperties": False,
}
_check: Any = AfterValidator(_check_uncertain)
_Uncertain: Any = Annotated[dict | None, _check, WithJsonSchema(_SCHEMA)]
# a base class made at run time
_FabricFields: Any = table_of(Fabric, uncertainty=(_Uncertain, None))


class Shorthands(BaseModel, use_attribute_docstrings=True):
    """Keys of [fabric] that constants replace when it is read."""

    preset: str | None = None
    """Name of a published fabric, which gives the constants that are left out."""
    file: str | None = None
    """A TOML file beside the scene whose [fabric] gives the constants that are left out, and whose
    [[terms]] what terms of these types leave out."""
    kes: dict | None = None
    """What a KES-F instrument prints; see `fecloth/fabric/README.md`."""
    fast: dict | None = None
    """What a FAST instrument prints; see `fecloth/fabric/README.md`."""


class FabricTable(_FabricFields):
    """A fabric's constants. A ``preset``, a ``file``, ``kes`` or ``fast`` gives the others.

    `kes` and `fast` have the fields of `Fabric.from_kes` and `Fabric.from_fast`, in the
    units of the instruments, with `load` and `tensile` among them.
    """

    shorthands: ClassVar = Shorthands.model_fields

    @model_validator(mode="before")
    @classmethod
    def _fill_from_shorthand(cls, data: Any, info: ValidationInfo) -> Any:
        """Return the table with constants in place of a name or of the key of a shorthand.

        Constants that the table itself has go before those of the shorthand. Raise `InputError`
        for several shorthands, or for one that gives no constants.
        """
        if isinstance(data, str):  # fabric = "cotton"
            data = {"preset": data}
        if not isinstance(data, dict):
            return data
        used = [key for key in cls.shorthands if key in data]
        if len(used) > 1:
            raise InputError(f"{used[0]} and {used[1]} are given", "give one of them")
        own_constants = {key: value for key, value in data.items() if key not in used}
        if not used:
            return own_constants
        folder = Path((info.context or {}).get("folder", "."))
        constants = _constants_of_shorthand(used[0], data[used[0]], folder)
        replaced = set(own_constants)
        if "bending_rigidity" in own_constants:
            # The shorthand's rigidity on the bias belongs to its rigidities along the yarns.
            constants.pop("bias_rigidity", None)
            replaced.add("bias_rigidity")
        if uncertainty := constants.get("uncertainty"):
            # The shorthand's uncertainty of a constant that was replaced does not count.
            own_uncertainty = own_constants.get("uncertainty") or {}
            own_constants["uncertainty"] = merged(uncertainty, replaced, own_uncertainty)
        return {**constants, **own_constants}


def _constants_of_shorthand(key: str, value: Any, folder: Path) -> dict:
    """Return the constants of a fabric that a shorthand of [fabric] gives.

    `key` is the shorthand: "preset", "file", "kes" or "fast"; `value` is what the scene has at
    this key, and the `folder` that of the scene. Raise `InputError` for a preset or a file that
    does not exist, and for readings from which no fabric can be made.
    """
    if key == "preset":
        return presets.constants(value)
    if key == "file":
        return _from_file(value, folder)
    if not isinstance(value, dict):
        allowed = 'must be a table of instrument readings, as in { W = 20.0, "2HB" = 0.05 }'
        raise InputError(f"{key} = {brief(value)}", allowed)
    make_fabric, names_of_settings = _INSTRUMENTS[key]
    settings = {name: value[name] for name in names_of_settings if name in value}
    readings = {name: reading for name, reading in value.items() if name not in settings}
    with errors_of("", f"{key}."):
        return dataclasses.asdict(make_fabric(readings, **settings))


def _from_file(name: Any, folder: Path) -> dict:
    """Return the constants of a file; its path is relative to the folder of the scene."""
    if not isinstance(name, str):
        raise InputError(f"file = {brief(name)}", "must be the path of a TOML file")
    if problem := file_problem(folder / name):
        reason, remedy = problem
        raise InputError(f"file = {name!r}", f"{folder / name}: {reason}", remedy=remedy)
    with errors_of("", f"file = {name!r}: "):
        return constants_in(folder / name)


# The constructor of a fabric, and the names of its arguments beside the readings.
_INSTRUMENTS: dict[str, tuple[Callable[..., Fabric], tuple[str, ...]]] = {
    "kes": (Fabric.from_kes, ("load", "tensile")),
    "fast": (Fabric.from_fast, ("load",)),
}
