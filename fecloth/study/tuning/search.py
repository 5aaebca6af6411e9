"""The short runs that show what the error of a problem is made of, and whether they suffice."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fecloth.errors import FeclothError, InputError
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.result import in_percent
from fecloth.study.tuning import choices
from fecloth.study.tuning.choices import (
    COSTLY_SECONDS,
    COUNTING_SHARE,
    HALF_OF_H_COSTS,
    HALVINGS,
    NODES_OF_P2,
    SEARCH_SECONDS,
    Bench,
    Choice,
    Trial,
    problem_with,
)
from fecloth.study.tuning.prediction import PART_OF_TOLERANCE, Candidate, Goal, Prediction
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors, graded_choices, summarise_meshes
from fecloth.study.tuning.time_errors import TimeErrors
from fecloth.study.workload import count_triangles, in_words

FIRST_TRIANGLES = 128  # of the first meshes on P1: a square sheet has 8 x 8 cells
# Errors are trusted up to this multiple of the measured √triangles: the next mesh has so many.
TRUSTED_EXTRAPOLATION = 2.0
# Runs shorter than this are measured more than once, after a short one [s].
QUICK_SECONDS = 0.2
# Part of the time left that the next mesh may take, by its prediction: the proof takes time, too.
PART_OF_TIME_LEFT = 0.7


def coarse_meshes(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return the elements and patterns to try, with an h that gives about 128 triangles.

    P2 gets a quarter of the triangles, so that it has as many nodes. If the mesh is so coarse
    that small parts of a shape cannot be meshed, h is halved until they can. If this never
    helps, the choices with the last h are returned, and their runs will say why they fail. A
    mesh without h stays as it is. Raise `InputError` for an unknown name in `elements`.
    """
    listed = choices.meshes_to_try(opened, elements)
    if listed[0].h is None:
        return listed
    if isinstance(opened, FunctionProblem):
        triangles = float(len(opened.first.cloth.triangles))
    else:
        triangles = count_triangles(opened.scene)
    factor = math.sqrt(triangles / FIRST_TRIANGLES)
    for halvings in range(HALVINGS + 1):
        scaled = [_scaled(choice, factor / 2**halvings) for choice in listed]
        try:
            problem_with(opened, scaled[0]).first  # noqa: B018  # raises if it is too coarse
            break
        except FeclothError:
            continue
    return scaled


def _scaled(choice: Choice, factor: float) -> Choice:
    """Return the choice with its h times a factor, and times 2 on P2."""
    h = factor * (choice.h or 0.0)
    if choice.element == "P2":
        h *= NODES_OF_P2
    return replace(choice, h=float(f"{h:.3g}"))


def measure_meshes(
    bench: Bench, meshes: Sequence[Choice], times: TimeErrors, coarse: Trial, goal: Goal
) -> tuple[SpaceErrors, Prediction]:
    """Run all meshes with the steps of the coarse run, and refine them as far as is needed.

    First each mesh is run as it is and with half of h. Then one mesh after the other is refined,
    see `next_mesh`, until the best setting is known well enough, the errors stall, a run fails,
    or the time left is too short. In the first part a run is left out if it should take more
    than `COSTLY_SECONDS`, unless it has the mesh of the coarse run.

    Return the errors in space, and the prediction from these and the errors in time.
    """
    orders = np.array([orders_of(bench, meshes, element) for element in ("P1", "P2")])
    trials = _first_meshes(bench, meshes, coarse)
    if coarse.choice.h is not None:
        trials += _refine_once(bench, coarse, trials)
    while True:
        space = summarise_meshes(bench, trials, orders)
        prediction = Prediction(space.meshes, times, coarse)
        candidates = goal.candidates(prediction)
        if coarse.choice.h is None or space.stalls(bench, goal.scale):
            return space, prediction
        mesh = next_mesh(space, candidates, goal)
        seconds_left = goal.limit(candidates) if goal.has_budget else SEARCH_SECONDS
        seconds_left -= bench.spent()
        if mesh is None or seconds_of_next(mesh, coarse) > PART_OF_TIME_LEFT * seconds_left:
            return space, prediction
        trials += bench.within(seconds_left).run([mesh.trials[-1].choice.with_half_of_h()])
        if not trials[-1].is_ok:
            return space, prediction


def _first_meshes(bench: Bench, meshes: Sequence[Choice], coarse: Trial) -> list[Trial]:
    """Run all meshes with the steps of the coarse run, and graded ones; return all trials.

    The coarse run is the first of them. If it is costly, no other is made.
    """
    if coarse.seconds > COSTLY_SECONDS:
        return [coarse]
    coarse_choice = coarse.choice
    others = [
        replace(
            mesh,
            method=coarse_choice.method,
            steps=coarse_choice.steps,
            rtol=coarse_choice.rtol,
        )
        for mesh in meshes
        if mesh.mesh != coarse_choice.mesh
    ]
    trials = [coarse, *bench.run(others, timed=coarse.seconds < QUICK_SECONDS)]
    if coarse_choice.h is not None:
        trials += bench.run(graded_choices(bench.opened, trials))
    return trials


