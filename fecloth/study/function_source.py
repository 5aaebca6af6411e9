"""A user's function of h and dt that a study changes and refines."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity
from fecloth.study import setups
from fecloth.study.change import REFINED, Change, Level
from fecloth.study.fingerprint import load_function, source_hash
from fecloth.study.problem import CommonProblem, quantities_of
from fecloth.study.workload import CHOSEN_STEPS, ITERATIONS, LOAD_STEP, Workload

# Functions that this process has imported, by file and name.
known_functions: dict[tuple[str, str], Callable] = {}


@dataclass(frozen=True, eq=False)
class FunctionProblem(CommonProblem):
    """A user's function of h and dt that returns cloth, system, method and start.

    Attributes
    ----------
    function
        The function.
    h
        Edge length [m]; None if the function takes none.
    dt
        Fixed step [s]; None if the method chooses its steps.
    t_end
        End of the run [s]; None for an equilibrium.
    placed
        The probes.
    settings
        Further arguments of the function.
    terms
        Terms in place of the function's own, as `describe_term` describes them, or None.
    sharper
        Divides the tolerance of the solver; None leaves it as it is.
    rtol
        Tolerance of steps that the function's method chooses: not known, 0.
    interest
        Quantities of interest, which a function does not have.
    """

    function: Callable
    h: float | None
    dt: float | None
    t_end: float | None
    placed: tuple[Probe, ...] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    terms: list[dict] | None = None
    sharper: float | None = None
    rtol: ClassVar[float] = 0.0
    interest: ClassVar[tuple[Quantity, ...]] = ()

    @property
    def name(self) -> str:  # type: ignore[override]  # read only
        return getattr(self.function, "__name__", "problem")

    source = name

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.placed)

    @property
    def span(self) -> float | None:  # type: ignore[override]  # read only
        """Length of the run [s]; None for an equilibrium."""
        return self.t_end

    @cached_property
    def first(self) -> setups.Setup:  # type: ignore[override]  # computed when it is needed
        """The setup of the first level."""
        return self.setup()

    @property
    def quantities(self) -> tuple[Quantity, ...]:  # type: ignore[override]  # read only
        """The paths of the probes, their ends in an equilibrium, or displacement."""
        return quantities_of(self.probes, static=self.t_end is None)

    def ratio(self, refine: str) -> float:
        """Return the usual ratio of two levels: a function's meshes are taken as nested."""
        return 2.0

    def workload(self, level: Level) -> Workload:
        """Predict the size of a level from the first one, whose mesh is made for it.

        The number of steps is a guess where an equilibrium or the method chooses it.
        """
        triangles = len(self.first.cloth.triangles) * level.h**2
        if self.is_static:
            return Workload(triangles, LOAD_STEP, unit=ITERATIONS)
        dt = self.first.steps.dt
        if dt is None:
            return Workload(triangles, CHOSEN_STEPS * level.h, self.is_explicit)
        assert self.first.t_end is not None
        steps = math.ceil((self.first.t_end - self.first.start.t) / dt * level.dt)
        return Workload(triangles, steps, self.is_explicit)

    def check(self, refine: str) -> None:
        """Raise `InputError` if there is no h or dt to refine, or a step of an equilibrium."""
        if refine not in REFINED:  # `make_levels` refuses it
            return
        needed_sizes = [refine]
        if refine == "both":
            needed_sizes = ["h", "dt"]
        for size in needed_sizes:
            if not self.can_refine(size):
                allowed = f"refine = {refine!r} needs the {size} of the first level"
                raise InputError(f"{size} is missing", allowed, self.name, f"Give {size}=….")
        if self.t_end is None and refine != "h":
            raise InputError("t_end is missing", "an equilibrium has no dt", self.name)

    @cached_property
    def tables(self) -> dict:
        """What edits can change, in the form of a scene's tables.

        An edit is written for scenes; so that it works here, too, the tables have element, h,
        terms, dt and t_end, and otherwise what an edit may ask for.
        """
        first = self.first
        cloth: dict = {"element": first.cloth.element}
        if self.h is not None:
            cloth["h"] = self.h
        terms = [setups.describe_term(term, i) for i, term in enumerate(first.system.terms)]
        tables = {"cloth": cloth, "terms": terms, "output": {}}
        if first.is_static:
            return tables | {"equilibrium": {}}
        if self.dt is None:  # the method chooses its steps
            return tables | {"time": {"dt": "auto", "method": "auto"}}
        return tables | {"time": {"dt": self.dt, "t_end": self.t_end, "method": "auto"}}

    def changed(self, change: Change) -> "FunctionProblem":
        """Return the problem with a change: other arguments, or other terms, h and dt.

        Raise `InputError` for an argument that the function does not take.
        """
        settings = dict(change.values)
        changed: dict[str, Any] = {}
        for size in ("h", "dt"):
            if size in settings:
                changed[size] = settings.pop(size)
        setups.accepted(self.function, settings)  # raises for an argument it does not take
        if change.edits:
            # the values are arguments of the function, not keys of the tables
            tables = replace(change, values={}).apply(self.tables)
            changed["h"] = tables["cloth"].get("h")
            changed["terms"] = tables["terms"]
            if self.dt is not None:
                changed["dt"] = tables["time"]["dt"]
        return replace(self, settings={**self.settings, **settings}, **changed)

    def refined(self, level: Level) -> "FunctionProblem":
        """Return a level of the problem; a refined dt divides the run into equal steps.

        The level divides h, dt and the tolerance of the solver; its edits change the terms.
        """
        h = self.h and self.h / level.h
        dt = self.dt
        if dt is not None and self.t_end is not None:
            steps = math.ceil(self.t_end / dt - 1e-9)  # 1e-9 against round-off of the quotient
            dt = self.t_end / round(steps * level.dt)
        finer = replace(self, h=h, dt=dt, sharper=level.sharper)
        if level.edits:
            return finer.changed(Change(edits=level.edits))
        return finer

    def graded(self, gradings: Sequence[Grading]) -> "FunctionProblem":
        """Return the problem with the argument `grading`, as JSON's types."""
        if "grading" not in inspect.signature(self.function).parameters:
            remedy = "Pass it on, as in fc.Cloth.rectangle(1.0, 1.0, h, grading=grading)."
            needed = "needs a function with the argument grading"
            raise InputError("grade = True", needed, self.name, remedy)
        tables = [setups.table_of_grading(grading) for grading in gradings]
        return self.changed(Change(values={"grading": tables}))

    def arguments(self) -> tuple[dict[str, object], float | None]:
        """Return the arguments of the function, and the step dt [s].

        dt is reduced so that it divides the run into equal steps; it is None without fixed
        steps. h and dt are also among the arguments, if there are any.
        """
        settings = dict(self.settings)
        dt = self.dt
        if self.h is not None:
            settings["h"] = self.h
        if dt is not None:
            if self.t_end is not None:
                dt = self.t_end / math.ceil(self.t_end / dt - 1e-9)
            settings["dt"] = dt
        return settings, dt

    def setup(self, cloth: Cloth | None = None) -> setups.Setup:
        """Call the function and return its setup, with other terms if the problem has them.

        `cloth` is not used, because the function makes its own; scenes use it.
        """
        settings, dt = self.arguments()
        setup = setups.setup_of_function(
            self.function,
            settings,
            dt=dt,
            t_end=self.t_end,
            probes=self.placed,
            sharper=self.sharper,
        )
        if self.terms is None:
            return setup
        return setups.with_terms(setup, self.terms)

    @property
    def is_importable(self) -> bool:
        """Whether other processes can import the function and know its probes."""
        are_named = all(isinstance(probe.where, str | None) for probe in self.placed)
        return are_named and _find_file(self.function) is not None

    def case(self) -> dict[str, object]:
        """Return all that determines a run, as JSON values.

        It is the key of the stored results, and `of_case` makes the problem from it again. The
        function is also put into `known_functions`.
        """
        file = _find_file(self.function) or ""
        name = self.function.__name__
        # so that `of_case` in this process need not import the file again
        known_functions[file, name] = self.function
        settings, dt = self.arguments()
        probes = []
        for probe in self.placed:
            point = list(probe.point) if probe.point else None
            probes.append([probe.name, probe.where, point])
        return {
            "path": file,
            "name": name,
            "digest": source_hash(file) if file else "",
            "settings": settings,
            "dt": dt,
            "t_end": self.t_end,
            "probes": probes,
            "terms": self.terms,
            "sharper": self.sharper,
        }

    @classmethod
    def of_case(
        cls, path: str, name: str, digest: str, probes: list, settings: dict, **more: Any
    ) -> "FunctionProblem":
        """Return the problem of a case, as `case` has written it.

        `digest` is not used here: it is in the case so that an edited file makes another case.
        The function comes from this process or, if it is not known here, from its file.
        """
        function = known_functions.get((path, name)) or load_function(path, name)
        placed = tuple(Probe(probe_name, where, point) for probe_name, where, point in probes)
        return cls(function, None, placed=placed, settings=settings, **more)

    def cloth_for(self, quantity: Quantity) -> Cloth | None:
        """Return the cloth that a field needs; None for other quantities."""
        if quantity.is_field:
            return self.first.cloth
        return None


def _find_file(function: Callable) -> str | None:
    """Return the path of the file that has the function at its top level.

    Return None for any other function, such as a method, a lambda, or one that was typed into a
    console: other processes cannot import it.
    """
    name = getattr(function, "__qualname__", "<")
    try:
        file = inspect.getsourcefile(function)
    except TypeError:  # as for an object that can be called
        return None
    # "<" is in the name of a lambda or of a function in a function, "." in that of a method
    is_at_top_level = "<" not in name and "." not in name
    if is_at_top_level and file and Path(file).exists():
        return str(Path(file).resolve())
    return None
