"""A scene as a source of set-ups: values by their keys make tables, and tables make a set-up."""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from pydantic import ValidationError

from fecloth.errors import InputError, errors_of
from fecloth.fabric.fabric import Fabric
from fecloth.integrators import EXPLICIT
from fecloth.mesh.cloth import Cloth
from fecloth.scene.cloth_tables import Pieces
from fecloth.scene.scene import Scene, scene_of
from fecloth.scene.table_model import as_tuples
from fecloth.scene.toml_text import flatten, to_toml, with_values, without_empty
from fecloth.simulation.dimensionless import wave_speed
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.setup import Setup
from fecloth.terms.traits import traits_of

# Tables that change no result of a run: what it is called, and what is done with its results.
WITHOUT_EFFECT = ("title", "expect", "interest", "output", "uncertain", "measured")
# Tables whose numbers are no parameters, and why.
NO_PARAMETERS = {
    "cloth": "changes the mesh, so that nodes cannot be compared",
    "cloths": "changes the mesh, so that nodes cannot be compared",
    "time": "is a number of the method, not of the cloth",
    "equilibrium": "is a number of the method, not of the cloth",
    "solver": "is a number of the solver, not of the cloth",
    **dict.fromkeys(
        ("output", "probes", "expect", "interest", "uncertain", "measured"),
        "changes no motion of the cloth",
    ),
}
SHARED = ("h", "element", "pattern")  # keys of [cloth] that several pieces share
PARAMETERS = ("fabric", "fabrics", "terms")  # tables whose numbers are the usual parameters
TRIANGLES = {"right": 2.0, "cross": 4.0}  # triangles per h²
EQUILATERAL = 4 / math.sqrt(3)  # triangles per h² of any other mesh
STABLE_STEP = 0.4  # stable step of central differences over h / wave speed, as with StVK
COARSEST = 30  # edge length over h of the first mesh that is tried for the area of a shape


