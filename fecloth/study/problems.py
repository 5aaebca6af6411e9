"""What a study refines: a scene, or a user's function of h and dt."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from fecloth.errors import InputError, is_number
from fecloth.integrators import EXPLICIT
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.scene.scene import Scene, load_scene
from fecloth.scene.tables import GradingTable
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.quantity import Quantity
from fecloth.study import measured_runs
from fecloth.study.fingerprint import source_hash
from fecloth.study.levels import REFINED, Level
from fecloth.study.orders import space_order
from fecloth.study.scene_text import digest_of_files, scene_of, text_of
from fecloth.study.setups import Setup, setup_of_function, setup_of_scene
from fecloth.study.workload import STEPS, Workload

STATIC = 20  # iterations of an equilibrium, for the predicted time


class _Common:
    """What both kinds of problems derive from their first level."""

    first: Setup

    @property
    def is_static(self) -> bool:
        return self.first.is_static

    @property
    def is_explicit(self) -> bool:
        return self.first.is_explicit

    def orders(self, quantity: Quantity) -> tuple[float, float]:
        """Return the theoretical orders in h and in dt."""
        time = 1.0 if self.is_static else float(self.first.steps.traits.order or 1)
        return space_order(quantity, self.first), time

    def check_quantity(self, quantity: Quantity) -> None:
        """Raise `InputError` for a quantity that the run does not have."""
        setup = self.first
        observer = Observer.bind(setup.system, setup.start, setup.probes, shape=True)
        names = {*observer.row(None, None), *Ledger.open(setup.system, setup.start).row()}
        quantity.require_known(sorted(names - {"t"}))


@dataclass(frozen=True, eq=False)
class SceneProblem(_Common):
    """A scene to refine."""

    scene: Scene
    name: str

    @cached_property
    def first(self) -> Setup:  # type: ignore[override]  # computed when it is first needed
        built = self.scene.build()
        run = built.system, built.state, built.steps, built.t_end, built.newton, built.linear
        return Setup(*run, built.probes)

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.scene.probes)

    @property
    def h(self) -> float | None:
        """Edge length of the first level [m]."""
        return self.scene.cloth.h

    @property
    def interest(self) -> tuple[Quantity, ...]:
        """The quantities of [interest]."""
        return tuple(self.scene.interest.all) if self.scene.interest else ()

    @property
    def rtol(self) -> float:
        """Tolerance of chosen steps [1/s]; 0 where the error does not choose them."""
        time = self.scene.time
        if self.scene.equilibrium or time.dt != "auto":
            return 0.0
        stable = time.method.type in EXPLICIT and time.rtol is None
        return 0.0 if stable else Adaptive.rtol if time.rtol is None else time.rtol

    @property
    def default_quantity(self) -> str | Quantity:
        if self.scene.interest:
            return self.scene.interest.all[0]
        probes = self.scene.probes
        return f"path of {probes[0].name}" if probes else "displacement"

    def ratio(self, refine: str) -> float:
        """Return the usual ratio of two levels; that of nested meshes is 2."""
        nested = getattr(self.scene.cloth, "pattern", "unstructured") != "unstructured"
        return 2.0 if nested or refine == "dt" else math.sqrt(2)

    def can_refine(self, what: str) -> bool:
        """Whether the scene has an h, or a dt in seconds."""
        if what == "dt" and self.scene.equilibrium:
            return False
        return is_number(self.scene.cloth.h if what == "h" else self.scene.time.dt)

    @cached_property
    def size(self) -> Workload:
        """Predicted size of the first level, without its mesh."""
        return Workload.of(self.scene)

    def workload(self, level: Level) -> Workload:
        """Predict the size of a level, without its mesh."""
        finer = level.dt
        if self.scene.equilibrium:
            finer = 1.0
        elif self.scene.time.dt == "auto":
            finer = level.h * math.sqrt(level.rtol)
        triangles, steps = self.size.triangles * level.h**2, math.ceil(self.size.steps * finer)
        return Workload(triangles, steps, self.size.is_explicit)

    def check(self, refine: str) -> None:
        """Raise `InputError` if it has no h or dt to refine."""
        if refine != "dt" and not self.can_refine("h"):
            remedy = "Give a .geo file and h, or a shape."
            raise InputError("a mesh of one size", "has no cloth.h to refine", self.name, remedy)
        if self.scene.equilibrium:
            if refine != "h":
                raise InputError(f"refine = {refine!r}", "an equilibrium has no dt", self.name)
            return
        explicit = self.scene.time.method.type in EXPLICIT and self.scene.time.rtol is None
        if refine == "dt" and not self.can_refine("dt"):
            raise InputError('dt = "auto"', "cannot be refined", self.name, "Give time.dt.")
        if refine == "both" and not (explicit or self.can_refine("dt")):
            remedy = "Give time.dt; or refine h: the steps follow their tolerance."
            raise InputError('dt = "auto"', "cannot be refined", self.name, remedy)

    def text(self, level: Level) -> str:
        """Return the scene of a level; a refined dt divides the run into equal steps."""
        h, dt, time = self.scene.cloth.h, None, self.scene.time
        if level.dt != 1 and time and time.dt != "auto":
            span = time.t_end - time.t_start
            dt = span / round(math.ceil(span / time.dt - 1e-9) * level.dt)
        finer = None if level.h == 1 or h is None else h / level.h
        rtol = None if level.rtol == 1 else self.rtol / level.rtol
        return text_of(self.scene, finer, dt, level.sharper, rtol)

    def graded(self, gradings: Sequence[Grading]) -> SceneProblem:
        """Return the problem with [[cloth.grading]]; a scene may not have its own already."""
        if self.scene.cloth.grading:
            remedy = "Leave grade or the gradings out."
            raise InputError("grade = True", "the scene has [[cloth.grading]]", self.name, remedy)
        entries = tuple(GradingTable(**asdict(one)) for one in gradings)
        cloth = self.scene.cloth.model_copy(update={"grading": entries})
        return replace(self, scene=self.scene.model_copy(update={"cloth": cloth}))

    runner = staticmethod(measured_runs.run_scene_text)
    is_importable = True

    def setup(self, level: Level) -> Setup:
        """Build the scene of a level."""
        return setup_of_scene(self.text(level), self.scene.trusts_geo)

    def case(self, level: Level, recorded: list[str], modes: int) -> dict[str, object]:
        """Return the arguments of `runner` for a level."""
        text, digest = self.text(level), digest_of_files(self.scene)
        case = {"text": text, "digest": digest, "recorded": recorded, "modes": modes}
        return case | {"trust_geo": self.scene.trusts_geo}

    def cloth_of(self, level: Level, quantity: Quantity) -> Cloth | None:
        """Return the cloth of a level where the quantity needs it."""
        return (
            scene_of(self.text(level), self.scene.trusts_geo).mesh() if quantity.is_field else None
        )


@dataclass(frozen=True, eq=False)
class FunctionProblem(_Common):
    """A user's function of h and dt that returns cloth, system, method and start."""

    function: Callable
    h: float | None
    dt: float | None
    t_end: float | None
    given: tuple[Probe, ...] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    rtol: ClassVar[float] = 0.0  # of steps that the function's method chooses: not known
    interest: ClassVar[tuple[Quantity, ...]] = ()

    @property
    def name(self) -> str:
        return getattr(self.function, "__name__", "problem")

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.given)

    @cached_property
    def first(self) -> Setup:  # type: ignore[override]  # computed when it is first needed
        return self.setup(Level())

    @property
    def default_quantity(self) -> str | Quantity:
        return f"path of {self.given[0].name}" if self.given and self.t_end else "displacement"

    def ratio(self, refine: str) -> float:
        """Return the usual ratio of two levels: a function's meshes are taken as nested."""
        return 2.0

    def can_refine(self, what: str) -> bool:
        """Whether the function has an h, or steps of a given dt."""
        return (self.h if what == "h" else self.dt) is not None

    def workload(self, level: Level) -> Workload:
        """Predict the size of a level from the first one."""
        triangles = len(self.first.cloth.triangles) * level.h**2
        if self.is_static:
            return Workload(triangles, STATIC)
        dt = self.first.steps.dt
        if dt is None:
            return Workload(triangles, STEPS * level.h, self.is_explicit)
        assert self.first.t_end is not None
        steps = math.ceil((self.first.t_end - self.first.start.t) / dt * level.dt)
        return Workload(triangles, steps, self.is_explicit)

    def check(self, refine: str) -> None:
        """Raise `InputError` if it has no h or dt to refine."""
        if refine not in REFINED:
            return
        for what in ("h", "dt") if refine == "both" else (refine,):
            if not self.can_refine(what):
                allowed = f"refine = {refine!r} needs the {what} of the first level"
                raise InputError(f"{what} is missing", allowed, self.name, f"Give {what}=….")
        if self.t_end is None and refine != "h":
            raise InputError("t_end is missing", "an equilibrium has no dt", self.name)

    def graded(self, gradings: Sequence[Grading]) -> FunctionProblem:
        """Return the problem with the argument `grading`, as JSON's types."""
        if "grading" not in inspect.signature(self.function).parameters:
            remedy = "Pass it on, as in fc.Cloth.rectangle(1.0, 1.0, h, grading=grading)."
            needed = "needs a function with the argument grading"
            raise InputError("grade = True", needed, self.name, remedy)
        entries = [{k: v for k, v in asdict(one).items() if v is not None} for one in gradings]
        entries = [
            one | {"point": list(one["point"])} if "point" in one else one for one in entries
        ]
        return replace(self, settings={**self.settings, "grading": entries})

    def sizes(self, level: Level) -> tuple[dict[str, object], float | None]:
        """Return the settings of the function, with h and dt, and dt."""
        settings, dt = dict(self.settings), self.dt
        if self.h is not None:
            settings["h"] = self.h / level.h
        if dt is not None and self.t_end is not None:
            dt = self.t_end / round(math.ceil(self.t_end / dt - 1e-9) * level.dt)
        if dt is not None:
            settings["dt"] = dt
        return settings, dt

    def setup(self, level: Level) -> Setup:
        """Call the function for a level."""
        settings, dt = self.sizes(level)
        run = self.function, settings, dt, self.t_end
        return setup_of_function(*run, self.given, level.sharper)

    runner = staticmethod(measured_runs.run_function)

    @property
    def is_importable(self) -> bool:
        """Whether other processes can import the function and know its probes."""
        names = all(isinstance(probe.where, str | None) for probe in self.given)
        return names and _importable(self.function) is not None

    def case(self, level: Level, recorded: list[str], modes: int) -> dict[str, object]:
        """Return the arguments of `runner` for a level."""
        file, name = _importable(self.function) or "", self.function.__name__
        measured_runs.known_functions[file, name] = self.function
        settings, dt = self.sizes(level)
        return {
            "path": file,
            "name": name,
            "digest": source_hash(file),
            "settings": settings,
            "dt": dt,
            "t_end": self.t_end,
            "probes": [[p.name, p.where, list(p.point) if p.point else None] for p in self.given],
            "recorded": recorded,
            "modes": modes,
            "sharper": level.sharper,
        }

    def cloth_of(self, level: Level, quantity: Quantity) -> Cloth | None:
        """Return the cloth of a level where the quantity needs it."""
        return self.setup(level).cloth if quantity.is_field else None


