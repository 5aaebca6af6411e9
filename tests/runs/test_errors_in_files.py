"""A run in a folder says its errors in time and in space in every file that a user reads."""

import json
import math

import meshio
import pytest

import fecloth as fc
from fecloth.runs.outcome import finished_message

DRUM = """
cloth = { shape = "rectangle", width = 0.6, height = 0.4, h = 0.2, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "boundary" }]
time = { method = "bdf2", dt = 0.001, t_end = 0.1 }
output = { frames = 2, restart_steps = 20 }
[start]
position = ["1.02*X", "1.02*Y", "0"]
velocity = ["0", "0", "sin(pi*X/0.6)*sin(pi*Y/0.4)"]
"""
BENT = """
cloth = { shape = "rectangle", width = 0.6, height = 0.4, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-3 }
terms = [{ type = "StVK" }, { type = "PlateBending" }]
pins = [{ where = "boundary" }]
start = { position = ["1.02*X", "1.02*Y", "0.02*sin(pi*X/0.6)*sin(pi*Y/0.4)"] }
time = { method = "bdf2", dt = 0.001, t_end = 0.004 }
output = { frames = 2 }
"""
HINGES = BENT.replace("PlateBending", "HingeBending")


@pytest.fixture
def run(tmp_path):
    def run(text, *settings, name="out", **options):
        (tmp_path / "drum.toml").write_text(text)
        scene = fc.load_scene(tmp_path / "drum.toml", list(settings))
        return fc.run_scene(scene, tmp_path / name, **options)

    return run


def files_of(outcome):
    log = (outcome.folder / "run.log").read_text()
    page = (outcome.folder / "report.html").read_text()
    return log, page, json.loads((outcome.folder / "summary.json").read_text())


# --- in time --------------------------------------------------------------------------------------


def test_a_resolved_run_says_its_error_and_the_step_for_one_per_cent(run):
    outcome = run(DRUM, "time.dt=0.0015")
    log, page, summary = files_of(outcome)
    words = summary["time_error_in_words"]
    assert 0.01 < summary["time_error"] < 0.1
    assert "of the motion (at most" in words
    assert "would give at most 1 %" in words
    assert words in log
    assert words in finished_message(outcome)
    assert words.split(";")[0].removeprefix("error in time ") in page
    assert not outcome.warnings


def test_a_run_that_resolves_nothing_warns(run):
    warned = []
    outcome = run(DRUM, "time.dt=0.02", "time.t_end=0.2", warn=warned.append)
    log, page, summary = files_of(outcome)
    assert summary["time_error"] > 0.3
    assert (
        summary["time_error_in_words"]
        == "error in time: not resolved, or small errors have grown; take a smaller dt"
    )
    assert "warning: error in time: not resolved" in log
    assert "not resolved" in page
    assert len(summary["warnings"]) == 1  # numerical dissipation is no cause of its own
    assert list(outcome.warnings) == summary["warnings"]
    assert warned == list(outcome.doubts)


@pytest.mark.stories
def test_a_resumed_run_says_the_same(run):
    whole = run(DRUM)
    run(DRUM, "time.t_end=0.06", name="parts")
    parts = run(DRUM, name="parts", resume=True)
    assert parts.summary["time_error"] == pytest.approx(whole.summary["time_error"], rel=0.02)


def test_a_scene_names_the_estimate(run):
    outcome = run(DRUM, "time.error_in_time='companion'")
    assert "a run with other steps is" in files_of(outcome)[2]["time_error_in_words"]
    assert run(DRUM, "time.error_in_time='none'", name="none").summary["time_error"] is None


# --- in space -------------------------------------------------------------------------------------


def cells(outcome):
    mesh = meshio.read(sorted(outcome.folder.glob("frames/*.vtu"))[-1])
    return {name: values[0] for name, values in mesh.cell_data.items()}


def test_a_run_says_its_error_and_its_frames_where_it_is(run):
    outcome = run(BENT, "output.error_density=true")
    log, page, summary = files_of(outcome)
    words = summary["space_error_in_words"]
    assert 0.01 < summary["space_error"] == outcome.space_error < 0.5
    assert words.startswith("error in space about")
    assert words in log
    assert words in finished_message(outcome)
    assert words.removeprefix("error in space ") in page
    density = cells(outcome)["error_density"]
    assert (density >= 0).all()
    assert density.max() > 0


def test_a_run_without_an_estimate_says_why(run):
    outcome = run(HINGES)
    log, page, summary = files_of(outcome)
    words = "no estimate, as HingeBending bends with a rigidity that depends on the mesh"
    assert summary["space_error"] is None
    assert words in summary["space_error_in_words"]
    assert words.endswith(outcome.space_error_reason)
    assert words in log
    assert "error in space" in page
    assert "error_density" not in cells(outcome)


def test_the_density_is_unknown_where_there_is_no_estimate(run):
    outcome = run(HINGES, "output.error_density=true")
    assert all(math.isnan(value) for value in cells(outcome)["error_density"])
