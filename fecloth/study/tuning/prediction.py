"""The cheapest setting that should meet a tolerance, from measured errors and seconds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fecloth.study.tuning.choices import SEARCH, Choice, Trial
from fecloth.study.tuning.space_errors import Mesh
from fecloth.study.tuning.time_errors import Rule, TimeErrors, key_of, size_of

FINE = 2 ** (1 / 6)  # ratio of the sizes that are compared
COARSER, FINER = 0.5, 16.0  # times the measured √triangles
LONGER, SHORTER = 1.0, 64.0  # times the measured numbers of steps
NOISE = 1.1  # times the least seconds: settings whose order the measured seconds do not tell
NODES_OF_P2 = 2.0  # per edge, over the nodes of P1
P2_STEPS = 2.0  # explicit steps on P2 over the steps on P1 with the same triangles
MARGIN = 0.75  # part of the tolerance that predicted errors may take
IN_TIME = 0.9  # part of the budget that predicted seconds may take
TIMES = 3.0  # times the CPU time of the tuned run: what its search may take if this is longer


@dataclass(frozen=True, eq=False)
class Candidate:
    """A setting with its predicted errors in space and time, (q,) each, and seconds."""

    mesh: Mesh
    rule: Rule
    edges: float
    x: float
    space: np.ndarray
    time: np.ndarray
    seconds: float

    @property
    def choice(self) -> Choice:
        return self.rule.choose(self.mesh.choose(self.edges), self.x)

    @property
    def key(self) -> tuple:
        """What its measured seconds hold for: element, pattern and rule."""
        return self.mesh.choice.mesh, *self.rule.key

    @property
    def error(self) -> float:
        return float((self.space + self.time).max())


@dataclass(frozen=True, eq=False)
class Prediction:
    """Errors and seconds of all meshes and methods."""

    meshes: Sequence[Mesh]
    times: TimeErrors
    coarse: Trial  # the run that the measurements of methods and meshes share
    other: float = 0.0  # error that no mesh and no step changes: of the solver and left-out terms
    # Measured over predicted seconds, by `Candidate.key`.
    factors: Mapping[tuple, float] = field(default_factory=dict)
    # Power of √triangles with which errors in time grow, by `Rule.key`: finer meshes have
    # shorter waves.
    growth: Mapping[tuple, float] = field(default_factory=dict)
    dropped: frozenset[tuple] = frozenset()  # `Candidate.key` of what is not tried again

    def with_seconds(self, candidate: Candidate, seconds: float) -> "Prediction":
        """Return the prediction with the measured seconds of a candidate."""
        factor = self.factors.get(candidate.key, 1.0) * seconds / candidate.seconds
        return replace(self, factors={**self.factors, candidate.key: factor})

    def without(self, candidate: Candidate, on_all_meshes: bool = False) -> "Prediction":
        """Return the prediction without the rule of a candidate on its mesh, or on all meshes."""
        meshes = self.meshes if on_all_meshes else [candidate.mesh]
        keys = {(mesh.choice.mesh, *candidate.rule.key) for mesh in meshes}
        return replace(self, dropped=self.dropped | keys)

    def pairs(self) -> list[tuple[Mesh, Rule]]:
        """Return all meshes with all rules.

        Explicit methods lump the mass, which changes the error of P2: there both kinds of rules
        need meshes that were run with their own kind.
        """
        lumped = self.coarse.choice.is_explicit
        return [
            (mesh, rule)
            for mesh in self.meshes
            for rule in self.times.rules
            if (mesh.choice.element != "P2" or (rule.kind == "limit") == lumped)
            and (mesh.choice.mesh, *rule.key) not in self.dropped
        ]

    def settings_of(self, mesh: Mesh, rule: Rule) -> tuple[np.ndarray, ...]:
        """Return m settings of a mesh and a rule: edges, x, (m, q) errors in space, time; seconds.

        They lie on a grid of sizes from below to above the measured ones.
        """
        is_p2 = mesh.choice.element == "P2"
        coarse = self.coarse
        if mesh.choice.h:
            edges = _sizes(mesh.errors.x, COARSER, FINER)
        else:
            edges = mesh.errors.x[-1:]
        fixed = rule.kind in ("limit", "static")
        x = np.array([1.0]) if fixed else _sizes(rule.errors.x, LONGER, SHORTER)
        edges, x = (values.ravel() for values in np.meshgrid(edges, x))
        if rule.kind == "limit":
            more = P2_STEPS if is_p2 and coarse.choice.element != "P2" else 1.0
            x = more * edges / coarse.edges
        elif rule.kind == "steps":
            x = np.ceil(x)
        finer = np.maximum(edges * (NODES_OF_P2 if is_p2 else 1.0) / coarse.edges, 1.0)
        in_time = rule.errors(x) * finer[:, None] ** self.growth.get(rule.key, 0.0)
        per_step = mesh.seconds(edges)[:, 0] / (coarse.seconds / coarse.steps)
        factor = self.factors.get((mesh.choice.mesh, *rule.key), 1.0)
        return edges, x, mesh.errors(edges), in_time, rule.seconds(x)[:, 0] * per_step * factor

    def error_in_time(self, trial: Trial) -> np.ndarray:
        """Return the (q,) predicted error in time of a run on any mesh."""
        key = key_of(trial.choice)
        rules = self.times.rules
        rule = next((rule for rule in rules if rule.key == key), rules[0])
        finer = max(trial.edges / self.coarse.edges, 1.0)
        in_time = rule.errors(np.array([size_of(trial.choice)]))[0]
        return in_time * finer ** self.growth.get(rule.key, 0.0)


def _sizes(measured: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return sizes from below to above the measured ones, in equal ratios."""
    ends = low * measured[0], high * measured[-1]
    return np.geomspace(*ends, math.ceil(math.log(ends[1] / ends[0]) / math.log(FINE)) + 1)


