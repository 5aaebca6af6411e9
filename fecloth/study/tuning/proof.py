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
# Cheaper settings that are tried at most after a proof, as long as the time of the search lasts.
CHEAPER_SETTINGS = 8
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


def yardstick_of_proof(bench: Bench, proof: Proof, error: np.ndarray) -> Yardstick:
    """Return the verifying run with what is left in it of an `error` of the tuned run."""
    assert proof.finer is not None
    left = np.maximum(error - bench.distance(proof.finer, proof.trial), 0.0)
    return Yardstick(proof.finer, left)


def prove(
    bench: Bench, prediction: Prediction, goal: Goal, other: Errors, space: SpaceErrors
) -> Proof | None:
    """Run the best candidate and a finer run, and return the error that their distance shows.

    If the error is too large, the prediction is corrected by it, and the candidate that is then
    the best is tried. After a proof, cheaper settings are tried, too.

    Return None if no candidate is predicted to meet the goal or runs to its end. The proof that
    is returned may miss the goal; if its error is not known, its `why` says so.

    `other` are the errors by all causes but space and time. The best run of the search serves as
    the finer run if it is finer and its own error is small.
    """
    best = Yardstick(space.reference, space.error + prediction.error_in_time(space.reference))
    is_best_accurate = best.left.max() <= COUNTING_SHARE * goal.scale
    attempts = list[Proof]()
    for _ in range(VERIFYING_RUNS):
        candidates = untried(goal.candidates(prediction), attempts)
        # the time of a verifying run does not count as time of the search
        is_late = attempts and bench.spent(attempts[-1].finer) > goal.limit(candidates)
        if not candidates or is_late:
            break
        candidate = candidates[0]
        (trial,) = bench.run([candidate.choice], timed=True)
        if not trial.is_ok:
            # a method is left out on all meshes; an equilibrium has one rule, so only its mesh
            has_method = candidate.rule.kind != "static"
            prediction = prediction.without(candidate, on_all_meshes=has_method)
            continue
        if is_best_accurate and best.run.edges >= FINER_MESH * trial.edges:
            proof = prove_beside(bench, best, candidate, trial, other)
        else:
            proof = verify(bench, candidate, trial, other)
        attempts.append(proof)
        if proof.why or proof.meets(goal):
            break
        prediction = corrected(prediction, proof)
    if not attempts:
        return None
    proof = choose_attempt(attempts, goal)
    if not proof.why and proof.meets(goal) and not goal.has_budget:
        proof = find_cheaper(bench, prediction, goal, proof)
    return proof


def untried(candidates: Sequence[Candidate], proofs: Iterable[Proof]) -> list[Candidate]:
    """Return the candidates whose settings were not run yet."""
    tried = {proof.candidate.choice for proof in proofs if proof.candidate}
    return [candidate for candidate in candidates if candidate.choice not in tried]


def choose_attempt(attempts: Sequence[Proof], goal: Goal) -> Proof:
    """Return the last attempt, or the one with the least error where the last is not enough."""
    if attempts[-1].error <= goal.tolerance:
        return attempts[-1]
    return min(attempts, key=lambda proof: proof.error)


