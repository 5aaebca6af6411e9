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
from fecloth.study.tuning.choices import (
    COUNTING_SHARE,
    HALVINGS,
    SEARCH_SECONDS,
    Bench,
    Choice,
    Trial,
    methods_to_try,
)
from fecloth.study.tuning.corrections import measure_growth, time_candidates
from fecloth.study.tuning.prediction import NOISE_OF_SECONDS, Goal, Prediction
from fecloth.study.tuning.proof import Proof, choose_run, choose_yardstick, prove
from fecloth.study.tuning.result import Tuned, summarise
from fecloth.study.tuning.search import coarse_meshes, measure_meshes, obstacle_of
from fecloth.study.tuning.space_errors import SpaceErrors
from fecloth.study.tuning.time_errors import measure_methods
from fecloth.study.workload import in_words
from fecloth.terms import Springs
from fecloth.terms.traits import traits_of

STEPS_OF_MODELS = 128  # of the runs on a coarse mesh that compare terms and gaps
# Gaps are divided by so much at most; the error that is left then is stated.
NARROWEST_GAP = 32.0
# Divides the solver's tolerance in the run that shows its error: 1 % of that is left in it.
SHARPER_SOLVER = 100.0


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
        As for `of`. What the function takes as `method` and `element` varies as `methods` and
        `elements` say; h and dt vary always.
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
        [fabric.uncertainty]; see `fecloth.study.budget`. A smaller error is work for nothing.
    model
        Whether terms may be left out or replaced by cheaper ones, if that changes the quantities
        by less than a quarter of the tolerance.
    methods, elements
        Names as in a scene, by default the usual methods with the scene's own, and P1 and P2.
    folder
        Where tuned.toml is written; None for nowhere.
    shared
        Arguments of `fecloth.study.of`: h, dt, t_end, probes, settings; cache, jobs, scheduler,
        time_limit, most_seconds, fresh. A run that is predicted to take longer than most_seconds
        is skipped.

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
    goal = _read_goal(tolerance, budget)
    quantities = opened.choose_quantities(quantity)
    warned = print_warnings(opened)
    bench = Bench(opened, quantities, runs)
    method_names = methods_to_try(opened, methods)
    meshes = coarse_meshes(opened, elements)
    bench, other, changed = _change_models(bench, meshes[0], goal, model=model)
    coarse, space, prediction = _measure_errors(bench, meshes, method_names, goal)
    other |= _measure_solver(bench, coarse)
    prediction = replace(prediction, other=sum(float(part.max()) for part in other.values()))
    # why nothing can be proved; "" as long as a proof may succeed
    why = obstacle_of(bench, space, prediction, goal, most_seconds=runs.most_seconds)
    if not why and bench.spent() < SEARCH_SECONDS:
        _say("seconds of the best settings: short runs")
        prediction = measure_growth(bench, prediction, goal)
        prediction = time_candidates(bench, prediction, goal)
        why = obstacle_of(bench, space, prediction, goal, most_seconds=runs.most_seconds)
    if not why:
        why = _why_too_late(bench, goal, prediction)
    proof = None
    if not why:
        _say("proof: the best setting beside a finer one")
        proof = prove(bench, prediction, goal, other, space)
        why = proof.why if proof else "no setting that should meet it ran to its end"
    # the whole error of the best run of the search
    left = space.error + prediction.error_in_time(space.reference) + prediction.other
    yardstick = choose_yardstick(bench, proof, space.reference, left)
    is_open = space.stalls(bench, goal.scale)
    final = choose_run(bench, goal, prediction, yardstick, proof, why=why, is_open=is_open)
    took = bench.spent() - _seconds_of_verifying(proof, space)
    tuned = summarise(bench, goal, final, took=took, dropped=changed, folder=folder)
    return replace(tuned, doubts=warned)


def _change_models(
    bench: Bench, mesh: Choice, goal: Goal, model: bool
) -> tuple[Bench, dict[str, np.ndarray], list[str]]:
    """Leave out terms if `model` says so, and narrow the gaps of contact if there is contact.

    `mesh` is the coarse mesh on which models are compared. Return the bench of the changed
    problem; the errors (q,) of these changes by their cause, "model" and "gap"; and the changes
    in words. Raise `InputError` if terms of a function are to be left out.
    """
    errors: dict[str, np.ndarray] = {}
    words: list[str] = []
    if model:
        _say("terms: what they change on a coarse mesh")
        choice = _coarse_choice(bench, mesh)
        bench, errors["model"], words = drop_terms(bench, choice, goal.scale)
    if bench.opened.has_contact:
        _say("gaps of contact: what halving them changes on a coarse mesh")
        bench, errors["gap"], narrowed = narrow_gaps(bench, mesh, goal.scale)
        words += narrowed
    return bench, errors, words


