"""The numbers of `tune` from both sides: at about 0.8 and 1.25 times their value."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.power_laws import PowerLaws, candidate, known_run, listed, predict, trial

import fecloth as fc
from fecloth.errors import FeclothError
from fecloth.study.problems import SceneProblem, open_problem
from fecloth.study.tuning import corrections, search, time_errors
from fecloth.study.tuning import tune as tune_module
from fecloth.study.tuning.choices import Choice, meshes_to_try, problem_with
from fecloth.study.tuning.corrections import measure_growth
from fecloth.study.tuning.curves import error_curve
from fecloth.study.tuning.prediction import Goal
from fecloth.study.tuning.shared_steps import prefer, shared_run
from fecloth.study.tuning.space_errors import (
    Mesh,
    SpaceErrors,
    drop_to_neighbours,
    summarise_meshes,
)
from fecloth.study.tuning.time_errors import TimeErrors, measure_methods

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.1, pattern = "PATTERN" }
fabric = { areal_density = 0.2, tensile_stiffness = 40.0, poisson_ratio = 0.3 }
equilibrium = {}
[[terms]]
type = "StVK"
[[pins]]
where = "top"
"""


@pytest.mark.parametrize("pattern", ["right", "cross", "equilateral", "unstructured"])
def test_meshes_of_all_patterns_begin_with_as_many_triangles(pattern, tmp_path):
    path = tmp_path / "sheet.toml"
    path.write_text(SCENE.replace("PATTERN", pattern))
    opened = open_problem(path)
    assert isinstance(opened, SceneProblem)
    choices = meshes_to_try(opened, ["P1"])
    assert {one.pattern for one in choices} == {"right", "cross", "equilateral", "unstructured"}
    counts = [len(problem_with(opened, one).first.cloth.triangles) for one in choices]
    assert max(counts) < 1.25 * min(counts)


@pytest.mark.parametrize(("part", "serves"), [(0.75 * 0.8, True), (0.75 * 1.25, False)])
def test_predicted_errors_may_take_three_quarters_of_the_tolerance(part, serves):
    found = Goal(tolerance=0.01).candidates(listed({"a": (0.01 * part, 1.0)}))
    assert bool(found) == serves


@pytest.mark.parametrize(("part", "serves"), [(0.9 * 0.8, True), (0.9 * 1.25, False)])
def test_predicted_seconds_may_take_nine_tenths_of_the_budget(part, serves):
    found = Goal(budget=10.0).candidates(listed({"a": (0.01, 10.0 * part)}))
    assert bool(found) == serves


@pytest.mark.parametrize(
    ("goal", "limit"),
    [
        (Goal(tolerance=0.01), {16.0: 60.0, 25.0: 75.0}),
        (Goal(budget=16.0), {1.0: 60.0}),
        (Goal(budget=25.0), {1.0: 75.0}),
    ],
)
def test_a_search_may_take_a_minute_or_three_times_the_tuned_run(goal, limit):
    for seconds, allowed in limit.items():
        candidates = goal.candidates(listed({"a": (0.001, seconds)}))
        assert goal.limit(candidates) == pytest.approx(allowed)


@pytest.mark.parametrize(("part", "first"), [(0.8, "slow"), (1.25, "fast")])
def test_seconds_within_a_tenth_do_not_decide_but_errors(part, first):
    settings = {"fast": (2e-3, 1.0), "slow": (1e-3, 1.0 + 0.1 * part)}
    assert Goal(tolerance=0.01).candidates(listed(settings))[0].rule.method == first


def measured(errors, seconds=None, methods=None, steps=64):
    """Runs of implicit methods with these errors beside an exact one."""
    names = methods or [f"m{i}" for i in range(len(errors))]
    seconds = seconds or [1.0] * len(errors)
    runs = tuple(
        trial(Choice("P1", "", 0.1, name, steps), 1 + error, time)
        for name, error, time in zip(names, errors, seconds, strict=True)
    )
    exact = trial(Choice("P1", "", 0.1, "exact", steps), 1.0, 100.0)
    return runs, TimeErrors((), exact, np.zeros(1), (*runs, exact))


