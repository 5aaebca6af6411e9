"""A run in a folder says its error in space in every file that a user reads."""

import json
import math

import meshio
import pytest

import fecloth as fc
from fecloth.runs.outcome import finished_message

SCENE = """
cloth = { shape = "rectangle", width = 0.6, height = 0.4, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-3 }
terms = [{ type = "StVK" }, { type = "BENDING" }]
pins = [{ where = "boundary" }]
start = { position = ["1.02*X", "1.02*Y", "0.02*sin(pi*X/0.6)*sin(pi*Y/0.4)"] }
time = { method = "bdf2", dt = 0.001, t_end = 0.004 }
output = { frames = 2 }
"""


@pytest.fixture
def run(tmp_path):
    def run(*settings, bending="PlateBending"):
        (tmp_path / "drum.toml").write_text(SCENE.replace("BENDING", bending))
        scene = fc.load_scene(tmp_path / "drum.toml", list(settings))
        return fc.run_scene(scene, tmp_path / "out", overwrite=True)

    return run


def files_of(outcome):
    log = (outcome.folder / "run.log").read_text()
    page = (outcome.folder / "report.html").read_text()
    return log, page, json.loads((outcome.folder / "summary.json").read_text())


def cells(outcome):
    mesh = meshio.read(sorted(outcome.folder.glob("frames/*.vtu"))[-1])
    return {name: values[0] for name, values in mesh.cell_data.items()}


def test_a_run_says_its_error_and_its_frames_where_it_is(run):
    outcome = run("output.error_density=true")
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
    outcome = run(bending="HingeBending")
    log, page, summary = files_of(outcome)
    words = "no estimate, as HingeBending bends with a rigidity that depends on the mesh"
    assert summary["space_error"] is None
    assert words in summary["space_error_in_words"]
    assert words.endswith(outcome.space_error_reason)
    assert words in log
    assert "error in space" in page
    assert "error_density" not in cells(outcome)


def test_the_density_is_unknown_where_there_is_no_estimate(run):
    outcome = run("output.error_density=true", bending="HingeBending")
    assert all(math.isnan(value) for value in cells(outcome)["error_density"])
