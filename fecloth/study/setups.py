"""What a study runs of a user's function, and how terms and gradings are described in tables."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from fecloth import terms as all_terms
from fecloth.errors import InputError, did_you_mean
from fecloth.mesh.grading import Grading
from fecloth.nonlinear.options import Newton
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.probes import Probe
from fecloth.simulation.resolve import choose_steps
from fecloth.simulation.setup import Setup
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.traits import parameters_of, traits_of

RETURNS = "must return cloth, system, method and start"


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
    old: Any = setup.system
    new = tuple(_make_term(term, old.terms) for term in terms)
    holds = any(traits_of(term).holds_normals for term in new)
    free = (replace(p, clamp=False) if getattr(p, "clamp", False) else p for p in old.pins)
    pins = old.pins if holds else tuple(free)
    return replace(setup, system=old.replace(terms=new, pins=pins))


def _make_term(term: Mapping, own: Sequence) -> Any:
    if "number" not in term:
        return getattr(all_terms, term["type"])()
    kept = own[term["number"]]
    before = parameters_of(kept)
    other = {key: term.get(key) for key in ("strain", "gap") if term.get(key) != before.get(key)}
    return replace(kept, **other) if other else kept
