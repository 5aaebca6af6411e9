"""A user's function as a source of set-ups: its arguments by name make a set-up."""

import inspect
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from fecloth import terms as all_terms
from fecloth.errors import InputError, did_you_mean, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.integrators import EXPLICIT
from fecloth.integrators.protocol import method_of
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.scene.toml_text import flatten
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.resolve import choose_steps
from fecloth.simulation.setup import Setup
from fecloth.stability.critical_step import critical_dt
from fecloth.study.fingerprint import load_function, source_hash
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.traits import parameters_of, traits_of

RETURNS = "must return cloth, system, method and start"
SIZES = ("h", "dt")  # arguments that are no parameters; a function need not take them
# Arguments that studies vary if the function takes them, beside its sizes.
VARIED = ("method", "element", "model", "pattern", "grading")
VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
# Functions that this process has imported, by file and name.
known_functions: dict[tuple[str, str], Callable] = {}


@dataclass(frozen=True, eq=False)
class FunctionSource:
    """A function of h, dt and other arguments that returns cloth, system, method and start.

    Attributes
    ----------
    function
        The function.
    arguments
        Its arguments by name, with h and dt where the problem has them.
    t_end
        End of the run [s]; None for an equilibrium.
    placed
        The probes.
    terms
        Terms in place of the function's own, as `describe_term` describes them, or None.
    """

    function: Callable
    arguments: Mapping[str, Any] = field(default_factory=dict)
    t_end: float | None = None
    placed: tuple[Probe, ...] = ()
    terms: list[dict] | None = None

    kind: ClassVar[str] = "function"
    usual_variations: ClassVar[tuple[str, ...]] = ()  # its other arguments vary only if asked
    tells_method: ClassVar[bool] = False  # before a set-up is made
    interest: ClassVar[tuple[Quantity, ...]] = ()  # a function names no quantities
    fabrics: ClassVar[Mapping[str, Fabric]] = {}  # which are not known by name
    suffix: ClassVar[str] = "txt"  # of a file with its text

    @property
    def name(self) -> str:
        """The name of the function."""
        return getattr(self.function, "__name__", "problem")

    where = name

    @property
    def keys(self) -> dict[str, str]:
        """The key of each value that studies vary: an argument, or "terms"."""
        taken = inspect.signature(self.function).parameters
        names = (*SIZES, *(name for name in VARIED if name in taken))
        return {name: name for name in (*names, "terms")}

    @property
    def h(self) -> float | None:
        """Edge length [m]; None where there is none to refine."""
        return self.arguments.get("h")

    @property
    def dt(self) -> float | None:
        """Fixed step [s]; None where there is none."""
        return None if self.t_end is None else self.arguments.get("dt")

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the arguments without a default that are not given."""
        parameters = inspect.signature(self.function).parameters.values()
        needed = [p.name for p in parameters if p.default is p.empty and p.kind not in VARIADIC]
        return tuple(name for name in needed if self.arguments.get(name) is None)

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.placed)

    @property
    def span(self) -> float | None:
        """Length of the run [s]; None for an equilibrium."""
        return self.t_end

    @property
    def has_stable_steps(self) -> bool:
        """Whether the steps follow from the limit of an explicit method."""
        return self.is_explicit and self.first.steps.dt is None

    @property
    def is_explicit(self) -> bool:
        """Whether the steps solve no equations."""
        return not self.first.is_static and self.first.steps.traits.explicit

    @property
    def method(self) -> str:
        """The argument `method`, else the name of the method's class; "" of an equilibrium."""
        if isinstance(self.arguments.get("method"), str):
            return self.arguments["method"]
        return "" if self.first.is_static else type(method_of(self.first.steps)).__name__

    @cached_property
    def first(self) -> Setup:
        """The set-up, which is made once."""
        return self.setup()

    @cached_property
    def tables(self) -> dict:
        """What studies look at, in the form of a scene's tables: cloth, terms, time."""
        first = self.first
        cloth: dict = {"element": first.cloth.element}
        if self.h is not None:
            cloth["h"] = self.h
        terms = self.terms
        if terms is None:
            terms = [describe_term(term, i) for i, term in enumerate(first.system.terms)]
        tables: dict[str, Any] = {"cloth": cloth, "terms": terms}
        if first.is_static:
            steps = first.steps.load_steps if isinstance(first.steps, LoadSteps) else 1
            return tables | {"equilibrium": {"load_steps": steps}}
        return tables | {"time": {"dt": self.dt or "auto", "t_end": self.t_end}}

    def changed(self, values: Mapping[str, Any], name: str = "") -> "FunctionSource":
        """Return the source with other arguments, or other terms.

        The items of lists and tables have keys with dots, as "stiffness.0" and "terms.1.gap". A
        table for a term is always for a term of the system, also where the function has an
        argument `terms`; None in its place leaves the term out. `name` is not used: the errors of
        a function name its argument. Raise `InputError` for an argument that the function does
        not take.
        """
        arguments = dict(self.arguments)
        terms = self.terms
        own_terms = "terms" in inspect.signature(self.function).parameters
        for key, value in values.items():
            first, *items = key.split(".")
            is_table = bool(items) and isinstance(value, Mapping | None)
            if first == "terms" and (is_table or not own_terms):
                terms = with_item(terms or self.tables["terms"], items, value)
            else:
                old = arguments.get(first, self._defaults.get(first))
                arguments[first] = with_item(old, items, value)
        changed = {key: value for key, value in arguments.items() if key not in SIZES}
        accepted(self.function, changed)  # refuses what the function does not take
        if terms is not None:
            terms = [term for term in terms if term is not None]
        return replace(self, arguments=arguments, terms=terms)

    @property
    def _defaults(self) -> dict[str, object]:
        """The defaults of the arguments."""
        parameters = inspect.signature(self.function).parameters
        return {name: parameter.default for name, parameter in parameters.items()}

    def interested_in(self, quantities: Sequence[str]) -> "FunctionSource":
        """Return the source itself, because a function names no quantities."""
        return self

    def values_of(self, choice: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values by key of a choice by the names of `keys`.

        An explicit method takes its stable step: then dt is None. Raise `InputError` for what the
        function has no argument for.
        """
        for name, value in choice.items():
            if name not in self.keys:
                what = f"{name} = {value!r}"
                raise InputError(what, f"needs a function with the argument {name}", self.name)
        if choice.get("method") in EXPLICIT:
            return {"dt": None, **choice}
        return dict(choice)

    def setup(self, cloth: Cloth | None = None) -> Setup:
        """Call the function with the arguments that it takes, and return its set-up.

        dt is reduced so that it divides the run into equal steps. `cloth` is not used, because
        the function makes its own. Raise `InputError` if the function does not return cloth,
        system, method and start, or does not take an argument.
        """
        arguments = dict(self.arguments)
        dt = arguments.get("dt")
        if dt is not None and self.t_end is not None:
            dt = self.t_end / math.ceil(self.t_end / dt - 1e-9)  # 1e-9 is round-off
            arguments["dt"] = dt
        if "grading" in arguments:  # the tables of gradings, as a case has them
            arguments["grading"] = [Grading(**entry) for entry in arguments["grading"]]
        returned = self.function(**accepted(self.function, arguments))
        if not (isinstance(returned, tuple | list) and len(returned) == 4):
            raise InputError(f"the function {self.name}", RETURNS, "problem")
        _, system, method, start = returned
        if not (isinstance(system, System) and isinstance(start, State)):
            raise InputError(f"the function {self.name}", RETURNS, "problem")
        setup = Setup(system=system, start=start, probes=self.placed)
        load_steps = max((term.load_steps for term in system.bound), default=1)
        if self.t_end is not None:
            fixed_dt = None if method.traits.chooses_dt else dt
            setup = replace(setup, t_end=self.t_end, steps=choose_steps(method, fixed_dt, {}))
        elif load_steps > 1:  # a term says that the equilibrium depends on how the loads grow
            setup = replace(setup, t_end=1.0, steps=LoadSteps(load_steps))  # 1: all of the loads
        if self.terms is None:
            return setup
        return with_terms(setup, self.terms)

    def setup_on(self, values: Mapping[str, Any], base: Setup) -> Setup:
        """Return the set-up with other values; the function makes its own cloth, not `base`'s."""
        return self.changed(values).setup()

    @property
    def cloth(self) -> Cloth:
        """The cloth alone."""
        return self.first.cloth

    def numbers(self) -> Iterator[tuple[str, float]]:
        """Yield the name and the value of each number that may be a parameter: not h and dt.

        Whole numbers are among them, because a user may write 2 for 2.0.
        """
        for name, value in flatten(self._all_arguments).items():
            if isinstance(value, float | int) and is_number(value):
                yield name, float(value)

    @property
    def _all_arguments(self) -> dict[str, object]:
        """The arguments without h and dt, given or by default."""
        arguments = self._defaults | dict(self.arguments)
        return {name: value for name, value in arguments.items() if name not in SIZES}

    def has_parameter(self, name: str) -> bool:
        """Whether a name is an argument but h and dt, or an item of such an argument."""
        return name.partition(".")[0] in self._all_arguments

    def is_usual_parameter(self, name: str) -> bool:
        """Whether a number is a parameter if none is named: a whole number may count something."""
        return isinstance(flatten(self._all_arguments)[name], float)

    def refuse_parameter(self, name: str) -> None:
        """Raise `InputError` for h and dt."""
        if name in SIZES:
            remedy = "study.converge says what the error of h and dt is."
            what = f"parameter {name!r}"
            raise InputError(what, "changes the mesh or the steps", "sensitivity", remedy)

    def refuse_refining(self, size: str) -> None:
        """Raise `InputError` that says that there is no h, or no dt, to refine."""
        if size == "dt" and self.t_end is None:
            raise InputError("t_end is missing", "an equilibrium has no dt", self.name)
        allowed = f"refine = {size!r} needs the {size} of the first level"
        raise InputError(f"{size} is missing", allowed, self.name, f"Give {size}=….")

    def text(self) -> str:
        """Return terms, their strains, h and dt as lines."""
        terms = self.tables["terms"]
        lines = [f"terms: {', '.join(term['type'] for term in terms) or 'none'}"]
        lines += [f"strain of {t['type']}: {t['strain']}" for t in terms if "strain" in t]
        sizes = [(name, self.arguments.get(name)) for name in SIZES]
        lines += [f"{name} = {size:g}" for name, size in sizes if size is not None]
        return "\n".join(lines) + "\n"

    @property
    def file_text(self) -> str:
        """The text of a scene's file, which a function does not have."""
        return ""

    @property
    def is_importable(self) -> bool:
        """Whether other processes can import the function and know its probes."""
        are_named = all(isinstance(probe.where, str | None) for probe in self.placed)
        return are_named and _find_file(self.function) is not None

    def case(self) -> dict[str, object]:
        """Return all that determines a run, as JSON values.

        The function is also put into `known_functions`, so that `of_case` in this process need
        not import the file again.
        """
        file = _find_file(self.function) or ""
        known_functions[file, self.function.__name__] = self.function
        probes = []
        for probe in self.placed:
            point = list(probe.point) if probe.point else None
            probes.append([probe.name, probe.where, point])
        return {
            "path": file,
            "name": self.function.__name__,
            "digest": source_hash(file) if file else "",
            "arguments": json.loads(json.dumps(dict(self.arguments), default=list)),
            "t_end": self.t_end,
            "probes": probes,
            "terms": self.terms,
        }

    @classmethod
    def of_case(
        cls, path: str, name: str, digest: str, probes: list, **more: Any
    ) -> "FunctionSource":
        """Return the source of a case, as `case` has written it.

        `digest` is not used here: it is in the case so that an edited file makes another case.
        The function comes from this process or, if it is not known here, from its file.
        """
        function = known_functions.get((path, name)) or load_function(path, name)
        placed = tuple(Probe(probe_name, where, point) for probe_name, where, point in probes)
        return cls(function, placed=placed, **more)

    def has_shape_of(self, other: Any) -> bool:
        """Whether the number of triangles follows from h: it is assumed, as no mesh is made.

        `other` is the source that this one was made of.
        """
        return True

    def count_triangles(self) -> float:
        """Return the number of triangles, for which the mesh is made."""
        return len(self.first.cloth.triangles)

    def count_stable_steps(self, triangles: float) -> float:
        """Estimate the number of stable steps on so many triangles, from the first mesh."""
        first = self.first
        assert self.t_end is not None
        limit = critical_dt(first.system, first.start, method_of(first.steps))
        steps = (self.t_end - first.start.t) / limit
        return math.ceil(steps * math.sqrt(triangles / self.count_triangles()))


def with_item(old: Any, keys: Sequence[str], value: object) -> Any:
    """Return `old` with a value in place of one item, which may be nested.

    The keys lead to the item: each is the key of a mapping, or the number of an item of a list
    or tuple. Without keys the value takes the place of `old`. `old` itself is not changed.
    """
    if not keys:
        return value
    first, *others = keys
    if isinstance(old, Mapping):
        return {**old, first: with_item(old[first], others, value)}
    items = list(old)
    items[int(first)] = with_item(items[int(first)], others, value)
    return tuple(items) if isinstance(old, tuple) else items


def accepted(function: Callable, arguments: Mapping[str, object]) -> dict[str, object]:
    """Return the arguments that a function takes; it need not take h and dt.

    Raises `InputError` for any other argument that it does not take.
    """
    parameters = inspect.signature(function).parameters
    kinds = [parameter.kind for parameter in parameters.values()]
    if inspect.Parameter.VAR_KEYWORD in kinds:  # **arguments takes any
        return dict(arguments)
    unknown = sorted(set(arguments) - set(parameters) - set(SIZES))
    if unknown:
        name = unknown[0]
        allowed = f"the function takes {', '.join(parameters) or 'nothing'}"
        remedy = did_you_mean(name, parameters)
        raise InputError(f"{name} = {arguments[name]!r}", allowed, "problem", remedy)
    return {key: value for key, value in arguments.items() if key in parameters}


def table_of_grading(grading: Grading) -> dict[str, object]:
    """Return a grading as a table of [[cloth.grading]], in JSON's types."""
    table = {key: value for key, value in asdict(grading).items() if value is not None}
    if "point" in table:
        table["point"] = list(table["point"])
    return table


def describe_term(term: Any, number: int) -> dict:
    """Return a term as a table, which a study may change and `with_terms` reads again.

    `number` is the place of the term in the system, from 0. The table has only what studies
    change or look at: the type, the strain measure, the gap, the friction, and whether a rest
    shape is given.
    """
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
    """Return the setup with the terms of these tables in place of its own.

    If there is no term with which clamped pins can hold the normals of the cloth, no pin clamps.
    """
    system: Any = setup.system
    new_terms = tuple(_make_term(term, system.terms) for term in terms)
    pins = system.pins
    if not any(traits_of(term).holds_normals for term in new_terms):
        pins = tuple(replace(p, clamp=False) if getattr(p, "clamp", False) else p for p in pins)
    return replace(setup, system=system.replace(terms=new_terms, pins=pins))


def _make_term(table: Mapping, own_terms: Sequence) -> Any:
    """Return the term of a table that `describe_term` made, and a study may have changed.

    It is the term of the system with the number in the table, with the strain measure and the
    gap of the table. A table without a number is of another term, with its defaults.
    """
    if "number" not in table:
        return getattr(all_terms, table["type"])()
    term = own_terms[table["number"]]
    parameters = parameters_of(term)
    changed = {}
    for key in ("strain", "gap"):
        if table.get(key) != parameters.get(key) and key in parameters:
            changed[key] = table.get(key)
    if changed:
        return replace(term, **changed)
    return term


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