@pytest.mark.parametrize(("part", "taken"), [(0.8, 1), (1.25, 0)])
def test_the_steps_of_all_meshes_may_take_a_quarter_of_the_tolerance(part, taken):
    """The cheapest run is taken that is accurate enough, and else a better one."""
    runs, times = measured([1e-5, 0.25 * part * 0.01], seconds=[10.0, 1.0])
    assert shared_run(PowerLaws(), times, 0.01) is runs[taken]


@pytest.mark.parametrize(("part", "refined"), [(0.8, True), (1.25, False)])
def test_a_finer_mesh_may_take_seven_tenths_of_the_time_left(part, refined, monkeypatch):
    """Of a minute, for a problem of which no setting should meet the tolerance yet."""
    monkeypatch.setattr(search, "seconds_of_next", lambda mesh, coarse: part * 0.7 * 60.0)
    monkeypatch.setattr(search, "orders_of", lambda bench, meshes, element: [2.0])
    monkeypatch.setattr(search, "graded_choices", lambda opened, trials: [])
    bench, prediction = PowerLaws(), predict(1.0, 10.0)
    coarse = trial(Choice("P1", "", 0.1, "bdf2", 64), 1 + 0.01)
    goal, meshes = Goal(1e-3), [Choice("P1", "", 0.1)]
    search.measure_meshes(bench, meshes, prediction.times, coarse, goal)
    assert [run.choice.h for run in bench.ran][:1] == [0.05]
    assert (len(bench.ran) > 1) == refined


@pytest.mark.parametrize(("method", "factor"), [("bdf2", 1.0), ("central_difference", 2.0)])
def test_explicit_steps_are_twice_as_many_on_half_of_h(method, factor):
    """A run of 64 steps on 40 √triangles is followed by one on 80."""
    (mesh,) = predict(1.0, 10.0).meshes
    seconds = search.seconds_of_next(mesh, trial(Choice("P1", "", 0.1, method)))
    assert seconds == pytest.approx(factor * 64 * 1e-6 * 80**2)


@pytest.mark.parametrize("refused", [0, 2, 9])
def test_h_of_meshes_that_cannot_be_made_is_halved_four_times(refused, tmp_path, monkeypatch):
    path, tried = tmp_path / "sheet.toml", []
    path.write_text(SCENE.replace("PATTERN", "right"))

    def problem(opened, choice):
        tried.append(choice.h)
        if len(tried) <= refused:
            raise FeclothError("too coarse")
        return problem_with(opened, choice)

    monkeypatch.setattr(search, "problem_with", problem)
    first = search.coarse_meshes(open_problem(path), ["P1"])[0]
    assert tried == pytest.approx([0.125 / 2**k for k in range(min(refused, 4) + 1)], rel=1e-2)
    assert first.h == tried[-1]


METHODS_IN_SPACE = {
    # Errors over the tolerance, seconds, and the method that all meshes take.
    "damped, though slower": ({"bdf2": (0.1, 9.0), "newmark": (0.1, 1.0)}, "bdf2"),
    "undamped, where no other": (
        {"newmark": (0.1, 1.0), "implicit_midpoint": (0.1, 2.0)},
        "newmark",
    ),
    "damped, even if inaccurate": ({"bdf2": (3.0, 9.0), "newmark": (0.1, 1.0)}, "bdf2"),
    "implicit": ({"bdf2": (0.5, 9.0), "central_difference": (0.1, 1.0)}, "bdf2"),
    "explicit, where alone accurate": (
        {"bdf2": (1.25, 9.0), "central_difference": (0.8, 1.0)},
        "central_difference",
    ),
    "explicit, if all are inaccurate and it the least": (
        {"bdf2": (3.0, 1.0), "central_difference": (1.25, 9.0)},
        "central_difference",
    ),
}


@pytest.mark.parametrize("case", METHODS_IN_SPACE)
def test_the_steps_of_all_meshes_follow_the_rules_in_their_order(case):
    settings, taken = METHODS_IN_SPACE[case]
    runs = [
        trial(
            Choice("P1", "", 0.1, name, None if name == "central_difference" else 64),
            1 + 0.01 * error,
            seconds,
        )
        for name, (error, seconds) in settings.items()
    ]
    exact = trial(Choice("P1", "", 0.1, "exact", 64, rtol=1e-3), 1.0)
    times = TimeErrors((), exact, np.zeros(1), (*runs, exact))
    assert shared_run(PowerLaws(), times, 0.01).choice.method == taken


