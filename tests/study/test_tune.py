"""`tune`: curves, the choice among settings, and tuned settings beside much finer runs."""

import math
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from support.power_laws import predict

import fecloth as fc
from fecloth.cli import main as cli
from fecloth.errors import InputError
from fecloth.scene.scene import load_scene, scene_of
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.command import StudyFailed
from fecloth.study.problems import open_problem
from fecloth.study.result import Table
from fecloth.study.run_problems import Runs
from fecloth.study.tuning.choices import Bench, Choice, problem_with
from fecloth.study.tuning.curves import cost_curve, error_curve, error_of_finest
from fecloth.study.tuning.prediction import Goal
from fecloth.study.tuning.result import Tuned
from fecloth.study.tuning.space_errors import drop_to_neighbours
from fecloth.study.tuning.tune import drop_terms

pytestmark = [pytest.mark.stories, pytest.mark.usefixtures("counted_work")]  # seconds decide
STRIP = """
cloth = { shape = "rectangle", width = 0.3, height = 1.0, h = 0.1 }
fabric = { areal_density = 0.2, tensile_stiffness = 40.0, poisson_ratio = 0.3 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "top" }]
start = { plane = "xz" }
equilibrium = {}
probes = [{ name = "tip", where = "bottom" }]
interest = { quantities = ["tip.z", "area"] }
"""
BOB = """
cloth = { shape = "rectangle", width = 0.2, height = 0.2, h = 0.1 }
terms = [
  { type = "StVK" }, { type = "PlateBending" }, { type = "MassDamping", rate = 2.0 },
  { type = "Gravity" },
]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = "20 ms", t_end = 0.3 }
probes = [{ name = "tip", where = "right" }]
interest = { path = ["tip"] }
[fabric]
areal_density = 0.2
tensile_stiffness = 200.0
poisson_ratio = 0.3
bending_rigidity = 1e-3
"""


@pytest.fixture
def strip(tmp_path):
    path = tmp_path / "strip.toml"
    path.write_text(STRIP)
    return path


def bench_of(path):
    opened = open_problem(path)
    interest = opened.scene.interest.all
    return Bench(opened, tuple(parse_quantity(one) for one in interest), Runs())


def test_errors_follow_their_order_between_and_beyond_the_runs():
    x = [4.0, 8.0, 16.0]
    curve = error_curve(x, [np.array([3.0 / s**2]) for s in x], np.array([2.0]), 0.0)
    at = np.array([2.0, 5.0, 8.0, 64.0])
    assert curve(at)[:, 0] == pytest.approx(3.0 / at**2, rel=1e-12)
    assert curve.order == pytest.approx([2.0])


def test_an_error_that_is_small_by_chance_counts_as_that_of_the_finer_run():
    errors = [np.array([0.5]), np.array([1e-6]), np.array([0.1])]
    curve = error_curve([1.0, 2.0, 4.0], errors, np.array([2.0]), 0.0)
    assert curve(np.array([2.0]))[0, 0] == pytest.approx(0.1)


def test_an_order_above_the_theory_is_not_extrapolated():
    curve = error_curve([1.0, 2.0], [np.array([1.0]), np.array([1e-3])], np.array([2.0]), 0.0)
    assert curve(np.array([4.0]))[0, 0] == pytest.approx(1e-3 / 4, rel=1e-12)


@pytest.mark.parametrize("left", [0.0, 0.01, 0.04])
def test_the_order_is_not_that_of_runs_within_the_error_of_their_reference(left):
    """Distances 1/x² to a reference with an error: where that is larger, the sum is flat."""
    x = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    curve = error_curve(x, [np.array([1 / s**2]) for s in x], np.array([2.0]), left)
    assert curve.order == pytest.approx([2.0], abs=0.4)


@pytest.mark.parametrize(("theory", "count"), [(2.0, 3), (1.0, 3), (2.0, 2), (3.0, 2)])
def test_the_error_of_the_finest_run_is_the_published_index(theory, count):
    sizes = [2.0 * 2**k for k in range(count)]
    values = [np.array([1.0 + s**-theory]) for s in sizes]
    found = error_of_finest(lambda a, b: abs(b - a), values, sizes, theory)
    assert found == pytest.approx((1.25 if count > 2 else 3.0) * sizes[-1] ** -theory)


