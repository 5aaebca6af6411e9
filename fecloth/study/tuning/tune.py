"""`tune`: an accepted error in, the cheapest proven setting out."""

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.quantities.units import TIME
from fecloth.quantities.units import quantity as read_quantity
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.budgeting.budget import tolerance_of_data
from fecloth.study.change import Level
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import SceneProblem
from fecloth.study.result import read_tolerance
from fecloth.study.run_problems import print_warnings
from fecloth.study.simplification.variants import Variant, changes_of, variants_of_term
from fecloth.study.tuning import shared_steps
from fecloth.study.tuning.choices import SEARCH, Bench, Choice, Trial, methods_to_try
from fecloth.study.tuning.corrections import measure_growth, time_candidates
from fecloth.study.tuning.prediction import Goal, Prediction
from fecloth.study.tuning.proof import answer, choose_yardstick, prove
from fecloth.study.tuning.result import Tuned, summarise
from fecloth.study.tuning.search import coarse_meshes, measure_meshes, obstacle_of
from fecloth.study.tuning.time_errors import measure_methods
from fecloth.study.workload import in_words
from fecloth.terms import Springs
from fecloth.terms.traits import traits_of

METHODS_TIME = 30.0  # s, CPU time for the runs of all methods
REPEATED = 3  # times that steps are halved because meshes disagree, at most
STEPS = 128  # of the runs that compare terms
SHARE = 0.25  # of the tolerance, for the terms that are left out or replaced
GAPS = 0.25  # of the tolerance, for the gaps of contact
NARROWEST = 32.0  # by so much gaps are divided at most
SAVES = 0.97  # times the seconds: what a change must at most cost to be worth it
SHARPER = 100.0  # divides the solver's tolerance in the run that shows its error


