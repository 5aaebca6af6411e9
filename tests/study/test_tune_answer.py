"""The answer of `tune` among its own runs, and the steps that all meshes share."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.power_laws import PowerLaws, known_run, predict, trial

from fecloth.errors import InputError
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.quantity import parse_quantity
from fecloth.study import run_problems, status
from fecloth.study.tuning import choices, time_errors
from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.prediction import Goal
from fecloth.study.tuning.proof import Proof, Yardstick, choose_run, choose_yardstick
from fecloth.study.tuning.result import summarise
from fecloth.study.tuning.shared_steps import blame_steps, shorten_steps
from fecloth.study.tuning.time_errors import TimeErrors, measure_methods

PREDICTION = predict(1.0, 10.0)
BEST = trial(Choice("P1", "", 0.01, "bdf2", 512), 1.0, seconds=50.0)
LEFT = 1e-3


def run_of(error, seconds, method="bdf2"):
    return trial(Choice("P1", "", round(0.1 + seconds / 1e3, 6), method, 64), 1 + error, seconds)


def answer_of(runs, goal, proof=None, why="", is_open=False):
    """The answer where a run that is repeated gives the same."""
    by_choice = {run.choice: run for run in runs}
    bench = PowerLaws(change=lambda made: by_choice[made.choice], done=list(runs))
    stick = Yardstick(BEST, np.array([LEFT]))
    return choose_run(bench, goal, PREDICTION, stick, proof, why, is_open)


def proof_of(run, error):
    return Proof(run, None, BEST, {"space": np.array([error])})


def test_the_cheapest_row_that_meets_the_tolerance_is_the_answer():
    rows = [run_of(2e-3, 6.8), run_of(4e-3, 1.9), run_of(5e-3, 1.7), run_of(2e-2, 0.1)]
    found = answer_of(rows, Goal(0.01), proof_of(rows[0], 3e-3))
    assert found.trial is rows[2]
    assert found.error == pytest.approx(5e-3 + LEFT)
    assert found.finer is BEST
    assert not found.why


@pytest.mark.parametrize(("part", "meets"), [(0.8, True), (1.25, False)])
def test_the_error_of_a_row_is_its_distance_and_what_is_left_in_the_best_run(part, meets):
    row = run_of(part * 0.01 - LEFT, 1.0)
    found = answer_of([row], Goal(0.01), why="it was not found")
    assert (found.why == "") == meets
    assert found.error == pytest.approx(part * 0.01)


def test_a_row_proves_where_no_setting_was_predicted_but_not_where_meshes_disagree():
    rows = [run_of(1e-3, 2.0), run_of(2e-3, 1.0)]
    assert answer_of(rows, Goal(0.01), why="none").trial is rows[1]
    assert answer_of(rows, Goal(0.01), why="they disagree", is_open=True).why == "they disagree"


@pytest.mark.parametrize(("part", "taken"), [(0.9 / 1.1, 1), (1.05 / 1.1, 0)])
def test_another_row_must_save_more_than_the_noise_of_seconds(part, taken):
    rows = [run_of(2e-3, 1.0), run_of(3e-3, part)]
    assert answer_of(rows, Goal(0.01), proof_of(rows[0], 3e-3)).trial is rows[taken]


@pytest.mark.parametrize(("times", "chosen"), [(1.2, 1), (1.875, 0)])
def test_of_runs_within_half_of_the_least_error_the_cheapest_can_be_had(times, chosen):
    rows = [run_of(1e-3, 1.0), run_of(2 * times * LEFT - LEFT, 0.1)]  # 2e-3 with what is left
    found = answer_of(rows, Goal(1e-6), why="it was not verified")
    assert found.trial is rows[chosen]
    assert found.why == "it was not verified"


def test_with_a_budget_the_most_accurate_row_within_it_is_the_answer():
    rows = [run_of(1e-3, 6.8), run_of(4e-3, 1.9), run_of(5e-3, 1.7)]
    assert answer_of(rows, Goal(budget=2.0)).trial is rows[1]


def test_a_budget_that_cannot_be_kept_is_said_and_the_fastest_run_offered():
    rows = [run_of(1e-3, 13.0), run_of(4e-3, 0.02)]
    goal = Goal(budget=1e-3)
    found = answer_of(rows, goal)
    assert found.trial is rows[1]
    row = {"element": "P1", "step": math.nan}
    found = replace(found, trial=replace(rows[1], row=rows[1].row | row), finer=None)
    opened = type("Opened", (), {"name": "strip"})()
    words = summarise(PowerLaws(opened), goal, found, 1.0, [], None).verdict
    assert words.startswith("not proved: a budget of 0.001 s cannot be kept")


def test_the_yardstick_is_the_run_of_which_less_is_left():
    proof = Proof(run_of(2e-3, 1.0), None, BEST, {"space": np.array([2.5e-3])})
    for left, taken in ((4e-4, False), (6e-4, True)):
        reference = run_of(0.0, 9.0)
        found = choose_yardstick(PowerLaws(), proof, reference, np.array([left]))
        assert (found.run is BEST) == taken
        assert found.left == pytest.approx([5e-4 if taken else left])


# --- runs that are no evidence --------------------------------------------------------------------


@pytest.mark.parametrize("kind", list(DoubtKind))
def test_a_run_with_a_doubt_that_spoils_it_is_no_evidence(kind):
    row = {"status": "ok", "cause": "", "doubts": [Doubt(kind, "any words").entry()]}
    judged = run_problems.judged(row)
    assert (judged["status"] == "ok") == (kind is not DoubtKind.MOTION)
    assert judged["cause"] == ("any words" if kind is DoubtKind.MOTION else "")


def test_runs_without_a_period_end_at_the_steps_of_the_problem(monkeypatch):
    monkeypatch.setattr(time_errors, "can_choose_steps", lambda opened: True)
    monkeypatch.setattr(time_errors, "first_steps", lambda opened: 16)
    monkeypatch.setattr(time_errors, "_own_steps", lambda opened, otherwise: 100)
    no_period = {"status": status.NO_VALUE, "cause": "tip.z has no period"}
    bench = PowerLaws(change=lambda run: trial(run.choice, **no_period))
    with pytest.raises(Exception, match="tip.z has no period"):
        measure_methods(bench, Choice("P1", "", 0.1), ["bdf2", "backward_euler"], 0.01, 1e9)
    assert [run.choice.steps for run in bench.ran] == [16, 32, 64, 128]


@pytest.mark.parametrize(
    ("size", "error", "is_zero"),
    [(8e-7, 0.0, True), (1.25e-6, 0.0, False), (8e-3, 1.1, True), (1.25e-2, 1.1, False)]
    + [(8e-3, 0.9, False)],
)
def test_a_component_that_is_zero_by_symmetry_is_refused(size, error, is_zero, monkeypatch):
    monkeypatch.setattr(choices, "size_of", lambda quantity, record: size)
    monkeypatch.setattr(choices, "size_of_vector", lambda quantity, run: 1.0)
    bench = PowerLaws(quantities=(parse_quantity("tip.y"),))
    if is_zero:
        with pytest.raises(
            InputError, match=r"tip\.y is .* where the whole vector is 1: it is zero"
        ):
            bench.check_sizes(BEST, np.array([error]))
    else:
        bench.check_sizes(BEST, np.array([error]))


def test_the_size_of_a_vector_is_the_length_that_its_probe_has_moved():
    point = type("Point", (), {"problem": type("P", (), {"probes": ("tip",)})()})()
    ends = {"tip.x": [1.0, 4.0], "tip.y": [0.0, 0.0], "tip.z": [0.0, -4.0]}
    run = replace(BEST, row=BEST.row | {"ends": ends, "point": point})
    assert choices.size_of_vector(parse_quantity("tip.y"), run) == pytest.approx(5.0)
    assert choices.size_of_vector(parse_quantity("area"), run) == 0.0


# --- the steps that all meshes share --------------------------------------------------------------


def laws(fine, tolerance=0.01, n=16):
    """Runs whose error in time is 1e-3 (16/n)² on h = 0.1, and `fine` (16/n)² on h = 0.05."""

    def change(run):
        size = 1e-3 if run.choice.h > 0.07 else fine
        return trial(run.choice, 1 + size * (16 / run.choice.steps) ** 2, 1e-3)

    bench = PowerLaws(change=change)
    exact = trial(Choice("P1", "", 0.1, "bdf2", 4096), 1.0)
    coarse = change(trial(Choice("P1", "", 0.1, "bdf2", n)))
    times = TimeErrors((), exact, np.zeros(1), ())
    return bench, times, coarse


@pytest.mark.parametrize(("fine", "steps"), [(0.8 * 2e-3, 16), (1.25 * 2e-3, 32), (0.7, 256)])
def test_steps_are_halved_until_they_serve_on_a_finer_mesh(fine, steps):
    """They may have twice the error in time of the coarse mesh, or a quarter of the tolerance."""
    bench, times, coarse = laws(fine)
    found = shorten_steps(bench, times, coarse, tolerance=0.004)
    assert found.choice.steps == steps
    assert Choice("P1", "", 0.05, "bdf2", steps) in {run.choice for run in bench.ran}


@pytest.mark.parametrize(("part", "blamed"), [(0.8, False), (1.25, True)])
def test_steps_are_blamed_where_half_of_dt_changes_the_finest_meshes(part, blamed):
    """By an error above half of the tolerance."""
    bench, _, _ = laws(part * 0.5 * 0.01)
    space = known_run(PREDICTION, 20.0, 1e-4, n=16)
    space = replace(space, reference=bench.run([Choice("P1", "", 0.05, "bdf2", 16)])[0])
    assert blame_steps(bench, replace(space, meshes=()), 0.01) == blamed


def test_the_seconds_of_a_search_have_its_set_up():
    run = trial(Choice("P1", "", 0.1), spent=5.0)
    bench = PowerLaws(done=[run])
    assert bench.spent() == pytest.approx(5.0, abs=1.0)
    late = replace(bench, begin=bench.begin - 8.0)
    assert late.spent() == pytest.approx(8.0, abs=1.0)
    assert late.spent(without=run) == pytest.approx(8.0, abs=1.0)
    in_processes = replace(late, runs=run_problems.Runs(jobs=2))
    assert in_processes.spent() == pytest.approx(13.0, abs=1.0)
    assert in_processes.spent(without=run) == pytest.approx(8.0, abs=1.0)
