"""The tuned run beside a finer one: its error, and other settings if it is far off."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.tuning.choices import COUNTING_SHARE, Bench, Choice, Trial, each_once
from fecloth.study.tuning.corrections import BEST_CANDIDATES
from fecloth.study.tuning.prediction import (
    NOISE_OF_SECONDS,
    PART_AFTER_MEASUREMENT,
    Candidate,
    Goal,
    Prediction,
)
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors, unsampled
from fecloth.study.tuning.time_errors import Rule
from fecloth.study.uncertainty import SAFE

FINER_MESH = math.sqrt(2)  # ratio of √triangles for a verifying run: twice as many triangles
VERIFYING_RUNS = 3  # at most; the prediction is corrected by each
CHEAPER_SETTINGS = (
    8  # that are tried at most after a proof, as long as the time of the search lasts
)
# Without a proof, the cheapest run is offered whose error is below this multiple of the least.
NEARLY_LEAST_ERROR = 1.5
Errors = Mapping[str, np.ndarray]  # (q,) errors by their causes


@dataclass(frozen=True, eq=False)
class Proof:
    """A tuned run beside a verifying one.

    Attributes
    ----------
    trial
        The tuned run.
    candidate
        Its prediction; None if it was not predicted.
    finer
        The verifying run; None if it failed.
    parts
        The error of the tuned run by its causes.
    why
        Why the error is not known; "" if it is.
    """

    trial: Trial
    candidate: Candidate | None
    finer: Trial | None
    parts: Errors
    why: str = ""

    @property
    def error(self) -> float:
        """The largest error of all quantities."""
        return float(sum(self.parts.values(), np.zeros(1)).max())

    def meets(self, goal: Goal) -> bool:
        """Whether error and seconds are as asked for."""
        return self.error <= goal.tolerance and self.trial.seconds <= goal.budget


@dataclass(frozen=True, eq=False)
class Yardstick:
    """A run that other runs are compared with, and its own error `left`, (q,)."""

    run: Trial
    left: np.ndarray

    def error(self, bench: Bench, trial: Trial) -> np.ndarray:
        """Return the (q,) largest error that a run may have."""
        return bench.distance(self.run, trial) + self.left


def verifying(bench: Bench, proof: Proof, error: np.ndarray) -> Yardstick:
    """Return the verifying run with what is left in it of an `error` of the tuned run."""
    assert proof.finer is not None
    left = np.maximum(error - bench.distance(proof.finer, proof.trial), 0.0)
    return Yardstick(proof.finer, left)


def prove(
    bench: Bench, prediction: Prediction, goal: Goal, other: Errors, space: SpaceErrors
) -> Proof | None:
    """Run the best candidate beside a finer one; try again where it is far off.

    Return None if no candidate can meet the goal. The best run of the search serves as the finer
    one if it is finer and its own error is small.
    """
    best = Yardstick(space.reference, space.error + prediction.error_in_time(space.reference))
    is_best_known = best.left.max() <= COUNTING_SHARE * goal.scale
    attempts = list[Proof]()
    for _ in range(VERIFYING_RUNS):
        candidates = untried(goal.candidates(prediction), attempts)
        is_late = attempts and bench.spent(attempts[-1].finer) > goal.limit(candidates)
        if not candidates or is_late:
            break
        candidate = candidates[0]
        (trial,) = bench.run([candidate.choice], timed=True)
        if not trial.is_ok:
            is_method = candidate.rule.kind != "static"
            prediction = prediction.without(candidate, on_all_meshes=is_method)
            continue
        if is_best_known and best.run.edges >= FINER_MESH * trial.edges:
            proof = beside(bench, best, candidate, trial, other)
        else:
            proof = verify(bench, candidate, trial, other)
        attempts.append(proof)
        if proof.why or proof.meets(goal):
            break
        prediction = corrected(prediction, proof)
    if not attempts:
        return None
    proof = stated(attempts, goal)
    if not proof.why and proof.meets(goal) and not goal.has_budget:
        proof = cheaper(bench, prediction, goal, proof)
    return proof


def untried(candidates: Sequence[Candidate], proofs: Iterable[Proof]) -> list[Candidate]:
    """Return the candidates whose settings were not run yet."""
    tried = {proof.candidate.choice for proof in proofs if proof.candidate}
    return [candidate for candidate in candidates if candidate.choice not in tried]


def stated(attempts: Sequence[Proof], goal: Goal) -> Proof:
    """Return the last attempt, or the one with the least error where the last is not enough."""
    if attempts[-1].error <= goal.tolerance:
        return attempts[-1]
    return min(attempts, key=lambda proof: proof.error)


def beside(
    bench: Bench, stick: Yardstick, candidate: Candidate, trial: Trial, other: Errors
) -> Proof:
    """Return the error of a run beside a yardstick, divided as its parts were predicted."""
    total = stick.error(bench, trial)
    parts = {"space": total}
    if candidate.rule.kind != "static":
        share = candidate.space / (candidate.space + candidate.time)
        parts = {"space": share * total, "time": (1 - share) * total}
    return Proof(trial, candidate, stick.run, parts | dict(other))


def verify(bench: Bench, candidate: Candidate, trial: Trial, other: Errors) -> Proof:
    """Run a finer setting and return the error of the run by its causes.

    Let ε be the part of an error that is left in the finer run. The distance d of both runs is
    (1 − ε) of the error, so that the error is d (1 + ε/(1 − ε)). Its second term gets a factor
    of safety.
    """
    choice, left = finer_choice(candidate)
    (finer,) = bench.run([choice])
    parts = {"space": candidate.space}
    if candidate.rule.kind != "static":
        parts["time"] = candidate.time
    parts |= other
    if not finer.is_ok:
        cause = str(finer.row["cause"]).splitlines()[0]
        why = f"the verifying run ({choice}) failed: {cause}"
        return Proof(trial, candidate, None, parts, why)
    part = np.max(list(left.values()), axis=0)
    factor = 1 + SAFE * part / (1 - part)
    total = factor * bench.distance(finer, trial) + unsampled(bench, finer)
    predicted = sum((parts[name] for name in left), np.zeros(len(total)))
    parts |= {name: total * parts[name] / predicted for name in left}
    return Proof(trial, candidate, finer, parts)


def finer_choice(candidate: Candidate) -> tuple[Choice, dict[str, np.ndarray]]:
    """Return the choice of a verifying run, and the part of each refined error left in it.

    Each cause of the error that counts is refined: rtol is divided by 4, dt and h of structured
    meshes by 2, and h of unstructured ones by √2. If no cause that counts can be refined, it is
    the mesh, or else the steps.
    """
    # an error of 0 is compared with the least number, so that no part of it counts
    least = COUNTING_SHARE * max(candidate.error, np.finfo(float).tiny)
    choice = candidate.choice
    order = candidate.rule.errors.order
    left = dict[str, np.ndarray]()
    is_time_refined = candidate.time.max() >= least
    if is_time_refined and choice.rtol:
        choice = replace(choice, rtol=choice.rtol / 4)
        left["time"] = 4.0**-order
    elif is_time_refined and choice.steps:
        choice = choice.with_half_of_dt()
        left["time"] = 2.0**-order
    if choice.h and (candidate.space.max() >= least or not left):
        is_structured = choice.pattern not in ("", "unstructured")
        ratio = 2.0 if is_structured else FINER_MESH
        choice = replace(choice, h=choice.h / ratio)
        left["space"] = ratio**-candidate.mesh.errors.order
    if not left:  # steps of first order, at least
        choice = choice.with_half_of_dt()
        left["time"] = np.full(len(candidate.time), 0.5)
    return choice, left


def corrected(prediction: Prediction, proof: Proof) -> Prediction:
    """Return the prediction with the measured error and the measured seconds of a tuned run.

    An error in space that is larger than predicted holds for all meshes of that element.
    """
    candidate = proof.candidate
    assert candidate is not None
    space = proof.parts["space"] / candidate.space
    in_time = proof.parts.get("time", candidate.time) / candidate.time

    def correct(mesh: Mesh) -> Mesh:
        if mesh is candidate.mesh:
            return replace(mesh, errors=mesh.errors.scaled(space))
        if mesh.choice.element == candidate.choice.element:
            return replace(mesh, errors=mesh.errors.scaled(np.maximum(space, 1.0)))
        return mesh

    def correct_rule(rule: Rule) -> Rule:
        if rule is candidate.rule:
            return replace(rule, errors=rule.errors.scaled(in_time))
        return rule

    times = replace(prediction.times, rules=tuple(map(correct_rule, prediction.times.rules)))
    meshes = tuple(map(correct, prediction.meshes))
    prediction = prediction.with_seconds(candidate, proof.trial.seconds)
    return replace(prediction, meshes=meshes, times=times)


def cheaper(bench: Bench, prediction: Prediction, goal: Goal, proof: Proof) -> Proof:
    """Try cheaper settings beside the verifying run, and return the cheapest proof."""
    other = {name: part for name, part in proof.parts.items() if name not in ("space", "time")}
    stick = verifying(bench, proof, proof.parts["space"] + proof.parts.get("time", 0.0))
    tried = [proof]
    for _ in range(CHEAPER_SETTINGS):
        candidates, prediction = next_candidates(goal, prediction, proof, tried)
        if not candidates or NOISE_OF_SECONDS * candidates[0].seconds > proof.trial.seconds:
            break
        candidate = candidates[0]
        if bench.spent(proof.finer) + candidate.seconds > goal.limit(candidates):
            break
        (trial,) = bench.run([candidate.choice], timed=True)
        if not trial.is_ok:
            prediction = prediction.without(candidate)
            continue
        tried.append(beside(bench, stick, candidate, trial, other))
        if tried[-1].error <= goal.tolerance and trial.seconds < proof.trial.seconds:
            proof = tried[-1]
    return proof


def next_candidates(
    goal: Goal, prediction: Prediction, proof: Proof, tried: Sequence[Proof]
) -> tuple[list[Candidate], Prediction]:
    """Return the settings to try next, the best first, and the prediction as now corrected.

    After an error that is too large a setting halfway is tried, or another mesh or method.
    """
    latest = tried[-1]
    assert latest.candidate is not None
    prediction = corrected(prediction, latest)
    if latest.error > goal.tolerance:
        if halfway := untried(between(proof, latest), tried):
            return halfway, prediction
        prediction = prediction.without(latest.candidate)
    return untried(goal.candidates(prediction, PART_AFTER_MEASUREMENT), tried), prediction


def between(proof: Proof, failed: Proof) -> list[Candidate]:
    """Return the setting halfway between two of the same mesh and method; none for others."""
    cheap = failed.candidate
    fine = proof.candidate
    if cheap is None or fine is None or cheap.key != fine.key:
        return []
    x = math.sqrt(fine.x * cheap.x)
    halfway = replace(
        fine,
        edges=math.sqrt(fine.edges * cheap.edges),
        x=math.ceil(x) if fine.rule.kind == "steps" else x,
        space=np.sqrt(fine.space * cheap.space),
        time=np.sqrt(fine.time * cheap.time),
        seconds=math.sqrt(proof.trial.seconds * failed.trial.seconds),
    )
    return [halfway]


def choose_yardstick(
    bench: Bench, proof: Proof | None, reference: Trial, left: np.ndarray
) -> Yardstick:
    """Return the verifying run, or the best run of the search if less is left in that one."""
    if proof and proof.finer and not proof.why:
        stick = verifying(bench, proof, sum(proof.parts.values(), np.zeros(len(left))))
        if stick.left.max() <= left.max():
            return stick
    return Yardstick(reference, left)


def answer(
    bench: Bench,
    goal: Goal,
    prediction: Prediction,
    yardstick: Yardstick,
    proof: Proof | None,
    why: str,
    is_open: bool = False,
) -> Proof:
    """Return the cheapest run that meets the goal; else what can be had, and `why` not more.

    With a budget it is the most accurate run within it. Where `is_open`, as finer meshes do not
    come closer to each other, nothing is proved. Without a proof it is the cheapest of the most
    accurate runs, with a budget the fastest run.
    """
    own = each_once(bench.other_than(proof.finer if proof else None)[bench.changed :])
    runs = [run for run in own if run.is_ok and run.records and not run.choice.sharper]
    errors = {run.choice: float(yardstick.error(bench, run).max()) for run in runs}
    if not is_open:
        proved = proof
        if proof is not None and (proof.why or not proof.meets(goal)):
            proved = None
        better = _find_better(bench, goal, runs, errors, proved)
        if better:
            return _measured(bench, prediction, yardstick, better)
        if proved:
            return proved
    accurate = runs
    if not goal.has_budget:
        limit = NEARLY_LEAST_ERROR * min(errors.values())
        accurate = [run for run in runs if errors[run.choice] <= limit]
    fastest = min(accurate, key=lambda run: run.seconds)
    return replace(_measured(bench, prediction, yardstick, fastest), why=why)


def _find_better(
    bench: Bench,
    goal: Goal,
    runs: Sequence[Trial],
    errors: Mapping[Choice, float],
    proved: Proof | None,
) -> Trial | None:
    """Return the best run that meets the goal and is better than the proved one, if any.

    The seconds of the best ones by the search are measured again before one is returned.
    """

    def rank(run: Trial) -> float:
        return errors[run.choice] if goal.has_budget else run.seconds

    limit = math.inf
    if proved and goal.has_budget:
        limit = proved.error
    elif proved:
        limit = proved.trial.seconds / NOISE_OF_SECONDS
    able = [run for run in runs if errors[run.choice] <= goal.tolerance]
    able = [run for run in able if run.seconds <= goal.budget and rank(run) < limit]
    for run in sorted(able, key=rank)[:BEST_CANDIDATES]:
        (timed,) = replace(bench, done=[]).run([run.choice], timed=True)
        is_slower = proved and not goal.has_budget and timed.seconds > proved.trial.seconds
        if timed.is_ok and timed.seconds <= goal.budget and not is_slower:
            return timed
    return None


def _measured(bench: Bench, prediction: Prediction, stick: Yardstick, run: Trial) -> Proof:
    """Return a run with its error, divided in space and time as the time was predicted."""
    total = stick.error(bench, run)
    parts = {"space": total}
    if run.choice.method:
        in_time = np.minimum(prediction.error_in_time(run), total)
        parts = {"space": total - in_time, "time": in_time}
    finer = stick.run if stick.run.choice != run.choice else None
    return Proof(run, None, finer, parts)