def tune(
    problem: Scene | str | Path | Callable | Opened,
    tolerance: float | str | None = None,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    budget: float | str | None = None,
    to_data: bool = False,
    model: bool = False,
    methods: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    folder: str | Path | None = None,
    **shared: Any,
) -> Tuned:
    """Find the cheapest setting of a problem that meets a tolerance, and prove its error.

    Runs on a coarse mesh show the error in time and the seconds of each method; runs on a few
    meshes with the same steps show the error in space of each element and pattern. From these
    the errors and the seconds of all settings are predicted, in scenes also of meshes that are
    graded at corners and pins (see `Grading`). The cheapest setting that should meet the
    tolerance is run. Its error is its difference from a finer run, plus the error of that, by
    its order (grid convergence index). Cheaper settings are then tried beside it. With contact
    the gaps are divided until their error, of first order, takes at most a quarter of the
    tolerance.

    Parameters
    ----------
    problem
        As for `of`. What the function takes as `method` and
        `element` varies as `methods` and `elements` say; h and dt vary always.
    tolerance
        Largest relative error of each quantity, as 0.01 or "1%"; None for 1 % without a budget.
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene
        their ends), or the displacement.
    budget
        Longest CPU time of the tuned run, as 60.0 [s] or "60 s". The most accurate setting
        within it is sought in place of the cheapest one, so that a tolerance beside it is
        refused.
    to_data
        Whether the tolerance is a third of how uncertain the quantities are by [uncertain] and
        [fabric.uncertainty], see `fecloth.study.budget`: a smaller error is work for nothing.
    model
        Whether terms may be left out or replaced by cheaper ones, if that changes the quantities
        by less than a quarter of the tolerance.
    methods, elements
        Names as in a scene, by default the usual methods with the scene's own, and P1 and P2.
    folder
        Where tuned.toml is written; None for nowhere.
    shared
        Arguments of `fecloth.study.of`: h, dt, t_end, probes, settings; cache, jobs, scheduler,
        time_limit, most_seconds, fresh.
        A run that is predicted to take longer than most_seconds is skipped.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity or one of size zero, or an
        unknown name.
    StudyFailed
        If no run on a coarse mesh reaches its end.
    """
    study = open_study(problem, shared)
    opened = study.problem
    runs = study.runs()
    if to_data:
        if tolerance is not None:
            raise InputError("to_data and tolerance are given", "give one of them", "tune")
        tolerance = tolerance_of_data(study, quantity)
        _say(f"tolerance by the data: {100 * tolerance:.2g} %")
    goal = _goal(tolerance, budget)
    quantities = opened.choose_quantities(quantity)
    warned = print_warnings(opened)
    bench = Bench(opened, quantities, runs)
    names = methods_to_try(opened, methods)
    meshes = coarse_meshes(opened, elements)
    other: dict[str, np.ndarray] = {}
    dropped: list[str] = []
    if model:
        _say("terms: what they change on a coarse mesh")
        coarsest = _coarse_choice(bench, meshes[0])
        bench, other["model"], dropped = drop_terms(bench, coarsest, goal.scale)
    if opened.has_contact:
        _say("gaps of contact: what halving them changes on a coarse mesh")
        bench, other["gap"], changed = narrow_gaps(bench, meshes[0], goal.scale)
        dropped += changed
    _say("errors in time: all methods on a coarse mesh")
    times = measure_methods(bench, meshes[0], names, goal.scale, METHODS_TIME)
    coarse = shared_steps.shared_run(bench, times, goal.scale)
    bench.check_sizes(coarse)
    _say("errors in space: all meshes with the same steps")
    coarse = shared_steps.shorten_steps(bench, times, coarse, goal.scale)
    for _ in range(REPEATED):
        space, prediction = measure_meshes(bench, meshes, times, coarse, goal)
        is_doubtful = space.rival or space.stalls(bench, goal.scale)
        if not (is_doubtful and shared_steps.blame_steps(bench, space, goal.scale)):
            break
        (shorter,) = bench.run([coarse.choice.with_half_of_dt()])
        if not shorter.is_ok or bench.spent() > SEARCH / 2:
            break
        coarse = shorter
    bench.check_sizes(space.reference, space.error)
    if not coarse.choice.is_explicit:  # it has a solver
        (sharper,) = bench.run([replace(coarse.choice, sharper=SHARPER)])
        other |= {"solver": bench.distance(sharper, coarse)} if sharper.is_ok else {}
    prediction = replace(prediction, other=sum(float(part.max()) for part in other.values()))
    proof = None
    why = obstacle_of(bench, space, prediction, goal, runs.most_seconds)
    if not why and bench.spent() < SEARCH:
        _say("seconds of the best settings: short runs")
        prediction = measure_growth(bench, prediction, goal)
        prediction = time_candidates(bench, prediction, goal)
        why = obstacle_of(bench, space, prediction, goal, runs.most_seconds)
    if not why:
        why = _why_too_late(bench, goal, prediction)
    if not why:
        _say("proof: the best setting beside a finer one")
        proof = prove(bench, prediction, goal, other, space)
        if proof:
            why = proof.why
        else:
            why = "no setting that should meet it ran to its end"
    if proof and proof.finer is not space.reference:
        verifying = proof.finer
    else:
        verifying = None
    left = space.error + prediction.error_in_time(space.reference) + prediction.other
    yardstick = choose_yardstick(bench, proof, space.reference, left)
    is_open = space.stalls(bench, goal.scale)
    final = answer(bench, goal, prediction, yardstick, proof, why, is_open)
    took = bench.spent() - (verifying.spent if verifying else 0.0)
    return replace(summarise(bench, goal, final, took, dropped, folder), doubts=warned)


def _why_too_late(bench: Bench, goal: Goal, prediction: Prediction) -> str:
    """Return that the time of the search is over before the best setting could run, or ""."""
    candidates = goal.candidates(prediction)
    if not candidates or bench.spent() + candidates[0].seconds <= goal.limit(candidates):
        return ""
    long = in_words(candidates[0].seconds)
    return f"the search has no time left; {candidates[0].choice} should meet it, in about {long}"


def _say(phase: str) -> None:
    print(f"tune: {phase}", file=sys.stderr, flush=True)


def _goal(tolerance: float | str | None, budget: float | str | None) -> Goal:
    if budget is None:
        return Goal(tolerance=read_tolerance(0.01 if tolerance is None else tolerance))
    what = f"budget = {budget!r}"
    if tolerance is not None:
        what = f"tolerance = {tolerance!r} and {what}"
        remedy = "A budget seeks the most accurate setting, a tolerance the cheapest."
        raise InputError(what, "only one of them may be given", "tune", remedy)
    if isinstance(budget, str):
        seconds = read_quantity("budget", str(budget), TIME)
    else:
        seconds = budget
    if not 0 < seconds < math.inf:
        raise InputError(what, 'must be a time > 0, as 60.0 [s] or "60 s"', "tune")
    return Goal(budget=float(seconds))