Problem = SceneProblem | FunctionProblem


def open_problem(
    problem: Any,
    h: float | None = None,
    dt: float | None = None,
    t_end: float | None = None,
    probes: Sequence[Probe] = (),
    settings: Mapping[str, object] | None = None,
) -> Problem:
    """Return the problem of a scene, its path, or a function; see `converge`.

    Raises
    ------
    InputError
        For anything else, and for h, dt, t_end, probes or settings besides a scene.
    """
    if isinstance(problem, Scene | str | Path):
        named = {"h": h, "dt": dt, "t_end": t_end, "probes": probes or None, **(settings or {})}
        given = [name for name, value in named.items() if value is not None]
        if given:
            remedy = "Change the scene."
            raise InputError(f"{given[0]} = …", "is for a function's problem", "problem", remedy)
        scene = problem if isinstance(problem, Scene) else load_scene(problem)
        stem = Path(str(scene.source).partition(" with ")[0]).stem
        return SceneProblem(scene, scene.title or stem)
    if not callable(problem):
        allowed = "must be a scene, its path, or a function of h and dt"
        raise InputError(f"problem = {problem!r}", allowed, "problem")
    return FunctionProblem(problem, h, dt, t_end, tuple(probes), settings or {})


def _importable(function: Callable) -> str | None:
    """Return the file of a function at its top level; None for any other."""
    name = getattr(function, "__qualname__", "<")
    try:
        file = inspect.getsourcefile(function)
    except TypeError:
        return None
    at_top = "<" not in name and "." not in name
    return str(Path(file).resolve()) if at_top and file and Path(file).exists() else None
