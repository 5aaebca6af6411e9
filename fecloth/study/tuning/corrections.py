"""Short runs of the best candidates, which correct the predicted errors in time and seconds."""

import math
from dataclasses import replace

import numpy as np

from fecloth.study.change import Change
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.tuning.choices import (
    COSTLY_SECONDS,
    COUNTING_SHARE,
    HALF_OF_H_COSTS,
    Bench,
)
from fecloth.study.tuning.prediction import Candidate, Goal, Prediction

BEST_CANDIDATES = 3  # whose errors in time and seconds are measured, or measured again
# Errors in time grow at most with this power of √triangles, and at least with the power 0: a
# larger one would be noise of a small error.
LARGEST_GROWTH = 2.0
# A short run that shows seconds has at least so many steps, and at least this part of all.
STEPS_OF_SHORT_RUN = 12
PART_OF_SHORT_RUN = 0.05


def measure_growth(bench: Bench, prediction: Prediction, goal: Goal) -> Prediction:
    """Return the prediction with the growth of errors in time on finer meshes.

    Finer meshes have shorter waves, so that errors in time grow with a power of √triangles. To
    measure the power of a rule, its run is compared with the most accurate implicit run: once on
    the coarse mesh, and once with half of h. This is done for the rules of the best candidates.
    The others get the largest measured power.
    """
    times = prediction.times
    best = goal.candidates(prediction)[:BEST_CANDIDATES]
    candidates = [candidate for candidate in best if _errs_in_time(candidate)]
    able = [run for run in times.trials if run.is_ok and run.choice.steps]
    implicit = [run for run in able if not run.choice.is_explicit]
    if not candidates or not implicit or prediction.coarse.choice.h is None:
        return prediction
    reference = min(implicit, key=lambda run: float(bench.distance(times.reference, run).max()))
    (finer_reference,) = bench.run([reference.choice.with_half_of_h()])
    growth = dict(prediction.growth)
    for candidate in candidates:
        # of the runs that were made by its rule, the one whose steps are nearest to its own
        distance_of_steps = np.abs(np.log(candidate.rule.errors.x / candidate.x))
        trial = candidate.rule.trials[int(np.argmin(distance_of_steps))]
        is_costly = HALF_OF_H_COSTS * trial.seconds > COSTLY_SECONDS
        if trial is reference or not finer_reference.is_ok or is_costly:
            continue
        (finer,) = bench.run([trial.choice.with_half_of_h()])
        if finer.is_ok:
            error = bench.distance(reference, trial).max()
            error_of_finer = bench.distance(finer_reference, finer).max()
            power = math.log(error_of_finer / error) / math.log(finer.edges / trial.edges)
            growth[candidate.rule.key] = float(np.clip(power, 0.0, LARGEST_GROWTH))
    largest = max(growth.values(), default=0.0)
    others = {rule.key: largest for rule in times.rules if rule.kind in ("steps", "rtol")}
    return replace(prediction, growth=others | growth)


def _errs_in_time(candidate: Candidate) -> bool:
    """Whether steps are chosen whose error is a part of the whole that counts."""
    is_chosen = candidate.rule.kind in ("steps", "rtol")
    return is_chosen and candidate.time.max() > COUNTING_SHARE * candidate.error


def time_candidates(bench: Bench, prediction: Prediction, goal: Goal) -> Prediction:
    """Return the prediction with measured seconds of the best candidates.

    Steps that follow rtol are not measured, because the steps of the beginning say little of the
    others.
    """
    candidates = goal.candidates(prediction)
    with_equal_steps = [
        candidate for candidate in candidates if candidate.rule.kind in ("steps", "limit")
    ]
    for candidate in with_equal_steps[:BEST_CANDIDATES]:
        prediction = prediction.with_seconds(candidate, _measure_seconds(bench, candidate))
    return prediction


def _measure_seconds(bench: Bench, candidate: Candidate) -> float:
    """Return the CPU seconds of a candidate [s], or infinity if its run fails.

    Only a part of the whole time is run, and its seconds are divided by the part. The short run
    has no quantities, because these may belong to the end.
    """
    choice = candidate.choice
    part = PART_OF_SHORT_RUN
    if choice.steps:
        part = min(max(PART_OF_SHORT_RUN, STEPS_OF_SHORT_RUN / choice.steps), 1.0)
        choice = replace(choice, steps=max(round(part * choice.steps), 1))
    short_bench = replace(bench, opened=shorten(bench.opened, part), quantities=())
    (trial,) = short_bench.run([choice], timed=True)
    if trial.is_ok:
        return trial.seconds / part
    return math.inf


def shorten(opened: Problem, part: float) -> Problem:
    """Return the problem that ends after a part (0 to 1) of its time.

    A scene loses its tables [interest] and [expect], which may ask for values of the end.
    """
    span = opened.span
    assert span is not None
    if isinstance(opened, FunctionProblem):
        return replace(opened, t_end=part * span)

    def end_earlier(tables: dict) -> dict:
        tables["time"]["t_end"] = opened.scene.time.t_start + part * span
        tables_of_the_end = ("interest", "expect")
        return {name: table for name, table in tables.items() if name not in tables_of_the_end}

    return opened.changed(Change(edits=(end_earlier,)))
