"""The cheapest setting that should meet a tolerance, from measured errors and seconds."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fecloth.study.tuning.choices import Choice, Trial
from fecloth.study.tuning.space_errors import Mesh
from fecloth.study.tuning.time_errors import Rule, TimeErrors, key_of, size_of

FINE = 2 ** (1 / 6)  # ratio of the sizes that are compared
COARSER, FINER = 0.5, 16.0  # times the measured √triangles
LONGER, SHORTER = 1.0, 64.0  # times the measured numbers of steps
NOISE = 1.1  # times the least seconds: settings whose order the measured seconds do not tell
NODES_OF_P2 = 2.0  # per edge, over the nodes of P1
P2_STEPS = 2.0  # explicit steps on P2 over the steps on P1 with the same triangles


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
    linear: str = ""

    @property
    def choice(self) -> Choice:
        chosen = self.rule.choose(self.mesh.choose(self.edges), self.x)
        return replace(chosen, linear=self.linear)

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

    # What was measured.
    meshes: Sequence[Mesh]
    times: TimeErrors
    coarse: Trial  # the run that the measurements of methods and meshes share
    # Error that no mesh and no step changes: of the solver and of left-out terms.
    other: float = 0.0
    # Measured over predicted seconds, by `Candidate.key`.
    factors: Mapping[tuple, float] = field(default_factory=dict)
    # The fastest linear solver, by `Candidate.key`.
    linear: Mapping[tuple, str] = field(default_factory=dict)
    # Power of √triangles with which errors in time grow, by method and kind of rule: finer meshes
    # have shorter waves.
    growth: Mapping[tuple, float] = field(default_factory=dict)
    dropped: frozenset[tuple] = frozenset()  # `Candidate.key` of what is not tried again

    def in_order(self, is_allowed: Callable, rank: Callable) -> list[Candidate]:
        """Return the best candidate of each mesh and rule, the best of all first."""
        # `is_allowed` and `rank` take arrays of errors and seconds. Of candidates whose ranks
        # differ by less than `NOISE`, the most accurate comes first: errors have no noise.

        def place(candidate: Candidate) -> float:
            return float(rank(candidate.error + self.other, candidate.seconds))

        tried = [self._best_of(mesh, rule, is_allowed, rank) for mesh, rule in self.pairs()]
        allowed = [candidate for candidate in tried if candidate is not None]
        limit = NOISE * min(map(place, allowed), default=0.0)

        def order(candidate: Candidate) -> tuple[bool, float]:
            is_close = place(candidate) <= limit
            return not is_close, candidate.error if is_close else place(candidate)

        return sorted(allowed, key=order)

    def with_seconds(self, candidate: Candidate, seconds: float) -> "Prediction":
        """Return the prediction with the measured seconds of a candidate."""
        factor = self.factors.get(candidate.key, 1.0) * seconds / candidate.seconds
        return replace(self, factors={**self.factors, candidate.key: factor})

    def without(self, candidate: Candidate, on_all_meshes: bool = False) -> "Prediction":
        """Return the prediction without the rule of a candidate on its mesh, or on all meshes."""
        rule = candidate.rule
        meshes = self.meshes if on_all_meshes else [candidate.mesh]
        keys = {(*mesh.choice.mesh, *rule.key) for mesh in meshes}
        return replace(self, dropped=self.dropped | keys)

    def pairs(self) -> list[tuple[Mesh, Rule]]:
        """Return all meshes with all rules."""
        # Explicit methods lump the mass, which changes the error of P2: there both kinds of rules
        # need meshes that were run with their own kind.
        lumped = self.coarse.choice.is_explicit
        return [
            (mesh, rule)
            for mesh in self.meshes
            for rule in self.times.rules
            if (mesh.choice.element != "P2" or (rule.kind == "limit") == lumped)
            and (*mesh.choice.mesh, *rule.key) not in self.dropped
        ]

    def _best_of(
        self, mesh: Mesh, rule: Rule, is_allowed: Callable, rank: Callable
    ) -> Candidate | None:
        edges = _sizes(mesh.errors.x, COARSER, FINER) if mesh.choice.h else mesh.errors.x[-1:]
        fixed = rule.kind in ("limit", "static")
        x = np.array([1.0]) if fixed else _sizes(rule.errors.x, LONGER, SHORTER)
        i, j = (index.ravel() for index in np.meshgrid(range(len(edges)), range(len(x))))
        at_edges, at_x = edges[i], x[j]
        if rule.kind == "limit":
            more = P2_STEPS if mesh.choice.element == "P2" else 1.0
            if self.coarse.choice.element == "P2":
                more = 1.0
            at_x = more * at_edges / self.coarse.edges
        elif rule.kind == "steps":
            at_x = np.ceil(at_x)
        space = mesh.errors(at_edges)
        nodes = at_edges * (NODES_OF_P2 if mesh.choice.element == "P2" else 1.0)
        finer = np.maximum(nodes / self.coarse.edges, 1.0)
        in_time = rule.errors(at_x) * finer[:, None] ** self.growth.get(rule.key, 0.0)
        per_step = mesh.seconds(at_edges)[:, 0] / (self.coarse.seconds / self.coarse.steps)
        key = mesh.choice.mesh, *rule.key
        seconds = rule.seconds(at_x)[:, 0] * per_step * self.factors.get(key, 1.0)
        error = (space + in_time).max(axis=1) + self.other
        allowed = np.flatnonzero(is_allowed(error, seconds))
        if not len(allowed):
            return None
        ranks = rank(error[allowed], seconds[allowed])
        close = allowed[ranks <= NOISE * ranks.min()]
        k = close[np.argmin(error[close])]
        sizes, linear = (float(at_edges[k]), float(at_x[k])), self.linear.get(key, "")
        return Candidate(mesh, rule, *sizes, space[k], in_time[k], float(seconds[k]), linear)

    def error_in_time(self, trial: Trial) -> np.ndarray:
        """Return the (q,) predicted error in time of a run on any mesh."""
        key, rules = key_of(trial.choice), self.times.rules
        rule = next((rule for rule in rules if rule.key == key), rules[0])
        finer = max(trial.edges / self.coarse.edges, 1.0)
        in_time = rule.errors(np.array([size_of(trial.choice)]))[0]
        return in_time * finer ** self.growth.get(rule.key, 0.0)


def _sizes(measured: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return sizes from below to above the measured ones, in equal ratios."""
    coarsest, finest = low * measured[0], high * measured[-1]
    return np.geomspace(
        coarsest, finest, math.ceil(math.log(finest / coarsest) / math.log(FINE)) + 1
    )


def cheapest(prediction: Prediction, tolerance: float) -> list[Candidate]:
    """Return the candidates that should meet a tolerance, the cheapest first."""
    return prediction.in_order(lambda error, _: error <= tolerance, lambda _, seconds: seconds)


def most_accurate(prediction: Prediction, budget: float) -> list[Candidate]:
    """Return the candidates that should take at most `budget` [s], the most accurate first."""
    return prediction.in_order(lambda _, seconds: seconds <= budget, lambda error, _: error)
