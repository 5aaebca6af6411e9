"""The short runs that show what the error of a problem is made of, and whether they suffice."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fecloth.errors import FeclothError, InputError
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.result import in_percent
from fecloth.study.tuning import choices
from fecloth.study.tuning.choices import COSTLY, SEARCH, Bench, Choice, Trial, problem_with
from fecloth.study.tuning.prediction import MARGIN, Candidate, Goal, Prediction
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors, graded_choices, summarise_meshes
from fecloth.study.tuning.time_errors import TimeErrors
from fecloth.study.workload import count_triangles, in_words

COARSE = 128  # triangles of the first runs
P2_COARSER = 2.0  # h of P2 over h of P1 in the first runs: these have as many nodes
TRIES, RATIO = 5, 1.6  # finer meshes until a shape with small parts can be meshed; their ratio
KNOWN = 0.3  # part of the tolerance up to which the best mesh's own error need be known
EXTRAPOLATED = 2.0  # times the measured √triangles, up to which predictions are trusted
RESERVE = 5.0  # s of the search: for what follows the meshes
DEARER = 6.0  # times the seconds: a run with half of h
QUICK = 0.2  # s: the seconds of such a run are measured more than once
SHARE = 0.7  # part of the time left that the next mesh may take


def coarse_meshes(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return the elements and patterns with about `COARSE` triangles; finer where it must be."""
    listed = choices.meshes_to_try(opened, elements)
    if listed[0].h is None:
        return listed
    if isinstance(opened, FunctionProblem):
        triangles = float(len(opened.first.cloth.triangles))
    else:
        triangles = count_triangles(opened.scene)
    for k in range(TRIES + 1):
        by = math.sqrt(triangles / COARSE) / RATIO**k
        scaled = [_scaled(choice, by) for choice in listed]
        try:
            problem_with(opened, scaled[0]).first  # noqa: B018  # raises if it is too coarse
            break
        except FeclothError:
            continue
    return scaled  # if none can be meshed, the run of the last says why


def _scaled(choice: Choice, by: float) -> Choice:
    factor = P2_COARSER if choice.element == "P2" else 1.0
    return replace(choice, h=float(f"{factor * by * (choice.h or 0.0):.3g}"))


def measure_meshes(
    bench: Bench, meshes: Sequence[Choice], times: TimeErrors, coarse: Trial, goal: Goal
) -> tuple[SpaceErrors, Prediction]:
    """Refine all meshes once, then the ones that matter, until the choice among them is known.

    A run is left out if its predicted time is more than a tenth of the time of the search,
    unless it has the mesh of the coarse run.
    """
    orders = np.array([orders_of(bench, meshes, element) for element in ("P1", "P2")])
    trials = _first_meshes(bench, meshes, coarse)
    if coarse.choice.h is not None:
        trials += _refine_once(bench, coarse, trials)
    while True:
        space = summarise_meshes(bench, trials, orders)
        prediction = Prediction(space.meshes, times, coarse)
        candidates = goal.candidates(prediction)
        if math.isinf(goal.budget):
            seconds_left = SEARCH - RESERVE
        else:
            seconds_left = goal.limit(candidates)
        seconds_left -= bench.spent()
        if coarse.choice.h is not None:
            mesh = next_mesh(space, candidates, goal)
        else:
            mesh = None
        if mesh is None or space.stalls(bench, goal.scale):
            return space, prediction
        if seconds_of_next(mesh, coarse) > SHARE * seconds_left:
            return space, prediction
        trials += bench.within(seconds_left).run([mesh.trials[-1].choice.with_half_of_h()])
        if not trials[-1].is_ok:
            return space, prediction


def _first_meshes(bench: Bench, meshes: Sequence[Choice], coarse: Trial) -> list[Trial]:
    """Run all meshes with the steps of the coarse run."""
    if coarse.seconds > COSTLY:
        return [coarse]
    own = coarse.choice
    others = [
        replace(mesh, method=own.method, steps=own.steps, rtol=own.rtol)
        for mesh in meshes
        if mesh.mesh != own.mesh
    ]
    trials = [coarse, *bench.run(others, timed=coarse.seconds < QUICK)]
    return trials + (bench.run(graded_choices(bench.opened, trials)) if own.h is not None else [])


