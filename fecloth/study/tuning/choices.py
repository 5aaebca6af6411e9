"""The settings among which `tune` chooses: mesh, element, method and steps of a problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT, studied_by
from fecloth.mesh.grading import Grading
from fecloth.study.change import Change
from fecloth.study.chart_grid import ALL_METHODS, ELEMENTS, change_names, known_names
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.setups import table_of_grading
from fecloth.study.workload import EQUILATERAL, TRIANGLES

CONTROLLED = "bdf2"  # the method whose steps are also chosen by rtol
PATTERNS = ("right", "cross", "equilateral", "unstructured")


@dataclass(frozen=True)
class Choice:
    """One setting."""

    # "P1" or "P2"; the pattern of the mesh, "" where it has none.
    element: str = ""
    pattern: str = ""
    h: float | None = None  # edge length [m]; None for the mesh of the problem
    # The method, and its number of equal steps or its tolerance [1/s]. Without both, explicit
    # methods go near their stability limit. "" is the method of the problem.
    method: str = ""
    steps: int | None = None
    rtol: float | None = None
    linear: str = ""  # the linear solver; "" for the solver of the problem
    # Divides a fixed tolerance of the nonlinear solver; None for the solver of the problem.
    sharper: float | None = None
    grading: tuple[Grading, ...] = ()  # places with smaller triangles; () as in the problem

    @property
    def is_explicit(self) -> bool:
        """Whether the steps follow from the stability limit."""
        return self.method in EXPLICIT

    @property
    def mesh(self) -> tuple[str, str, tuple[Grading, ...]]:
        """Element, pattern and grading."""
        return self.element, self.pattern, self.grading

    @property
    def rule(self) -> tuple[str, bool]:
        """Method, and whether rtol chooses the steps."""
        return self.method, self.rtol is not None

    def __str__(self) -> str:
        graded = "graded" if self.grading else ""
        mesh = " ".join(part for part in (self.element, self.pattern, graded) if part)
        size = f"h = {1e3 * self.h:.3g} mm" if self.h else ""
        how = f"rtol = {self.rtol:g} 1/s" if self.rtol else ""
        how = f"{self.steps} steps" if self.steps else how
        parts = (mesh, size, self.method, how, self.linear)
        exact = "sharper tolerance" if self.sharper else ""
        return ", ".join(part for part in (*parts, exact) if part)


def own_choice(opened: Problem) -> Choice:
    """Return the element, the pattern and h of the problem itself."""
    if isinstance(opened, FunctionProblem):
        return Choice(h=opened.h)
    cloth = opened.scene.cloth
    pattern = cloth.pattern if cloth.shape == "rectangle" else ""
    return Choice(cloth.element, pattern, cloth.h)


def meshes_to_try(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return the elements and patterns of a problem, its own pattern first.

    Other patterns are tried with the first element only: on P2 they differ less.
    """
    own = own_choice(opened)
    if isinstance(opened, FunctionProblem):
        return [replace(own, element=element) for element in elements or ("",)]
    chosen = known_names("element", elements or ELEMENTS, ELEMENTS)
    patterns = dict.fromkeys([own.pattern, *PATTERNS]) if own.pattern else {"": None}
    return [
        replace(own, element=element, pattern=pattern, h=_same_triangles(own, pattern))
        for pattern in patterns
        for element in (chosen if pattern == own.pattern else chosen[:1])
    ]


def _same_triangles(own: Choice, pattern: str) -> float | None:
    """Return the edge length with which a pattern has as many triangles as the scene's own."""
    if own.h is None or pattern == own.pattern:
        return own.h
    count = [TRIANGLES.get(name, EQUILATERAL) for name in (pattern, own.pattern)]
    return own.h * math.sqrt(count[0] / count[1])


def methods_to_try(opened: Problem, methods: Sequence[str] | None) -> list[str]:
    """Return the methods of a problem; [""] where there is none to choose."""
    if opened.span is None:
        if methods:
            remedy = "Leave the methods out."
            raise InputError(
                f"methods = {methods!r}", "an equilibrium has no method", "tune", remedy
            )
        return [""]
    if isinstance(opened, FunctionProblem):
        return list(methods) if methods else [""]
    if methods:
        return known_names("method", methods, ALL_METHODS)
    own = opened.scene.time.method.type
    tried = sorted(studied_by("tune"), key=_preference)
    return list(dict.fromkeys([*tried, *([own] if own != "auto" else [])]))


def _preference(name: str) -> tuple:
    """Return the sort key of a method: explicit first, then by high order, then by damping."""
    traits = ALL_METHODS[name]().traits
    return not traits.explicit, -traits.order, traits.at_infinity


def problem_with(opened: Problem, choice: Choice) -> Problem:
    """Return the problem with a choice."""
    return opened.changed(change_of(opened, choice))


def change_of(opened: Problem, choice: Choice) -> Change:
    """Return the change to a choice; without `sharper`, which a level of the problem has."""
    if isinstance(opened, FunctionProblem):
        names = {"method": choice.method, "element": choice.element}
        dt = opened.t_end / choice.steps if choice.steps and opened.t_end else opened.dt
        return Change(values={"h": choice.h, "dt": dt} | {k: v for k, v in names.items() if v})
    return Change(edits=(*_steps_of(opened, choice).edits, partial(_set_mesh_and_solver, choice)))


def _steps_of(opened: SceneProblem, choice: Choice) -> Change:
    """Return the change to the element, the method and the steps of a choice."""
    names: dict = {"element": choice.element or opened.scene.cloth.element, "model": ""}
    names["method"] = choice.method or "equilibrium"  # keeps its time as it is
    if choice.rtol:
        names["rtol"] = choice.rtol
    elif choice.steps and opened.span:
        names["dt"] = opened.span / choice.steps
    return change_names(opened, names)


def _set_mesh_and_solver(choice: Choice, tables: dict) -> dict:
    if choice.pattern:
        tables["cloth"]["pattern"] = choice.pattern
    if choice.h is not None:
        tables["cloth"]["h"] = choice.h
    if choice.grading:
        tables["cloth"]["grading"] = list(map(table_of_grading, choice.grading))
    if choice.linear:
        tables.setdefault("solver", {})["linear"] = choice.linear
    if choice.is_explicit:
        tables.pop("solver", None)
    dt, every = tables.get("time", {}).get("dt", "auto"), tables["output"].get("every")
    if dt != "auto" and every and every < dt:
        tables["output"]["every"] = dt  # frames come no more often than steps
    return tables
