"""The tuned run beside a finer one: its error, and cheaper or finer settings if it is far off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.problems import Problem
from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.prediction import Candidate, Prediction
from fecloth.study.tuning.sampled_extremes import unsampled
from fecloth.study.tuning.search import KNOWN, Goal
from fecloth.study.tuning.space_errors import SpaceErrors
from fecloth.study.tuning.time_errors import TimeErrors
from fecloth.study.tuning.trials import Bench, Trial, spent
from fecloth.study.uncertainty import SAFE

FINER = 1.4  # times the √triangles of a tuned run: at least those of the verifying one
COUNTS = 0.25  # part of the error from which a cause is refined in the verifying run
ROUNDS = 3  # verifying runs at most
LOOSE = 0.85  # times the tolerance: below this error a cheaper setting is tried
NEARLY = 1.5  # times the least error: runs that are as good
TRIES, CLOSE = 4, 0.9  # of cheaper settings; part of the tolerance that their errors may take
CHEAPER = 0.85  # times the seconds: what a cheaper setting should at most cost


@dataclass(frozen=True, eq=False)
class Proof:
    """A tuned run, its predicted candidate, its error by causes, and the verifying run."""

    # The run, and what was predicted of it.
    trial: Trial
    candidate: Candidate | None
    finer: Trial | None  # the verifying run; None if it failed
    parts: dict[str, np.ndarray]  # the error by its cause, (q,) each
    search: tuple[Trial, ...]  # all runs but the last verifying one
    why: str = ""  # why the error is not known; "" if it is

    @property
    def error(self) -> float:
        """The largest error of a quantity, of all causes together."""
        return float(sum(self.parts.values(), np.zeros(1)).max())


def prove(
    bench: Bench,
    prediction: Prediction,
    goal: Goal,
    search: Sequence[Trial],
    other: dict,
    space: SpaceErrors,
) -> Proof | None:
    """Run the best candidate beside a finer one; try again where it is far off.

    Return None if no candidate can meet the goal.
    """
    found: Proof | None = None
    best: Proof | None = None
    search = list(search)
    left = space.error + prediction.error_in_time(space.reference)
    for _ in range(ROUNDS):
        candidates = goal.candidates(prediction)
        if not candidates or (found and spent(search) > goal.limit(candidates)):
            break
        first = candidates[0]
        trial = bench.run([first.choice], timed=True)[0]
        if not trial.is_ok:
            search.append(trial)
            prediction = without(prediction, first)
            continue
        if found and found.finer:
            search.append(found.finer)
        found = _known(bench, first, trial, search, other, space.reference, left, goal)
        found = found or verify(bench, first, trial, search, other)
        search.append(trial)
        met = found.error <= goal.tolerance and trial.seconds <= goal.budget
        if found.why or met:
            break
        prediction = scaled(prediction, found)
        best = found if best is None or found.error < best.error else best
    if best and found and found.error > max(best.error, goal.tolerance):
        last = [found.finer] if found.finer else []
        found = replace(best, search=(*found.search, *last))
    if found and not found.why and found.error < LOOSE * goal.tolerance < math.inf:
        found = _cheaper(bench, prediction, goal, found)
    return found


def _known(
    bench: Bench,
    candidate: Candidate,
    trial: Trial,
    search: Sequence[Trial],
    other: dict,
    reference: Trial,
    left: np.ndarray,
    goal: Goal,
) -> Proof | None:
    """Return the error beside the best run of the search, if that is finer and accurate enough.

    `left` are its own errors, (q,).
    """
    if reference.edges < FINER * trial.edges or left.max() > KNOWN * goal.scale:
        return None
    parts = _divide(bench.distance(reference, trial) + left, candidate) | other
    before = [one for one in search if one is not reference]
    return Proof(trial, candidate, reference, parts, (*before, trial))


def _divide(total: np.ndarray, candidate: Candidate) -> dict[str, np.ndarray]:
    """Return an error divided in those of space and time, as they were predicted."""
    if candidate.rule.kind == "static":
        return {"space": total}
    both = candidate.space + candidate.time
    return {"space": total * candidate.space / both, "time": total * candidate.time / both}


def verify(
    bench: Bench, candidate: Candidate, trial: Trial, search: Sequence[Trial], other: dict
) -> Proof:
    """Run a finer setting and return the error of the run by its causes."""
    fractions = {
        "space": candidate.space.max() / (candidate.error + 1e-300),
        "time": candidate.time.max() / (candidate.error + 1e-300),
    }
    refined = [name for name, size in fractions.items() if size >= COUNTS]
    choice, left = finer_choice(bench.opened, candidate, refined or ["space"])
    finer = bench.run([choice])[0]
    parts = {"space": candidate.space, "time": candidate.time} | other
    if candidate.rule.kind == "static":
        del parts["time"]
    known = (*search, trial)
    if not finer.is_ok:
        cause = str(finer.row["cause"]).splitlines()[0]
        why = f"the verifying run ({choice}) failed: {cause}"
        return Proof(trial, candidate, None, parts, known, why)
    change, part = bench.distance(finer, trial), np.max(list(left.values()), axis=0)
    total = change * (1 + SAFE * part / (1 - part)) + unsampled(bench, finer)
    share = sum((parts[name] for name in left), np.zeros(len(total)))
    for name in left:
        parts[name] = total * parts[name] / share
    return Proof(trial, candidate, finer, parts, known)


def finer_choice(
    opened: Problem, candidate: Candidate, refined: Sequence[str]
) -> tuple[Choice, dict[str, np.ndarray]]:
    """Return the finer choice, and the part of each refined error that should be left in it."""
    choice = candidate.choice
    left: dict[str, np.ndarray] = {}
    if "space" in refined and choice.h:
        ratio = 2.0 if choice.pattern not in ("", "unstructured") else math.sqrt(2)
        choice = replace(choice, h=choice.h / ratio)
        left["space"] = ratio**-candidate.mesh.errors.order
    if "time" in refined and choice.rtol:
        choice = replace(choice, rtol=choice.rtol / 4)
        left["time"] = 4.0**-candidate.rule.errors.order
    elif "time" in refined and candidate.rule.kind in ("steps", "limit"):
        steps = choice.steps or 0
        if steps:
            choice = replace(choice, steps=2 * steps)
            left["time"] = 2.0**-candidate.rule.errors.order
    if not left and choice.h:
        return finer_choice(opened, candidate, ["space"])
    if not left:
        return replace(choice, steps=2 * (choice.steps or 1)), {
            "time": 0.5 * np.ones(len(candidate.time))
        }
    return choice, left


def scaled(prediction: Prediction, proof: Proof) -> Prediction:
    """Return the prediction with the measured error and the measured seconds of a tuned run.

    An error in space that is larger than predicted holds for all meshes of that element.
    """
    candidate = proof.candidate
    assert candidate is not None
    space = proof.parts["space"] / candidate.space
    in_time = proof.parts.get("time", candidate.time) / candidate.time
    ratio = float(np.clip(proof.trial.seconds / candidate.seconds, 0.2, 5.0))
    larger = np.maximum(space, 1.0)
    meshes = tuple(
        replace(one, errors=one.errors.scaled(space if one is candidate.mesh else larger))
        if one.choice.element == candidate.choice.element
        else one
        for one in prediction.meshes
    )
    rules = tuple(
        replace(one, errors=one.errors.scaled(in_time)) if one is candidate.rule else one
        for one in prediction.times.rules
    )
    key = candidate.key
    factor = prediction.factors.get(key, 1.0) * ratio
    times = replace(prediction.times, rules=rules)
    factors = {**prediction.factors, key: factor}
    return replace(prediction, meshes=meshes, times=times, factors=factors)


def best_run(bench: Bench, space: SpaceErrors, times: TimeErrors, search, other: dict) -> Proof:
    """Return the cheapest of the most accurate runs so far, where the goal cannot be met."""

    def error_in_space(one: Trial) -> np.ndarray:
        apart = bench.distance(space.reference, one) if one is not space.reference else 0.0
        return apart + space.error

    good = [one for one in space.trials if one.is_ok]
    least = min(float(error_in_space(one).max()) for one in good)
    near = [one for one in good if error_in_space(one).max() <= NEARLY * least]
    trial = min(near, key=lambda one: one.seconds)
    rule = trial.choice.method, trial.choice.steps
    same = [one for one in times.trials if (one.choice.method, one.choice.steps) == rule]
    shared = same[0] if same else times.reference
    parts = {"space": error_in_space(trial), **other}
    if shared.choice.method:
        parts["time"] = bench.distance(times.reference, shared) + times.error
    return Proof(trial, None, None, parts, tuple(search), "it was not verified")


def without(prediction: Prediction, candidate: Candidate) -> Prediction:
    """Return the prediction without a rule whose run failed, if others are left."""
    rules = tuple(one for one in prediction.times.rules if one is not candidate.rule)
    return replace(prediction, times=replace(prediction.times, rules=rules))


def _cheaper(bench: Bench, prediction: Prediction, goal: Goal, found: Proof) -> Proof:
    """Try cheaper settings by the corrected prediction; the verifying run is their reference.

    After a setting whose error is too large, one halfway to it is tried, or another method.
    """
    assert found.finer is not None
    reference, last = found.finer, found
    both = found.parts["space"] + found.parts.get("time", 0.0)
    left = np.maximum(both - bench.distance(reference, found.trial), 0.0)
    other = {name: one for name, one in found.parts.items() if name not in ("space", "time")}
    for _ in range(TRIES):
        failed = last.error > goal.tolerance
        halfway = _between(found, last) if failed else None
        if failed and last.candidate and not halfway:  # another method, which does worse here
            prediction = without(prediction, last.candidate)
        else:
            prediction = scaled(prediction, last)
        candidates = [halfway] if halfway else goal.candidates(prediction, CLOSE)
        if not candidates or candidates[0].seconds > CHEAPER * found.trial.seconds:
            break
        if spent(found.search) + candidates[0].seconds > goal.limit(candidates):
            break
        trial = bench.run([candidates[0].choice], timed=True)[0]
        found = replace(found, search=(*found.search, trial))
        if not trial.is_ok:
            break
        parts = _divide(bench.distance(reference, trial) + left, candidates[0]) | other
        last = Proof(trial, candidates[0], reference, parts, found.search)
        if last.error <= goal.tolerance and trial.seconds < found.trial.seconds:
            found = last
    return found


def _between(found: Proof, failed: Proof) -> Candidate | None:
    """Return the setting halfway between two of the same mesh and method; None for others."""
    one, other = found.candidate, failed.candidate
    if one is None or other is None or one.key != other.key or one.linear != other.linear:
        return None
    sizes = ("edges", "space", "time")
    middle = {name: np.sqrt(getattr(one, name) * getattr(other, name)) for name in sizes}
    x = math.sqrt(one.x * other.x)
    x = math.ceil(x) if one.rule.kind == "steps" else x
    seconds = math.sqrt(found.trial.seconds * failed.trial.seconds)
    return replace(one, x=x, seconds=seconds, **middle)
