"""Scenes: a strict TOML file that names a cloth, a fabric, terms, pins, a start and a method.

Scenes mirror the Python calls: the keys of a term, the fabric or the solver are the fields of
the classes in `fecloth.terms`, of `Fabric` and of `Newton`, with the same units. Numbers and
values of formulas are in SI; a text may be a number with another unit of the same dimension,
as in ``dt = "5 ms"`` (see `units`). Each table is described where it is defined: `tables`,
`cloth_tables`, `placement`, `schedule` and `probe_tables`.
"""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr, ValidationError, create_model, model_validator

from fecloth.errors import InputError, SceneError
from fecloth.linalg.direct import Direct
from fecloth.linalg.protocol import LinearSolver
from fecloth.mesh.child_process import TIME_LIMIT
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.options import Newton
from fecloth.quantities import toml_file
from fecloth.scene import tables, toml_text
from fecloth.scene.build import build
from fecloth.scene.cloth_tables import join_pieces
from fecloth.scene.error_words import errors_at, scene_error
from fecloth.scene.fitted import with_fitted_terms
from fecloth.scene.placement import PinTable, Start
from fecloth.scene.probe_tables import (
    Expectations,
    Interest,
    ProbeTable,
    names_of_measured,
    refuse_times,
)
from fecloth.scene.problem import Problem
from fecloth.scene.schedule import EquilibriumTable, Output, Time
from fecloth.scene.table_model import Table, as_tuples, require_exactly_one
from fecloth.scene.tables import FabricTable
from fecloth.scene.toml_text import override
from fecloth.simulation.answer import places_of
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.system.system import System
from fecloth.terms.bending.friction import LOAD_STEPS


