"""What a study runs: the objects of a scene, or the objects that a user's function returns."""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Self

from fecloth import terms as all_terms
from fecloth.errors import InputError, did_you_mean
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.runs.run_scene import compile_kernels
from fecloth.scene.scene import Scene
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import StepInfo, march
from fecloth.simulation.on_request import on_request
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.record_steps import rows_at_least, trial_recorder
from fecloth.simulation.resolve import choose_steps, method_to_report, resolve
from fecloth.simulation.run import Result, collect
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.traits import parameters_of, traits_of

RETURNS = "must return cloth, system, method and start"
Chosen = tuple[Any, SolverContext, str]


@dataclass(frozen=True, eq=False)
class Setup:
    """A system with its start and how it is solved; an equilibrium without `t_end`."""

    system: System
    start: State
    steps: Any = None
    t_end: float | None = None
    newton: Newton | None = None
    linear: str = "auto"
    probes: tuple[Probe | str, ...] = ()

    @property
    def cloth(self) -> Cloth:
        return self.system.cloth

    @property
    def is_static(self) -> bool:
        """Whether the result is an equilibrium."""
        return self.t_end is None or isinstance(self.steps, LoadSteps)

    @cached_property
    def observer(self) -> Observer:
        return Observer.bind(self.system, self.start, self.probes, shape=True)

    @cached_property
    def ledger(self) -> Ledger:
        return Ledger.open(self.system, self.start)

    @property
    def energies(self) -> list[str]:
        """Names of the columns of the ledger."""
        return sorted(self.ledger.row())

    def row(self, rest: State | None = None) -> dict[str, float]:
        """Return the columns at the start, or at an equilibrium."""
        if rest is None:
            return self.ledger.row() | self.observer.row(None, None)
        return Ledger.open(self.system, rest).row() | self.observer.row_at_rest(rest)

    def recording(self, columns: Iterable[str]) -> Self:
        """Return the setup that also has those of the columns that are on request."""
        return replace(self, probes=(*self.probes, *on_request(columns)))

    def probed_as(self, base: "Setup") -> Self:
        """Return the setup with the probes of another, which are bound once for one cloth."""
        probed = replace(self, probes=base.probes)
        if self.cloth is base.cloth:
            bound = replace(base.observer, system=self.system, start=self.start)
            vars(probed)["observer"] = bound
        return probed

    def choose(self) -> Chosen:
        """Return the choice of steps, also of `Auto`, their solver, and in words why."""
        assert self.t_end is not None
        run = self.system, self.steps, self.start, self.t_end, self.linear, self.newton
        return resolve(*run, trial_recorder(self.system, self.ledger, self.observer))

    def run(
        self,
        chosen: Chosen,
        report: Callable[[StepInfo], None] = lambda info: None,
        rows: int | None = None,
        watch: Callable[[Iterable], Iterable] = iter,
    ) -> Result:
        """March to the end; `watch` passes the steps on, `rows` are as for `fecloth.run`."""
        (steps, solver, why), t_end = chosen, self.t_end
        assert t_end is not None
        states = watch(march(self.system, steps, self.start, None, t_end, solver=solver))
        next_row = rows_at_least(rows, self.start.t, t_end) if rows else None
        given = self.system, method_to_report(steps), self.ledger, self.observer, why
        return collect(states, *given, report=report, next_row=next_row)


def setup_of_scene(scene: Scene, compiled: bool = False, cloth: Cloth | None = None) -> Setup:
    """Return the setup of a scene, with what its run needs compiled if asked for."""
    built = scene.build(cloth)
    if compiled:
        compile_kernels(built)
    run = built.system, built.state, built.steps, built.t_end, built.newton, built.linear
    return Setup(*run, built.probes)


def setup_of_function(
    function: Callable,
    settings: Mapping[str, object],
    dt: float | None,
    t_end: float | None,
    probes: tuple[Probe, ...] = (),
    sharper: float | None = None,
) -> Setup:
    """Call the user's function with the settings that it takes and return its setup."""
    name = getattr(function, "__name__", "problem")
    if "grading" in settings:  # from JSON
        entries: Any = settings["grading"]
        settings = {**settings, "grading": [Grading(**entry) for entry in entries]}
    returned = function(**accepted(function, settings))
    if not (isinstance(returned, tuple | list) and len(returned) == 4):
        raise InputError(f"the function {name}", RETURNS, "problem")
    _, system, method, start = returned
    if not (isinstance(system, System) and isinstance(start, State)):
        raise InputError(f"the function {name}", RETURNS, "problem")
    newton = Newton()
    if sharper is not None:  # "auto" may leave more than levels differ by
        newton = Newton(tolerance=newton.residual / sharper)
    steps = None
    if t_end is not None:
        steps = choose_steps(method, dt if not method.traits.chooses_dt else None, {})
    elif (least := max((term.load_steps for term in system.bound), default=1)) > 1:
        steps, t_end = LoadSteps(least), 1.0  # the place of rest depends on the way there
    return Setup(system, start, steps, t_end, newton, probes=tuple(probes))


def accepted(function: Callable, settings: Mapping[str, object]) -> dict[str, object]:
    """Return the settings that a function takes; h and dt may be left out by it."""
    parameters = inspect.signature(function).parameters
    if any(item.kind is inspect.Parameter.VAR_KEYWORD for item in parameters.values()):
        return dict(settings)
    unknown = sorted(set(settings) - set(parameters) - {"h", "dt"})
    if unknown:
        what = f"{unknown[0]} = {settings[unknown[0]]!r}"
        allowed = f"the function takes {', '.join(parameters) or 'nothing'}"
        raise InputError(what, allowed, "problem", did_you_mean(unknown[0], parameters))
    return {key: value for key, value in settings.items() if key in parameters}


def table_of_grading(grading: Grading) -> dict[str, object]:
    """Return a grading as a table of [[cloth.grading]], in JSON's types."""
    table = {key: value for key, value in asdict(grading).items() if value is not None}
    return {key: list(value) if key == "point" else value for key, value in table.items()}


def describe_term(term: Any, number: int) -> dict:
    """Return what edits of the terms need to know of a term, which is the number-th of a system."""
    table: dict = {"type": type(term).__name__, "number": number}
    parameters = parameters_of(term)
    if isinstance(parameters.get("strain"), str):
        table["strain"] = term.strain
    if "gap" in parameters:
        table["gap"] = term.gap
    if "rest" in parameters:
        table["rest"] = term.rest if isinstance(term.rest, str) else "given"
    return table


def with_terms(setup: Setup, terms: Sequence[Mapping]) -> Setup:
    """Return the setup with these terms, and the clamps of pins if one of them holds normals."""
    old = setup.system
    new = tuple(_make_term(term, old.terms) for term in terms)
    holds = any(traits_of(term).holds_normals for term in new)
    pins = old.pins if holds else tuple(map(_unclamp, old.pins))
    return replace(setup, system=replace(old, terms=new, pins=pins))


def _make_term(term: Mapping, own: Sequence) -> Any:
    if "number" not in term:
        return getattr(all_terms, term["type"])()
    kept = own[term["number"]]
    before = parameters_of(kept)
    other = {key: term.get(key) for key in ("strain", "gap") if term.get(key) != before.get(key)}
    return replace(kept, **other) if other else kept


def _unclamp(pin: Any) -> Any:
    return replace(pin, clamp=False) if getattr(pin, "clamp", False) else pin
