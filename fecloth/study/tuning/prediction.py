"""The cheapest setting that should meet a tolerance, from measured errors and seconds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fecloth.study.tuning.choices import NODES_OF_P2, SEARCH_SECONDS, Choice, Trial
from fecloth.study.tuning.space_errors import Mesh
from fecloth.study.tuning.time_errors import Rule, TimeErrors, key_of, size_of

RATIO_OF_SIZES = 2 ** (1 / 6)  # of successive sizes that are compared: the best is off by 6 %
# Settings are sought from the first to the second times the measured √triangles, and up to the
# third times the measured numbers of steps. Farther off, errors are only guessed.
COARSEST_MESH = 0.5
FINEST_MESH = 16.0
SHORTEST_STEPS = 64.0
# Ratio of measured seconds up to which they are taken as equal, because of their noise.
NOISE_OF_SECONDS = 1.1
# Part of the tolerance that predicted errors may take, and the part where errors of neighbouring
# settings were measured. Seconds are predicted as well as the latter, for a budget.
PART_OF_TOLERANCE = 0.75
PART_AFTER_MEASUREMENT = 0.9
# A search may take this multiple of the CPU time of the tuned run, if that is longer than
# `SEARCH_SECONDS`.
SEARCH_OVER_RUN = 3.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A setting with its predicted errors and seconds.

    Attributes
    ----------
    mesh, rule
        Its kind of mesh, and its method.
    edges
        √triangles of its mesh.
    x
        The size of its steps; see `Rule.kind`.
    space, time
        Predicted errors in space and in time, (q,) each.
    seconds
        Predicted CPU time [s].
    """

    mesh: Mesh
    rule: Rule
    edges: float
    x: float
    space: np.ndarray
    time: np.ndarray
    seconds: float

    @property
    def choice(self) -> Choice:
        """The setting."""
        return self.rule.choose(self.mesh.choose(self.edges), self.x)

    @property
    def key(self) -> tuple:
        """What its measured seconds hold for: element, pattern and rule."""
        return key_of_pair(self.mesh, self.rule)

    @property
    def error(self) -> float:
        """The largest predicted error of all quantities, without `Prediction.other`."""
        return float((self.space + self.time).max())


def key_of_pair(mesh: Mesh, rule: Rule) -> tuple:
    """Return what tells pairs of a mesh and a rule apart."""
    return mesh.choice.mesh, *rule.key


