"""The numbers of a problem that its results depend on, and the problem with other ones."""

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from fecloth.errors import InputError, brief, did_you_mean, is_number
from fecloth.scene.table_model import as_tuples
from fecloth.scene.toml_text import flatten, without_empty
from fecloth.simulation.setup import Setup
from fecloth.study.change import Change
from fecloth.study.function_problem import FunctionProblem
from fecloth.study.problems import Problem, SceneProblem
from fecloth.system.reuse import reusing

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
    """Return the parameters that are asked for.

    If `asked` is None, return all numbers of fabric and terms, or all arguments of a function,
    that are not 0. A name that stands for several numbers, such as a list, gives a parameter for
    each. `scale` has the sizes of usual changes, by name. Raise `InputError` for a name that is
    no number of the problem or occurs twice, for a number that changes the mesh, the steps or
    the solver, for a value of 0 without a scale, for a scale of another name, and if there is
    no parameter.
    """
    if not isinstance(asked, str | Sequence | Mapping | None):
        raise InputError(f"parameters = {brief(asked)}", "must be names, or a mapping", WHERE)
    numbers = dict(numbers_of(problem))
    if asked is None:
        usual_names = _usual_names(problem, numbers)
        # a value of 0 has no usual change, so it is no parameter without a scale
        names: Sequence[str] = [name for name in usual_names if numbers[name]]
        if not names:
            remedy = "Name parameters, with a scale for each value of 0."
            raise InputError("parameters = None", f"{problem.name} has none", WHERE, remedy)
    else:
        names = []
        for name in [asked] if isinstance(asked, str) else asked:
            names_of_items = [key for key in numbers if key.startswith(f"{name}.")]
            names += names_of_items or [name]  # the key of a list stands for all of its numbers
    if not names or len(set(names)) < len(names):
        raise InputError(f"parameters = {asked!r}", "must be names, each one once", WHERE)
    for name in sorted(set(scale) - set(names)):
        raise InputError(f"scale of {name!r}", "is of no parameter here", WHERE)
    return tuple(_make_parameter(problem, name, numbers, scale) for name in names)


def _make_parameter(
    problem: Problem, name: str, numbers: Mapping[str, float], scale: Mapping[str, float]
) -> Parameter:
    """Return the parameter with this name.

    `numbers` are all numbers of the problem, `scale` the sizes of usual changes, both by name.
    Raise `InputError` for a number that changes the mesh, the steps or the solver, for an
    unknown name, and for a usual change that is not above 0, as of a value of 0 without a scale.
    """
    refuse_sizes(problem, name)
    if name not in numbers:
        all_names = ", ".join(numbers) or "no number"
        allowed = f"must be a number of the problem: {all_names}"
        raise InputError(f"parameter {name!r}", allowed, WHERE, did_you_mean(name, numbers))
    value = numbers[name]
    width = scale.get(name, abs(value))
    if not (is_number(width) and width > 0):
        what = f"parameter {name!r} = 0"
        if name in scale:
            what = f"scale of {name!r} = {width!r}"
        remedy = f"Give the size of a usual change, as scale={{{name!r}: 0.01}}."
        raise InputError(what, "needs a change > 0 to compare with", WHERE, remedy)
    return Parameter(name, value, float(width))


def refuse_sizes(problem: Problem, name: str) -> None:
    """Raise `InputError` for a number that is no parameter.

    Such a number changes the mesh, the steps or the solver, or, as of [output], no motion.
    """
    if isinstance(problem, SceneProblem):
        table = name.partition(".")[0]
        if reason := REFUSED.get(table):
            remedy = ""
            if table.startswith("cloth"):
                remedy = "A function of Python may move the nodes of the same triangles."
            elif table in ("time", "solver", "equilibrium") and name != "time.t_end":
                # not for t_end, because `converge` finds no error of it
                remedy = "fecloth converge says what its error is."
            raise InputError(f"parameter {name!r}", reason, WHERE, remedy)
    elif name in SIZES:
        remedy = "study.converge says what the error of h and dt is."
        raise InputError(f"parameter {name!r}", "changes the mesh or the steps", WHERE, remedy)


def numbers_of(problem: Problem) -> Iterator[tuple[str, float]]:
    """Yield the name and the value of each number that may be a parameter.

    Whole numbers of a scene are left out, because they count something. Whole numbers of a
    function are not: a user may write 2 for 2.0. Also left out are the uncertainties of numbers
    of a fabric, and h and dt of a function.
    """
    if isinstance(problem, SceneProblem):
        tables = {name: table for name, table in problem.tables.items() if name not in REFUSED}
        for name, value in _find_numbers(tables, float).items():
            if not _UNCERTAINTY.match(name):
                yield name, value
        return
    arguments = {key: value for key, value in _arguments(problem).items() if key not in SIZES}
    yield from _find_numbers(arguments, float | int).items()


