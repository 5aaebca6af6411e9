"""The tuned run beside a finer one: its error, and cheaper or finer settings if it is far off."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.tuning.choices import Bench, Choice, Trial
from fecloth.study.tuning.prediction import Candidate, Prediction
from fecloth.study.tuning.search import KNOWN, Goal
from fecloth.study.tuning.space_errors import SpaceErrors, unsampled
from fecloth.study.uncertainty import SAFE

FINER = 1.4  # times the √triangles of a tuned run: the verifying run has at least so many
COUNTS = 0.25  # part of the error from which a cause is refined in the verifying run
ROUNDS = 3  # verifying runs at most
TRIES, CLOSE = 8, 0.9  # of cheaper settings; part of the tolerance that their errors may take
CHEAPER = 0.85  # times the seconds: what a cheaper setting should at most cost
SLOWER = 5.0  # measured over predicted seconds, that a prediction is corrected by at most


@dataclass(frozen=True, eq=False)
class Proof:
    """A tuned run, its predicted candidate, its error by causes, and the verifying run."""

    trial: Trial
    candidate: Candidate | None  # None if the run was not predicted
    finer: Trial | None  # the verifying run; None if it failed
    parts: Mapping[str, np.ndarray]  # the error by its cause, (q,) each
    why: str = ""  # why the error is not known; "" if it is
    search: tuple[Trial, ...] = ()  # all runs but the verifying one

    @property
    def error(self) -> float:
        return float(sum(self.parts.values(), np.zeros(1)).max())

    def meets(self, goal: Goal) -> bool:
        return self.error <= goal.tolerance and self.trial.seconds <= goal.budget


@dataclass(frozen=True, eq=False)
class Judge:
    """What says how large the error of a run is."""

    bench: Bench
    goal: Goal
    other: Mapping[str, np.ndarray]  # errors that no mesh and no step changes, by cause, (q,) each
    # The best run of the search, and its own error, (q,).
    reference: Trial
    left: np.ndarray

    def attempt(self, candidate: Candidate, trial: Trial) -> Proof:
        """Return the error of a run, beside the best run of the search if that one serves."""
        # It must be finer, and its own error small; otherwise a finer setting is run.
        is_finer = self.reference.edges >= FINER * trial.edges
        is_known = self.left.max() <= KNOWN * self.goal.scale
        if is_finer and is_known:
            return beside(self, candidate, trial)
        return verify(self.bench, candidate, trial, self.other)


def prove(
    bench: Bench,
    prediction: Prediction,
    goal: Goal,
    search: Sequence[Trial],
    other: Mapping[str, np.ndarray],
    space: SpaceErrors,
) -> Proof | None:
    """Run the best candidate beside a finer one; try again where it is far off."""
    # Return None if no candidate can meet the goal.
    left = space.error + prediction.error_in_time(space.reference)
    judge = Judge(bench, goal, other, space.reference, left)
    attempts: list[Proof] = []
    runs: Sequence[Trial] = list(search)
    for _ in range(ROUNDS):
        candidates = untried(goal.candidates(prediction), attempts)
        if not candidates:
            break
        if attempts and bench.spent(others(runs, attempts[-1])) > goal.limit(candidates):
            break
        (trial,) = bench.run([candidates[0].choice], timed=True)
        runs = [*runs, trial]
        if not trial.is_ok:
            is_method = candidates[0].rule.kind != "static"
            prediction = prediction.without(candidates[0], on_all_meshes=is_method)
            continue
        proof = judge.attempt(candidates[0], trial)
        attempts.append(proof)
        runs = [*runs, proof.finer] if proof.finer else runs
        if proof.why or proof.meets(goal):
            break
        prediction = corrected(prediction, proof)
    if not attempts:
        return None
    proof = stated(attempts, goal)
    if not proof.why and proof.meets(goal) and goal.tolerance < math.inf:
        proof, runs = cheaper(judge, prediction, proof, runs)
    return replace(proof, search=others(runs, proof))


def others(runs: Sequence[Trial], proof: Proof) -> tuple[Trial, ...]:
    """Return the runs but the verifying one."""
    return tuple(run for run in runs if run is not proof.finer)


def untried(candidates: Sequence[Candidate], proofs: Iterable[Proof]) -> list[Candidate]:
    """Return the candidates whose settings were not run yet."""
    tried = {proof.candidate.choice for proof in proofs if proof.candidate}
    return [candidate for candidate in candidates if candidate.choice not in tried]


def stated(attempts: Sequence[Proof], goal: Goal) -> Proof:
    """Return the last attempt, or the one with the least error where the last is not enough."""
    if attempts[-1].error <= goal.tolerance:
        return attempts[-1]
    return min(attempts, key=lambda proof: proof.error)


def beside(judge: Judge, candidate: Candidate, trial: Trial) -> Proof:
    """Return the error of a run as its distance to the reference, plus the error of that run."""
    total = judge.bench.distance(judge.reference, trial) + judge.left
    parts = divided(total, candidate) | dict(judge.other)
    return Proof(trial, candidate, judge.reference, parts)


def divided(total: np.ndarray, candidate: Candidate) -> dict[str, np.ndarray]:
    """Return an error divided in space and time, as the parts were predicted."""
    if candidate.rule.kind == "static":
        return {"space": total}
    both = candidate.space + candidate.time
    return {"space": total * candidate.space / both, "time": total * candidate.time / both}


def verify(
    bench: Bench, candidate: Candidate, trial: Trial, other: Mapping[str, np.ndarray]
) -> Proof:
    """Run a finer setting and return the error of the run by its causes.

    With the part ε of an error that is left in the finer run, the distance d of both is (1 − ε) of
    the error: this is d (1 + ε/(1 − ε)), where the second term has a factor of safety.
    """
    choice, left = finer_choice(candidate)
    (finer,) = bench.run([choice])
    in_time = {} if candidate.rule.kind == "static" else {"time": candidate.time}
    parts = {"space": candidate.space, **in_time, **other}
    if not finer.is_ok:
        cause = str(finer.row["cause"]).splitlines()[0]
        why = f"the verifying run ({choice}) failed: {cause}"
        return Proof(trial, candidate, None, parts, why)
    part = np.max(list(left.values()), axis=0)
    change = bench.distance(finer, trial)
    total = change * (1 + SAFE * part / (1 - part)) + unsampled(bench, finer)
    predicted = sum((parts[name] for name in left), np.zeros(len(total)))
    parts |= {name: total * parts[name] / predicted for name in left}
    return Proof(trial, candidate, finer, parts)


def finer_choice(candidate: Candidate) -> tuple[Choice, dict[str, np.ndarray]]:
    """Return the choice of a verifying run, and the part of each refined error left in it."""
    # It refines each cause that counts; if none of these can be refined, the mesh, or the steps.
    least = COUNTS * max(candidate.error, 1e-300)
    choice = candidate.choice
    refined = {}
    if candidate.time.max() >= least:
        refined["time"] = _shorter_steps(candidate)
    if candidate.space.max() >= least or refined.get("time") is None:
        refined["space"] = _finer_mesh(candidate)
    left = {}
    for name, finer in refined.items():
        if finer is not None:
            changes, left[name] = finer
            choice = replace(choice, **changes)
    if not left:
        steps = 2 * (choice.steps or 1)
        return replace(choice, steps=steps), {"time": 0.5 * np.ones(len(candidate.time))}
    return choice, left


def _finer_mesh(candidate: Candidate) -> tuple[dict, np.ndarray] | None:
    """Return the change of the choice, and the part of the error that is left; None without h."""
    choice = candidate.choice
    if not choice.h:
        return None
    ratio = 2.0 if choice.pattern not in ("", "unstructured") else math.sqrt(2)
    return {"h": choice.h / ratio}, ratio**-candidate.mesh.errors.order


def _shorter_steps(candidate: Candidate) -> tuple[dict, np.ndarray] | None:
    """Return the change of the choice, and the part left; None where steps follow the mesh."""
    choice, order = candidate.choice, candidate.rule.errors.order
    if choice.rtol:
        return {"rtol": choice.rtol / 4}, 4.0**-order
    if choice.steps:
        return {"steps": 2 * choice.steps}, 2.0**-order
    return None


def corrected(prediction: Prediction, proof: Proof) -> Prediction:
    """Return the prediction with the measured error and the measured seconds of a tuned run."""
    # An error in space that is larger than predicted holds for all meshes of that element.
    candidate = proof.candidate
    assert candidate is not None
    space = proof.parts["space"] / candidate.space
    in_time = proof.parts.get("time", candidate.time) / candidate.time

    def correction(mesh) -> np.ndarray | float:
        if mesh.choice.element != candidate.choice.element:
            return 1.0
        return space if mesh is candidate.mesh else np.maximum(space, 1.0)

    meshes = tuple(
        replace(mesh, errors=mesh.errors.scaled(correction(mesh))) for mesh in prediction.meshes
    )
    rules = tuple(
        replace(rule, errors=rule.errors.scaled(in_time)) if rule is candidate.rule else rule
        for rule in prediction.times.rules
    )
    ratio = float(np.clip(proof.trial.seconds / candidate.seconds, 1 / SLOWER, SLOWER))
    times = replace(prediction.times, rules=rules)
    prediction = prediction.with_seconds(candidate, ratio * candidate.seconds)
    return replace(prediction, meshes=meshes, times=times)


def cheaper(
    judge: Judge, prediction: Prediction, proof: Proof, runs: Sequence[Trial]
) -> tuple[Proof, Sequence[Trial]]:
    """Try cheaper settings beside the verifying run; return the cheapest proof, and all runs."""
    assert proof.finer is not None
    both = proof.parts["space"] + proof.parts.get("time", 0.0)
    left = np.maximum(both - judge.bench.distance(proof.finer, proof.trial), 0.0)
    judge = replace(judge, reference=proof.finer, left=left)
    tried = [proof]
    for _ in range(TRIES):
        candidates, prediction = next_candidates(judge.goal, prediction, proof, tried)
        if not candidates or candidates[0].seconds > CHEAPER * proof.trial.seconds:
            break
        if judge.bench.spent(others(runs, proof)) + candidates[0].seconds > judge.goal.limit(
            candidates
        ):
            break
        (trial,) = judge.bench.run([candidates[0].choice], timed=True)
        runs = [*runs, trial]
        if not trial.is_ok:
            prediction = prediction.without(candidates[0])
            continue
        tried.append(beside(judge, candidates[0], trial))
        if tried[-1].error <= judge.goal.tolerance and trial.seconds < proof.trial.seconds:
            proof = tried[-1]
    return proof, runs


def next_candidates(
    goal: Goal, prediction: Prediction, proof: Proof, tried: Sequence[Proof]
) -> tuple[list[Candidate], Prediction]:
    """Return the settings to try next, the best first, and the prediction as now corrected."""
    # After a setting whose error is too large, one halfway to it is tried, or another mesh or
    # method.
    latest = tried[-1]
    assert latest.candidate is not None
    prediction = corrected(prediction, latest)
    if latest.error > goal.tolerance:
        if halfway := untried(between(proof, latest), tried):
            return halfway, prediction
        prediction = prediction.without(latest.candidate)
    return untried(goal.candidates(prediction, CLOSE), tried), prediction


def between(proof: Proof, failed: Proof) -> list[Candidate]:
    """Return the setting halfway between two of the same mesh and method; none for others."""
    cheap, fine = failed.candidate, proof.candidate
    if cheap is None or fine is None or (cheap.key, cheap.linear) != (fine.key, fine.linear):
        return []
    sizes = ("edges", "x", "space", "time")
    middle = {name: np.sqrt(getattr(fine, name) * getattr(cheap, name)) for name in sizes}
    middle["x"] = math.ceil(middle["x"]) if fine.rule.kind == "steps" else float(middle["x"])
    seconds = math.sqrt(proof.trial.seconds * failed.trial.seconds)
    return [replace(fine, seconds=seconds, **middle)]
