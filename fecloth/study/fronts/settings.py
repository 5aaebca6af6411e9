"""The settings of a front: lines of method, element, pattern and terms, with h and dt."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from fecloth.integrators import EXPLICIT, METHODS, studied_by
from fecloth.study.problem import StudyProblem, refuse_methods
from fecloth.study.variants import known_names
from fecloth.terms import TRAITS

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT, "auto": None}
ELEMENTS = ("P1", "P2")
PATTERNS = ("right", "cross", "equilateral", "unstructured")
MODELS = tuple(name for name, traits in TRAITS.items() if traits.kind == "membrane")
FIRST_STEPS = 4  # equal steps of the coarsest dt
FIRST_RTOL = 0.1  # tolerance of the coarsest chosen steps [1/s]
# Of two settings that are neighbours: h over the finer h, dt and rtol over the finer ones.
RATIO_OF_H = math.sqrt(2)
RATIO_OF_DT = 2.0
RATIO_OF_RTOL = 4.0


@dataclass(frozen=True)
class Line:
    """What the settings of one line have in common; "" is what the problem itself has.

    Attributes
    ----------
    method, element, model, pattern
        Names as in a scene.
    terms
        The name of a change of the terms.
    """

    method: str = ""
    element: str = ""
    model: str = ""
    pattern: str = ""
    terms: str = ""

    def __str__(self) -> str:
        words = (self.method, self.element, self.model, self.pattern, self.terms)
        return " ".join(word for word in words if word)


@dataclass(frozen=True)
class Setting:
    """A line with its sizes: `i` and `j` say how often h and dt were refined."""

    line: Line
    i: int = 0
    j: int = 0

    def finer(self, i: int = 0, j: int = 0) -> "Setting":
        """Return the setting with an h and a dt that are refined so many times more."""
        return replace(self, i=self.i + i, j=self.j + j)


@dataclass(frozen=True, eq=False)
class Settings:
    """All settings of a problem.

    Attributes
    ----------
    problem
        The problem.
    coarsest
        The largest h [m]; None for a mesh without h.
    changes
        Values for `StudyProblem.at` by the names of changes of the terms.
    values
        The only values of "h" and of "dt" that are tried, the coarsest first; what is left out
        has any value.
    finest
        The least h of a setting whose neighbours are sought [m]; None for any.
    sharper
        Divides the solver's tolerance, as for `StudyProblem`; None leaves the solver as it is.
    """

    problem: StudyProblem
    coarsest: float | None
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    finest: float | None = None
    sharper: float | None = None

    @classmethod
    def of(
        cls,
        problem: StudyProblem,
        changes: Mapping[str, Mapping[str, Any]] | None = None,
        finest: float | None = None,
    ) -> "Settings":
        """Return the settings of a problem, from meshes that are as coarse as its cloth allows.

        The largest h is a quarter of the length of the cloth, or its width if that is less.
        """
        coarsest = None
        if problem.h is not None:
            extent = np.ptp(problem.first.cloth.X, axis=0)
            coarsest = float(f"{min(*extent, max(extent) / 4):.6g}")
        return cls(problem, coarsest, changes or {}, finest=finest)

    def sizes_in_time(self, line: Line) -> str:
        """Return what the steps of a line follow: "dt", "rtol", or "" for nothing to refine.

        Explicit methods take their stable step, an equilibrium has none, and of a function that
        takes no dt the steps are its own.
        """
        if self.problem.is_static or line.method in EXPLICIT:
            return ""
        if line.method == "auto":
            return "rtol"
        if line.method in METHODS or self.problem.dt is not None:
            return "dt"
        return "rtol" if self.problem.rtol else ""

    def choice_of_sizes(self, setting: Setting) -> dict[str, float]:
        """Return h, and dt or rtol, of a setting, as far as it has them."""
        sizes = {}
        if self.coarsest is not None:
            h = self.coarsest / RATIO_OF_H**setting.i
            if "h" in self.values:
                h = self.values["h"][setting.i]
            sizes["h"] = float(f"{h:.6g}")
        size = self.sizes_in_time(setting.line)
        if size == "dt":
            assert self.problem.span is not None
            sizes["dt"] = self.problem.span / (FIRST_STEPS * RATIO_OF_DT**setting.j)
            if "dt" in self.values:
                sizes["dt"] = self.values["dt"][setting.j]
        elif size == "rtol":
            sizes["rtol"] = FIRST_RTOL / RATIO_OF_RTOL**setting.j
        return sizes

    def choice(self, setting: Setting) -> dict[str, Any]:
        """Return the values of a setting by their names, for `StudyProblem.choose`."""
        line = setting.line
        names = ("method", "element", "model", "pattern")
        choice = {name: getattr(line, name) for name in names if getattr(line, name)}
        return {**choice, **self.choice_of_sizes(setting)}

    def problem_of(self, setting: Setting) -> StudyProblem:
        """Return the problem with a setting; raise `InputError` if it refuses that."""
        problem = self.problem.at(self.changes.get(setting.line.terms, {}), setting.line.terms)
        chosen = problem.choose(name=str(setting.line), **self.choice(setting))
        return chosen.finer(sharper=self.sharper)

    def varies(self, line: Line) -> tuple[bool, bool]:
        """Return whether a line has an h, and a dt or rtol, to refine."""
        return self.coarsest is not None, bool(self.sizes_in_time(line))

    def can_be_finer(self, setting: Setting) -> tuple[bool, bool]:
        """Return whether h, and whether dt or rtol, of a setting can be refined."""
        has_h, has_steps = self.varies(setting.line)
        last_h = "h" in self.values and setting.i + 1 >= len(self.values["h"])
        if self.finest and self.coarsest:
            last_h |= self.coarsest / RATIO_OF_H ** (setting.i + 1) < 0.99 * self.finest
        last_dt = "dt" in self.values and self.sizes_in_time(setting.line) == "dt"
        last_dt = last_dt and setting.j + 1 >= len(self.values["dt"])
        return has_h and not last_h, has_steps and not last_dt


def make_lines(
    problem: StudyProblem,
    methods: Sequence[str] | None,
    elements: Sequence[str] | None,
    models: Sequence[str] | None = None,
    patterns: Sequence[str] | None = None,
    study: str = "front",
) -> list[Line]:
    """Return a line for each combination of names.

    None stands for the usual names: the problem's own method and the usual ones, P1 and P2, its
    own model and, on a rectangle, its own pattern. Names that a function has no argument for are
    not varied. Raise `InputError` for an unknown name, and for methods of an equilibrium.
    """
    refuse_methods(problem, methods, study)
    cloth = problem.tables["cloth"]
    own_models = [term["type"] for term in problem.tables["terms"]]
    usual = {
        "method": [] if problem.is_static else usual_methods(problem),
        "element": [cloth.get("element", "P1"), *ELEMENTS],
        "pattern": [cloth["pattern"]] if cloth.get("pattern") else [],
        "model": [],
    }
    known: dict[str, Iterable[str]] = {
        "method": ALL_METHODS,
        "element": ELEMENTS,
        "pattern": PATTERNS,
        "model": dict.fromkeys([*own_models, *MODELS]),
    }
    asked = {"method": methods, "element": elements, "pattern": patterns, "model": models}
    names: dict[str, list[str]] = {}
    for what, given in asked.items():
        if given is None and what not in problem.source.usual_variations:
            names[what] = [""]
        elif what == "model" and what in problem.source.keys:  # an argument, with any values
            names[what] = list(given or [""])
        else:
            chosen = usual[what] if given is None else given
            names[what] = known_names(what, chosen, known[what]) or [""]
    combinations = product(*(names[what] for what in ("method", "element", "model", "pattern")))
    return [Line(*words) for words in combinations]


def usual_methods(problem: StudyProblem) -> list[str]:
    """Return the names of the methods that are tried, the problem's own one first."""
    own = problem.source.method
    names = [own] if own in ALL_METHODS else []
    return list(dict.fromkeys([*names, *studied_by("chart"), "auto"]))