def _arguments(problem: FunctionProblem) -> dict[str, object]:
    """Return the arguments of the function, given or by default."""
    parameters = inspect.signature(problem.function).parameters
    defaults = {name: parameter.default for name, parameter in parameters.items()}
    return defaults | dict(problem.settings)


def _find_numbers(data: Mapping, kind: Any) -> dict[str, float]:
    """Return the numbers of this kind in tables and lists, by their dotted names."""
    values = flatten(data).items()
    return {name: float(v) for name, v in values if isinstance(v, kind) and is_number(v)}


def _usual_names(problem: Problem, numbers: Mapping[str, float]) -> list[str]:
    """Return the names that are meant if none is given, out of all `numbers` of the problem."""
    if isinstance(problem, SceneProblem):
        return [name for name in numbers if name.partition(".")[0] in TABLES]
    arguments = _find_numbers(_arguments(problem), float)  # whole numbers may count something
    return [name for name in numbers if name in arguments]


def setup_with(problem: Problem, values: Mapping[str, float], base: Setup) -> Setup:
    """Return the setup of the problem with other values, on the same triangles as `base`.

    A scene is built on the cloth of `base`; a function makes its own cloth. All that does not
    depend on the values is taken from `base`. Raise `InputError` if the values are refused, or
    change the triangles or the held nodes: then the positions of both runs cannot be compared
    node by node.
    """
    try:
        with reusing(base.system):
            setup = _setup_on(problem, values, base)
    except InputError as error:
        # its own value is allowed, so this one lies beyond an end of what is allowed
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


def _setup_on(problem: Problem, values: Mapping[str, float], base: Setup) -> Setup:
    """Return the setup with other values, with as much of `base` as stays the same.

    Of a scene whose values are all of the fabric and the terms, only these are made again. If
    they are refused, the whole scene is read, which says what is wrong.
    """
    in_tables = all(name.partition(".")[0] in TABLES for name in values)
    if isinstance(problem, SceneProblem) and in_tables:
        with suppress(ValidationError):
            return replace(base, system=base.system.replace(**_fabric_and_terms(problem, values)))
    return problem.changed(Change(values=grouped(problem, values))).setup(base.cloth)


def _fabric_and_terms(problem: SceneProblem, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the arguments of `System` that a scene has in its `TABLES`, with other values.

    Raise `ValidationError` if a table does not allow its value.
    """
    scene = problem.scene
    own_tables = {name: table for name, table in problem.tables.items() if name in TABLES}
    tables = as_tuples(without_empty(Change(values=values).apply(own_tables)))
    own_tables = as_tuples(without_empty(own_tables))

    def make(model: Any, table: dict, own_table: dict) -> Any:
        if table == own_table:
            return model.make()
        return type(model).model_validate(table, context={"folder": Path()}).make()

    terms = list(map(make, scene.terms, tables.get("terms", ()), own_tables.get("terms", ())))
    fabric: Any
    if scene.fabric:
        fabric = make(scene.fabric, tables["fabric"], own_tables["fabric"])
    else:
        fabric = {
            name: make(model, tables["fabrics"][name], own_tables["fabrics"][name])
            for name, model in (scene.fabrics or {}).items()
        }
    return {"terms": terms, "fabric": fabric}


def grouped(problem: Problem, values: Mapping[str, float]) -> dict[str, object]:
    """Return the values as `Change` takes them.

    The values of a scene stay as they are, by their dotted keys. A function takes whole
    arguments: a value of the item "stiffness.0" gives the list `stiffness` with this item
    changed.
    """
    if isinstance(problem, SceneProblem):
        return dict(values)
    arguments = _arguments(problem)
    changed = dict[str, object]()
    for name, value in values.items():
        argument, *keys_of_item = name.split(".")
        # another item of the same list may be changed already
        old = changed.get(argument, arguments[argument])
        changed[argument] = _replaced(old, keys_of_item, value)
    return changed


def _replaced(old: object, keys: Sequence[str], value: float) -> object:
    """Return `old` with the value in place of one item, which may be nested.

    The keys lead to the item: each is the key of a mapping, or the number of an item of a list
    or tuple. Without keys the value takes the place of `old`. `old` itself is not changed.
    """
    if not keys:
        return value
    first_key, *other_keys = keys
    if isinstance(old, Mapping):
        return {**old, first_key: _replaced(old[first_key], other_keys, value)}
    items = list(old)  # type: ignore[call-overload]  # a list or tuple, by `flatten`
    number = int(first_key)
    items[number] = _replaced(items[number], other_keys, value)
    if isinstance(old, tuple):
        return tuple(items)
    return items
