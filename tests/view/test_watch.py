"""The window of `fecloth run … --watch`, under Xvfb; without a display it is refused."""

import os
import shutil
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from fecloth.cli.main import main

SCENE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.2, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 100.0 }
terms = [{ type = "StVK" }, { type = "Gravity" },
  { type = "Obstacle", shape = { type = "Plane", point = [0, 0, -0.05], normal = [0, 0, 1] } }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.1 }
"""
WATCHED = """
import sys
import pyvista
from fecloth.cli.main import main
from fecloth.view import watch

watch.PAUSE = 0.0
pictures = []
ranges = []

class Seen(watch.Window):
    def close(self):
        pictures.append(self._plotter.screenshot(return_img=True))
        pyvista.plotting.Plotter.close(self._plotter)
    def follow(self, state):
        super().follow(state)
        pictures.append(self._plotter.screenshot(return_img=True))
        ranges.append(self._actor.mapper.scalar_range[1])

watch.Window = Seen
status = main(["run", "scene.toml", "--watch", "--quiet"])
import numpy as np
np.savez("pictures.npz", *pictures)
print(*ranges)
sys.exit(status)
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)


def test_without_a_display_it_is_refused(scene, monkeypatch, capsys):
    pytest.importorskip("pyvista")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["run", "scene.toml", "--watch"]) == 2
    assert "--watch: needs a display, and none is set" in capsys.readouterr().err
    assert not os.path.exists("out")


@pytest.mark.stories
def test_a_window_follows_the_run(scene):
    pytest.importorskip("pyvista")
    if not shutil.which("xvfb-run"):
        pytest.skip("needs xvfb-run")
    command = ["xvfb-run", "-a", sys.executable, "-c", WATCHED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    ends = list(map(float, done.stdout.split()))  # of the colours: the largest displacement
    assert ends == sorted(ends)
    assert 0.01 < ends[-1] < 0.1
    pictures = list(np.load("pictures.npz").values())
    assert len(pictures) == 11  # of each step, and at the end
    changed = [(a != b).any(axis=2).mean() for a, b in pairwise(pictures[:-1])]
    assert min(changed) > 1e-3  # the cloth moves
    assert (pictures[0] != pictures[0][0, 0]).any(axis=2).mean() > 0.05  # and is there