def _measure_errors(
    bench: Bench, meshes: Sequence[Choice], methods: Sequence[str], goal: Goal
) -> tuple[Trial, SpaceErrors, Prediction]:
    """Measure the errors in time of all methods, and the errors in space of all meshes.

    If the steps are why the meshes disagree, all meshes are run again with half of dt. Return
    the run on the coarse mesh with the steps that all meshes had at last; the errors in space;
    and the prediction from all errors.

    Raise `InputError` for a quantity of size zero, and `StudyFailed` if no run on the coarse
    mesh reaches its end.
    """
    _say("errors in time: all methods on a coarse mesh")
    times = measure_methods(bench, meshes[0], methods, goal.scale, SEARCH_SECONDS / 2)
    coarse = shared_steps.shared_run(bench, times, goal.scale)
    bench.check_sizes(coarse)
    _say("errors in space: all meshes with the same steps")
    coarse = shared_steps.shorten_steps(bench, times, coarse, goal.scale)
    for _ in range(HALVINGS):
        space, prediction = measure_meshes(bench, meshes, times, coarse, goal)
        is_doubtful = space.rival or space.stalls(bench, goal.scale)
        if not (is_doubtful and shared_steps.blame_steps(bench, space, goal.scale)):
            break
        (shorter,) = bench.run([coarse.choice.with_half_of_dt()])
        if not shorter.is_ok or bench.spent() > SEARCH_SECONDS / 2:
            break
        coarse = shorter
    bench.check_sizes(space.reference, space.error)
    return coarse, space, prediction


def _measure_solver(bench: Bench, coarse: Trial) -> dict[str, np.ndarray]:
    """Return the (q,) error by the solver's tolerance, if it is known; explicit steps have none."""
    if coarse.choice.is_explicit:
        return {}
    (sharper,) = bench.run([replace(coarse.choice, sharper=SHARPER_SOLVER)])
    return {"solver": bench.distance(sharper, coarse)} if sharper.is_ok else {}


def _seconds_of_verifying(proof: Proof | None, space: SpaceErrors) -> float:
    """Return the seconds of the verifying run, if it was not a run of the search."""
    if proof and proof.finer and proof.finer is not space.reference:
        return proof.finer.spent
    return 0.0


def _why_too_late(bench: Bench, goal: Goal, prediction: Prediction) -> str:
    """Return in words that the best setting would take longer than the time left to the search.

    Return "" if there is enough time, or if there is no setting.
    """
    candidates = goal.candidates(prediction)
    if not candidates:
        return ""
    best = candidates[0]
    if bench.spent() + best.seconds <= goal.limit(candidates):
        return ""
    seconds = in_words(best.seconds)
    return f"the search has no time left; {best.choice} should meet it, in about {seconds}"


def _say(phase: str) -> None:
    """Print the phase that begins."""
    print(f"tune: {phase}", file=sys.stderr, flush=True)


def _read_goal(tolerance: float | str | None, budget: float | str | None) -> Goal:
    """Return the goal from the arguments of `tune`; without both, a tolerance of 1 %.

    Raise `InputError` if both are given, for a tolerance outside 0 to 100 %, and for a budget
    that is no time > 0.
    """
    if budget is None:
        return Goal(tolerance=read_tolerance(0.01 if tolerance is None else tolerance))
    if tolerance is not None:
        what = f"tolerance = {tolerance!r} and budget = {budget!r}"
        remedy = "A budget seeks the most accurate setting, a tolerance the cheapest."
        raise InputError(what, "only one of them may be given", "tune", remedy)
    seconds = read_quantity("budget", budget, TIME) if isinstance(budget, str) else budget
    if not 0 < seconds < math.inf:
        allowed = 'must be a time > 0, as 60.0 [s] or "60 s"'
        raise InputError(f"budget = {budget!r}", allowed, "tune")
    return Goal(budget=float(seconds))


def _coarse_choice(bench: Bench, mesh: Choice) -> Choice:
    """Return the setting on a coarse mesh in which models are compared."""
    if bench.opened.span is None:
        return mesh
    return replace(mesh, method="bdf2", steps=STEPS_OF_MODELS)