def test_seconds_grow_with_a_power_within_its_bounds():
    curve = cost_curve([1.0, 2.0], [1.0, 100.0], 1.0, 3.2)
    assert curve(np.array([4.0]))[0, 0] == pytest.approx(100 * 2**3.2)


def test_a_first_run_that_loads_code_costs_as_much_as_a_finer_one():
    curve = cost_curve([1.0, 2.0, 4.0], [7.0, 0.2, 0.4], 0.5, 1.0)
    assert curve(np.array([1.0, 4.0]))[:, 0] == pytest.approx([0.2, 0.4])


@pytest.mark.parametrize(("space", "in_time"), [(1.0, 10.0), (5.0, 1.0), (0.5, 100.0)])
def test_the_cheapest_setting_is_the_closed_form_of_power_laws(space, in_time):
    """Of a/x² + b/n² = T the least x² n has a/x² = 2 b/n²."""
    tolerance = 1e-3
    x, n = math.sqrt(1.5 * space / tolerance), math.sqrt(3 * in_time / tolerance)
    found = Goal(tolerance).candidates(predict(space, in_time), 1.0)[0]
    assert found.seconds == pytest.approx(1e-6 * x**2 * n, rel=0.3)
    assert found.seconds >= 0.999 * 1e-6 * x**2 * n
    assert 0.7 * tolerance < found.error <= tolerance


def test_with_a_budget_the_error_is_the_least_within_it():
    prediction = predict(1.0, 10.0)
    best = Goal(budget=0.1 / 0.9).candidates(prediction)[0]
    assert best.seconds <= 0.1
    assert Goal(0.9 * best.error).candidates(prediction, 1.0)[0].seconds > 0.1


def test_seconds_that_differ_by_noise_change_no_choice():
    """A second mesh of equal errors: whichever is faster by 5 %, the same candidate comes first."""
    found = predict(1.0, 10.0)
    (mesh,) = found.meshes
    firsts = []
    for factor in (0.95, 1.05):
        other = replace(
            mesh,
            choice=replace(mesh.choice, pattern="cross"),
            seconds=mesh.seconds.scaled(factor),
        )
        firsts.append(Goal(1e-3).candidates(replace(found, meshes=(mesh, other)), 1.0)[0].choice)
    assert firsts[0] == firsts[1]


def test_the_lowest_point_lies_as_far_below_the_lowest_node_as_it_may():
    """A bowl whose lowest point is the centre of a triangle, h/√3 from its nodes, or of an edge."""
    for element in ("P1", "P2"):
        cloth = fc.Cloth.rectangle(1.0, 1.0, 0.1, pattern="equilateral", element=element)
        corners = cloth.X[cloth.triangles]  # the inner quarter of P2 has the same centre
        at = corners[np.argmin(np.sum((corners.mean(axis=1) - 0.5) ** 2, axis=1))].mean(axis=0)
        depth = 1 - np.sum((cloth.X - at) ** 2, axis=1)
        assert drop_to_neighbours(cloth, depth) == pytest.approx(1 - depth.max(), rel=0.35)
    on_edge = 1 - (cloth.X[:, 0] - 0.525) ** 2 - 1e3 * cloth.X[:, 1]
    assert drop_to_neighbours(cloth, on_edge) >= 1 - on_edge.max() > 0


def test_a_choice_changes_the_scene_and_nothing_else(strip):
    opened = open_problem(strip)
    changed = problem_with(opened, Choice("P2", "cross", 0.05))
    cloth = changed.scene.cloth
    assert (cloth.element, cloth.pattern, cloth.h) == ("P2", "cross", 0.05)
    assert changed.scene.fabric == opened.scene.fabric
    assert changed.scene.interest == opened.scene.interest


