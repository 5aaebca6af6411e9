"""The numbers of `tune` from both sides: at about 0.8 and 1.25 times their value."""

import numpy as np
import pytest
from support.power_laws import PowerLaws, listed, trial

from fecloth.study.problems import SceneProblem, open_problem
from fecloth.study.tuning.choices import Choice, meshes_to_try, problem_with
from fecloth.study.tuning.search import Goal, shared_run
from fecloth.study.tuning.time_errors import TimeErrors

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 1.0
h = 0.1
pattern = "PATTERN"
[fabric]
areal_density = 0.2
tensile_stiffness = 40.0
poisson_ratio = 0.3
[[terms]]
type = "StVK"
[[pins]]
where = "top"
[equilibrium]
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
def test_the_steps_of_all_meshes_may_take_a_fifth_of_the_tolerance(part, taken):
    """The cheapest run is taken that is accurate enough, and else a better one."""
    runs, times = measured([1e-5, 0.2 * part * 0.01], seconds=[10.0, 1.0])
    assert shared_run(PowerLaws(), times, 0.01) is runs[taken]
