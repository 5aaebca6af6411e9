"""The answer of `tune`: of all its runs the cheapest that is known to be as accurate as asked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.tuning.choices import Bench, Trial, each_once
from fecloth.study.tuning.prediction import Prediction
from fecloth.study.tuning.proof import Proof
from fecloth.study.tuning.search import Goal

NEARLY = 1.5  # times the least error: runs that are as accurate
FASTER = 0.9  # times the seconds of the proved setting: what another run must at most take
TIMED = 3  # runs, of the cheapest, whose seconds are measured with care


@dataclass(frozen=True, eq=False)
class Yardstick:
    """A run, and what is left of its own error, (q,): the error of others is at most their sum."""

    run: Trial
    left: np.ndarray

    def error(self, bench: Bench, trial: Trial) -> np.ndarray:
        """Return the (q,) largest error that a run may have."""
        return bench.distance(self.run, trial) + self.left


def choose_yardstick(bench: Bench, proof: Proof | None, reference: Trial, left) -> Yardstick:
    """Return the verifying run, or the best run of the search if less is left in that one."""
    searched = Yardstick(reference, left)
    if proof is None or proof.finer is None or proof.why:
        return searched
    total = sum(proof.parts.values(), np.zeros(len(left)))
    rest = np.maximum(total - bench.distance(proof.finer, proof.trial), 0.0)
    return Yardstick(proof.finer, rest) if rest.max() <= left.max() else searched


def answer(
    bench: Bench,
    goal: Goal,
    prediction: Prediction,
    yardstick: Yardstick,
    proof: Proof | None,
    runs: Sequence[Trial],
    why: str,
    is_open: bool = False,
) -> Proof:
    """Return the cheapest run that meets the goal; else what can be had, and `why` not more.

    The error of a run is at most its distance to the yardstick plus what is left in that one. With
    a budget the answer is the most accurate run within it. Where `is_open`, as finer meshes do not
    come closer to each other, nothing is proved. Without a proof the answer is the cheapest of the
    most accurate runs, with a budget the fastest run.
    """
    rows = [run for run in each_once(runs) if run.is_ok and run.records and not run.choice.sharper]
    errors = {run.choice: float(yardstick.error(bench, run).max()) for run in rows}
    has_budget = math.isfinite(goal.budget)
    if not is_open:
        proved = proof if proof is not None and not proof.why and proof.meets(goal) else None
        able = [
            run
            for run in rows
            if errors[run.choice] <= goal.tolerance
            and run.seconds <= goal.budget
            and (proved is None or has_budget or run.seconds < FASTER * proved.trial.seconds)
            and (proved is None or not has_budget or errors[run.choice] < proved.error)
        ]
        able.sort(key=lambda run: errors[run.choice] if has_budget else run.seconds)
        for run in able[:TIMED]:
            (timed,) = bench.run([run.choice], timed=True)
            slow = proved is not None and not has_budget and timed.seconds > proved.trial.seconds
            if timed.is_ok and timed.seconds <= goal.budget and not slow:
                return _stated(prediction, yardstick, bench, timed)
        if proved:
            return proved
    least = min(errors.values())
    near = rows if has_budget else [run for run in rows if errors[run.choice] <= NEARLY * least]
    fastest = min(near, key=lambda run: run.seconds)
    return replace(_stated(prediction, yardstick, bench, fastest), why=why)


def _stated(prediction: Prediction, yardstick: Yardstick, bench: Bench, run: Trial) -> Proof:
    """Return a run with its error, divided in space and time as the time was predicted."""
    total = yardstick.error(bench, run)
    finer = yardstick.run if yardstick.run.choice != run.choice else None
    in_time = np.minimum(prediction.error_in_time(run), total) if run.choice.method else 0.0
    parts = {"space": total - in_time} | ({"time": in_time} if run.choice.method else {})
    return Proof(run, None, finer, parts)