def narrow_gaps(
    bench: Bench, mesh: Choice, tolerance: float
) -> tuple[Bench, np.ndarray, list[str]]:
    """Divide the gaps of contact until their error is at most a quarter of the tolerance.

    They are divided by `NARROWEST_GAP` at most. Return the bench of the problem with the
    narrower gaps; the relative error (q,) that their gaps leave; and the change in words, an
    empty list for none.

    The error is of first order in the gap, so that halving the gaps shows half of it. If one of
    the two runs fails, the error is not known and counts as infinite.
    """
    choice = _coarse_choice(bench, mesh)
    opened = bench.opened
    halved = replace(bench, opened=opened.refined(Level(sharper=None, gap=2.0)))
    (run,) = bench.run([choice])
    (run_with_half,) = halved.run([choice])
    if not (run.is_ok and run_with_half.is_ok):
        return bench.with_problem(opened), np.full(len(bench.quantities), math.inf), []
    error = 2 * bench.distance(run_with_half, run)
    needed_divisor = float(error.max()) / (COUNTING_SHARE * tolerance)
    divisor = min(max(1.0, needed_divisor), NARROWEST_GAP)
    if divisor == 1:
        return bench.with_problem(opened), error, []
    narrow = bench.with_problem(opened.refined(Level(sharper=None, gap=divisor)))
    return narrow, error / divisor, [f"gaps / {divisor:.3g}"]


def drop_terms(
    bench: Bench, choice: Choice, tolerance: float
) -> tuple[Bench, np.ndarray, list[str]]:
    """Leave out terms, or replace them by cheaper ones, as long as the quantities change little.

    First each variant of a term is run alone. Variants that change the quantities by at most a
    quarter of the tolerance and save seconds are then combined, the fastest first, as long as
    the combination changes them by no more. Membranes are not left out: in free fall they change
    nothing.

    Return the bench of the reduced problem; the relative change (q,) of its quantities; and the
    names of the variants it has. If the problem itself fails, nothing is left out. Raise
    `InputError` for a function, whose terms cannot be changed.
    """
    if not isinstance(bench.opened, SceneProblem):
        remedy = "Write a scene file, or compare the models with compare."
        raise InputError("model = True", "needs a scene: it changes its terms", "tune", remedy)
    (full,) = bench.run([choice], timed=True)
    change_of_all = np.zeros(len(bench.quantities))
    taken: dict[str, Variant] = {}  # by the slot: at most one variant of each term
    if not full.is_ok:
        return _bench_with(bench, []), change_of_all, []

    def change_by(variants: Sequence[Variant]) -> tuple[np.ndarray, float] | None:
        """Return the change (q,) by variants and the seconds with them; None if it is large."""
        trial = run_variants(bench, variants, choice)
        if trial is None or not trial.is_ok:
            return None
        change = bench.distance(full, trial)
        if change.max() > COUNTING_SHARE * tolerance:
            return None
        return change, trial.seconds

    cheaper = []
    for variant in _variants(bench.opened, choice.element):
        result = change_by([variant])
        if result is None:
            continue
        _, seconds = result
        if NOISE_OF_SECONDS * seconds < full.seconds:
            cheaper.append((seconds, variant))
    for _, variant in sorted(cheaper, key=itemgetter(0)):
        if variant.slot in taken:
            continue
        result = change_by([*taken.values(), variant])
        if result is not None:
            change_of_all, _ = result
            taken[variant.slot] = variant
    names = [variant.name for variant in taken.values()]
    return _bench_with(bench, taken.values()), change_of_all, names


def _variants(opened: SceneProblem, element: str) -> list[Variant]:
    """Return the variants of all terms, except variants that leave out a membrane.

    `Springs` may be left out, although their kind is "membrane".
    """
    traits = {type(term).__name__: traits_of(term) for term in opened.first.system.terms}
    membranes = {name for name, own in traits.items() if own.kind == "membrane"}
    membranes -= {Springs.__name__}
    variants = []
    for term in opened.tables.get("terms", []):
        for variant in variants_of_term(term, element, traits[term["type"]]):
            leaves_out_membrane = variant.kind == "without" and variant.by in membranes
            if not leaves_out_membrane:
                variants.append(variant)
    return variants


def run_variants(bench: Bench, variants: Sequence[Variant], choice: Choice) -> Trial | None:
    """Run the problem with some variants; None if it is refused."""
    try:
        return _bench_with(bench, variants).run([choice], timed=True)[0]
    except InputError:
        return None


def _bench_with(bench: Bench, variants: Iterable[Variant]) -> Bench:
    """Return the bench with the problem that some variants change."""
    return bench.with_problem(bench.opened.changed(changes_of(variants)))
