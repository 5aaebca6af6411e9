"""How errors in time grow on finer meshes, which have shorter waves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fecloth.study.tuning.prediction import Prediction
from fecloth.study.tuning.search import Goal
from fecloth.study.tuning.time_errors import Rule
from fecloth.study.tuning.trials import Bench, Trial

BEST = 3  # candidates whose rules are looked at
COUNTS = 0.2  # part of the predicted error from which the error in time matters
MOST = 2.0  # power of √triangles


def measure_growth(
    bench: Bench, prediction: Prediction, goal: Goal, search: list[Trial]
) -> Prediction:
    """Return the prediction with the growth of the errors in time of the best candidates.

    Each rule runs on a mesh with half of h beside the most accurate implicit one, as on the coarse
    mesh. Rules that are not measured get the largest power. The runs are added to `search`.
    """
    times = prediction.times
    candidates = goal.candidates(prediction)[:BEST]
    looked_at = [
        one
        for one in candidates
        if one.rule.kind in ("steps", "rtol") and one.time.max() > COUNTS * one.error
    ]
    if not looked_at or prediction.coarse.choice.h is None:
        return prediction
    implicit = [one for one in times.trials if one.is_ok and one.choice.steps]
    implicit = [one for one in implicit if not one.choice.is_explicit]
    if not implicit:
        return prediction
    reference = min(implicit, key=lambda one: float(bench.distance(times.reference, one).max()))
    (finest,) = _on_finer_mesh(bench, [reference])
    search.append(finest)
    growth = dict(prediction.growth)
    for one in looked_at:
        trial = _nearest(one.rule, one.x)
        if trial is reference or not finest.is_ok:
            continue
        (finer,) = _on_finer_mesh(bench, [trial])
        search.append(finer)
        if finer.is_ok:
            before = float(bench.distance(reference, trial).max())
            after = float(bench.distance(finest, finer).max())
            power = math.log(after / before) / math.log(finer.edges / trial.edges)
            growth[one.rule.key] = float(np.clip(power, 0.0, MOST))
    most = max(growth.values(), default=0.0)
    others = {one.key: most for one in times.rules if one.kind in ("steps", "rtol")}
    return replace(prediction, growth=others | growth)


def _on_finer_mesh(bench: Bench, trials: list[Trial]) -> list[Trial]:
    choices = [replace(one.choice, h=float(f"{(one.choice.h or 1) / 2:.6g}")) for one in trials]
    return bench.run(choices)


def _nearest(rule: Rule, x: float) -> Trial:
    """Return the run of a rule whose size is nearest to x."""
    apart = np.abs(np.log(rule.errors.x / x))
    return rule.trials[int(np.argmin(apart))]
