"""A run in a folder says its error in time in every file that a user reads."""

import json

import pytest

import fecloth as fc
from fecloth.runs.outcome import finished_message

SCENE = """
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


@pytest.fixture
def run(tmp_path):
    def run(*settings, name="out", **options):
        (tmp_path / "drum.toml").write_text(SCENE)
        scene = fc.load_scene(tmp_path / "drum.toml", list(settings))
        return fc.run_scene(scene, tmp_path / name, **options)

    return run


def words_of(outcome):
    log = (outcome.folder / "run.log").read_text()
    page = (outcome.folder / "report.html").read_text()
    return log, page, json.loads((outcome.folder / "summary.json").read_text())


def test_a_resolved_run_says_its_error_and_the_step_for_one_per_cent(run):
    outcome = run("time.dt=0.0015")
    log, page, summary = words_of(outcome)
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
    outcome = run("time.dt=0.02", "time.t_end=0.2", warn=warned.append)
    log, page, summary = words_of(outcome)
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
    whole = run()
    run("time.t_end=0.06", name="parts")
    parts = run(name="parts", resume=True)
    assert parts.summary["time_error"] == pytest.approx(whole.summary["time_error"], rel=0.02)


def test_a_scene_names_the_estimate(run):
    outcome = run("time.error_in_time='companion'")
    assert "a run with other steps is" in words_of(outcome)[2]["time_error_in_words"]
    assert run("time.error_in_time='none'", name="none").summary["time_error"] is None
