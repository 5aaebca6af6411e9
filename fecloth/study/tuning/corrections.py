"""Short runs of the best candidates, which correct the predicted errors in time and seconds."""

import math
from dataclasses import replace

import numpy as np

from fecloth.study.change import Change
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.tuning.choices import COSTLY, Bench
from fecloth.study.tuning.prediction import Candidate, Goal, Prediction

BEST = 3  # candidates that are looked at
COUNTS = 0.2  # part of the predicted error from which the error in time matters
MOST = 2.0  # power of √triangles
CLOSE = 3.0  # times the seconds of the best one, up to which others are candidates
FEWEST, PART = 12, 0.05  # steps of a short run, and its part of the whole one
DEARER = 6.0  # times the seconds: a run with half of h


def measure_growth(bench: Bench, prediction: Prediction, goal: Goal) -> Prediction:
    """Return the prediction with the growth of the errors in time of the best candidates.

    Finer meshes have shorter waves, so that errors in time grow. Each rule runs with half of h
    beside the most accurate implicit one, as on the coarse mesh. Rules that are not measured get
    the largest power.
    """
    times = prediction.times
    candidates = [of for of in goal.candidates(prediction)[:BEST] if _errs_in_time(of)]
    able = [run for run in times.trials if run.is_ok and run.choice.steps]
    implicit = [run for run in able if not run.choice.is_explicit]
    if not candidates or not implicit or prediction.coarse.choice.h is None:
        return prediction
    reference = min(implicit, key=lambda run: float(bench.distance(times.reference, run).max()))
    (finest,) = bench.run([reference.choice.with_half_of_h()])
    growth = dict(prediction.growth)
    for candidate in candidates:
        apart = np.abs(np.log(candidate.rule.errors.x / candidate.x))
        trial = candidate.rule.trials[int(np.argmin(apart))]
        if trial is reference or not finest.is_ok or DEARER * trial.seconds > COSTLY:
            continue
        (finer,) = bench.run([trial.choice.with_half_of_h()])
        if finer.is_ok:
            ratio = bench.distance(finest, finer).max() / bench.distance(reference, trial).max()
            power = math.log(ratio) / math.log(finer.edges / trial.edges)
            growth[candidate.rule.key] = float(np.clip(power, 0.0, MOST))
    most = max(growth.values(), default=0.0)
    others = {rule.key: most for rule in times.rules if rule.kind in ("steps", "rtol")}
    return replace(prediction, growth=others | growth)


def _errs_in_time(candidate: Candidate) -> bool:
    """Whether steps are chosen whose error is a part of the whole that counts."""
    is_chosen = candidate.rule.kind in ("steps", "rtol")
    return is_chosen and candidate.time.max() > COUNTS * candidate.error


def time_candidates(bench: Bench, prediction: Prediction, goal: Goal) -> Prediction:
    """Return the prediction with measured seconds of the best candidates.

    Steps that follow rtol are not measured, because the steps of the beginning say little of the
    others.
    """
    fixed = [of for of in goal.candidates(prediction) if of.rule.kind in ("steps", "limit")]
    for candidate in fixed[:BEST]:
        if candidate.seconds <= CLOSE * fixed[0].seconds:
            seconds = _seconds(bench, candidate)
            prediction = prediction.with_seconds(candidate, seconds)
    return prediction


def _seconds(bench: Bench, candidate: Candidate) -> float:
    """Return the seconds of a candidate from a short run; infinite if that fails."""
    choice = candidate.choice
    part = min(max(PART, FEWEST / (choice.steps or FEWEST / PART)), 1.0)
    short = replace(bench, opened=shorten(bench.opened, part), quantities=())
    if choice.steps:
        choice = replace(choice, steps=max(round(part * choice.steps), 1))
    (trial,) = short.run([choice], timed=True)
    return trial.seconds / part if trial.is_ok else math.inf


def shorten(opened: Problem, part: float) -> Problem:
    """Return the beginning of a run."""
    span = opened.span
    assert span is not None
    if isinstance(opened, FunctionProblem):
        return replace(opened, t_end=part * span)

    def edit(tables: dict) -> dict:
        tables["time"]["t_end"] = opened.scene.time.t_start + part * span
        return {k: v for k, v in tables.items() if k not in ("interest", "expect")}

    return opened.changed(Change(edits=(edit,)))
