"""A user's function of h and dt that a study refines."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity
from fecloth.study import measured_runs
from fecloth.study.common_problem import CommonProblem, quantities_of
from fecloth.study.fingerprint import source_hash
from fecloth.study.levels import REFINED, Level
from fecloth.study.setups import Setup, setup_of_function
from fecloth.study.workload import STEPS, Workload

STATIC = 20  # iterations of an equilibrium, for the predicted time


@dataclass(frozen=True, eq=False)
class FunctionProblem(CommonProblem):
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
    def name(self) -> str:  # type: ignore[override]  # read only
        return getattr(self.function, "__name__", "problem")

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.given)

    @cached_property
    def first(self) -> Setup:  # type: ignore[override]  # computed when it is first needed
        return self.setup(Level())

    @property
    def quantities(self) -> tuple[Quantity, ...]:  # type: ignore[override]  # read only
        """The paths of the probes, their ends in an equilibrium, or displacement."""
        return quantities_of(self.probes, static=self.t_end is None)

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
        more = {"recorded": recorded, "modes": modes, "sharper": level.sharper}
        return self.reference(level) | more

    def reference(self, level: Level) -> dict[str, Any]:
        """Return where a process finds the function, and its arguments for a level."""
        file, name = _importable(self.function) or "", self.function.__name__
        measured_runs.known_functions[file, name] = self.function
        settings, dt = self.sizes(level)
        return {
            "path": file,
            "name": name,
            "digest": source_hash(file) if file else "",
            "settings": settings,
            "dt": dt,
            "t_end": self.t_end,
            "probes": [[p.name, p.where, list(p.point) if p.point else None] for p in self.given],
        }

    def cloth_of(self, level: Level, quantity: Quantity) -> Cloth | None:
        """Return the cloth of a level where the quantity needs it."""
        return self.setup(level).cloth if quantity.is_field else None


def _importable(function: Callable) -> str | None:
    """Return the file of a function at its top level; None for any other."""
    name = getattr(function, "__qualname__", "<")
    try:
        file = inspect.getsourcefile(function)
    except TypeError:
        return None
    at_top = "<" not in name and "." not in name
    return str(Path(file).resolve()) if at_top and file and Path(file).exists() else None