def test_rules_are_kept_in_their_order_and_passed_over_where_none_is_left():
    numbers = [1, 2, 3, 4, 6]
    rules = [lambda n: n % 2 == 0, lambda n: n > 6, lambda n: n > 3, lambda n: n % 3 == 0]
    assert prefer(numbers, by=rules) == [6]
    assert prefer(numbers, by=[]) == numbers
    assert prefer(numbers, by=[lambda n: n > 9]) == numbers


@pytest.mark.parametrize(("part", "is_known"), [(0.8, True), (1.25, False)])
def test_the_best_mesh_is_refined_until_its_error_is_a_quarter_of_the_tolerance(part, is_known):
    prediction = predict(1.0, 1.0)
    of = candidate(prediction, 40.0, 64, 1e-3, 1e-3)
    space = known_run(prediction, 40.0, part * 0.25 * 0.01)
    assert search.next_mesh(space, [of], Goal(0.01)) is (None if is_known else of.mesh)
    rival = replace(space, rival=replace(of.mesh))
    expected = None if is_known else rival.rival
    assert search.next_mesh(rival, [of], Goal(0.01)) is expected
    assert search.next_mesh(space, [], Goal(0.01)) is of.mesh


# --- curves and predictions -----------------------------------------------------------------------


@pytest.mark.parametrize(("order", "taken"), [(0.4, 0.5), (0.625, 0.625), (2.5, 2.0)])
def test_errors_go_on_with_their_order_from_a_half_to_the_theory(order, taken):
    errors = [np.array([1.0]), np.array([0.5**order])]
    curve = error_curve([1.0, 2.0], errors, np.array([2.0]), 0.0)
    assert curve(np.array([4.0]))[0, 0] == pytest.approx(0.5**order * 0.5**taken)
    assert curve.order == pytest.approx([taken])


def test_the_error_of_one_run_goes_on_with_three_quarters_of_the_theory():
    curve = error_curve([1.0], [np.array([1.0])], np.array([2.0]), 0.0)
    assert curve(np.array([2.0]))[0, 0] == pytest.approx(0.5**1.5)


def test_sizes_are_looked_for_from_half_to_sixteen_times_the_measured_ones():
    """And steps from as many as were measured to 64 times as many."""
    prediction = predict(1.0, 163.84)
    coarsest = Goal(tolerance=1e9).candidates(prediction)[0]
    assert (coarsest.edges, coarsest.x) == (pytest.approx(5.0), 32)
    least = 1 / (16 * 40.0) ** 2 + 163.84 / (64 * 128.0) ** 2  # equal parts
    for part, serves in ((1.01, True), (0.99, False)):
        assert bool(Goal(tolerance=part * least / 0.75).candidates(prediction)) == serves


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_errors_in_time_grow_with_the_nodes_of_which_p2_has_twice_as_many(element):
    """Of a mesh with 4 times the edges of the coarse one, and a power of 1.5."""
    prediction = predict(1e-12, 1.0)
    (mesh,) = prediction.meshes
    mesh = replace(mesh, choice=replace(mesh.choice, element=element, h=None))
    prediction = replace(prediction, meshes=(mesh,), growth={("bdf2", "steps"): 1.5})
    of = Goal(tolerance=1.0).candidates(prediction)[0]
    finer = 4.0 * (2.0 if element == "P2" else 1.0)  # 40 and 10 √triangles
    assert of.time[0] == pytest.approx(finer**1.5 / of.x**2)


@pytest.mark.parametrize(("element", "factor"), [("P1", 1.0), ("P2", 2.0)])
def test_explicit_steps_grow_with_the_edges_and_p2_has_twice_as_many(element, factor):
    """On a mesh with 4 times the √triangles of the coarse one."""
    prediction = predict(1.0, 1e-9)
    (mesh,), rule = prediction.meshes, prediction.times.rules[0]
    mesh = replace(mesh, choice=replace(mesh.choice, element=element, h=None))
    rule = replace(rule, method="central_difference", kind="limit")
    coarse = trial(Choice("P1", "", 0.1, "central_difference"))
    times = replace(prediction.times, rules=(rule,))
    prediction = replace(prediction, meshes=(mesh,), times=times, coarse=coarse)
    assert Goal(tolerance=1.0).candidates(prediction)[0].x == pytest.approx(4.0 * factor)


