"""The tuned run beside a finer one: its error, and cheaper or finer settings if it is far off."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.study.tuning.choices import Bench, Choice, Trial, each_once
from fecloth.study.tuning.prediction import Candidate, Goal, Prediction
from fecloth.study.tuning.search import KNOWN
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors, unsampled
from fecloth.study.uncertainty import SAFE

FINER = 1.4  # times the √triangles of a tuned run: the verifying run has at least so many
COUNTS = 0.25  # part of the error from which a cause is refined in the verifying run
ROUNDS = 3  # verifying runs at most
TRIES, CLOSE = 8, 0.9  # of cheaper settings; part of the tolerance that their errors may take
CHEAPER = 0.85  # times the seconds: what a cheaper setting should at most cost
SLOWER = 5.0  # measured over predicted seconds, that a prediction is corrected by at most
NEARLY = 1.5  # times the least error: runs that are as accurate
FASTER = 0.9  # times the seconds of the proved setting: what another run must at most take
TIMED = 3  # runs, of the cheapest, whose seconds are measured with care
Errors = Mapping[str, np.ndarray]  # (q,) errors by their causes


@dataclass(frozen=True, eq=False)
class Proof:
    """A tuned run, its predicted candidate, its error by causes, and the verifying run."""

    trial: Trial
    candidate: Candidate | None  # None if the run was not predicted
    finer: Trial | None  # the verifying run; None if it failed
    parts: Errors
    why: str = ""  # why the error is not known; "" if it is

    @property
    def error(self) -> float:
        return float(sum(self.parts.values(), np.zeros(1)).max())

    def meets(self, goal: Goal) -> bool:
        return self.error <= goal.tolerance and self.trial.seconds <= goal.budget


@dataclass(frozen=True, eq=False)
class Yardstick:
    """A run, and what is left of its own error, (q,)."""

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
    stick = Yardstick(space.reference, space.error + prediction.error_in_time(space.reference))
    is_known = stick.left.max() <= KNOWN * goal.scale
    attempts = list[Proof]()
    for _ in range(ROUNDS):
        candidates = untried(goal.candidates(prediction), attempts)
        is_late = attempts and bench.spent(attempts[-1].finer) > goal.limit(candidates)
        if not candidates or is_late:
            break
        (trial,) = bench.run([candidates[0].choice], timed=True)
        if not trial.is_ok:
            is_method = candidates[0].rule.kind != "static"
            prediction = prediction.without(candidates[0], on_all_meshes=is_method)
            continue
        if is_known and stick.run.edges >= FINER * trial.edges:
            proof = beside(bench, stick, candidates[0], trial, other)
        else:
            proof = verify(bench, candidates[0], trial, other)
        attempts.append(proof)
        if proof.why or proof.meets(goal):
            break
        prediction = corrected(prediction, proof)
    if not attempts:
        return None
    proof = stated(attempts, goal)
    if not proof.why and proof.meets(goal) and goal.tolerance < math.inf:
        proof = cheaper(bench, prediction, goal, proof)
    return proof


def untried(candidates: Sequence[Candidate], proofs: Iterable[Proof]) -> list[Candidate]:
    """Return the candidates whose settings were not run yet."""
    tried = {proof.candidate.choice for proof in proofs if proof.candidate}
    return [candidate for candidate in candidates if candidate.choice not in tried]


def stated(attempts: Sequence[Proof], goal: Goal) -> Proof:
    """Return the last attempt, or the one with the least error where the last is not enough."""
    is_enough = attempts[-1].error <= goal.tolerance
    if is_enough:
        return attempts[-1]
    return min(attempts, key=lambda proof: proof.error)


def beside(
    bench: Bench, stick: Yardstick, candidate: Candidate, trial: Trial, other: Errors
) -> Proof:
    """Return the error of a run beside a yardstick, divided as its parts were predicted."""
    total = stick.error(bench, trial)
    parts = {"space": total}
    if candidate.rule.kind != "static":
        both = candidate.space + candidate.time
        parts = {"space": total * candidate.space / both, "time": total * candidate.time / both}
    return Proof(trial, candidate, stick.run, parts | dict(other))


def verify(bench: Bench, candidate: Candidate, trial: Trial, other: Errors) -> Proof:
    """Run a finer setting and return the error of the run by its causes.

    With the part ε of an error that is left in the finer run, the distance d of both is (1 −
    ε) of the error: this is d (1 + ε/(1 − ε)), where the second term has a factor of safety.
    """
    choice, left = finer_choice(candidate)
    (finer,) = bench.run([choice])
    if candidate.rule.kind == "static":
        in_time = {}
    else:
        in_time = {"time": candidate.time}
    parts = {"space": candidate.space, **in_time, **other}
    if not finer.is_ok:
        cause = str(finer.row["cause"]).splitlines()[0]
        why = f"the verifying run ({choice}) failed: {cause}"
        return Proof(trial, candidate, None, parts, why)
    part = np.max(list(left.values()), axis=0)
    total = bench.distance(finer, trial) * (1 + SAFE * part / (1 - part)) + unsampled(bench, finer)
    predicted = sum((parts[name] for name in left), np.zeros(len(total)))
    parts |= {name: total * parts[name] / predicted for name in left}
    return Proof(trial, candidate, finer, parts)


def finer_choice(candidate: Candidate) -> tuple[Choice, dict[str, np.ndarray]]:
    """Return the choice of a verifying run, and the part of each refined error left in it."""
    # It refines each cause that counts; if none of these can be refined, the mesh, or the steps.
    least = COUNTS * max(candidate.error, 1e-300)
    choice = candidate.choice
    order = candidate.rule.errors.order
    left = dict[str, np.ndarray]()
    in_time = candidate.time.max() >= least
    if in_time and choice.rtol:
        choice = replace(choice, rtol=choice.rtol / 4)
        left["time"] = 4.0**-order
    elif in_time and choice.steps:
        choice = choice.with_half_of_dt()
        left["time"] = 2.0**-order
    if choice.h and (candidate.space.max() >= least or not left):
        if choice.pattern not in ("", "unstructured"):
            ratio = 2.0
        else:
            ratio = math.sqrt(2)
        choice = replace(choice, h=choice.h / ratio)
        left["space"] = ratio**-candidate.mesh.errors.order
    if not left:
        return choice.with_half_of_dt(), {"time": 0.5 * np.ones(len(candidate.time))}
    return choice, left


def corrected(prediction: Prediction, proof: Proof) -> Prediction:
    """Return the prediction with the measured error and the measured seconds of a tuned run."""
    # An error in space that is larger than predicted holds for all meshes of that element.
    candidate = proof.candidate
    assert candidate is not None
    space = proof.parts["space"] / candidate.space
    in_time = proof.parts.get("time", candidate.time) / candidate.time

    def correct(mesh: Mesh) -> Mesh:
        if mesh.choice.element != candidate.choice.element:
            return mesh
        factor = space if mesh is candidate.mesh else np.maximum(space, 1.0)
        return replace(mesh, errors=mesh.errors.scaled(factor))

    changed = replace(candidate.rule, errors=candidate.rule.errors.scaled(in_time))
    rules = tuple(changed if it is candidate.rule else it for it in prediction.times.rules)
    ratio = float(np.clip(proof.trial.seconds / candidate.seconds, 1 / SLOWER, SLOWER))
    prediction = prediction.with_seconds(candidate, ratio * candidate.seconds)
    meshes = tuple(map(correct, prediction.meshes))
    times = replace(prediction.times, rules=rules)
    return replace(prediction, meshes=meshes, times=times)


def cheaper(bench: Bench, prediction: Prediction, goal: Goal, proof: Proof) -> Proof:
    """Try cheaper settings beside the verifying run, and return the cheapest proof."""
    other = {name: part for name, part in proof.parts.items() if name not in ("space", "time")}
    stick = verifying(bench, proof, proof.parts["space"] + proof.parts.get("time", 0.0))
    tried = [proof]
    for _ in range(TRIES):
        candidates, prediction = next_candidates(goal, prediction, proof, tried)
        if not candidates or candidates[0].seconds > CHEAPER * proof.trial.seconds:
            break
        spent = bench.spent(proof.finer) + candidates[0].seconds
        if spent > goal.limit(candidates):
            break
        (trial,) = bench.run([candidates[0].choice], timed=True)
        if not trial.is_ok:
            prediction = prediction.without(candidates[0])
            continue
        tried.append(beside(bench, stick, candidates[0], trial, other))
        if tried[-1].error <= goal.tolerance and trial.seconds < proof.trial.seconds:
            proof = tried[-1]
    return proof


def next_candidates(
    goal: Goal, prediction: Prediction, proof: Proof, tried: Sequence[Proof]
) -> tuple[list[Candidate], Prediction]:
    """Return the settings to try next, the best first, and the prediction as now corrected."""
    # After an error that is too large a setting halfway is tried, or another mesh or method.
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
    cheap = failed.candidate
    fine = proof.candidate
    if cheap is None or fine is None or cheap.key != fine.key:
        return []
    sizes = ("edges", "x", "space", "time")
    middle = {name: np.sqrt(getattr(fine, name) * getattr(cheap, name)) for name in sizes}
    if fine.rule.kind == "steps":
        middle["x"] = math.ceil(middle["x"])
    else:
        middle["x"] = float(middle["x"])
    seconds = math.sqrt(proof.trial.seconds * failed.trial.seconds)
    return [replace(fine, seconds=seconds, **middle)]


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
    rows = [run for run in own if run.is_ok and run.records and not run.choice.sharper]
    errors = {run.choice: float(yardstick.error(bench, run).max()) for run in rows}
    if proof is not None and not proof.why and proof.meets(goal):
        proved = proof
    else:
        proved = None

    def place(run: Trial) -> float:
        if goal.has_budget:
            return errors[run.choice]
        return run.seconds

    most = math.inf
    if proved:
        if goal.has_budget:
            most = proved.error
        else:
            most = FASTER * proved.trial.seconds
    able = [run for run in rows if errors[run.choice] <= goal.tolerance]
    able = [run for run in able if run.seconds <= goal.budget and place(run) < most]
    for run in [] if is_open else sorted(able, key=place)[:TIMED]:
        (timed,) = replace(bench, done=[]).run([run.choice], timed=True)
        slow = proved and not goal.has_budget and timed.seconds > proved.trial.seconds
        if timed.is_ok and timed.seconds <= goal.budget and not slow:
            return _measured(prediction, yardstick, bench, timed)
    if proved and not is_open:
        return proved
    least = math.inf if goal.has_budget else NEARLY * min(errors.values())
    accurate = [run for run in rows if errors[run.choice] <= least]
    fastest = min(accurate, key=lambda run: run.seconds)
    return replace(_measured(prediction, yardstick, bench, fastest), why=why)


def _measured(prediction: Prediction, stick: Yardstick, bench: Bench, run: Trial) -> Proof:
    """Return a run with its error, divided in space and time as the time was predicted."""
    total = stick.error(bench, run)
    parts = {"space": total}
    if run.choice.method:
        in_time = np.minimum(prediction.error_in_time(run), total)
        parts = {"space": total - in_time, "time": in_time}
    return Proof(run, None, stick.run if stick.run.choice != run.choice else None, parts)