def prove_beside(
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
    """Run a setting finer than the candidate's, and return the error of `trial` by its causes.

    `trial` is the run of the candidate. If the finer run fails, the parts are the predicted
    ones, and `why` of the proof has the cause.

    Let ε be the part of an error that is left in the finer run. The distance d of both runs is
    (1 − ε) of the error, so that the error is d (1 + ε/(1 − ε)). Its second term gets a factor
    of safety. The error is divided among the refined causes as it was predicted.
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
    largest_left = np.max(list(left.values()), axis=0)
    factor = 1 + SAFE * largest_left / (1 - largest_left)
    total = factor * bench.distance(finer, trial) + unsampled(bench, finer)
    predicted = sum((parts[name] for name in left), np.zeros(len(total)))
    parts |= {name: total * parts[name] / predicted for name in left}
    return Proof(trial, candidate, finer, parts)


def finer_choice(candidate: Candidate) -> tuple[Choice, dict[str, np.ndarray]]:
    """Return the choice of a verifying run, and the part of each refined error left in it.

    The parts are (q,) arrays by cause, "space" or "time", for the causes that are refined.

    Each cause is refined whose error counts beside the whole: rtol is divided by 4, dt and h of
    structured meshes by 2, and h of unstructured meshes by √2. If no cause that counts can be
    refined, the mesh is refined, or the steps if the mesh has no h.
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
    """Return the prediction, corrected by the measured error and seconds of a proof's candidate.

    The errors of its mesh and of its rule are scaled by measured over predicted error. A larger
    error in space than predicted also scales the other meshes of the same element; a smaller one
    does not.
    """
    candidate = proof.candidate
    assert candidate is not None
    ratio_in_space = proof.parts["space"] / candidate.space
    ratio_in_time = proof.parts.get("time", candidate.time) / candidate.time

    def correct_mesh(mesh: Mesh) -> Mesh:
        if mesh is candidate.mesh:
            return replace(mesh, errors=mesh.errors.scaled(ratio_in_space))
        if mesh.choice.element == candidate.choice.element:
            return replace(mesh, errors=mesh.errors.scaled(np.maximum(ratio_in_space, 1.0)))
        return mesh

    def correct_rule(rule: Rule) -> Rule:
        if rule is candidate.rule:
            return replace(rule, errors=rule.errors.scaled(ratio_in_time))
        return rule

    times = replace(prediction.times, rules=tuple(map(correct_rule, prediction.times.rules)))
    meshes = tuple(map(correct_mesh, prediction.meshes))
    prediction = prediction.with_seconds(candidate, proof.trial.seconds)
    return replace(prediction, meshes=meshes, times=times)


def find_cheaper(bench: Bench, prediction: Prediction, goal: Goal, proof: Proof) -> Proof:
    """Try settings cheaper than a proved one, and return the proof of the cheapest that serves.

    Each is compared with the verifying run of the first proof, so that it needs no finer run of
    its own. The search ends after `CHEAPER_SETTINGS` runs, when its time is over, or when no
    setting is predicted to be cheaper by more than the noise of measured seconds. If none
    serves, return `proof` itself.
    """
    # neither the mesh nor the steps change these parts
    other = {name: part for name, part in proof.parts.items() if name not in ("space", "time")}
    stick = yardstick_of_proof(bench, proof, proof.parts["space"] + proof.parts.get("time", 0.0))
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
        tried.append(prove_beside(bench, stick, candidate, trial, other))
        if tried[-1].error <= goal.tolerance and trial.seconds < proof.trial.seconds:
            proof = tried[-1]
    return proof


def next_candidates(
    goal: Goal, prediction: Prediction, proof: Proof, tried: Sequence[Proof]
) -> tuple[list[Candidate], Prediction]:
    """Return the settings to try next, the best first, and the corrected prediction.

    `proof` is the cheapest proof so far. The latest of the `tried` settings corrects the
    prediction. If its error was too large, the next setting lies halfway between it and the
    proof. If there is none, as with another mesh or method, its mesh and rule are left out.
    """
    latest = tried[-1]
    assert latest.candidate is not None
    prediction = corrected(prediction, latest)
    if latest.error > goal.tolerance:
        if halfway := untried(halfway_between(proof, latest), tried):
            return halfway, prediction
        prediction = prediction.without(latest.candidate)
    return untried(goal.candidates(prediction, PART_AFTER_MEASUREMENT), tried), prediction


def halfway_between(proof: Proof, failed: Proof) -> list[Candidate]:
    """Return the setting halfway between a proved one and one whose error is too large.

    "Halfway" is the geometric mean of each size and of what was predicted. The list is empty if
    the two differ in mesh or method, or were not predicted.
    """
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
        stick = yardstick_of_proof(bench, proof, sum(proof.parts.values(), np.zeros(len(left))))
        if stick.left.max() <= left.max():
            return stick
    return Yardstick(reference, left)


def choose_run(
    bench: Bench,
    goal: Goal,
    prediction: Prediction,
    yardstick: Yardstick,
    proof: Proof | None,
    why: str,
    is_open: bool = False,
) -> Proof:
    """Return the best run that provably meets the goal, with its error.

    With a tolerance this is the cheapest run within it, with a budget the most accurate one.
    All runs of the search take part, beside the one of `proof`. Their errors are their distances
    to the run of the `yardstick`, plus its own error.

    If no run provably meets the goal, return the best run there is, with `why` as the reason
    that nothing is proved. With a tolerance this is the cheapest of the most accurate runs, with
    a budget the fastest run. It is also returned where `is_open`: finer meshes do not come
    closer to each other, so that no distance proves an error.
    """
    verifying_run = proof.finer if proof else None
    runs_of_problem = bench.other_than(verifying_run)[bench.changed :]  # earlier: other terms
    # A run with a sharper solver only shows the error of the solver; it is no setting to offer.
    runs = [
        run
        for run in each_once(runs_of_problem)
        if run.is_ok and run.records and not run.choice.sharper
    ]
    errors = {run.choice: float(yardstick.error(bench, run).max()) for run in runs}
    if not is_open:
        proved = proof
        if proof is not None and (proof.why or not proof.meets(goal)):
            proved = None
        better = _find_better(bench, goal, runs, errors, proved)
        if better:
            return _proof_by_yardstick(bench, prediction, yardstick, better)
        if proved:
            return proved
    candidates = runs
    if not goal.has_budget:
        largest_error = NEARLY_LEAST_ERROR * min(errors.values())
        candidates = [run for run in runs if errors[run.choice] <= largest_error]
    fastest = min(candidates, key=lambda run: run.seconds)
    return replace(_proof_by_yardstick(bench, prediction, yardstick, fastest), why=why)


def _find_better(
    bench: Bench,
    goal: Goal,
    runs: Sequence[Trial],
    errors: Mapping[Choice, float],
    proved: Proof | None,
) -> Trial | None:
    """Return the best run that meets the goal and is better than the proved one; None if none.

    "Better" is cheaper, or with a budget more accurate. `errors` are the errors of the runs by
    their choices. Seconds of the search are rough: the best runs are repeated with careful
    timing, and the first that is still good enough is returned.
    """

    def value_to_minimise(run: Trial) -> float:
        return errors[run.choice] if goal.has_budget else run.seconds

    limit = math.inf
    if proved and goal.has_budget:
        limit = proved.error
    elif proved:
        limit = proved.trial.seconds / NOISE_OF_SECONDS
    better_runs = [
        run
        for run in runs
        if errors[run.choice] <= goal.tolerance
        and run.seconds <= goal.budget
        and value_to_minimise(run) < limit
    ]
    for run in sorted(better_runs, key=value_to_minimise)[:BEST_CANDIDATES]:
        # repeated on a bench of its own: `bench.done` has the run already
        (timed,) = replace(bench, done=[]).run([run.choice], timed=True)
        is_slower = proved and not goal.has_budget and timed.seconds > proved.trial.seconds
        if timed.is_ok and timed.seconds <= goal.budget and not is_slower:
            return timed
    return None


def _proof_by_yardstick(
    bench: Bench, prediction: Prediction, stick: Yardstick, run: Trial
) -> Proof:
    """Return a run with its error by a yardstick, divided into space and predicted time."""
    total = stick.error(bench, run)
    parts = {"space": total}
    if run.choice.method:
        in_time = np.minimum(prediction.error_in_time(run), total)
        parts = {"space": total - in_time, "time": in_time}
    finer = stick.run if stick.run.choice != run.choice else None
    return Proof(run, None, finer, parts)
