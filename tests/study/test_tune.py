"""`tune`: tuned settings beside much finer runs, what proves nothing, and what it writes."""

import math
import re
import tomllib

import numpy as np
import pytest
from support.strips import TIP, moving_strip, scene_file
from support.strips import strip as hung

import fecloth as fc
from fecloth.scene.scene import load_scene, scene_of
from fecloth.simulation.quantity_values import relative_difference
from fecloth.study.command import StudyFailed
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.settings import Settings
from fecloth.study.problem import StudyProblem
from fecloth.study.result import Table
from fecloth.study.runs import Run, Runs, record_at, run_quantities
from fecloth.study.tuning import Reduced, leave_out_terms
from fecloth.study.tuning_result import Tuned

pytestmark = pytest.mark.usefixtures("counted_work")  # seconds decide
STRIP = """
cloth = { shape = "rectangle", width = 0.3, height = 1.0, h = 0.1, pattern = "right" }
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
strip = scene_file(STRIP, "scene")


def write(folder, text, name="scene.toml"):
    path = folder / name
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def tuned_strip(tmp_path_factory, counted_work):
    """The strip, tuned with P1 only."""
    folder = tmp_path_factory.mktemp("strip")
    return fc.tune(write(folder, STRIP), "1%", elements=["P1"], folder=folder)


def largest_error(exact, tuned):
    """The largest relative difference of the quantities of a tuned scene to a much finer run."""
    tuned = StudyProblem.of(tuned)
    runs = [Run(exact, "exact"), Run(tuned, "tuned")]
    rows = run_quantities(runs, exact.quantities, Runs(quiet=True))
    return max(
        relative_difference(quantity, *(record_at(row, quantity) for row in rows))
        for quantity in exact.quantities
    )


# --- tuned settings are as accurate as they say ---------------------------------------------------


def test_the_error_of_a_tuned_equilibrium_is_the_true_one(strip, tuned_strip):
    exact = StudyProblem.of(strip).choose(element="P2", h=0.02)
    true = largest_error(exact, tuned_strip.scene)
    assert tuned_strip.proved, tuned_strip.verdict
    assert 1e-5 < true <= 0.01
    assert true <= tuned_strip.error
    assert tuned_strip.error == pytest.approx(sum(tuned_strip.parts.values()))
    assert tuned_strip.text == tuned_strip.scene.read_text()


@pytest.mark.stories
def test_the_error_of_a_tuned_run_is_the_true_one(tmp_path):
    """Of a sheet with bending: without it the folds are as fine as the mesh, and none agree."""
    path = write(tmp_path, BOB)
    tuned = fc.tune(path, "5%", elements=["P1"], methods=["bdf2"], folder=tmp_path)
    exact = StudyProblem.of(path).choose(element="P2", h=0.04, method="bdf2", dt=0.3 / 300)
    assert tuned.proved, tuned.verdict
    assert largest_error(exact, tuned.scene) <= 1.2 * 0.05


def test_a_tuned_scene_has_its_settings_and_all_else_of_the_scene(strip, tuned_strip):
    own, tuned = load_scene(strip), load_scene(tuned_strip.scene)
    assert tuned.cloth.h == tuned_strip.settings["h"]
    assert tuned.cloth.element == tuned_strip.settings["element"] == "P1"
    assert tuned.cloth.pattern == tuned_strip.settings["pattern"]
    assert tuned.fabric == own.fabric
    assert tuned.interest == own.interest


def test_the_tuned_setting_is_the_cheapest_row_within_the_tolerance(tuned_strip):
    rows = [row for row in tuned_strip.table if row["status"] == "ok"]
    met = [row for row in rows if row["error %"] + row["uncertainty %"] <= 1.0]
    cheapest = min(met, key=lambda row: row["seconds"])
    assert [row["tuned"] for row in rows].count(True) == 1
    assert cheapest["tuned"]
    assert cheapest["h"] == tuned_strip.settings["h"]
    assert len({(row["element"], row["pattern"], row["h"]) for row in rows}) == len(rows)


@pytest.mark.stories
def test_a_function_is_tuned_in_h(tmp_path):
    elements = ["P1", "P2"]
    asked = {"h": 0.1, "pattern": "cross", "probes": TIP, "elements": elements}
    tuned = fc.tune(hung, "0.5%", "tip.x", folder=tmp_path, **asked)
    assert tuned.proved
    assert tuned.scene is None
    assert set(tuned.table["element"]) == set(elements)
    page = tuned.report(tmp_path).read_text()
    assert "proved" in page
    assert (tmp_path / "figure.png").exists()


@pytest.mark.stories
def test_the_tuned_motion_takes_no_longer_than_its_budget():
    run = {"h": 0.1, "dt": 0.005, "t_end": 0.05, "probes": TIP}
    tuned = fc.tune(moving_strip, quantity="tip.x", budget="0.02 s", **run)
    assert tuned.proved, tuned.verdict
    assert tuned.seconds <= tuned.budget == 0.02
    assert 0 < tuned.error < 0.05
    assert math.isnan(tuned.tolerance)
    within = [row for row in tuned.table if row["status"] == "ok" and row["seconds"] <= 0.02]
    bounds = [row["error %"] + row["uncertainty %"] for row in within]
    (own,) = [row for row in tuned.table if row["tuned"]]
    assert own["error %"] + own["uncertainty %"] == min(bounds)


# --- the command and the report -------------------------------------------------------------------


@pytest.mark.parametrize("error", [1.4, math.nan])
def test_a_setting_that_is_not_proved_is_reported_without_nan(tmp_path, error):
    row = {"element": "P1", "status": "ok", "seconds": 0.1, "error": error, "tuned": True}
    row |= {"method": "equilibrium", "uncertainty": 0.1, "error %": error, "uncertainty %": 0.1}
    table = Table((row, {"status": "failed", "method": "equilibrium", "tuned": False}))
    tuned = Tuned("strip", "not proved: it is too long", table, seconds=0.1, search_seconds=1.0)
    assert not any("nan" in note for note in tuned.notes())
    page = tuned.report(tmp_path).read_text()
    assert "CPU time: 0.1 s" in page
    assert tuned.exit_status == 1


# --- what proves nothing --------------------------------------------------------------------------


@pytest.mark.stories
def test_a_mesh_that_cannot_be_refined_is_named(tmp_path):
    write(
        tmp_path,
        "Point(1) = {0, 0, 0, 0.2}; Point(2) = {1, 0, 0, 0.2}; Point(3) = {0, 1, 0, 0.2};"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1}; Curve Loop(1) = {1, 2, 3};"
        'Plane Surface(1) = {1}; Physical Curve("top") = {1}; Physical Curve("bottom") = {2};'
        'Physical Surface("cloth") = {1};',
        "sheet.geo",
    )
    sheet = re.sub("cloth = .*", 'cloth = { shape = "file", path = "sheet.geo" }', STRIP)
    scene = write(tmp_path, sheet.replace('plane = "xz"', 'plane = "xy"'))
    tuned = fc.tune(scene, "2%", "tip.z", elements=["P1"])
    assert not tuned.proved
    assert "the mesh has no h" in tuned.verdict
    assert tuned.exit_status == 1


@pytest.mark.stories
def test_changes_that_do_not_shrink_prove_nothing():
    """As with folds: each finer mesh has another result; here by its stiffness."""

    def folded(h):
        return hung(h, 20.0 + 5.0 * math.cos(math.pi * math.log2(0.25 / h)))

    tuned = fc.tune(folded, "2%", "tip.x", h=0.1, probes=TIP, seconds=2.0)
    assert not tuned.proved
    assert "do not shrink as the order says" in tuned.verdict
    assert math.isnan(tuned.error)
    assert "unknown" in tuned.verdict


@pytest.mark.stories
@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.3, "the next setting would be h = .* mm, dt = .* ms"),
        (0.01, "1 level reached the end of the run in time; a limit needs 3"),
    ],
)
def test_a_time_that_is_up_is_said_with_the_next_setting(seconds, words):
    run = {"h": 0.1, "dt": 0.005, "t_end": 0.05, "probes": TIP}
    tuned = fc.tune(moving_strip, 1e-6, "tip.x", seconds=seconds, **run)
    assert not tuned.proved
    assert re.search(words, " ".join([tuned.verdict, *tuned.remarks]))


def test_a_scene_that_fails_on_every_mesh_says_the_cause(tmp_path):
    torn = STRIP.replace("tensile_stiffness = 40.0", "tensile_stiffness = 1e-6")
    with pytest.raises(StudyFailed, match="no limit was found: .*stretches without end"):
        fc.tune(write(tmp_path, torn), elements=["P1"])


# --- terms ----------------------------------------------------------------------------------------


def reduced_terms(source, tolerance=0.01):
    """The names of the terms that are left out or replaced, and the error of that."""
    problem = StudyProblem.of(source)
    bench = Bench(Settings.of(problem), problem.quantities, Runs(quiet=True), 100.0)
    return leave_out_terms(Reduced(problem), bench, tolerance)


@pytest.mark.stories
def test_a_membrane_in_free_fall_is_not_left_out():
    """Nothing stretches the cloth, so that no run of the search would miss its membrane."""
    time = {"method": "bdf2", "dt": 0.02, "t_end": 0.1}
    data = {key: value for key, value in tomllib.loads(BOB).items() if key != "pins"}
    reduced = reduced_terms(scene_of(data | {"time": time}), 0.03)
    assert "without StVK" not in reduced.changes
    types = {term["type"] for term in reduced.problem.tables["terms"]}
    assert types & {"StVK", "Springs"}


@pytest.mark.stories
def test_a_tuned_scene_says_which_terms_it_lacks(tmp_path):
    force = ' { type = "PointForce", where = "bottom", force = [0, 1e-9, 0] }]\npins'
    path = write(tmp_path, STRIP.replace("]\npins", f",{force}", 1))
    tuned = fc.tune(path, "3%", elements=["P1"], model=True)
    assert tuned.proved, tuned.verdict
    assert "PointForce" not in tuned.text
    assert any("without PointForce" in remark for remark in tuned.remarks)
    assert np.isfinite(tuned.parts["model"])
