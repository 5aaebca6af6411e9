"""The numbers of a problem that its results depend on, and the problem with other ones."""

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.errors import InputError, brief, did_you_mean, is_number
from fecloth.scene.toml_text import flatten
from fecloth.simulation.setup import Setup
from fecloth.study.change import Change
from fecloth.study.function_problem import FunctionProblem
from fecloth.study.problems import Problem, SceneProblem

WHERE = "sensitivity"
TABLES = ("fabric", "fabrics", "terms")  # tables whose numbers are taken if none is named
REFUSED = {  # table of a scene → why its numbers are no parameters
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
# Keys of the uncertainty of numbers, on which no result depends.
_UNCERTAINTY = re.compile(r"(fabric|fabrics\.[^.]+)\.uncertainty\.")
SIZES = ("h", "dt")  # arguments of a function that are no parameters
Asked = str | Sequence[str] | Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """A number of a problem: a key of a scene, or an argument of a function.

    Attributes
    ----------
    name
        The key, or the argument.
    value
        Its value.
    width
        The unit of its changes: |value|, or the scale that was given.
    """

    name: str
    value: float
    width: float

    def at(self, change: float) -> float:
        """Return the value after a change in units of the width."""
        return self.value + change * self.width


def choose_parameters(
    problem: Problem, asked: Asked | None, scale: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """Return the parameters that are asked for, or all numbers of fabric and terms but zeros.

    `scale` are the sizes of usual changes, by name. Raises `InputError` for a name that is no
    number of the problem, for a number that changes the mesh, the steps or the solver, and for a
    value of 0 without a scale.
    """
    if not isinstance(asked, str | Sequence | Mapping | None):
        raise InputError(f"parameters = {brief(asked)}", "must be names, or a mapping", WHERE)
    known = dict(numbers_of(problem))
    if asked is None:
        names: Sequence[str] = [name for name in _usual_names(problem, known) if known[name]]
        if not names:
            remedy = "Name parameters, with a scale for each value of 0."
            raise InputError("parameters = None", f"{problem.name} has none", WHERE, remedy)
    else:
        names = []
        for name in [asked] if isinstance(asked, str) else asked:
            items = [key for key in known if key.startswith(f"{name}.")]
            names += items or [name]  # the key of a pair stands for both of its numbers
    if not names or len(set(names)) < len(names):
        raise InputError(f"parameters = {asked!r}", "must be names, each one once", WHERE)
    for name in sorted(set(scale) - set(names)):
        raise InputError(f"scale of {name!r}", "is of no parameter here", WHERE)
    return tuple(_make_parameter(problem, name, known, scale) for name in names)


def _make_parameter(
    problem: Problem, name: str, known: Mapping[str, float], scale: Mapping[str, float]
) -> Parameter:
    """Return the parameter of a name; `known` are all numbers of the problem."""
    refuse_sizes(problem, name)
    if name not in known:
        listed = ", ".join(known) or "no number"
        allowed = f"must be a number of the problem: {listed}"
        raise InputError(f"parameter {name!r}", allowed, WHERE, did_you_mean(name, known))
    value = known[name]
    width = scale.get(name, abs(value))
    if not (is_number(width) and width > 0):
        what = f"parameter {name!r} = 0"
        if name in scale:
            what = f"scale of {name!r} = {width!r}"
        remedy = f"Give the size of a usual change, as scale={{{name!r}: 0.01}}."
        raise InputError(what, "needs a change > 0 to compare with", WHERE, remedy)
    return Parameter(name, value, float(width))


def refuse_sizes(problem: Problem, name: str) -> None:
    """Raise `InputError` for a number that changes the mesh, the steps or the solver."""
    if isinstance(problem, SceneProblem):
        table = name.partition(".")[0]
        if reason := REFUSED.get(table):
            remedy = ""
            if table.startswith("cloth"):
                remedy = "A function of Python may move the nodes of the same triangles."
            elif table in ("time", "solver", "equilibrium") and name != "time.t_end":
                remedy = "fecloth converge says what its error is."
            raise InputError(f"parameter {name!r}", reason, WHERE, remedy)
    elif name in SIZES:
        remedy = "study.converge says what the error of h and dt is."
        raise InputError(f"parameter {name!r}", "changes the mesh or the steps", WHERE, remedy)


def numbers_of(problem: Problem) -> Iterator[tuple[str, float]]:
    """Return names and values of all numbers that may be parameters.

    Whole numbers of a scene are left out: they count something. Those of a function may be meant
    as any number.
    """
    if isinstance(problem, SceneProblem):
        tables = {name: table for name, table in problem.tables.items() if name not in REFUSED}
        for name, value in _find_numbers(tables, float).items():
            if not _UNCERTAINTY.match(name):
                yield name, value
        return
    arguments = {k: v for k, v in _arguments(problem).items() if k not in SIZES}
    yield from _find_numbers(arguments, float | int).items()


def _arguments(problem: FunctionProblem) -> dict[str, object]:
    """Return the arguments of the function, given or by default."""
    listed = inspect.signature(problem.function).parameters
    return {name: item.default for name, item in listed.items()} | dict(problem.settings)


def _find_numbers(data: Mapping, kind: Any) -> dict[str, float]:
    """Return the numbers of this kind in tables and lists, by their dotted names."""
    values = flatten(data).items()
    return {name: float(v) for name, v in values if isinstance(v, kind) and is_number(v)}


def _usual_names(problem: Problem, known: Mapping[str, float]) -> list[str]:
    """Return the names that are meant if none is given."""
    if isinstance(problem, SceneProblem):
        return [name for name in known if name.partition(".")[0] in TABLES]
    arguments = _find_numbers(_arguments(problem), float)  # whole numbers may count something
    return [name for name in known if name in arguments]


def setup_with(problem: Problem, values: Mapping[str, float], base: Setup) -> Setup:
    """Return the setup of the problem with other values, on the same triangles as `base`.

    Raises `InputError` if the values are refused, or change the triangles or the held nodes.
    """
    try:
        changed = problem.changed(Change(values=grouped(problem, values)))
        setup = changed.setup(base.cloth)
    except InputError as error:
        allowed = "needs values on both sides of its own: " + str(error)
        raise InputError(f"parameter {' and '.join(values)}", allowed, WHERE) from None
    cloth = setup.cloth
    system = setup.system
    has_same_mesh = np.array_equal(cloth.triangles, base.cloth.triangles)
    has_same_pins = np.array_equal(system.constraints.nodes, base.system.constraints.nodes)
    if not (has_same_mesh and has_same_pins):
        what = f"parameter {' and '.join(values)}"
        remedy = "Move the nodes of the same triangles, and hold the same nodes."
        raise InputError(what, "changes the mesh or the held nodes", WHERE, remedy)
    return setup


def grouped(problem: Problem, values: Mapping[str, float]) -> dict[str, object]:
    """Return the values by the arguments of a function, with the items of a list together.

    The values of a scene stay as they are.
    """
    if isinstance(problem, SceneProblem):
        return dict(values)
    arguments = _arguments(problem)
    changed = dict[str, object]()
    for name, value in values.items():
        key, *rest = name.split(".")
        changed[key] = _replaced(changed.get(key, arguments[key]), rest, value)
    return changed


def _replaced(old: object, keys: Sequence[str], value: float) -> object:
    """Return `old` with the value in place of the item that the keys lead to."""
    if not keys:
        return value
    first, *rest = keys
    if isinstance(old, Mapping):
        return {**old, first: _replaced(old[first], rest, value)}
    items = list(old)  # type: ignore[call-overload]  # a list or tuple, by `flatten`
    items[int(first)] = _replaced(items[int(first)], rest, value)
    if isinstance(old, tuple):
        return tuple(items)
    return items