@dataclass(frozen=True)
class Goal:
    """What is asked for: the largest error, or the longest CPU time [s]; the other is infinite."""

    tolerance: float = math.inf
    budget: float = math.inf

    @property
    def has_budget(self) -> bool:
        return math.isfinite(self.budget)

    @property
    def scale(self) -> float:
        """The tolerance; with a budget 1 %, for which the runs of the search are fine enough."""
        if math.isinf(self.tolerance):
            return 0.01
        return self.tolerance

    def limit(self, candidates: Sequence[Candidate]) -> float:
        """Return the CPU time that the search may take [s]."""
        if self.has_budget:
            return max(SEARCH, TIMES * self.budget)
        return max(SEARCH, TIMES * candidates[0].seconds if candidates else 0.0)

    def candidates(self, prediction: Prediction, margin: float = MARGIN) -> list[Candidate]:
        """Return the predicted candidate of each mesh and rule, the best first.

        They are the cheapest within `margin` times the tolerance, or the most accurate within
        the budget. Of candidates that differ by less than `NOISE` the most accurate counts:
        errors have no noise.
        """

        def rank(error: Any, seconds: Any) -> Any:
            return error if self.has_budget else seconds

        chosen = []
        for mesh, rule in prediction.pairs():
            edges, x, space, in_time, seconds = prediction.settings_of(mesh, rule)
            error = (space + in_time).max(axis=1) + prediction.other
            fits = seconds <= IN_TIME * self.budget
            allowed = np.flatnonzero(fits if self.has_budget else error <= margin * self.tolerance)
            if not len(allowed):
                continue
            ranks = rank(error[allowed], seconds[allowed])
            close = allowed[ranks <= NOISE * ranks.min()]
            k = close[np.argmin(error[close])]
            numbers = float(edges[k]), float(x[k]), space[k], in_time[k], float(seconds[k])
            chosen.append(Candidate(mesh, rule, *numbers))
        places = [rank(each.error + prediction.other, each.seconds) for each in chosen]
        limit = NOISE * min(places, default=0.0)

        def order(pair: tuple[Candidate, float]) -> tuple[bool, float]:
            candidate, place = pair
            return place > limit, candidate.error if place <= limit else place

        return [each for each, _ in sorted(zip(chosen, places, strict=True), key=order)]