@pytest.mark.parametrize("tolerance", [1e-2, pytest.param(2e-3, marks=pytest.mark.stories)])
def test_the_error_of_a_tuned_equilibrium_is_the_true_one(strip, tmp_path, tolerance):
    tuned = fc.tune(strip, tolerance, folder=tmp_path)
    bench = bench_of(strip)
    own, fine = bench.run([Choice(), Choice("P2", "right", 0.02)])
    tuned_run = replace(bench, opened=open_problem(tuned.scene)).run([Choice()])[0]
    true = bench.distance(fine, tuned_run).max()
    assert tuned.proved, tuned.verdict
    assert true <= 1.2 * tolerance
    assert true <= 1.5 * tuned.error
    assert tuned.text == tuned.scene.read_text()
    assert bench.distance(fine, own).max() > 1e-5  # the reference differs from the scene itself


@pytest.mark.stories
def test_the_error_of_a_tuned_run_is_the_true_one(tmp_path):
    """Of a sheet with bending: without it the folds are as fine as the mesh, and none agree."""
    path = tmp_path / "bob.toml"
    path.write_text(BOB)
    tuned = fc.tune(path, "2%", folder=tmp_path)
    bench = bench_of(path)
    (fine,) = bench.run([Choice("P2", "unstructured", 0.03, "bdf2", 800)])
    (again,) = replace(bench, opened=open_problem(tuned.scene)).run([Choice()])
    true = bench.distance(fine, again).max()
    assert tuned.proved, tuned.verdict
    assert true <= 1.2 * 0.02
    assert tuned.search_seconds < 60
    assert {"space", "time", "solver"} <= set(tuned.parts) | {"solver"}


def test_a_function_is_tuned_in_h(tmp_path):
    def hang(h, element="P1"):
        cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="cross", element=element)
        mass = "lumped" if element == "P1" else "consistent"
        terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
        system = fc.System(cloth, fc.Fabric(0.2, 20.0), terms, pins=["left"], mass=mass)
        return cloth, system, None, system.rest()

    tip = [fc.Probe("tip", "right")]
    tuned = fc.tune(
        hang, "0.1%", "tip.x", h=0.1, probes=tip, elements=["P1", "P2"], folder=tmp_path
    )
    assert tuned.proved
    assert tuned.scene is None
    assert tuned.settings["element"] in ("P1", "P2")
    page = tuned.report(tmp_path).read_text()
    assert "proved" in page
    assert (tmp_path / "figure.png").exists()


