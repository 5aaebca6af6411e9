"""Short runs of the best candidates: their seconds, and the fastest linear solver."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

from fecloth.scene.toml_text import to_toml
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.scene_text import scene_of
from fecloth.study.tuning.choices import span_of
from fecloth.study.tuning.prediction import Candidate, Prediction
from fecloth.study.tuning.search import Goal
from fecloth.study.tuning.trials import Bench, Trial

BEST = 3  # candidates whose seconds are measured
CLOSE = 3.0  # times the seconds of the best one, up to which others are candidates
FEWEST, PART = 12, 0.05  # steps of a short run, and its part of the whole one
LINEAR = "pcg", "direct"  # solvers that are tried besides the problem's own
FASTER = 0.85  # times the seconds, for another solver to be taken


def time_candidates(
    bench: Bench, prediction: Prediction, goal: Goal, search: list[Trial]
) -> Prediction:
    """Return the prediction with measured seconds of the best candidates.

    Their short runs are added to `search`. Steps that follow rtol are not measured, because those
    of the beginning say little of the others.
    """
    candidates = [one for one in goal.candidates(prediction) if one.rule.kind in ("steps", "limit")]
    factors = dict(prediction.factors)
    for one in candidates[:BEST]:
        if one.seconds <= CLOSE * candidates[0].seconds:
            seconds = _seconds(bench, one, search)
            factors[one.key] = factors.get(one.key, 1.0) * seconds / one.seconds
    prediction = replace(prediction, factors=factors)
    best = goal.candidates(prediction)[:1]
    if not best or best[0].rule.kind != "steps" or isinstance(bench.opened, FunctionProblem):
        return prediction
    tried = {name: _seconds(bench, replace(best[0], linear=name), search) for name in LINEAR}
    name = min(tried, key=lambda name: tried[name])
    if tried[name] < FASTER * best[0].seconds:
        key = best[0].key
        factors[key] = factors.get(key, 1.0) * tried[name] / best[0].seconds
        return replace(prediction, factors=factors, linear={key: name})
    return prediction


def _seconds(bench: Bench, candidate: Candidate, search: list[Trial]) -> float:
    """Return the seconds of a candidate from a short run; infinite if that fails."""
    choice = candidate.choice
    steps = choice.steps or FEWEST / PART
    part = min(max(PART, FEWEST / steps), 1.0)
    short = replace(bench, opened=shorten(bench.opened, part), quantities=())
    if choice.steps:
        choice = replace(choice, steps=max(round(part * choice.steps), 1))
    (trial,) = short.run([choice], timed=True)
    search.append(trial)
    return trial.seconds / part if trial.is_ok else math.inf


def shorten(opened: Problem, part: float) -> Problem:
    """Return the beginning of a run."""
    span = span_of(opened)
    assert span is not None
    if isinstance(opened, FunctionProblem):
        return replace(opened, t_end=part * span)
    data = tomllib.loads(opened.scene.to_toml())
    data = {key: value for key, value in data.items() if key not in ("interest", "expect")}
    data["time"]["t_end"] = opened.scene.time.t_start + part * span
    return SceneProblem(scene_of(to_toml(data), opened.scene.trusts_geo), opened.name)