def _refine_once(bench: Bench, coarse: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Run each mesh with half of h, unless that was done or would take too long."""
    known = {run.choice: run for run in bench.done[bench.changed :] if run.is_ok}
    refined = []
    for trial in trials:
        choice = trial.choice.with_half_of_h()
        is_own = trial.choice.mesh == coarse.choice.mesh
        if choice in known:
            refined.append(known[choice])
        elif trial.is_ok and (is_own or DEARER * trial.seconds <= COSTLY):
            refined += bench.run([choice], timed=trial.seconds < QUICK)
    return refined


def orders_of(bench: Bench, meshes: Sequence[Choice], element: str) -> list[float]:
    """Return the theoretical orders of the quantities in h; of P1 where P2 is not tried."""
    chosen = next((mesh for mesh in meshes if mesh.element == element), meshes[0])
    try:
        orders = problem_with(bench.opened, chosen).orders
        return [orders(quantity)[0] for quantity in bench.quantities]
    except InputError:  # the terms refuse the element
        return [2.0] * len(bench.quantities)


def next_mesh(space: SpaceErrors, candidates: Sequence[Candidate], goal: Goal) -> Mesh | None:
    """Return the mesh to refine next; None if no run is needed.

    While no setting should meet the goal, or the error of the best run is not known well enough,
    it is the mesh that the best one disagrees with, or the best one. Then it is the mesh of the
    first candidate, if that is far finer than what was run.
    """
    if not candidates or space.error.max() > KNOWN * goal.scale:
        return space.rival or space.most_accurate
    if is_extrapolated(candidates[0]):
        return candidates[0].mesh
    return None


def is_extrapolated(candidate: Candidate) -> bool:
    """Whether a setting is so much finer than the runs of its mesh that these predict little."""
    return candidate.edges > EXTRAPOLATED * candidate.mesh.errors.x[-1]


def seconds_of_next(mesh: Mesh, coarse: Trial) -> float:
    """Predict the seconds of the next finer mesh; explicit steps are halved with h."""
    finest = mesh.trials[-1]
    more = 2.0 if coarse.choice.is_explicit else 1.0
    if len(mesh.trials) > 1:
        ratio = max(finest.edges / mesh.trials[-2].edges, 2.0)
    else:
        ratio = 2.0
    per_step = float(mesh.seconds(np.array([ratio * finest.edges]))[0, 0])
    return more * finest.steps * per_step


def obstacle_of(
    bench: Bench, space: SpaceErrors, prediction: Prediction, goal: Goal, most: float | None
) -> str:
    """Return why no setting can be proved; "" if one may be. `most` is the longest run [s]."""
    if space.reference.choice.h is None:
        return (
            "the mesh has no h, so it is not refined, and its error in space counts as 100 %; "
            "a .geo file with h in [cloth] can be refined"
        )
    causes = "; ".join(space.reference.row["obstacles"])
    causes = f": {causes}" if causes else ""
    if space.stalls(bench, goal.scale):
        return f"finer meshes do not come closer to each other{causes}"
    candidates = goal.candidates(prediction)
    if not candidates:
        return _why_none(space, prediction, goal, causes)
    first = candidates[0]
    known = float(space.error.max())
    seconds = f"in about {in_words(first.seconds)}"
    if first.seconds > (most or math.inf):
        return f"{first.choice} should meet it, {seconds}: too long"
    if known > goal.tolerance and is_extrapolated(first):
        differ = f"the best meshes that were run still differ by {in_percent(known)}"
        return f"{differ}; {first.choice} may meet it, {seconds}"
    return ""


def _why_none(space: SpaceErrors, prediction: Prediction, goal: Goal, causes: str) -> str:
    """Return why no setting is predicted to meet the goal: its time, the solver or the mesh."""
    if math.isfinite(goal.budget):
        return f"no setting is predicted to take less than {goal.budget:g} s"
    allowed = MARGIN * goal.tolerance
    mesh = space.most_accurate
    if not math.isfinite(prediction.other):
        return "the error of the gaps of contact is not known: a run with half of them failed"
    if prediction.other > allowed:
        left = in_percent(prediction.other)
        return f"the solver's tolerance, changed terms and gaps alone make an error of {left}"
    error = mesh.errors.y[-1]
    if error.max() <= allowed:
        return "the error in time of all methods is predicted to be larger"
    finer = f"{float(((error / allowed) ** (1 / mesh.errors.order)).max()):.2g} times finer"
    finest = f"{mesh.trials[-1].choice}, the finest that the time of the search allows{causes}"
    return f"it needs a mesh about {finer} than {finest}"