def pulled_strip(h, dt):
    """A strip, held at its left edge, that its weight begins to stretch."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="cross")
    terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, 200.0), terms, pins=["left"])
    return cloth, system, fc.ImplicitMidpoint(), system.rest()


def test_runs_of_a_motion_that_only_measure_seconds_have_no_error():
    tip = [fc.Probe("tip", "right")]
    tuned = fc.tune(pulled_strip, "3%", "tip.x", h=0.1, dt=0.005, t_end=0.05, probes=tip)
    rows = [row for row in tuned.table.rows if row["status"] == "ok"]
    assert tuned.proved
    assert all(("error %" in row) == (row["run"] != "timing") for row in rows)
    assert {"search", "timing", "tuned", "verifying"} <= set(tuned.table["run"])
    assert tuned.table["run"].count("sharper solver") == 1
    assert all(math.isfinite(row["error %"]) for row in rows if row["run"] != "timing")


def test_the_command_writes_a_scene_that_runs(strip, tmp_path, capsys):
    options = ["--elements", "P1", "-o", str(tmp_path / "out")]
    assert cli.main(["tune", str(strip), "--tolerance", "1%", *options]) == 0
    told = capsys.readouterr().out
    assert told.startswith("proved: ")
    assert load_scene(tmp_path / "out" / "tuned.toml").interest is not None
    assert "out/report.html" in told
    columns = next(line for line in told.splitlines() if line.startswith("| run"))
    assert (
        columns
        == "| run | element | pattern | h [m] | status | triangles | steps | CPU s | error % |"
    )


def test_a_bare_budget_on_the_command_line_is_in_seconds(strip, tmp_path, capsys):
    words = ["--elements", "P1", "-o", str(tmp_path / "out")]
    assert cli.main(["tune", str(strip), "--budget", "0", *words]) == 2
    assert "budget = 0.0: must be a time > 0" in capsys.readouterr().err


@pytest.mark.parametrize("error", [1.4, math.nan])
def test_a_setting_that_is_not_proved_is_reported_without_nan(tmp_path, error):
    row = {"run": "tuned", "element": "P1", "status": "ok", "CPU s": 0.1, "error %": error}
    table = Table((row, {"run": "search", "status": "failed"}))
    tuned = Tuned("strip", "not proved: it is too long", table, seconds=0.1, tolerance=1e-6)
    assert not any("nan" in note for note in tuned.notes())
    page = tuned.report(tmp_path).read_text()
    assert "CPU time: 0.1 s." in page


def test_a_mesh_that_cannot_be_refined_is_named(strip, tmp_path):
    (tmp_path / "sheet.geo").write_text(
        "Point(1) = {0, 0, 0, 0.2}; Point(2) = {1, 0, 0, 0.2}; Point(3) = {0, 1, 0, 0.2};"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1}; Curve Loop(1) = {1, 2, 3};"
        'Plane Surface(1) = {1}; Physical Curve("top") = {1}; Physical Curve("bottom") = {2};'
        'Physical Surface("cloth") = {1};'
    )
    scene = tmp_path / "sheet.toml"
    sheet = re.sub("cloth = .*", 'cloth = { shape = "file", path = "sheet.geo" }', STRIP)
    scene.write_text(sheet.replace('plane = "xz"', 'plane = "xy"'))
    tuned = fc.tune(scene, "2%", "tip.z", elements=["P1"])
    assert not tuned.proved
    assert "the mesh has no h" in tuned.verdict


def test_the_tuned_motion_takes_no_longer_than_its_budget():
    tip = [fc.Probe("tip", "right")]
    run = {"h": 0.1, "dt": 0.005, "t_end": 0.05, "probes": tip}
    tuned = fc.tune(pulled_strip, quantity="tip.x", budget="0.1 s", **run)
    assert tuned.proved == (tuned.seconds <= tuned.budget == 0.1), tuned.verdict
    assert 0 < tuned.error < 0.05
    assert math.isnan(tuned.tolerance)


def test_a_setting_that_would_take_too_long_is_not_run(strip):
    bench = replace(bench_of(strip), runs=Runs(most_seconds=1.0))
    short, long = bench.run([Choice("P1", "right", 0.1), Choice("P1", "right", 0.001)])
    assert short.is_ok
    assert not long.is_ok
    assert "too long" in long.row["cause"]


def test_a_tolerance_below_reach_needs_a_finer_mesh(strip):
    tuned = fc.tune(strip, 1e-9, elements=["P1"], most_seconds=0.2)
    assert not tuned.proved
    assert "times finer than P1" in tuned.verdict
    assert "do not come closer" not in tuned.verdict


def test_each_phase_prints_one_line(strip, capsys):
    fc.tune(strip, "1%", elements=["P1"])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert all(line.startswith("tune: ") for line in lines)


L_SHAPE = """
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {1, 0.5, 0}; Point(4) = {0.5, 0.5, 0};
Point(5) = {0.5, 1, 0}; Point(6) = {0, 1, 0}; Line(1) = {1, 2}; Line(2) = {2, 3};
Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6}; Plane Surface(1) = {1};
Physical Curve("held") = {HELD}; Physical Surface("cloth") = {1};
"""
BLOWN = """
terms = [{ type = "StVK" }, { type = "Pressure", p = -20.0 }]
pins = [{ where = "held" }]
start = { position = ["X", "Y", "-0.02 * sin(pi * X) * sin(pi * Y)"] }
equilibrium = {}
interest = { quantities = ["sag"] }
[cloth]
shape = "file"
path = "sheet.geo"
h = 0.06
[fabric]
areal_density = 0.2
tensile_stiffness = 800.0
poisson_ratio = 0.3
"""


@pytest.mark.stories
def test_the_lowest_node_proves_no_error_that_is_too_small(tmp_path):
    (tmp_path / "sheet.geo").write_text(L_SHAPE.replace("HELD", "1, 2, 3, 4, 5, 6"))
    path = tmp_path / "sheet.toml"
    path.write_text(BLOWN)
    tuned = fc.tune(path, 0.02, elements=["P1"], folder=tmp_path)
    bench = bench_of(path)
    (fine,) = bench.run([Choice("P2", "", 0.04)])
    (again,) = replace(bench, opened=open_problem(tuned.scene)).run([Choice()])
    true = float(bench.distance(fine, again).max())
    assert tuned.proved, tuned.verdict
    assert true <= 1.2 * tuned.error


@pytest.mark.stories
def test_a_mesh_graded_at_the_corner_of_an_l_is_chosen(tmp_path):
    shape = L_SHAPE.replace("HELD", "5") + 'Physical Point("tip") = {2};'
    (tmp_path / "sheet.geo").write_text(shape)
    path = tmp_path / "sheet.toml"
    data = tomllib.loads(BLOWN)
    del data["start"]
    hung = [{"type": "StVK"}, {"type": "Gravity", "acceleration": [0, -9.81, 0]}]
    data |= {"terms": hung, "probes": [{"name": "tip", "where": "tip"}]}
    data["fabric"]["tensile_stiffness"] = 100.0
    data["interest"] = {"quantities": ["tip.y"]}
    data["equilibrium"] = {"load_steps": 1}
    path.write_text(to_toml(data))
    tuned = fc.tune(path, 0.003, folder=tmp_path)
    bench = bench_of(path)
    gradings = tuple(one.make() for one in load_scene(tuned.scene).cloth.grading)
    fine, even = bench.run([Choice("P2", "", 0.06, grading=gradings), Choice("P2", "", 0.03)])
    (again,) = replace(bench, opened=open_problem(tuned.scene)).run([Choice()])
    assert tuned.proved, tuned.verdict
    assert "[[cloth.grading]]" in tuned.text
    assert bench.distance(fine, again).max() <= 1.2 * 0.003
    assert again.edges < even.edges / 2  # whose error is 0.24 %


def test_a_membrane_in_free_fall_is_not_left_out():
    """Nothing stretches the cloth, so that no run of the search would miss its membrane."""

    def falling(scene):
        data = tomllib.loads(scene) | {"time": {"method": "bdf2", "dt": 0.02, "t_end": 0.1}}
        return scene_of({key: value for key, value in data.items() if key != "pins"})

    bench = bench_of(falling(BOB))
    choice = Choice("P1", "", 0.1, "bdf2", 4)
    reduced, change, names = drop_terms(bench, choice, 0.03)
    assert "without StVK" not in names
    assert change.max() <= 0.03
    assert {term.type for term in reduced.opened.scene.terms} & {"StVK", "Springs"}


@pytest.mark.stories
def test_the_table_has_each_run_once_and_names_runs_of_other_terms(strip):
    tuned = fc.tune(strip, "2%", elements=["P1"], model=True)
    rows = [tuple(sorted(row.items())) for row in tuned.table if row["status"] == "ok"]
    assert len(rows) == len(set(rows))
    assert "other terms" in tuned.table["run"]
    assert tuned.table["run"].count("tuned") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"tolerance": "0%"}, "between 0 and 100 %"),
        ({"budget": "soon"}, "budget"),
        ({"tolerance": "1%", "budget": 1.0}, "only one of them may be given"),
        ({"budget": -1.0}, "must be a time > 0"),
        ({"methods": ["bdf2"]}, "an equilibrium has no method"),
        ({"elements": ["P3"]}, "must be one of P1, P2"),
        ({"quantity": "tipp.z"}, "tip"),
        ({"quantity": "tip.y"}, "has no relative error"),
    ],
)
def test_mistakes_are_named(strip, arguments, words):
    with pytest.raises(InputError, match=words):
        fc.tune(strip, **arguments)


def test_a_scene_that_fails_on_every_mesh_says_the_cause(tmp_path):
    path = tmp_path / "torn.toml"
    text = STRIP.replace("tensile_stiffness = 40.0", "tensile_stiffness = 1e-6")
    path.write_text(text)
    with pytest.raises(StudyFailed, match="no run on a coarse mesh reached its end"):
        fc.tune(path)