def test_the_lowest_point_is_a_third_of_the_mean_drop_below_a_node_and_a_quarter_at_the_border():
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.25, pattern="right")
    border = cloth.nodes("boundary")
    inner = next(i for i in range(len(cloth.X)) if np.allclose(cloth.X[i], 0.5))
    on_border = next(i for i in border if np.allclose(cloth.X[i], [0.5, 0.0]))
    for node, part in ((inner, 1 / 3), (on_border, 1 / 4)):
        depth = np.zeros(len(cloth.X))
        depth[node] = 0.6
        assert drop_to_neighbours(cloth, depth) == pytest.approx(0.6 * part)


# --- meshes ---------------------------------------------------------------------------------------


def mesh_runs(values, pattern="", seconds=None):
    """Runs on meshes of 10, 20, 40, … √triangles with these values."""
    times = seconds or [None] * len(values)
    choices = [Choice("P1", pattern, 0.1 * 0.5**k, "bdf2", 64) for k in range(len(values))]
    return [trial(*each) for each in zip(choices, values, times, strict=True)]


@pytest.mark.parametrize(("part", "doubted"), [(0.8, False), (1.25, True)])
def test_two_kinds_of_meshes_are_doubted_that_differ_by_more_than_their_errors(part, doubted):
    """Each has the error (d/3) 3 of two runs, d apart; beyond their sum the difference counts."""
    orders = np.array([[2.0], [2.0]])
    error = 1e-3 + 2e-3
    one, other = mesh_runs([1.001, 1.0], "right"), mesh_runs([1.002, 1.0], "cross")
    other = [trial(run.choice, run.row["value"] + part * error) for run in other]
    space = summarise_meshes(PowerLaws(), [*one, *other], orders)
    assert space.reference is one[1]
    assert space.error == pytest.approx([max(1e-3, (part - 1) * error)])
    assert space.rival is None  # the disagreement, 0.75e-3, is less than the run's own error
    far = [trial(run.choice, run.row["value"] + error) for run in other]
    space = summarise_meshes(PowerLaws(), [*one, *far], orders)
    assert space.error == pytest.approx([part * error])
    assert space.rival.choice.pattern == "cross"
    assert doubted == (part > 1)


@pytest.mark.parametrize(("power", "beyond"), [(0.8, 1.0), (1.25, 1.25), (2.56, 2.56), (4.0, 3.2)])
def test_seconds_of_a_step_grow_with_a_power_of_1_to_3_2(power, beyond):
    runs = mesh_runs([1.1, 1.0], seconds=[1.0, 2.0**power])
    (mesh,) = summarise_meshes(PowerLaws(), runs, np.array([[2.0], [2.0]])).meshes
    ratio = mesh.seconds(np.array([80.0]))[0, 0] / mesh.seconds(np.array([20.0]))[0, 0]
    assert ratio == pytest.approx(4.0**beyond)


@pytest.mark.parametrize(("order", "stalls"), [(0.3 * 0.8, True), (0.3 * 1.25, False)])
def test_finer_meshes_do_not_help_whose_changes_fall_with_an_order_below_03(order, stalls):
    changes = 0.1, 0.1 * 0.5**order
    runs = tuple(mesh_runs([1.0, 1.0 + changes[0], 1.0 + sum(changes)]))
    mesh = Mesh(runs[0].choice, None, None, runs)
    space = SpaceErrors((mesh,), runs[-1], np.zeros(1))
    assert space.stalls(PowerLaws(), 0.01) == stalls


@pytest.mark.parametrize(("part", "stalls"), [(0.8, False), (1.25, True)])
def test_changes_up_to_twice_the_tolerance_may_be_irregular(part, stalls):
    runs = tuple(mesh_runs([1.0, 1.001, 1.001 + 2 * part * 0.01]))
    mesh = Mesh(runs[0].choice, None, None, runs)
    space = SpaceErrors((mesh,), runs[-1], np.zeros(1))
    assert space.stalls(PowerLaws(), 0.01) == stalls


@pytest.mark.parametrize(("part", "refined"), [(0.8, False), (1.25, True)])
def test_errors_are_trusted_up_to_twice_the_measured_size(part, refined):
    prediction = predict(1.0, 1.0)
    of = candidate(prediction, part * 2 * 40.0, 64, 1e-3, 1e-3)
    space = known_run(prediction, 40.0, 1e-6)
    mesh = search.next_mesh(space, [of], Goal(0.01))
    assert mesh is (of.mesh if refined else None)


