"""The short runs that show what the error of a problem is made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import FeclothError, InputError
from fecloth.integrators import METHODS
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.tuning.choices import Choice, meshes_to_try, problem_with
from fecloth.study.tuning.graded_choices import graded_choices
from fecloth.study.tuning.prediction import Candidate, Prediction, cheapest, most_accurate
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors, summarise_meshes
from fecloth.study.tuning.time_errors import TimeErrors
from fecloth.study.tuning.trials import Bench, Trial, spent
from fecloth.study.workload import count_triangles

COARSE = 128  # triangles of the first runs
P2_COARSER = 2.0  # h of P2 over that of P1 in the first runs: these have as many nodes
TRIES = 5  # finer meshes, until a shape with small parts can be meshed
MARGIN = 0.75  # part of the tolerance that predicted errors may take
CALM = 0.2  # part of the tolerance that the steps of the runs on all meshes may take
KNOWN = 0.3  # part of the tolerance up to which the best mesh's own error need be known
EXTRAPOLATED = 2.0  # times the measured √triangles, up to which predictions are trusted
SHORTEST, TIMES = 60.0, 3.0  # CPU time of the search: s, and times that of the tuned run


@dataclass(frozen=True)
class Goal:
    """What is asked for: the largest error, or the longest CPU time [s]; the other is infinite."""

    tolerance: float = math.inf
    budget: float = math.inf

    @property
    def scale(self) -> float:
        """The tolerance; with a budget 1 %, for which the runs of the search are fine enough."""
        return self.tolerance if math.isfinite(self.tolerance) else 0.01

    def candidates(self, prediction: Prediction, margin: float = MARGIN) -> list[Candidate]:
        """Return the predicted candidates, the best first; `margin` is a part of the tolerance."""
        if math.isfinite(self.budget):
            return most_accurate(prediction, 0.9 * self.budget)
        return cheapest(prediction, margin * self.tolerance)

    def limit(self, candidates: Sequence[Candidate]) -> float:
        """Return the CPU time that the search may take [s]."""
        if math.isfinite(self.budget):
            return max(SHORTEST, TIMES * self.budget)
        return max(SHORTEST, TIMES * candidates[0].seconds if candidates else 0.0)


def coarse_meshes(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return the elements and patterns with about `COARSE` triangles; finer where it must be."""
    listed = meshes_to_try(opened, elements)
    if listed[0].h is None:
        return listed
    if isinstance(opened, FunctionProblem):
        triangles = float(len(opened.first.cloth.triangles))
    else:
        triangles = count_triangles(opened.scene)
    by = math.sqrt(triangles / COARSE)
    scaled = [_scaled(one, by) for one in listed]
    for _ in range(TRIES):
        try:
            problem_with(opened, scaled[0]).first  # noqa: B018  # raises if it is too coarse
            return scaled
        except FeclothError:
            by /= 1.6
            scaled = [_scaled(one, by) for one in listed]
    return scaled  # whose run says why it is refused


def _scaled(choice: Choice, by: float) -> Choice:
    assert choice.h is not None
    factor = P2_COARSER if choice.element == "P2" else 1.0
    return replace(choice, h=float(f"{factor * by * choice.h:.3g}"))


def shared_run(bench: Bench, times: TimeErrors, tolerance: float) -> Trial:
    """Return the run whose steps all meshes take: the cheapest that is accurate enough in time.

    Methods that damp the shortest waves are preferred: the others keep those that each finer mesh
    adds and that their steps do not resolve. So are implicit ones, because explicit ones lump the
    mass of P2.
    """

    def error(one: Trial) -> float:
        return float((bench.distance(times.reference, one) + times.error).max())

    fixed = [one for one in times.trials if one.is_ok and not one.choice.rtol]
    fixed = [one for one in fixed if not (one.choice.is_explicit and one.choice.steps)]
    fixed = [one for one in fixed if not _keeps_waves(one.choice)] or fixed
    served = [one for one in fixed if error(one) <= tolerance]
    served = [one for one in served if not one.choice.is_explicit] or served or fixed
    good = [one for one in served if error(one) <= CALM * tolerance]
    return min(good, key=lambda one: one.seconds) if good else min(served, key=error)