def _coarse_choice(bench: Bench, mesh: Choice) -> Choice:
    """Return the setting on a coarse mesh in which models are compared."""
    if bench.opened.span is None:
        return mesh
    return replace(mesh, method="bdf2", steps=STEPS)


def narrow_gaps(
    bench: Bench, mesh: Choice, tolerance: float
) -> tuple[Bench, np.ndarray, list[str]]:
    """Return the problem with gaps whose error is a part of the tolerance, and that error (q,).

    The error is of first order in the gap: halving the gaps shows half of it. Return also the
    change in words. Where a run fails the error is not known, and infinite.
    """
    choice = _coarse_choice(bench, mesh)
    opened = bench.opened
    halved = replace(bench, opened=opened.refined(Level(sharper=None, gap=2.0)))
    runs = [*bench.run([choice]), *halved.run([choice])]
    if not all(run.is_ok for run in runs):
        return bench.with_problem(opened), np.full(len(bench.quantities), math.inf), []
    error = 2 * bench.distance(runs[1], runs[0])
    by = min(max(1.0, float(error.max()) / (GAPS * tolerance)), NARROWEST)
    if by == 1:
        return bench.with_problem(opened), error, []
    narrow = bench.with_problem(opened.refined(Level(sharper=None, gap=by)))
    return narrow, error / by, [f"gaps / {by:.3g}"]


def drop_terms(
    bench: Bench, choice: Choice, tolerance: float
) -> tuple[Bench, np.ndarray, list[str]]:
    """Leave out terms, or replace them by cheaper ones, as long as their changes are small.

    Returns the reduced problem, (q,) its change of the quantities, and the names of the changes.
    Membranes are not left out: in free fall they change nothing.
    """
    if not isinstance(bench.opened, SceneProblem):
        remedy = "Write a scene file, or compare the models with compare."
        raise InputError("model = True", "needs a scene: it changes its terms", "tune", remedy)
    (full,) = bench.run([choice], timed=True)
    total = np.zeros(len(bench.quantities))
    taken: dict[str, Variant] = {}

    def run_with(variant: Variant) -> tuple[np.ndarray, float] | None:
        """Return the change by a variant beside the taken ones, if it is small, and seconds."""
        trial = run_variants(bench, [*taken.values(), variant], choice)
        if trial is None or not trial.is_ok:
            return None
        change = bench.distance(full, trial)
        if change.max() <= SHARE * tolerance:
            return (change, trial.seconds)
        return None

    worth = []
    for variant in _variants(bench.opened, choice.element) if full.is_ok else []:
        if (made := run_with(variant)) and made[1] < SAVES * full.seconds:
            worth.append((made[1], variant))
    for _, variant in sorted(worth, key=itemgetter(0)):
        if variant.slot not in taken and (made := run_with(variant)):
            total = made[0]
            taken[variant.slot] = variant
    names = [variant.name for variant in taken.values()]
    return _with(bench, taken.values()), total, names


def _variants(opened: SceneProblem, element: str) -> list[Variant]:
    """Return the variants of all terms, except variants that leave out a membrane."""
    traits = {type(term).__name__: traits_of(term) for term in opened.first.system.terms}
    kept = {name for name, own in traits.items() if own.kind == "membrane"} - {Springs.__name__}
    terms = opened.tables.get("terms", [])
    listed = [v for term in terms for v in variants_of_term(term, element, traits[term["type"]])]
    return [v for v in listed if not (v.kind == "without" and v.by in kept)]


def run_variants(bench: Bench, variants: Sequence[Variant], choice: Choice) -> Trial | None:
    """Run the problem with some variants; None if it is refused."""
    try:
        return _with(bench, variants).run([choice], timed=True)[0]
    except InputError:
        return None


def _with(bench: Bench, variants: Iterable[Variant]) -> Bench:
    return bench.with_problem(bench.opened.changed(changes_of(variants)))
