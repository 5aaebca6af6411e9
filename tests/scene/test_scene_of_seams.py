"""[[seams]] in scenes: the same as in Python, with restart, errors by key, and sensitivities."""

import numpy as np
import pytest
from support.rundirs import gone_on

import fecloth as fc
from fecloth.scene.scene import load_scene

TEXT = """
terms = [{ type = "StVK" }, { type = "PlateBending" }, { type = "Gravity" }]
pins = [{ where = "front/top" }]
output = { every_steps = 4, restart_steps = 3 }
seams = [
  { first = "front.left", second = "back.left", close = "0.05 s" },
  { first = "front.right", second = "back.right", stiffness = 0.001, close = "0.05 s" },
]
[cloths.front]
shape = "rectangle"
width = 0.2
height = 0.2
h = 0.05
[cloths.back]
shape = "rectangle"
width = 0.2
height = 0.22
h = 0.04
start = { shift = [0, 0, -0.02] }
[fabric]
areal_density = 0.2
tensile_stiffness = 500.0
bending_rigidity = 1e-3
[time]
method = "METHOD"
dt = DT
t_end = 0.08
"""
METHODS = {"bdf2": "0.004", "central_difference": "2e-5"}


def scene_file(folder, method="bdf2", text=TEXT):
    path = folder / "bag.toml"
    path.write_text(text.replace("METHOD", method).replace("DT", METHODS[method]))
    return path


def test_a_scene_has_the_seams_of_python(tmp_path):
    system = load_scene(scene_file(tmp_path)).build().system
    assert system.seams == (
        fc.Seam("front.left", "back.left", close=0.05),
        fc.Seam("front.right", "back.right", stiffness=0.001, close=0.05),
    )
    assert "SeamBending" in system.names


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_a_broken_off_run_goes_on_bit_for_bit(tmp_path):
    """It is broken off while the seams close; the start of the run is not known after it."""
    whole = gone_on(scene_file(tmp_path), tmp_path, 8)
    (gap, *_) = (values for name, values in whole.observed.items() if name.startswith("gap"))
    assert gap[0] == pytest.approx(np.hypot(0.02, 0.02), rel=0.1)
    assert gap[-1] == 0.0
    assert whole.state.t == pytest.approx(0.08)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("method", METHODS)
def test_a_sensitivity_agrees_with_twin_runs(method, tmp_path):
    text = TEXT.replace("t_end = 0.08", "t_end = 0.012")
    if method == "central_difference":
        text = text.replace("t_end = 0.012", "t_end = 0.002")
    scene = scene_file(tmp_path, method, text)
    s = fc.sensitivity(scene, parameters=["fabric.tensile_stiffness"], quantity="energy.StVK")
    assert s.checked < 1e-3


STATIC = """
[equilibrium]
[[probes]]
name = "tip"
where = "low/bottom"
[cloths.high]
shape = "rectangle"
width = 0.2
height = 0.1
h = 0.05
pattern = "right"
start = { shift = [0, 0.1, 0] }
[cloths.low]
shape = "rectangle"
width = 0.2
height = 0.1
h = 0.025
pattern = "right"
[fabric]
areal_density = 0.2
tensile_stiffness = 50.0
poisson_ratio = 0.4
bending_rigidity = 1e-3
"""
HEAD = """
terms = [
  { type = "StVK" },
  { type = "PlateBending" },
  { type = "Gravity", acceleration = [0, -9.81, 0] },
]
pins = [{ where = "high/top" }]
seams = [{ first = "high.bottom", second = "low.top" }]
"""


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_h_of_all_pieces_is_refined_in_their_ratio(tmp_path):
    path = tmp_path / "strip.toml"
    path.write_text(HEAD + STATIC)
    study = fc.study.converge(path, "tip.y", levels=3)
    assert study.verdict.startswith("converges")
    triangles = [row["triangles"] for row in study.levels]
    assert triangles == [80, 320, 1280]
    # w (2H)²/2 = Y u along the strip, but for its held top
    sunk = study.limit
    assert sunk == pytest.approx(-0.2 * 9.81 * 0.2**2 / 2 / 50.0, rel=0.15)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("start", ['disturb = "1 mm"', 'mode = 1\namplitude = "1 mm"'])
def test_pieces_are_disturbed_together(start, tmp_path):
    path = tmp_path / "strip.toml"
    path.write_text(HEAD + STATIC + f"[start]\n{start}\n")
    built = load_scene(path).build()
    x = built.start.x
    assert 5e-4 < np.abs(x[:, 2]).max() < 1.001e-3
    assert not built.system.constraints.followers.gap(x).round(15).any()
    assert not x[built.cloth.nodes("high/top"), 2].any()
