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
TABLES = ("fabric", "fabrics", "terms")  # whose numbers are taken if none are named
REFUSED = {  # tables of a scene whose numbers are no parameters
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
_UNCERTAINTY = re.compile(r"(fabric|fabrics\.[^.]+)\.uncertainty\.")  # of numbers, no numbers
SIZES = ("h", "dt")  # arguments of a function that are no parameters
Asked = str | Sequence[str] | Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """A number of a problem: a key of a scene, or an argument of a function."""

    name: str
    value: float
    # The unit of its changes: |value|, or the scale that was given. A change of p by 1 is a
    # change of the value by the width.
    width: float

    def at(self, change: float) -> float:
        """The value after a change in units of the width."""
        return self.value + change * self.width


def choose_parameters(
    problem: Problem, asked: Asked | None, scale: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """The parameters that are asked for, or all numbers of fabric and terms that are not 0.

    It raises `InputError` for a name that is no number of the problem, for a number that changes
    the mesh, the steps or the solver, and for a value of 0 without a scale.
    """
    if not isinstance(asked, str | Sequence | Mapping | None):
        raise InputError(f"parameters = {brief(asked)}", "must be names, or a mapping", WHERE)
    known = dict(numbers_of(problem))
    if asked is None:
        names: Sequence[str] = [name for name in _usual(problem, known) if known[name]]
        if not names:
            remedy = "Name parameters, with a scale for each value of 0."
            raise InputError("parameters = None", f"{problem.name} has none", WHERE, remedy)
    else:
        listed = [asked] if isinstance(asked, str) else asked
        # The key of a pair stands for both of its numbers.
        names = [n for a in listed for n in ([k for k in known if k.startswith(f"{a}.")] or [a])]
    if not names or len(set(names)) < len(names):
        raise InputError(f"parameters = {asked!r}", "must be names, each one once", WHERE)
    for name in sorted(set(scale) - set(names)):
        raise InputError(f"scale of {name!r}", "is of no parameter here", WHERE)
    return tuple(_parameter(problem, name, known, scale) for name in names)


def _parameter(
    problem: Problem, name: str, known: Mapping[str, float], scale: Mapping[str, float]
) -> Parameter:
    refuse_sizes(problem, name)
    if name not in known:
        listed = ", ".join(known) or "no number"
        allowed = f"must be a number of the problem: {listed}"
        raise InputError(f"parameter {name!r}", allowed, WHERE, did_you_mean(name, known))
    value = known[name]
    width = scale.get(name, abs(value))
    if not (is_number(width) and width > 0):
        if name in scale:
            what = f"scale of {name!r} = {width!r}"
        else:
            what = f"parameter {name!r} = 0"
        remedy = f"Give the size of a usual change, as scale={{{name!r}: 0.01}}."
        raise InputError(what, "needs a change > 0 to compare with", WHERE, remedy)
    return Parameter(name, value, float(width))


def refuse_sizes(problem: Problem, name: str) -> None:
    """Refuse what changes the mesh, the steps or the solver."""
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
    """Names and values of all numbers that are not whole numbers."""
    if isinstance(problem, SceneProblem):
        listed = _numbers({k: v for k, v in problem.tables.items() if k not in REFUSED}, float)
        yield from (item for item in listed.items() if not _UNCERTAINTY.match(item[0]))
        return
    given = {k: v for k, v in _arguments(problem).items() if k not in SIZES}
    yield from _numbers(given, float | int).items()


def _arguments(problem: FunctionProblem) -> dict[str, object]:
    """The arguments of the function, given or by default."""
    listed = inspect.signature(problem.function).parameters
    return {name: item.default for name, item in listed.items()} | dict(problem.settings)


def _numbers(data: Mapping, kind: Any) -> dict[str, float]:
    values = flatten(data).items()
    return {name: float(v) for name, v in values if isinstance(v, kind) and is_number(v)}


def _usual(problem: Problem, known: Mapping[str, float]) -> list[str]:
    if isinstance(problem, SceneProblem):
        return [name for name in known if name.partition(".")[0] in TABLES]
    arguments = _numbers(_arguments(problem), float)  # without whole numbers, which may count
    return [name for name in known if name in arguments]


def setup_with(problem: Problem, values: Mapping[str, float], base: Setup) -> Setup:
    """The setup of the problem with other values, on nodes that belong to those of `base`.

    It raises `InputError` if the values are refused, or change the triangles or the held
    nodes.
    """
    try:
        changed = problem.changed(Change(values=grouped(problem, values)))
        setup = changed.setup(base.cloth)
    except InputError as error:
        allowed = "needs values on both sides of its own: " + str(error)
        raise InputError(f"parameter {' and '.join(values)}", allowed, WHERE) from None
    cloth = setup.cloth
    system = setup.system
    same = np.array_equal(cloth.triangles, base.cloth.triangles)
    if not (same and np.array_equal(system.constraints.nodes, base.system.constraints.nodes)):
        what = " and ".join(values)
        remedy = "Move the nodes of the same triangles, and hold the same nodes."
        raise InputError(f"parameter {what}", "changes the mesh or the held nodes", WHERE, remedy)
    return setup


def grouped(problem: Problem, values: Mapping[str, float]) -> dict[str, object]:
    """Values by the arguments of a function: items of a list together; of a scene as they are."""
    if isinstance(problem, SceneProblem):
        return dict(values)
    arguments = _arguments(problem)
    changed = dict[str, object]()
    for name, value in values.items():
        key, *rest = name.split(".")
        changed[key] = _replaced(changed.get(key, arguments[key]), rest, value)
    return changed


def _replaced(old: object, keys: Sequence[str], value: float) -> object:
    """The value in place of an item of `old`."""
    if not keys:
        return value
    first, *rest = keys
    if isinstance(old, Mapping):
        return {**old, first: _replaced(old[first], rest, value)}
    items = list(old)  # type: ignore[call-overload]  # a list or tuple, by `flatten`
    items[int(first)] = _replaced(items[int(first)], rest, value)
    return tuple(items) if isinstance(old, tuple) else items