class Scene(Table):
    """A checked scene file: its tables with all defaults.

    Two scenes are equal if their tables are equal, whatever their files.
    """

    title: str | None = None
    """A name for reports."""
    mass: Literal["lumped", "consistent"] | None = None
    """How the mass is put on the nodes. The default is "lumped" for P1, "consistent" for P2.
    Explicit methods need "lumped"."""
    cloth: tables.Shape
    """The cloth: shape and mesh."""
    fabric: FabricTable | None = None
    """The fabric of the whole cloth: a table, or the name of a published fabric."""
    fabrics: dict[str, FabricTable] | None = None
    """In place of `fabric`: a fabric for each region, as in [fabrics.body]."""
    grain_degrees: float | dict[str, float] = 0.0
    """Angle from X to the warp [degrees]: a number, or a number for each region."""
    terms: tuple[tables.Term, ...] = ()
    """Forces and energies, as [[terms]]; a scene has the terms that it names, and no others."""
    pins: tuple[PinTable, ...] = ()
    """What holds or moves nodes, as [[pins]]."""
    seams: tuple[tables.SeamTable, ...] = ()
    """Edges that are sewn together, as [[seams]]."""
    start: Start = Start()
    """Where the cloth starts."""
    time: Time = None  # type: ignore[assignment]  # None if static
    """Method, step and duration of a motion."""
    equilibrium: EquilibriumTable | None = None
    """In place of `time`: the scene is static."""
    solver: tables.SolverTable = tables.SolverTable()
    """Newton's iteration and the linear solver."""
    output: Output = Output(frames=50)
    """When frames and restart files are written."""
    probes: tuple[ProbeTable, ...] = ()
    """Points whose path is recorded, as [[probes]]."""
    expect: dict[str, Expectations] = Field({})
    """What `fecloth check` verifies: names of columns, each with an expectation."""
    interest: Interest | None = None
    """The quantities of interest: what a run answers at its end, and studies compare."""
    uncertain: dict = Field({})
    """For `fecloth budget`: standard uncertainties of numbers by key, as "10 %"
    or in their units; start = 5 for disturbed starts."""
    measured: dict = Field({})
    """By quantity, the measured value and its standard uncertainty, as ["36 mm", "2 %"]: numbers
    in SI or with a unit. A run shows them beside its own; `fecloth budget` compares them."""

    _source: str = PrivateAttr("scene")
    _arguments: tuple[str, ...] = PrivateAttr(())
    _text: str = PrivateAttr("")
    _trusts_geo: bool = PrivateAttr(False)
    _mesh_time: float = PrivateAttr(TIME_LIMIT)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.model_dump() == other.model_dump()

    @model_validator(mode="before")
    @classmethod
    def _set_defaults(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return the tables with tuples for lists, and with the default of `mass`.

        It is "consistent" for P2 elements and "lumped" for P1; of a mesh file that may say the
        element it is known later. Raise `InputError` for a scene with both [time] and
        [equilibrium].
        """
        data = as_tuples(data)
        _refuse_time_with_equilibrium(data)
        cloth = data.get("cloth")
        if not isinstance(cloth, dict):  # a mistake, which the field `cloth` refuses
            return data
        piece: Any = cloth
        if isinstance(cloth.get("pieces"), dict):  # all have one element: the first one tells it
            piece = next(iter(cloth["pieces"].values()), {})
        if not isinstance(piece, dict) or (piece.get("shape") == "file" and "element" not in piece):
            return data
        data.setdefault("mass", "consistent" if piece.get("element") == "P2" else "lumped")
        return data

    @model_validator(mode="after")
    def _check_tables_together(self):
        """Raise `InputError` for tables of which each is valid, but not beside the others.

        In a static scene also set the load steps that friction needs.
        """
        require_exactly_one(self, "fabric", "fabrics")
        if self.fabrics == {}:
            raise InputError("fabrics = {}", "must name a region, as in [fabrics.body]")
        if isinstance(self.cloth, tables.Pieces) and self.start.places:
            remedy = "Write [cloths.NAME.start] for each piece."
            what = f"start.{self.start.places[0]} is given"
            raise InputError(what, "is for one piece", remedy=remedy)
        names = [probe.name for probe in self.probes]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise InputError(f"probes.{i}.name = {name!r}", "two probes need two names")
        require_exactly_one(self, "time", "equilibrium")
        if self.equilibrium:
            self._refuse_time()
            self._set_steps_for_friction(self.equilibrium)
        if self.schedule.dt != "auto" and self.output.every and self.output.every < self.time.dt:
            allowed = f"must be at least time.dt = {self.time.dt} [s]"
            raise InputError(f"output.every = {self.output.every}", allowed)
        return self

    def _refuse_time(self) -> None:
        """Raise `InputError` for keys that only a scene with [time] may have.

        These are velocities, intervals in seconds, solvers that need a mass, and options of
        Newton's iteration.
        """
        static = "needs [time]: this scene has [equilibrium]"
        if self.start.velocity:
            raise InputError("start.velocity is given", static, remedy="Leave it out.")
        instead_of = {"every": "frames or every_steps", "restart_every": "restart_steps"}
        for key, instead in instead_of.items():
            if getattr(self.output, key):
                raise InputError(f"output.{key} is given", static, remedy=f"Use {instead}.")
        if self.solver.linear in ("pcg", "multigrid"):
            remedy = "Leave it out, or take direct, pardiso, rslab or superlu."
            raise InputError(f'solver.linear = "{self.solver.linear}"', static, remedy=remedy)
        if self.solver.make() != Newton():
            remedy = "Its tolerance and max_iterations are keys of [equilibrium]; leave others out."
            raise InputError("[solver] has more than linear", static, remedy=remedy)

    def _set_steps_for_friction(self, static: EquilibriumTable) -> None:
        """Set `equilibrium` to at least `LOAD_STEPS` load steps if a fabric has friction.

        Friction inside a fabric depends on the path, so the loads must grow in small steps.
        Raise `InputError` if friction is to be shaken out where no term has any.
        """
        if self.fabric:
            fabrics = [self.fabric]
        else:
            fabrics = list((self.fabrics or {}).values())
        has_friction = any(term.type == "BendingFriction" for term in self.terms)
        if static.friction != "laid" and not has_friction:
            what = f'equilibrium.friction = "{static.friction}"'
            allowed = "needs BendingFriction"
            raise InputError(what, allowed, remedy='Add { type = "BendingFriction" } to terms.')
        # A fabric without hysteresis has no friction, also with the term.
        if has_friction and any(any(fabric.make().hysteresis or ()) for fabric in fabrics):
            number = max(static.load_steps, LOAD_STEPS)
            in_small_steps = static.model_copy(update={"load_steps": number})
            object.__setattr__(self, "equilibrium", in_small_steps)

    @property
    def schedule(self) -> Time | EquilibriumTable:
        """The table [time], or [equilibrium] of a static scene: what t is, and the steps."""
        return self.equilibrium or self.time

    def require_expectations(self) -> None:
        """Raise `SceneError` if [expect] is empty or has a time outside the run.

        The command `check` asks for this. `run` allows a run that is shorter than [expect].
        """
        if not self.expect:
            remedy = "Add one, as in: sag = { value = 0.1, relative = 0.01 }"
            raise SceneError("no [expect] table", "nothing to check", self._source, remedy)
        course = self.schedule
        refuse_times(self.expect, course.t_start, course.t_end, self._source, course.unit)

    @property
    def source(self) -> str:
        """The file and the overrides that the scene was read from, for messages."""
        return self._source

    @property
    def trusts_geo(self) -> bool:
        """Whether the .geo file that it names may hold any command."""
        return self._trusts_geo

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities that a run answers: those of [interest], and what was measured.

        Without both it is where the probes are at the end.
        """
        quantities = list(self.interest.all) if self.interest else []
        texts = {quantity.text for quantity in quantities}
        measured = (name for name in names_of_measured(self.measured) if name not in texts)
        quantities += map(parse_quantity, measured)
        return tuple(quantities) or places_of(probe.probe() for probe in self.probes)

    @property
    def refining(self) -> tuple[str, ...]:
        """The words of the command that refines its mesh; () where none can.

        There is none for a scene without a file, with terms of Python or a start on one mesh,
        or without an h.
        """
        if not self._arguments or self.start.frame or getattr(self.cloth, "h", None) is None:
            return ()
        return ("fecloth", "converge", *self._arguments)

    @property
    def text(self) -> str:
        """The text of that file, for the numbers of lines in messages."""
        return self._text

    def to_tables(self) -> dict:
        """Return the tables with all defaults and absolute paths, as TOML reads them."""
        data = self.model_dump(exclude_none=True)
        if self.time and len(data["time"]["method"]) == 1:
            data["time"]["method"] = data["time"]["method"]["type"]
        for name, expectations in data["expect"].items():
            if len(expectations) == 1:
                data["expect"][name] = expectations[0]
        return toml_text.without_empty(data)

    def to_toml(self) -> str:
        """Return the scene as TOML with all defaults; it loads again to an equal scene.

        Paths are absolute, so that the text can be in any folder.
        """
        return toml_text.to_toml(self.to_tables())

    def resolved(self, steps: Any, linear: LinearSolver | None) -> Self:
        """Return the scene with the method and the linear solver that its run has chosen.

        `steps` are the steps of the run, and `linear` is its linear solver, None for an explicit
        method. "auto" stays where it is a solver that changes during the run, by the work that it
        counts. The scene repeats the run bit for bit.
        """
        changes: dict[str, Any] = {}
        if self.time and self.time.method.type == "auto":
            changes["time"] = self.time.taking(steps)
        if isinstance(linear, Direct):
            changes["solver"] = self.solver.model_copy(update={"linear": linear.name})
        return self.model_copy(update=changes)

    def mesh(self) -> Cloth:
        """Return the cloth alone; raise `SceneError` if it cannot be meshed."""
        with errors_at("cloth", self._source):
            if isinstance(self.cloth, tables.MeshFile | tables.Pieces):
                return self.cloth.cloth(self._trusts_geo, self._mesh_time)
            return self.cloth.cloth()

    def build(
        self, cloth: Cloth | None = None, make_system: Callable[..., System] = System
    ) -> Problem:
        """Bind terms and pins to the cloth by `make_system`, and place the start.

        Without a `cloth` the scene is meshed. `make_system` takes the arguments of `System`.
        """
        if cloth is None:
            cloth = self.mesh()
        return build(self, cloth, make_system)


def load_scene(
    path: str | Path,
    overrides: Iterable[str] = (),
    terms: Mapping[str, type] | None = None,
    trust_geo: bool = False,
    mesh_time: float = TIME_LIMIT,
) -> Scene:
    """Read and check a scene file.

    Raises `SceneError` for any mistake, with the file, the key, its value, what is allowed,
    and the nearest valid key or name.

    Parameters
    ----------
    path
        A TOML file; the paths in it are relative to its folder.
    overrides
        Values that replace values of the file, as in ``["time.dt=0.005", "terms.0.time=0.02"]``.
    terms
        The user's own types of terms, beside the terms of `fecloth.terms`: ``{"Winkler":
        Winkler}``, each a dataclass whose fields are the keys of its ``[[terms]]`` table. Only
        Python code can add them: a scene names no code, so that a file from elsewhere runs none.
    trust_geo
        Whether a .geo file that the scene names may hold any command of Gmsh, also commands that
        run programs and write files.
    mesh_time
        Seconds after which reading or meshing that file is stopped.
    """
    path = Path(path)
    overrides = tuple(overrides)
    data = override(toml_text.read(path), overrides)
    source = f"{path} with {', '.join(overrides)}" if overrides else str(path)
    scene_class = Scene
    text = toml_file.text(path)
    if terms:  # a class of scenes that may also have terms of these types
        any_term: Any = tables.terms_with(terms)[1]  # the type of a table of any term
        scene_class = create_model("Scene", __base__=Scene, terms=(tuple[any_term, ...], ()))
    scene = _check(scene_class, data, source, text, path.parent)
    scene._trusts_geo = trust_geo
    scene._mesh_time = mesh_time
    if not terms:  # which no command could read
        scene._arguments = _arguments_of(path, overrides, trust_geo)
    return scene


def _arguments_of(path: Path, overrides: Iterable[str], trust_geo: bool) -> tuple[str, ...]:
    """Return the arguments with which a command reads a scene with these changes."""
    changes = [word for override in overrides for word in ("--set", override)]
    trust = ["--trust-geo"] if trust_geo else []
    return str(path), *changes, *trust


def scene_of(tables: dict, trust_geo: bool = False) -> Scene:
    """Check the tables of a scene whose paths are absolute; errors name no file."""
    scene = _check(Scene, toml_text.without_empty(tables), source="", text="", folder=Path())
    scene._trusts_geo = trust_geo
    return scene


def _refuse_time_with_equilibrium(data: dict[str, Any]) -> None:
    """Raise `InputError` for a scene that has both tables."""
    if "time" in data and "equilibrium" in data:
        allowed = "a scene has one of them; with [equilibrium] it is static, without time and dt"
        remedy = "Leave out the other."
        raise InputError("time and equilibrium are given", allowed, remedy=remedy)


def _check(scene_class: type[Scene], data: dict, source: str, text: str, folder: Path) -> Scene:
    """Return the scene of the tables `data`; raise `SceneError` for any mistake.

    `source` is the place of the mistake in messages, and `text` is the text of the file, for
    the numbers of lines; the `folder` is the one to which paths in the tables are relative.
    """
    with errors_at("", source):
        data = with_fitted_terms(join_pieces(data), folder)
    try:
        scene = scene_class.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise scene_error(error, data, source, text) from None
    scene._source = source or "the scene"
    scene._text = text
    return scene
