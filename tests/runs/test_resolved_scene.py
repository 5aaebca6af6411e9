"""scene.resolved.toml has what a run has chosen, and repeats the run."""

import tomllib

import pytest
from support.matrices import hide

from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

SHEET = """
fabric = {{ areal_density = 0.2, tensile_stiffness = {stiffness}, poisson_ratio = 0.3 }}
cloth = {{ shape = "rectangle", width = 0.5, height = 0.5, h = 0.1 }}
terms = [{terms}]
pins = [{{ where = "left" }}]
time = {{ t_end = {t_end} }}
output = {{ frames = 2 }}
"""
SHELL = '{ type = "StVK" }, { type = "Gravity" }'
FLOOR = 'type = "Obstacle", shape = { type = "Plane", point = [0, 0, -0.02], normal = [0, 0, 1] }'
CASES = {
    "central_difference": {"stiffness": 5.0, "terms": SHELL, "t_end": 0.09},
    "generalized_alpha": {"stiffness": 1e5, "terms": SHELL, "t_end": 0.09},
    "bdf2": {"stiffness": 1e3, "terms": f"{SHELL}, {{ {FLOOR} }}", "t_end": 0.08},
}


def run(file, text, **options):
    """Run a scene in a folder beside its file; return the folder and the resolved scene."""
    file.write_text(text)
    folder = file.with_suffix("")
    run_scene(load_scene(file), folder, **options)
    resolved = (folder / "scene.resolved.toml").read_text()
    return folder, resolved


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize("method", CASES)
def test_the_resolved_scene_names_the_method_and_repeats_the_run(tmp_path, method):
    folder, resolved = run(tmp_path / "first.toml", SHEET.format(**CASES[method]))
    time = tomllib.loads(resolved)["time"]
    assert time["method"] == method or time["method"]["type"] == method
    assert (time["rtol"], time["dt"]) == (1e-3, "auto")
    again, resolved_again = run(tmp_path / "again.toml", resolved)
    assert resolved_again == resolved
    for name in ("observed.csv", "energies.csv"):
        assert (again / name).read_bytes() == (folder / name).read_bytes()
    last = sorted(folder.glob("frames/*.vtu"))[-1]
    assert (again / "frames" / last.name).read_bytes() == last.read_bytes()


def test_the_resolved_scene_names_the_factorisation(tmp_path, monkeypatch):
    text = SHEET.format(**CASES["generalized_alpha"]) + 'solver = { linear = "direct" }\n'
    _, resolved = run(tmp_path / "here.toml", text)
    hide(monkeypatch, "pypardiso", "rslab")
    _, without = run(tmp_path / "there.toml", text)
    here, there = tomllib.loads(resolved), tomllib.loads(without)
    assert there["solver"]["linear"] == "superlu"
    assert here["solver"]["linear"] in ("pardiso", "rslab")
    assert there["time"] == here["time"]
