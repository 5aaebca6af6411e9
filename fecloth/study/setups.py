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
    """Call the user's function with the settings that it takes and return its setup.

    Raise `InputError` if the function does not return cloth, system, method and start, or does
    not take a setting.

    Parameters
    ----------
    settings
        Arguments of the function; gradings may be tables.
    dt
        Fixed step [s]; None where the method chooses its steps.
    t_end
        End of the run [s]; None for an equilibrium.
    sharper
        Divides the tolerance of the solver; None leaves it as it is.
    """
    name = getattr(function, "__name__", "problem")
    if "grading" in settings:  # the tables of gradings, as a case has them
        entries: Any = settings["grading"]
        settings = {**settings, "grading": [Grading(**entry) for entry in entries]}
    returned = function(**accepted(function, settings))
    if not (isinstance(returned, tuple | list) and len(returned) == 4):
        raise InputError(f"the function {name}", RETURNS, "problem")
    _, system, method, start = returned
    if not (isinstance(system, System) and isinstance(start, State)):
        raise InputError(f"the function {name}", RETURNS, "problem")
    newton = Newton()
    if sharper is not None:  # the tolerance "auto" may leave larger errors than levels differ by
        newton = Newton(tolerance=newton.residual / sharper)
    steps = None
    load_steps = max((term.load_steps for term in system.bound), default=1)
    if t_end is not None:
        fixed_dt = None if method.traits.chooses_dt else dt
        steps = choose_steps(method, fixed_dt, {})
    elif load_steps > 1:  # a term says that the equilibrium depends on how the loads grow
        steps = LoadSteps(load_steps)
        t_end = 1.0  # all of the loads
    return Setup(
        system=system,
        start=start,
        steps=steps,
        t_end=t_end,
        newton=newton,
        probes=tuple(probes),
    )


def accepted(function: Callable, settings: Mapping[str, object]) -> dict[str, object]:
    """Return the settings that a function takes; it need not take h and dt.

    Raises `InputError` for any other setting that it does not take.
    """
    parameters = inspect.signature(function).parameters
    kinds = [parameter.kind for parameter in parameters.values()]
    if inspect.Parameter.VAR_KEYWORD in kinds:  # **settings takes any argument
        return dict(settings)
    unknown = sorted(set(settings) - set(parameters) - {"h", "dt"})
    if unknown:
        name = unknown[0]
        allowed = f"the function takes {', '.join(parameters) or 'nothing'}"
        remedy = did_you_mean(name, parameters)
        raise InputError(f"{name} = {settings[name]!r}", allowed, "problem", remedy)
    return {key: value for key, value in settings.items() if key in parameters}


def table_of_grading(grading: Grading) -> dict[str, object]:
    """Return a grading as a table of [[cloth.grading]], in JSON's types."""
    table = {key: value for key, value in asdict(grading).items() if value is not None}
    if "point" in table:
        table["point"] = list(table["point"])
    return table


def describe_term(term: Any, number: int) -> dict:
    """Return a term as a table, which an edit may change and `with_terms` reads again.

    `number` is the place of the term in the system, from 0. The table has only what edits of
    studies change or look at: the type, the strain measure, the gap, and whether a rest shape is
    given.
    """
    table: dict = {"type": type(term).__name__, "number": number}
    parameters = parameters_of(term)
    if isinstance(parameters.get("strain"), str):
        table["strain"] = term.strain
    if "gap" in parameters:
        table["gap"] = term.gap
    if "rest" in parameters:
        table["rest"] = "given"
        if isinstance(term.rest, str):
            table["rest"] = term.rest
    return table


def with_terms(setup: Setup, terms: Sequence[Mapping]) -> Setup:
    """Return the setup with the terms of these tables in place of its own.

    If there is no term with which clamped pins can hold the normals of the cloth, no pin clamps.
    """
    system: Any = setup.system
    new_terms = tuple(_make_term(term, system.terms) for term in terms)
    pins = system.pins
    if not any(traits_of(term).holds_normals for term in new_terms):
        pins = tuple(_without_clamp(pin) for pin in pins)
    return replace(setup, system=system.replace(terms=new_terms, pins=pins))


def _without_clamp(pin: Any) -> Any:
    """Return a pin that leaves the normals free."""
    if getattr(pin, "clamp", False):
        return replace(pin, clamp=False)
    return pin


def _make_term(table: Mapping, own_terms: Sequence) -> Any:
    """Return the term of a table that `describe_term` made, and an edit may have changed.

    It is the term of the system with the number in the table, with the strain measure and the
    gap of the table. A table without a number is of another term, with its defaults.
    """
    if "number" not in table:
        return getattr(all_terms, table["type"])()
    term = own_terms[table["number"]]
    parameters = parameters_of(term)
    changed = {}
    for key in ("strain", "gap"):
        if table.get(key) != parameters.get(key):
            changed[key] = table.get(key)
    if changed:
        return replace(term, **changed)
    return term