def test_the_first_meshes_have_128_triangles_and_those_of_p2_a_quarter(tmp_path):
    path = tmp_path / "sheet.toml"
    path.write_text(SCENE.replace("PATTERN", "right"))
    choices = {one.element: one.h for one in search.coarse_meshes(open_problem(path), None)[:2]}
    assert choices == {"P1": pytest.approx(0.125), "P2": pytest.approx(0.25)}


# --- errors in time -------------------------------------------------------------------------------


@pytest.fixture
def free_steps(monkeypatch):
    """A motion whose first run has 16 steps."""
    monkeypatch.setattr(time_errors, "can_choose_steps", lambda opened: True)
    monkeypatch.setattr(time_errors, "first_steps", lambda opened: 16)


def ladder(error_at, tolerance, methods=("newmark",)):
    """The steps of each method that are run where `error_at(method, n)` is the error in time."""

    def change(run):
        n = run.choice.steps or 1 / run.choice.rtol
        return trial(run.choice, 1 + error_at(run.choice.method, n))

    bench = PowerLaws(change=change)
    measure_methods(bench, Choice("P1", "", 0.1), methods, tolerance, 1e9)
    steps = {}
    for run in bench.ran:
        steps.setdefault(run.choice.method, []).append(run.choice.steps)
    return steps


@pytest.mark.parametrize(("part", "most"), [(0.8, 64), (1.25, 128)])
def test_steps_are_halved_until_the_error_is_below_the_tolerance(part, most, free_steps):
    tolerance = 1e-3
    error = part * tolerance
    assert max(ladder(lambda _, n: error * (64 / n) ** 2, tolerance)["newmark"]) == most


@pytest.mark.parametrize(("part", "least"), [(0.8, 8), (1.25, 16)])
def test_fewer_steps_are_run_until_the_error_is_above_the_tolerance(part, least, free_steps):
    tolerance = 1e-3

    def error_at(method, n):
        size = 1e-6 if method == "newmark" else part * tolerance
        return size * (16 / n) ** 2

    steps = ladder(error_at, tolerance, ["newmark", "implicit_midpoint"])
    assert min(steps["implicit_midpoint"]) == least


def test_at_least_four_steps_are_run(free_steps):
    assert min(ladder(lambda _, n: 1e-9 / n**2, 1e-3)["newmark"]) == 4


@pytest.mark.parametrize(("steps", "is_run"), [(0.8 * 20_000, True), (1.25 * 20_000, False)])
def test_explicit_steps_are_run_up_to_20000_of_them(steps, is_run, monkeypatch):
    opened = SimpleNamespace(span=1.0)
    problem = SimpleNamespace(first=SimpleNamespace(system=None, start=None))
    monkeypatch.setattr(time_errors, "problem_with", lambda opened, choice: problem)
    monkeypatch.setattr(time_errors, "critical_dt", lambda system, start: 1.0 / steps)
    bench = PowerLaws(opened=opened)
    time_errors._explicit_runs(bench, Choice("P1", "", 0.1, "central_difference"))
    assert bool(bench.ran) == is_run


@pytest.mark.parametrize(("known", "error"), [(0.8e-4, 1e-4), (1.25e-4, 1.25e-4), (math.nan, 1.0)])
def test_an_explicit_run_without_another_has_an_error_of_1e_4_or_more(known, error):
    run = trial(Choice("P1", "", 0.1, "central_difference"), time_error=known)
    assert time_errors._own_error(PowerLaws(), [run]) == pytest.approx([error])


def growing(power, share=0.5, tolerance=1e-3):
    """The growth that is found, and the runs for it, where errors in time grow with x^power."""
    prediction = predict(1.0, 10.0)

    def change(run):
        x = 1 / run.choice.h
        return trial(run.choice, 1 + 10.0 / run.choice.steps**2 * (x / 10.0) ** power)

    rule = prediction.times.rules[0]
    runs = tuple(change(trial(Choice("P1", "", 0.1, "bdf2", n))) for n in (32, 64, 128))
    exact = trial(Choice("P1", "", 0.1, "bdf2", 128), 1.0)
    rule = replace(rule, trials=runs)
    times = TimeErrors((rule,), exact, np.zeros(1), runs)
    bench = PowerLaws(change=change)
    of = candidate(prediction, 40.0, 64, (1 - share) * tolerance, share * tolerance)
    of = replace(of, rule=rule)

    class Given(Goal):
        def candidates(self, prediction, margin=0.0):
            return [of]

    found = measure_growth(bench, replace(prediction, times=times), Given(tolerance))
    return found.growth.get(rule.key), bench.ran