@dataclass(frozen=True, eq=False)
class Settings:
    """The m settings of a mesh with a rule, and what is predicted for each.

    Attributes
    ----------
    edges, x
        √triangles and sizes of steps, (m,) each.
    space, time
        Errors in space and in time, (m, q) each.
    seconds
        CPU times [s], (m,).
    """

    edges: np.ndarray
    x: np.ndarray
    space: np.ndarray
    time: np.ndarray
    seconds: np.ndarray

    def candidate(self, mesh: Mesh, rule: Rule, k: int) -> Candidate:
        """Return the setting number k of this mesh and this rule as a candidate."""
        return Candidate(
            mesh=mesh,
            rule=rule,
            edges=float(self.edges[k]),
            x=float(self.x[k]),
            space=self.space[k],
            time=self.time[k],
            seconds=float(self.seconds[k]),
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """Errors and seconds of all meshes and methods.

    Attributes
    ----------
    meshes
        All kinds of meshes, with their errors in space.
    times
        All methods, with their errors in time.
    coarse
        The run that the measurements of methods and of meshes have in common.
    other
        Error that no mesh and no step changes: by the solver, changed terms and gaps.
    factors
        Measured over predicted seconds, by `Candidate.key`.
    growth
        Power of √triangles with which errors in time grow, by `Rule.key`: finer meshes have
        shorter waves.
    dropped
        `Candidate.key` of what is not tried again.
    """

    meshes: Sequence[Mesh]
    times: TimeErrors
    coarse: Trial
    other: float = 0.0
    factors: Mapping[tuple, float] = field(default_factory=dict)
    growth: Mapping[tuple, float] = field(default_factory=dict)
    dropped: frozenset[tuple] = frozenset()

    def with_seconds(self, candidate: Candidate, seconds: float) -> "Prediction":
        """Return the prediction with the measured seconds of a candidate."""
        factor = self.factors.get(candidate.key, 1.0) * seconds / candidate.seconds
        return replace(self, factors={**self.factors, candidate.key: factor})

    def without(self, candidate: Candidate, on_all_meshes: bool = False) -> "Prediction":
        """Return the prediction without a candidate's rule on its mesh, or on all meshes."""
        meshes = self.meshes if on_all_meshes else [candidate.mesh]
        keys = {key_of_pair(mesh, candidate.rule) for mesh in meshes}
        return replace(self, dropped=self.dropped | keys)

    def pairs(self) -> list[tuple[Mesh, Rule]]:
        """Return the pairs of a mesh and a rule whose errors are known, except the dropped ones.

        Explicit methods lump the mass, which changes the error in space of P2. So on P2 an
        explicit rule needs a mesh that was run explicitly, and an implicit rule one that was run
        implicitly. All meshes were run with the steps of the coarse run.
        """
        are_meshes_lumped = self.coarse.choice.is_explicit
        pairs = []
        for mesh in self.meshes:
            for rule in self.times.rules:
                is_rule_lumped = rule.kind == "limit"
                is_p2 = mesh.choice.element == "P2"
                has_other_mass = is_p2 and is_rule_lumped != are_meshes_lumped
                if not has_other_mass and key_of_pair(mesh, rule) not in self.dropped:
                    pairs.append((mesh, rule))
        return pairs

    def settings_of(self, mesh: Mesh, rule: Rule) -> Settings:
        """Return the settings of a mesh and a rule, with their predicted errors and seconds.

        They are all pairs of a size of the mesh and a size of the steps. The sizes reach from
        meshes coarser than the measured ones to finer ones, and to steps shorter than the
        measured ones.
        """
        coarse = self.coarse
        is_p2 = mesh.choice.element == "P2"
        edges = mesh.errors.x[-1:]  # without h there is a single mesh
        if mesh.choice.h:
            edges = _sizes(COARSEST_MESH * mesh.errors.x[0], FINEST_MESH * mesh.errors.x[-1])
        x = np.ones(1)
        if rule.kind in ("steps", "rtol"):
            x = _sizes(rule.errors.x[0], SHORTEST_STEPS * rule.errors.x[-1])
        edges, x = (values.ravel() for values in np.meshgrid(edges, x))
        if rule.kind == "limit":
            # the stable step falls with the distance of nodes, and P2 has nodes amid its edges
            x = edges / coarse.edges
            if is_p2 and coarse.choice.element != "P2":
                x *= NODES_OF_P2
        elif rule.kind == "steps":
            x = np.ceil(x)  # a whole number of steps
        nodes_along_edge = edges * NODES_OF_P2 if is_p2 else edges
        errors_in_time = rule.errors(x) * self._growth(rule, nodes_along_edge)[:, None]
        # the rule was timed on the coarse mesh: a step on this mesh takes so many times as long
        ratio_of_step = mesh.seconds(edges)[:, 0] / (coarse.seconds / coarse.steps)
        factor = self.factors.get(key_of_pair(mesh, rule), 1.0)
        seconds = rule.seconds(x)[:, 0] * ratio_of_step * factor
        return Settings(
            edges=edges, x=x, space=mesh.errors(edges), time=errors_in_time, seconds=seconds
        )

    def error_in_time(self, trial: Trial) -> np.ndarray:
        """Return the (q,) predicted error in time of a run on any mesh."""
        key = key_of(trial.choice)
        rules = self.times.rules
        # an equilibrium has one rule, whose key is another
        rule = next((rule for rule in rules if rule.key == key), rules[0])
        on_coarse_mesh = rule.errors(np.array([size_of(trial.choice)]))[0]
        return on_coarse_mesh * self._growth(rule, np.array([trial.edges]))

    def _growth(self, rule: Rule, edges: np.ndarray) -> np.ndarray:
        """Return the factor of errors in time on finer meshes than the coarse one."""
        return np.maximum(edges / self.coarse.edges, 1.0) ** self.growth.get(rule.key, 0.0)


def _sizes(least: float, largest: float) -> np.ndarray:
    """Return sizes in equal ratios."""
    count = math.ceil(math.log(largest / least) / math.log(RATIO_OF_SIZES)) + 1
    return np.geomspace(least, largest, count)


@dataclass(frozen=True)
class Goal:
    """What is asked for; one of both is infinite.

    Attributes
    ----------
    tolerance
        The largest error.
    budget
        The longest CPU time of the tuned run [s].
    """

    tolerance: float = math.inf
    budget: float = math.inf

    @property
    def has_budget(self) -> bool:
        """Whether the most accurate setting within a time is asked for."""
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
            return max(SEARCH_SECONDS, SEARCH_OVER_RUN * self.budget)
        if candidates:
            return max(SEARCH_SECONDS, SEARCH_OVER_RUN * candidates[0].seconds)
        return SEARCH_SECONDS

    def candidates(
        self, prediction: Prediction, margin: float = PART_OF_TOLERANCE
    ) -> list[Candidate]:
        """Return one candidate of each mesh and rule that can meet the goal, the best first.

        With a tolerance the candidate is the cheapest setting whose predicted error is at most
        `margin` times the tolerance. With a budget it is the most accurate setting within it.
        Candidates that are worse than the best one by less than `NOISE_OF_SECONDS` count as
        equally good, and are sorted by their errors, which have no noise.
        """
        candidates = []
        for mesh, rule in prediction.pairs():
            candidate = self._best_setting(prediction, mesh, rule, margin)
            if candidate:
                candidates.append(candidate)

        def value_to_minimise(candidate: Candidate) -> float:
            if self.has_budget:
                return candidate.error + prediction.other
            return candidate.seconds

        best_value = min(map(value_to_minimise, candidates), default=0.0)

        def sort_key(candidate: Candidate) -> tuple[bool, float]:
            value = value_to_minimise(candidate)
            if value <= NOISE_OF_SECONDS * best_value:
                return False, candidate.error  # False comes before True
            return True, value

        return sorted(candidates, key=sort_key)

    def _best_setting(
        self, prediction: Prediction, mesh: Mesh, rule: Rule, margin: float
    ) -> Candidate | None:
        """Return the best setting of a mesh and a rule; None if none meets the goal.

        It is the cheapest one within `margin` times the tolerance, or the most accurate one
        within the budget. Of settings that are equal within the noise, the most accurate one is
        taken.
        """
        settings = prediction.settings_of(mesh, rule)
        error = (settings.space + settings.time).max(axis=1) + prediction.other
        if self.has_budget:
            meets_goal = settings.seconds <= PART_AFTER_MEASUREMENT * self.budget
            to_minimise = error
        else:
            meets_goal = error <= margin * self.tolerance
            to_minimise = settings.seconds
        if not meets_goal.any():
            return None
        least = to_minimise[meets_goal].min()
        close_to_least = np.flatnonzero(meets_goal & (to_minimise <= NOISE_OF_SECONDS * least))
        best = close_to_least[np.argmin(error[close_to_least])]
        return settings.candidate(mesh, rule, best)