def _refine_once(bench: Bench, coarse: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Return the runs of all meshes with half of h.

    A run that was made before is taken again. It is left out if the mesh failed, or if half of h
    would be costly and the mesh is not the one of the coarse run.
    """
    # the runs of this problem: earlier ones have other terms
    done = {run.choice: run for run in bench.done[bench.changed :] if run.is_ok}
    refined = []
    for trial in trials:
        choice = trial.choice.with_half_of_h()
        is_own = trial.choice.mesh == coarse.choice.mesh
        is_costly = HALF_OF_H_COSTS * trial.seconds > COSTLY_SECONDS
        if choice in done:
            refined.append(done[choice])
        elif trial.is_ok and (is_own or not is_costly):
            refined += bench.run([choice], timed=trial.seconds < QUICK_SECONDS)
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
    if not candidates or space.error.max() > COUNTING_SHARE * goal.scale:
        return space.rival or space.most_accurate
    if is_extrapolated(candidates[0]):
        return candidates[0].mesh
    return None


def is_extrapolated(candidate: Candidate) -> bool:
    """Whether a setting is so much finer than the runs of its mesh that these predict little."""
    return candidate.edges > TRUSTED_EXTRAPOLATION * candidate.mesh.errors.x[-1]


def seconds_of_next(mesh: Mesh, coarse: Trial) -> float:
    """Predict the CPU seconds of the next run of a mesh [s], with half of its smallest h.

    It has as many steps as the finest run; explicit ones twice as many, because their stable
    step is halved with h.
    """
    finest = mesh.trials[-1]
    ratio = 2.0
    if len(mesh.trials) > 1:  # an unstructured mesh may gain more triangles by half of h
        ratio = max(finest.edges / mesh.trials[-2].edges, 2.0)
    steps = finest.steps
    if coarse.choice.is_explicit:
        steps *= 2
    return steps * float(mesh.seconds(np.array([ratio * finest.edges]))[0, 0])


def obstacle_of(
    bench: Bench,
    space: SpaceErrors,
    prediction: Prediction,
    goal: Goal,
    most_seconds: float | None,
) -> str:
    """Return in words why no setting can be proved to meet the goal; "" if one may be.

    `most_seconds` is the CPU time [s] that a run may take; None for no limit.
    """
    if space.reference.choice.h is None:
        return (
            "the mesh has no h, so it is not refined, and its error in space counts as 100 %; "
            "a .geo file with h in [cloth] can be refined"
        )
    causes = "; ".join(space.reference.row["obstacles"])
    if causes:
        causes = f": {causes}"
    if space.stalls(bench, goal.scale):
        return f"finer meshes do not come closer to each other{causes}"
    candidates = goal.candidates(prediction)
    if not candidates:
        return _why_none(space, prediction, goal, causes)
    first = candidates[0]
    error = float(space.error.max())
    seconds = f"in about {in_words(first.seconds)}"
    if first.seconds > (most_seconds or math.inf):
        return f"{first.choice} should meet it, {seconds}: too long"
    if error > goal.tolerance and is_extrapolated(first):
        differ = f"the best meshes that were run still differ by {in_percent(error)}"
        return f"{differ}; {first.choice} may meet it, {seconds}"
    return ""


def _why_none(space: SpaceErrors, prediction: Prediction, goal: Goal, causes: str) -> str:
    """Return in words why no setting is predicted to meet the goal.

    The first reason that holds is given: the budget, the gaps of contact, the other errors that
    mesh and steps do not change, the steps, or else the mesh. `causes` is added to the last one.
    """
    if math.isfinite(goal.budget):
        return f"no setting is predicted to take less than {goal.budget:g} s"
    allowed = PART_OF_TOLERANCE * goal.tolerance
    if not math.isfinite(prediction.other):
        return "the error of the gaps of contact is not known: a run with half of them failed"
    if prediction.other > allowed:
        other = in_percent(prediction.other)
        return f"the solver's tolerance, changed terms and gaps alone make an error of {other}"
    mesh = space.most_accurate
    error = mesh.errors.y[-1]
    if error.max() <= allowed:
        return "the error in time of all methods is predicted to be larger"
    # error ~ h^order, so h must be divided by (error / allowed)^(1 / order)
    ratio = float(((error / allowed) ** (1 / mesh.errors.order)).max())
    finest = f"{mesh.trials[-1].choice}, the finest that the time of the search allows{causes}"
    return f"it needs a mesh about {ratio:.2g} times finer than {finest}"