@pytest.mark.parametrize(("power", "found"), [(0.7, 0.7), (1.6, 1.6), (2.5, 2.0), (-0.5, 0.0)])
def test_the_growth_of_errors_in_time_is_measured_up_to_the_power_2(power, found):
    assert growing(power)[0] == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(("share", "counts"), [(0.25 * 0.8, False), (0.25 * 1.25, True)])
def test_growth_is_measured_where_errors_in_time_are_a_quarter(share, counts):
    assert bool(growing(1.0, share=share)[1]) == counts


# --- seconds, and terms that are left out ---------------------------------------------------------


def timed(others, monkeypatch):
    """What is run to measure seconds; `others` are seconds of further methods over the first's."""
    monkeypatch.setattr(corrections, "shorten", lambda opened, part: opened)
    base = predict(1.0, 10.0)
    rule = base.times.rules[0]
    more = [
        replace(rule, method=f"m{i}", seconds=rule.seconds.scaled(times))
        for i, times in enumerate(others)
    ]
    prediction = replace(base, times=replace(base.times, rules=(rule, *more)))
    bench = PowerLaws(change=lambda run: trial(run.choice, 1.0, run.seconds))
    corrections.time_candidates(bench, prediction, Goal(1e-3))
    return bench.ran


def test_the_seconds_of_three_settings_are_measured(monkeypatch):
    ran = timed([1.3, 1.6, 1.9, 2.2], monkeypatch)
    assert {run.choice.method for run in ran} == {"bdf2", "m0", "m1"}


@pytest.mark.parametrize(("steps", "of_short_run"), [(6, 6), (100, 12), (1000, 50)])
def test_a_short_run_has_12_steps_or_a_twentieth_of_all(steps, of_short_run, monkeypatch):
    monkeypatch.setattr(corrections, "shorten", lambda opened, part: opened)
    bench = PowerLaws(change=lambda run: trial(run.choice, seconds=run.choice.steps * 1e-3))
    of = candidate(predict(1.0, 10.0), 20.0, steps, 1e-3, 1e-3)
    assert corrections._measure_seconds(bench, of) == pytest.approx(steps * 1e-3)
    assert [run.choice.steps for run in bench.ran] == [of_short_run]


def without_damping(change, seconds, tmp_path, monkeypatch):
    """The names of changes where to leave out the damping has this change and these seconds."""
    path = tmp_path / "sheet.toml"
    damping = '[[terms]]\ntype = "MassDamping"\nrate = 1.0\n[[pins]]'
    path.write_text(SCENE.replace("PATTERN", "right").replace("[[pins]]", damping))

    def run(bench, variants, choice):
        if "without MassDamping" not in [variant.name for variant in variants]:
            return trial(choice, 9.0, 9.0)  # another change, which is too large
        return trial(choice, 1.0 + change, seconds)

    monkeypatch.setattr(tune_module, "run_variants", run)
    bench = PowerLaws(open_problem(path), change=lambda run: trial(run.choice, 1.0, 1.0))
    return tune_module.drop_terms(bench, Choice("P1", "right", 0.1), 0.01)[2]


@pytest.mark.parametrize(("part", "dropped"), [(0.8, True), (1.25, False)])
def test_a_term_is_left_out_that_changes_a_quarter_of_the_tolerance(
    part, dropped, tmp_path, monkeypatch
):
    assert bool(without_damping(0.25 * part * 0.01, 0.5, tmp_path, monkeypatch)) == dropped


@pytest.mark.parametrize(("part", "dropped"), [(0.9, True), (1.05, False)])
def test_a_term_is_left_out_that_saves_more_than_the_noise_of_seconds(
    part, dropped, tmp_path, monkeypatch
):
    assert bool(without_damping(1e-5, part / 1.1, tmp_path, monkeypatch)) == dropped