@dataclass(frozen=True, eq=False)
class SceneSource:
    """A scene whose values a study changes.

    Attributes
    ----------
    scene
        The scene.
    name
        Its title, or the name of its file.
    where
        What errors name: the name of the file, if there is one.
    keys
        The key of each value that studies vary, by the name that studies have for it.
    usual_variations
        The names among them that a study varies without being told so.
    """

    scene: Scene
    name: str
    where: str = "the scene"

    kind: ClassVar[str] = "scene"
    usual_variations: ClassVar[tuple[str, ...]] = ("method", "element", "pattern")
    tells_method: ClassVar[bool] = True  # before a set-up is made
    missing: ClassVar[tuple[str, ...]] = ()  # all values of a scene are known
    is_importable: ClassVar[bool] = True  # other processes can read its tables
    keys: ClassVar[Mapping[str, str]] = {
        "h": "cloth.h",
        "dt": "time.dt",
        "rtol": "time.rtol",
        "method": "time.method",
        "element": "cloth.element",
        "pattern": "cloth.pattern",
        "grading": "cloth.grading",
        "load_steps": "equilibrium.load_steps",
        "terms": "terms",
    }
    suffix: ClassVar[str] = "toml"  # of a file with its text

    @cached_property
    def tables(self) -> dict:
        """The tables of the scene, with all defaults and absolute paths."""
        return self.scene.to_tables()

    @property
    def pieces(self) -> dict[str, Any]:
        """By key, the tables of the cloth: one, or those of its pieces."""
        cloth = self.scene.cloth
        if not isinstance(cloth, Pieces):
            return {"cloth": cloth}
        return {f"cloth.pieces.{name}": piece for name, piece in cloth.pieces.items()}

    @property
    def h(self) -> float | None:
        """Edge length [m], of several pieces the largest; None where there is none to refine."""
        sizes = [piece.h for piece in self.pieces.values()]
        return None if None in sizes else max(sizes)

    @property
    def dt(self) -> float | None:
        """Fixed step [s]; None where there is none."""
        dt = self.tables.get("time", {}).get("dt", "auto")
        return None if dt == "auto" else dt

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.scene.probes)

    @property
    def interest(self) -> tuple[Quantity, ...]:
        """The quantities of [interest]."""
        if self.scene.interest:
            return tuple(self.scene.interest.all)
        return ()

    @property
    def span(self) -> float | None:
        """Length of the run [s]; None for an equilibrium."""
        if self.scene.equilibrium:
            return None
        return self.scene.time.t_end - self.scene.time.t_start

    @property
    def has_stable_steps(self) -> bool:
        """Whether the steps follow from the limit of an explicit method."""
        time = self.scene.time
        return self.is_explicit and time.dt == "auto" and time.rtol is None

    @property
    def is_explicit(self) -> bool:
        """Whether the steps solve no equations."""
        return self.method in EXPLICIT

    @property
    def method(self) -> str:
        """The name of the method; "" of an equilibrium."""
        return "" if self.scene.equilibrium else self.scene.time.method.type

    @property
    def fabrics(self) -> dict[str, Fabric]:
        """The fabrics by the keys of their tables."""
        several = (self.scene.fabrics or {}).items()
        tables = {"fabric": self.scene.fabric} | {f"fabrics.{name}": t for name, t in several}
        return {name: table.make() for name, table in tables.items() if table}

    def changed(self, values: Mapping[str, Any], name: str = "") -> "SceneSource":
        """Return the source with other values by key; None removes a key.

        Another element takes its usual mass; an explicit method keeps the lumped one. If the
        values are refused, `InputError` names the change: by `name`, or by the values.
        """
        words = name or describe_values(values)
        with errors_of(f"{self.where} with {words}"):
            changed = {**self._of_pieces(values), **self._mass_for(values)}
            tables = with_values(self._tables_for(values), changed)
            _let_frames_follow_steps(tables)
            return replace(self, scene=scene_of(tables, self.scene.trusts_geo))

    def _of_pieces(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by key with those of [cloth] for each piece: h in their ratios."""
        spread = dict[str, Any]()
        for key, value in values.items():
            table, _, name = key.partition(".")
            if table != "cloth" or name not in SHARED or "cloth" in self.pieces:
                spread[key] = value
                continue
            for own, piece in self.pieces.items():
                if hasattr(piece, name):
                    spread[f"{own}.{name}"] = value * piece.h / self.h if name == "h" else value
        return spread

    def _mass_for(self, values: Mapping[str, Any]) -> dict[str, None]:
        """Return the value that removes the mass, where another element takes its usual one."""
        given = {key.replace(" ", ""): value for key, value in values.items()}
        method = given.get("time.method", self.method)
        if isinstance(method, Mapping):
            method = method.get("type")
        element = getattr(next(iter(self.pieces.values())), "element", None)
        if given.get("cloth.element", element) == element or "mass" in given or method in EXPLICIT:
            return {}
        return {"mass": None}

    def _tables_for(self, values: Mapping[str, Any]) -> dict:
        """Return the tables to which values are applied.

        They are the tables of the scene with all defaults. But a term that changes its type has
        only the keys that the user wrote, because all others are defaults of its old type.
        """
        if not self.scene.terms:
            return self.tables
        keys = [key.replace(" ", "") for key in values]  # "terms . 0 . type" is allowed
        terms = []
        for i, term in enumerate(self.scene.terms):
            table = self.tables["terms"][i]
            if f"terms.{i}.type" in keys:
                table = {key: table[key] for key in table if key in term.model_fields_set}
            terms.append(table)
        return self.tables | {"terms": terms}

    def interested_in(self, quantities: Sequence[str]) -> "SceneSource":
        """Return the source with these quantities as [interest]."""
        return self.changed({"interest": {"quantities": list(quantities)}})

    def values_of(self, choice: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values by key of a choice by the names of `keys`, and what goes with it.

        An explicit method takes its stable step and a lumped mass. A fixed step, and a tolerance
        of chosen steps, take the place of the other. With "model" each membrane becomes a term
        of this type, with its defaults.
        """
        values = dict[str, Any]()
        method = choice.get("method")
        if method in EXPLICIT:
            values |= {"mass": "lumped", "solver": None}
        if self.scene.time and (method in EXPLICIT or {"dt", "rtol"} & choice.keys()):
            values |= {"time.dt": "auto"}
            values |= dict.fromkeys(("time.rtol", "time.atol", "time.longest"))
        if model := choice.get("model"):
            values["terms"] = [self._as_model(i, model) for i in range(len(self.scene.terms))]
        if method and method == self.method:
            choice = {name: value for name, value in choice.items() if name != "method"}
        named = {name: value for name, value in choice.items() if name != "model"}
        return values | {self.keys[name]: value for name, value in named.items()}

    def _as_model(self, number: int, model: str) -> dict:
        """Return the table of a term; of a membrane with another model in its place."""
        term = self.scene.terms[number]
        if traits_of(term.make()).kind == "membrane" and term.type != model:
            return {"type": model}
        return self.tables["terms"][number]

    def setup(self, cloth: Cloth | None = None) -> Setup:
        """Build the scene, on the cloth if it is given.

        The setup has no frames of [output], so that no step has to end at the time of a frame.
        """
        built = self.scene.build(cloth)
        return Setup(
            system=built.system,
            start=built.start,
            steps=built.steps,
            t_end=built.t_end,
            newton=built.newton,
            linear=built.linear,
            probes=built.probes,
        )

    def setup_on(self, values: Mapping[str, Any], base: Setup) -> Setup:
        """Return the set-up with other values, with as much of `base` as stays the same.

        Of a scene whose values are all of fabrics and terms, only these are made again. If they
        are refused, the whole scene is read, which says what is wrong.
        """
        if all(name.partition(".")[0] in PARAMETERS for name in values):
            with suppress(ValidationError):
                return replace(base, system=base.system.replace(**self._fabric_and_terms(values)))
        return self.changed(values).setup(base.cloth)

    def _fabric_and_terms(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments of `System` for the tables of `PARAMETERS`, with other values.

        Raise `ValidationError` if a table does not allow its value.
        """
        scene = self.scene
        own = {name: table for name, table in self.tables.items() if name in PARAMETERS}
        tables = as_tuples(without_empty(with_values(own, values)))
        own = as_tuples(without_empty(own))

        def make(model: Any, table: dict, own_table: dict) -> Any:
            if table == own_table:
                return model.make()
            return type(model).model_validate(table, context={"folder": Path()}).make()

        terms = list(map(make, scene.terms, tables.get("terms", ()), own.get("terms", ())))
        if scene.fabric:
            fabric: Any = make(scene.fabric, tables["fabric"], own["fabric"])
        else:
            fabric = {
                name: make(model, tables["fabrics"][name], own["fabrics"][name])
                for name, model in (scene.fabrics or {}).items()
            }
        return {"terms": terms, "fabric": fabric}

    @cached_property
    def cloth(self) -> Cloth:
        """The cloth alone."""
        return self.scene.mesh()

    def numbers(self) -> Iterator[tuple[str, float]]:
        """Yield the key and the value of each number that may be a parameter.

        Whole numbers are left out, because they count something, and so are the uncertainties of
        numbers of a fabric, on which no result depends.
        """
        for name, value in flatten(self.tables).items():
            is_left_out = name.partition(".")[0] in NO_PARAMETERS or ".uncertainty." in name
            if isinstance(value, float) and math.isfinite(value) and not is_left_out:
                yield name, value

    def has_parameter(self, name: str) -> bool:
        """Whether a name is the key of a number, or of a list or table of numbers."""
        return any(f"{key}.".startswith(f"{name}.") for key, _ in self.numbers())

    def is_usual_parameter(self, name: str) -> bool:
        """Whether a number is a parameter if none is named: one of fabric or terms."""
        return name.partition(".")[0] in PARAMETERS

    def refuse_parameter(self, name: str) -> None:
        """Raise `InputError` for a number of the mesh, the steps, the solver or the files."""
        table = name.partition(".")[0]
        if reason := NO_PARAMETERS.get(table):
            remedy = ""
            if table.startswith("cloth"):
                remedy = "A function of Python may move the nodes of the same triangles."
            elif table in ("time", "solver", "equilibrium") and name != "time.t_end":
                # not for t_end, because `converge` finds no error of it
                remedy = "fecloth converge says what its error is."
            raise InputError(f"parameter {name!r}", reason, "sensitivity", remedy)

    def refuse_refining(self, size: str) -> None:
        """Raise `InputError` that says why there is no h, or no fixed dt, to refine."""
        if size == "h":
            fixed = next((key for key, piece in self.pieces.items() if piece.h is None), "cloth")
            remedy = "Give a .geo file and h, or a shape."
            raise InputError(
                "a mesh of one size", f"has no {fixed}.h to refine", self.where, remedy
            )
        if self.scene.equilibrium:
            raise InputError("refine = 'dt'", "an equilibrium has no dt", self.where)
        remedy = "Give time.dt; or refine h, or dt alone: then each step is halved."
        raise InputError('dt = "auto"', "cannot be refined with h", self.where, remedy)

    def text(self) -> str:
        """Return the scene as TOML."""
        return to_toml(self.tables)

    @property
    def file_text(self) -> str:
        """The text of a scene's file: the scene."""
        return self.text()

    def case(self) -> dict[str, object]:
        """Return all that determines a run, as JSON values."""
        tables = {key: value for key, value in self.tables.items() if key not in WITHOUT_EFFECT}
        if "fabric" in tables:
            tables["fabric"] = _constants(tables["fabric"])
        if "fabrics" in tables:
            fabrics = tables["fabrics"].items()
            tables["fabrics"] = {name: _constants(fabric) for name, fabric in fabrics}
        return {
            "tables": tables,
            "digest": digest_of_files(self.scene),
            "trust_geo": self.scene.trusts_geo,
        }

    @classmethod
    def of_case(cls, tables: dict, digest: str, trust_geo: bool) -> "SceneSource":
        """Return the source of a case, as `case` has written it.

        `digest` is not used here: it is in the case so that an edited file that the scene reads
        makes another case.
        """
        return cls(scene_of(tables, trust_geo), "scene")

    def has_shape_of(self, other: Any) -> bool:
        """Whether the meshes differ in h alone, so that the number of triangles follows from h.

        `other` is the source that this one was made of.
        """
        alike = {key: piece.model_copy(update={"h": None}) for key, piece in self.pieces.items()}
        others = other.pieces.items()
        return alike == {key: piece.model_copy(update={"h": None}) for key, piece in others}

    def count_triangles(self) -> float:
        """Estimate the number of triangles from area and h, without gradings or the mesh."""
        if self.h is None:
            return len(self.cloth.triangles)
        return sum(
            self._estimate_area(piece)
            / piece.h**2
            * TRIANGLES.get(getattr(piece, "pattern", ""), EQUILATERAL)
            for piece in self.pieces.values()
        )

    def _estimate_area(self, cloth: Any) -> float:
        """Return the area of a piece, or of the whole cloth [m²], from its table.

        For a shape without a formula it is the area of a coarse mesh, which is made quickly: first
        with 30 h, then with ever finer edges until the shape can be meshed. Raise `InputError` if
        it cannot be meshed with h either.
        """
        if cloth.shape == "rectangle":
            return cloth.width * cloth.height
        if cloth.shape == "disk":
            return math.pi * cloth.radius**2
        factor = float(COARSEST)
        while factor > 1:
            try:
                return cloth.model_copy(update={"h": factor * cloth.h}).cloth().area
            except InputError:  # too coarse for a shape with small parts
                factor /= 2
        return self.cloth.area  # raises the error with its place in the scene

    def count_stable_steps(self, triangles: float) -> float:
        """Estimate the number of stable steps of an explicit method on so many triangles.

        The stable step is in proportion to h / c, with the speed c of waves of stretching in the
        stiffest fabric, and the smallest h of all gradings.
        """
        speed = max(wave_speed(fabric) for fabric in self.fabrics.values())
        usual = math.sqrt(EQUILATERAL * self.cloth.area / triangles)
        shortest = usual
        for piece in self.pieces.values():
            h = piece.h or usual
            smallest = [table.make().smallest(h) for table in getattr(piece, "grading", ())]
            shortest = min(shortest, h * min([1.0, *smallest]))
        assert self.span is not None
        return math.ceil(self.span * speed / (STABLE_STEP * shortest))


def describe_values(values: Mapping[str, object]) -> str:
    """Return "key = value, key = value"."""
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def _let_frames_follow_steps(tables: dict) -> None:
    """Make the frames of [output], in the tables of a scene, no more frequent than the steps."""
    dt = (tables.get("time") or {}).get("dt", "auto")  # None: the table is removed
    every = (tables.get("output") or {}).get("every")
    if isinstance(dt, float) and every and every < dt:
        tables["output"] = tables["output"] | {"every": dt}


def _constants(fabric: dict) -> dict:
    """Return the table of a fabric without its uncertainty, which changes no result."""
    return {key: value for key, value in fabric.items() if key != "uncertainty"}


def digest_of_files(scene: Scene) -> str:
    """Return a hash of the contents of the files that the scene reads.

    These are the mesh, the start and tables of terms. So an edited file makes another case.
    """
    digest = hashlib.sha256()
    paths = [getattr(scene.cloth, "path", None), scene.start.frame]
    paths += [dict(term).get("path") for term in scene.terms]
    paths += getattr(scene.cloth, "paths", ())
    for path in paths:
        digest.update(Path(path).read_bytes() if path else b"-")  # "-": no file in this place
    return digest.hexdigest()[:12]
