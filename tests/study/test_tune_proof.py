"""The proof of a tuned setting, on power laws with plain numbers in place of runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.power_laws import Listed, PowerLaws, candidate, known_run, listed, predict, trial

from fecloth.study.problems import FunctionProblem
from fecloth.study.tuning import proof as proof_module
from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.curves import Curve
from fecloth.study.tuning.prediction import Goal
from fecloth.study.tuning.proof import (
    Proof,
    choose_attempt,
    corrected,
    finer_choice,
    halfway_between,
    prove,
    untried,
    verify,
)
from fecloth.study.tuning.search import _first_meshes, _refine_once


def true_error(run):
    return run.row["value"] - 1.0


def runs_of(bench):
    return [(round(1 / one.choice.h), one.choice.steps) for one in bench.ran]


@pytest.mark.parametrize("pattern", ["", "unstructured", "right"])
@pytest.mark.parametrize(("space", "in_time"), [(1.0, 10.0), (5.0, 1.0), (0.5, 100.0), (1.0, 0.0)])
def test_the_stated_error_is_the_true_one_of_a_power_law_and_a_little_more(space, in_time, pattern):
    """A finer run tells (1 − part) of an error; the grid convergence index adds the rest."""
    prediction, tolerance = predict(space, in_time or 1e-9, pattern), 1e-3
    bench = PowerLaws(space=space, in_time=in_time)
    first = Goal(tolerance).candidates(prediction)[0]
    (run,) = bench.run([first.choice])
    proof = verify(bench, first, run, {})
    assert true_error(run) <= 1.001 * proof.error < 1.4 * true_error(run)


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_the_stated_error_is_the_true_one_of_a_power_of_rtol_and_a_little_more(order):
    """A run with rtol/4 has 4^−p of the error."""
    rtol, in_time, space = 0.01, 1e-3, 1e-7

    def add_error_in_time(run):
        return trial(run.choice, run.row["value"] + in_time * (run.choice.rtol / rtol) ** order)

    by_rtol = candidate(predict(1.0, 10.0), space**-0.5, 1 / rtol, space, in_time)
    errors = Curve(np.array([1 / rtol]), np.array([[in_time]]), -order, -order, np.array([order]))
    by_rtol = replace(by_rtol, rule=replace(by_rtol.rule, kind="rtol", errors=errors))
    bench = PowerLaws(change=add_error_in_time)
    (run,) = bench.run([by_rtol.choice])
    stated = verify(bench, by_rtol, run, {}).error
    assert true_error(run) == pytest.approx(in_time, rel=1e-3)
    assert true_error(run) <= 1.001 * stated < 1.15 * true_error(run)


@pytest.mark.parametrize(("space", "in_time"), [(1.0, 10.0), (5.0, 1.0), (0.5, 100.0)])
@pytest.mark.parametrize("wrong", [1.0, 4.0, 0.25])
def test_a_proved_error_is_the_true_one_also_after_a_wrong_prediction(space, in_time, wrong):
    bench, tolerance = PowerLaws(space=wrong * space, in_time=wrong * in_time), 1e-3
    prediction = predict(space, in_time)
    proof = prove(bench, prediction, Goal(tolerance), {}, known_run(prediction, 10.0, 1.0))
    assert not proof.why
    assert proof.error <= tolerance
    assert true_error(proof.trial) <= 1.001 * proof.error


def test_what_a_node_may_miss_of_the_lowest_point_is_added(monkeypatch):
    monkeypatch.setattr(proof_module, "unsampled", lambda bench, run: np.array([3e-4]))
    bench, prediction = PowerLaws(), predict(1.0, 10.0)
    first = Goal(1e-3).candidates(prediction)[0]
    (run,) = bench.run([first.choice])
    with_it = verify(bench, first, run, {}).error
    monkeypatch.undo()
    assert with_it == pytest.approx(verify(bench, first, run, {}).error + 3e-4, rel=1e-12)


@pytest.mark.parametrize(("wrong", "others"), [(4.0, 4.0), (0.25, 1.0)])
def test_an_error_in_space_above_the_prediction_holds_for_all_meshes_of_the_element(wrong, others):
    prediction = predict(1.0, 10.0)
    (mesh,) = prediction.meshes
    cross = replace(mesh, choice=replace(mesh.choice, pattern="cross"))
    second = replace(mesh, choice=replace(mesh.choice, element="P2"))
    prediction = replace(prediction, meshes=(mesh, cross, second))
    of = candidate(prediction, 20.0, 64, 1e-3, 1e-3)
    parts = {"space": wrong * of.space, "time": of.time}
    proof = Proof(trial(of.choice, seconds=3 * of.seconds), of, None, parts)
    after = corrected(prediction, proof)
    at = np.array([20.0])
    ratios = [float((m.errors(at) / mesh.errors(at))[0, 0]) for m in after.meshes]
    assert ratios == pytest.approx([wrong, others, 1.0])
    assert after.factors[of.key] == pytest.approx(3.0)


def test_halfway_between_two_settings_is_their_geometric_mean():
    prediction = predict(1.0, 10.0)
    one = candidate(prediction, 40.0, 400, 1e-3, 4e-3)
    other = candidate(prediction, 10.0, 100, 4e-3, 1e-3)
    proofs = [Proof(trial(of.choice, seconds=of.seconds), of, None, {}) for of in (one, other)]
    (middle,) = halfway_between(*proofs)
    assert (middle.edges, middle.x) == (pytest.approx(20.0), 200)
    assert (middle.space, middle.time) == (pytest.approx([2e-3]), pytest.approx([2e-3]))
    assert middle.seconds == pytest.approx(math.sqrt(one.seconds * other.seconds))


def test_the_error_of_a_cheaper_setting_has_the_error_of_the_verifying_run():
    """Stated 0.5 of the first: half of its error 4/9 to the verifying run, which has the rest."""
    _, proof = tried_after(0.5, {"b": (0.6, 2.0)})
    own = 0.5 - 0.5 * 0.5 / 1.125
    assert proof.trial.choice.method == "b"
    assert proof.error == pytest.approx(0.6 - 0.5 * 0.5 / 1.125 + own)


def test_the_errors_of_other_causes_are_added():
    bench, prediction = PowerLaws(), predict(1.0, 10.0)
    first = Goal(1e-3).candidates(prediction)[0]
    (run,) = bench.run([first.choice])
    alone = verify(bench, first, run, {})
    with_solver = verify(bench, first, run, {"solver": np.array([2e-4])})
    assert with_solver.error == pytest.approx(alone.error + 2e-4, rel=1e-12)


@pytest.mark.parametrize(("part", "refined"), [(0.2, False), (0.3125, True)])
def test_a_cause_of_a_quarter_of_the_error_is_refined_in_the_verifying_run(part, refined):
    prediction, error = predict(1.0, 10.0), 1e-3
    for swapped in (False, True):
        errors = ((1 - part) * error, part * error)
        of = candidate(prediction, 20.0, 64, *(errors[::-1] if swapped else errors))
        bench = PowerLaws()
        verify(bench, of, trial(of.choice, 1 + error), {})
        finer = 1 / bench.ran[-1].choice.h > 21, bench.ran[-1].choice.steps > 65
        assert finer == ((refined, True) if swapped else (True, refined))


@pytest.mark.parametrize(
    ("ratio", "left", "serves"),
    [
        (1.41 * 1.25, 0.25 * 0.9, True),
        (1.41 * 1.25, 0.25 * 1.25, False),
        (1.41 * 0.8, 0.25 * 0.8, False),
    ],
)
def test_the_best_run_of_the_search_proves_if_it_is_finer_and_accurate(ratio, left, serves):
    """√2 times the √triangles, and a quarter of the tolerance for its own error."""
    prediction, tolerance = predict(1.0, 1e-9), 1e-3
    first = Goal(tolerance).candidates(prediction)[0]
    space = known_run(prediction, ratio * first.edges, left * tolerance)
    bench = PowerLaws(space=1.0, in_time=0.0)
    proof = prove(bench, prediction, Goal(tolerance), {}, space)
    assert (proof.finer is space.reference) == serves
    if serves:
        own = left * tolerance + true_error(bench.ran[0]) - true_error(space.reference)
        assert true_error(proof.trial) <= proof.error
        assert bench.distance(space.reference, bench.ran[0])[0] + left * tolerance == pytest.approx(
            own, rel=1e-2
        )


def test_three_rounds_of_verifying_runs_are_tried():
    """Of a problem whose error falls with no refinement; the best run is stated."""
    values = iter(1 + 1e-3 * np.array([2.0, 1.0, 1.6, 1.0, 2.2, 1.0, 2.0, 1.0, 3.0, 1.0]))

    def change(run):
        return trial(run.choice, next(values))

    bench, prediction = PowerLaws(change=change), predict(1.0, 10.0)
    proof = prove(bench, prediction, Goal(1e-3), {}, known_run(prediction, 10.0, 1.0))
    assert len(bench.ran) == 2 * 3
    assert proof.error > 1e-3
    assert proof.trial is bench.ran[2]
    assert set(map(id, bench.ran)) - {id(proof.trial)} <= set(
        map(id, [*bench.other_than(proof.finer), proof.finer])
    )


def tried_after(true, others, seconds=5.0):
    """The settings tried after one that takes longer than predicted, with the proof of all.

    `true` is its stated error, and `others` have the predicted errors and seconds.
    """
    settings = {"a": (0.5, 1.0)} | others
    bench = Listed(settings | {"a": (true / 1.125, seconds)})  # the index adds an eighth
    prediction = listed(settings)
    proof = prove(bench, prediction, Goal(1.0), {}, known_run(prediction, 1.0, 9.0))
    assert [trial.choice.method for trial in bench.ran[:2]] == ["a", "a"]
    return [trial.choice.method for trial in bench.ran[2:]], proof


@pytest.mark.parametrize("stated", [0.5, 0.98])
def test_a_cheaper_setting_is_tried_after_each_that_meets_the_tolerance(stated):
    ran, proof = tried_after(stated, {"b": (0.2, 2.0)})
    assert ran == ["b"]
    assert proof.trial.choice.method == "b"
    assert proof.error <= 1.0


def test_a_cheaper_setting_that_fails_does_not_end_the_search():
    class Failing(Listed):
        def run(self, choices, timed=False):
            (made,) = super().run(choices, timed)
            failed = {"status": "failed"} if made.choice.method == "b" else {}
            return [replace(made, row=made.row | failed)]

    settings = {"a": (0.5, 1.0), "b": (0.2, 1.5), "c": (0.2, 2.0)}
    bench = Failing(settings | {"a": (0.4, 5.0)})
    prediction = listed(settings)
    proof = prove(bench, prediction, Goal(1.0), {}, known_run(prediction, 1.0, 9.0))
    assert [trial.choice.method for trial in bench.ran] == ["a", "a", "b", "c"]
    assert proof.trial.choice.method == "c"


def test_a_setting_that_is_not_tried_again_leaves_its_method_on_other_meshes():
    prediction = predict(1.0, 10.0)
    (mesh,) = prediction.meshes
    cross = replace(mesh, choice=replace(mesh.choice, pattern="cross"))
    prediction = replace(prediction, meshes=(mesh, cross))
    first = candidate(prediction, 20.0, 64, 1e-3, 1e-3)
    left = {pair[0].choice.pattern for pair in prediction.without(first).pairs()}
    assert left == {cross.choice.pattern}
    assert prediction.without(first, on_all_meshes=True).pairs() == []


@pytest.mark.parametrize(("part", "is_timed"), [(0.8, True), (1.25, False)])
def test_the_seconds_of_meshes_below_a_fifth_of_a_second_are_measured_with_care(part, is_timed):
    asked = []

    class Recorder(PowerLaws):
        def run(self, choices, timed=False):
            asked.append(timed)
            return super().run(choices, timed)

    coarse = trial(Choice("P1", "right", 0.1, "bdf2", 64), seconds=part * 0.2)
    meshes = [coarse.choice, replace(coarse.choice, pattern="cross")]
    bench = Recorder(opened=FunctionProblem.__new__(FunctionProblem))
    _first_meshes(bench, meshes, coarse)
    _refine_once(bench, coarse, [coarse])
    assert [asked[0], asked[-1]] == [is_timed, is_timed]


@pytest.mark.parametrize(("share", "tries"), [(0.9 / 1.1, ["b"]), (1.05 / 1.1, [])])
def test_a_cheaper_setting_must_save_more_than_the_noise_of_seconds(share, tries):
    assert tried_after(0.5, {"b": (0.2, 2.0)}, seconds=2.0 / share)[0] == tries


@pytest.mark.parametrize(("error", "tries"), [(0.9 * 0.8, ["b"]), (0.9 * 1.15, [])])
def test_a_cheaper_setting_may_take_09_of_the_tolerance(error, tries):
    assert tried_after(0.5, {"b": (error, 2.0)})[0] == tries


def test_eight_cheaper_settings_are_tried():
    """Whose errors are larger than predicted, so that all fail; the first one stays."""
    others = {name: (0.6, 2.0 + 0.2 * i) for i, name in enumerate("bcdefghijk")}
    settings = {"a": (0.5, 1.0)} | others
    bench = Listed({name: (3.0, s) for name, (_, s) in settings.items()} | {"a": (0.4, 5.0)})
    prediction = listed(settings)
    proof = prove(bench, prediction, Goal(1.0), {}, known_run(prediction, 1.0, 9.0))
    assert [trial.choice.method for trial in bench.ran] == ["a", "a", *"bcdefghi"]
    assert proof.trial is bench.ran[0]


@pytest.mark.parametrize("seconds", [6.0, 100.0])
def test_no_setting_is_run_twice(seconds):
    """Both take so much longer than predicted that they still look cheaper afterwards."""
    bench = Listed({"a": (0.4, 50.0), "b": (0.2, seconds)})
    prediction = listed({"a": (0.5, 0.4), "b": (0.2, 0.5)})
    proof = prove(bench, prediction, Goal(1.0), {}, known_run(prediction, 1.0, 9.0))
    assert [trial.choice.method for trial in bench.ran] == ["a", "a", "b"]
    assert proof.trial.choice.method == ("b" if seconds < 50.0 else "a")


def test_a_setting_halfway_to_a_tried_one_that_is_one_of_both_is_not_run():
    """With 100 and 99 steps on one mesh the setting halfway has 100 again."""
    prediction = predict(1.0, 10.0)
    fine, coarse = (candidate(prediction, 40.0, n, 1e-3, 1e-3) for n in (100, 99))
    proofs = [Proof(trial(of.choice), of, None, {}) for of in (fine, coarse)]
    (middle,) = halfway_between(*proofs)
    assert middle.choice == fine.choice
    assert untried([middle], proofs) == []
    assert untried([middle], proofs[1:]) == [middle]


@pytest.mark.parametrize(
    ("errors", "taken"), [((3.0, 2.0, 0.9), 2), ((3.0, 1.1, 1.2), 1), ((1.2, 1.1), 1)]
)
def test_the_last_attempt_is_stated_or_the_most_accurate_where_it_misses_the_tolerance(
    errors, taken
):
    attempts = [Proof(None, None, None, {"space": np.array([e])}) for e in errors]
    assert choose_attempt(attempts, Goal(1.0)) is attempts[taken]


@pytest.mark.parametrize(("goal", "met"), [(Goal(1.0), (True, False)), (Goal(budget=2.0), (1, 0))])
def test_a_proof_meets_a_tolerance_by_its_error_and_a_budget_by_its_seconds(goal, met):
    run = trial(Choice(h=0.1), seconds=2.0)
    for part, is_met in zip((0.8, 1.25), met, strict=True):
        of_error = Proof(run, None, None, {"space": np.array([part])})
        of_seconds = Proof(trial(run.choice, seconds=2.0 * part), None, None, {})
        proof = of_error if math.isfinite(goal.tolerance) else of_seconds
        assert proof.meets(goal) == bool(is_met)


@pytest.mark.parametrize(
    ("method", "kind", "x", "h", "refined"),
    [
        ("bdf2", "steps", 64, 0.05, {"space", "time"}),
        ("bdf2", "rtol", 100.0, 0.05, {"space", "time"}),
        ("central_difference", "limit", 1.0, 0.05, {"space"}),
        ("central_difference", "limit", 1.0, None, {"time"}),
        ("bdf2", "steps", 64, None, {"time"}),
    ],
)
def test_a_verifying_run_refines_what_can_be_refined(method, kind, x, h, refined):
    """Errors in space and time are equal; explicit steps at their limit follow the mesh."""
    prediction = predict(1.0, 10.0)
    of = candidate(prediction, 20.0, x, 1e-3, 1e-3, seconds=1.0)
    mesh = replace(of.mesh, choice=replace(of.mesh.choice, h=h))
    of = replace(of, mesh=mesh, rule=replace(of.rule, method=method, kind=kind))
    choice, left = finer_choice(of)
    assert set(left) == refined
    assert ((choice.h or 0) < (of.choice.h or 0)) == ("space" in refined)
    if kind == "rtol":
        assert choice.rtol == pytest.approx(of.choice.rtol / 4)
    elif "time" in refined:
        assert choice.steps == 2 * (of.choice.steps or 1)


@pytest.mark.parametrize("ratio", [4.0, 25.0, 0.1])
def test_predicted_seconds_are_corrected_by_the_measured_ones(ratio):
    prediction = predict(1.0, 10.0)
    of = candidate(prediction, 20.0, 64, 1e-3, 1e-3)
    proof = Proof(trial(of.choice, seconds=ratio * of.seconds), of, None, {"space": of.space})
    assert corrected(prediction, proof).factors[of.key] == pytest.approx(ratio)