def _keeps_waves(choice: Choice) -> bool:
    """Whether the method leaves waves undamped that its steps do not resolve."""
    method = METHODS.get(choice.method)
    return method is not None and method().traits.at_infinity == 1


def measure_meshes(
    bench: Bench,
    meshes: Sequence[Choice],
    times: TimeErrors,
    coarse: Trial,
    goal: Goal,
) -> tuple[SpaceErrors, Prediction]:
    """Refine all meshes once, then those that matter, until the choice among them is known."""
    orders = np.array([orders_of(bench, meshes, element) for element in ("P1", "P2")])
    steps = {key: getattr(coarse.choice, key) for key in ("method", "steps", "rtol")}
    started = [replace(one, **steps) for one in meshes]
    trials = [coarse]
    listed = [one for one in started if one.mesh != coarse.choice.mesh]
    trials += bench.run(listed)
    if coarse.choice.h is None:
        return _summarise(bench, trials, orders, times, coarse)
    graded = graded_choices(bench.opened, trials)
    trials += bench.run(graded)
    started += graded
    served = {one.choice.mesh for one in trials if one.is_ok}
    trials += bench.run([_finer(one, 2.0) for one in started if one.mesh in served])
    while True:
        space, prediction = _summarise(bench, trials, orders, times, coarse)
        candidates = goal.candidates(prediction)
        allowed = goal.limit(candidates) - spent([*times.trials, *trials])
        mesh = _next_mesh(space, candidates, goal)
        if (
            mesh is None
            or _seconds_of_next(mesh, coarse) > 0.7 * allowed
            or space.stalls(bench, goal.scale)
        ):
            return space, prediction
        found = bench.within(allowed).run([_finer(mesh.trials[-1].choice, 2.0)])
        trials += found
        if not found[0].is_ok:
            return space, prediction


def orders_of(bench: Bench, meshes: Sequence[Choice], element: str) -> list[float]:
    """Return the theoretical orders of the quantities in h; of P1 where P2 is not tried."""
    chosen = next((one for one in meshes if one.element == element), meshes[0])
    try:
        problem = problem_with(bench.opened, chosen)
        return [problem.orders(one)[0] for one in bench.quantities]
    except InputError:  # the terms refuse the element
        return [2.0] * len(bench.quantities)


def _summarise(bench: Bench, trials, orders, times, coarse) -> tuple[SpaceErrors, Prediction]:
    space = summarise_meshes(bench, trials, orders)
    return space, Prediction(space.meshes, times, coarse)


def _finer(choice: Choice, ratio: float) -> Choice:
    assert choice.h is not None
    return replace(choice, h=float(f"{choice.h / ratio:.6g}"))


def _next_mesh(space: SpaceErrors, candidates: Sequence[Candidate], goal: Goal) -> Mesh | None:
    """Return the mesh to refine next; None if no run is needed.

    It is the best known one, the one that it disagrees with, or one far from what was run.
    """
    best = min(space.meshes, key=lambda one: float(one.errors.y[-1].max()))
    if not candidates or space.error.max() > KNOWN * goal.scale:
        return space.rival or best
    first = candidates[0]
    is_near = first.edges <= EXTRAPOLATED * first.mesh.errors.x[-1]
    return None if is_near else first.mesh


def _seconds_of_next(mesh: Mesh, coarse: Trial) -> float:
    """Predict the seconds of the next finer mesh."""
    last = mesh.trials[-1]
    more = 2.0 if coarse.choice.is_explicit else 1.0
    ratio = max(last.edges / mesh.trials[-2].edges, 2.0) if len(mesh.trials) > 1 else 2.0
    per_step = float(mesh.seconds(np.array([ratio * last.edges]))[0, 0])
    return more * last.steps * per_step
