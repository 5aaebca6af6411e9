"""Runs with a plate, a turning clamp and rest angles of the start go on bit for bit."""

import os
import signal

import numpy as np
import pytest
from support.rundirs import written

from fecloth.output.frames import read_frame
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

SCENE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.2, h = 0.1 }
terms = [
  { type = "StVK" }, { type = "PlateBending", rest = "start" },
  { type = "BendingDamping", time = 0.01, law = { type = "PlateBending" } },
  { type = "Gravity" },
]
start = { position = ["X", "Y", "0.2 * X ** 2"] }
output = { every_steps = 7, restart_steps = 5 }
[fabric]
areal_density = 0.2
tensile_stiffness = 200.0
bending_rigidity = [2e-3, 1e-3]
bending_poisson_ratio = 0.2
[[pins]]
where = "left"
clamp = true
rotate = { point = [0, 0, 0], axis = [0, 1, 0], angle = "2 * t" }
"""
METHODS = {
    "bdf2": 'dt = 0.004\nt_end = 0.12\n[solver]\nlinear = "direct"\n',
    "energy_momentum": 'dt = 0.004\nt_end = 0.12\n[solver]\nlinear = "direct"\n',
    "central_difference": "t_end = 0.05\n",
}


def stop_after(step):
    """A report of a run that asks it to end after a step, as Ctrl-C does."""

    def report(info):
        if info.step == step:
            os.kill(os.getpid(), signal.SIGINT)

    return report


@pytest.mark.stories
@pytest.mark.parametrize(
    ("method", "element"),
    [("bdf2", "P1"), ("energy_momentum", "P2"), ("central_difference", "P2")],
)
def test_a_broken_off_run_goes_on_bit_for_bit(method, element, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mass = 'mass = "lumped"\n' if method == "central_difference" else ""
    text = SCENE.replace("h = 0.1 ", f'h = 0.1, element = "{element}" ')
    scene = tmp_path / "sheet.toml"
    scene.write_text(f'{mass}{text}[time]\nmethod = "{method}"\n{METHODS[method]}')
    run_scene(load_scene(scene), tmp_path / "whole")
    outcome = run_scene(load_scene(scene), tmp_path / "broken", report=stop_after(17))
    assert outcome.status == "interrupted"
    assert run_scene(load_scene(scene), tmp_path / "broken", resume=True).status == "done"
    whole, broken = written(tmp_path / "whole"), written(tmp_path / "broken")
    assert {name: whole[name] == broken.get(name) for name in whole} == dict.fromkeys(whole, True)
    cloth = load_scene(scene).mesh()
    first, *_, last = (
        read_frame(f, cloth) for f in sorted((tmp_path / "whole/frames").glob("*.vtu"))
    )
    assert np.abs(last.x - first.x)[:, 2].max() > 0.005  # it has moved
