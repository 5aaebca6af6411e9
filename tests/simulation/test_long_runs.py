"""Runs of many frames: what they hold in memory does not grow with the number of frames."""

import json
import subprocess
import sys

import pytest

from fecloth.runs.environment import peak_memory

SCENE = """
mass = "lumped"
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.03, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "central_difference", dt = 1e-4, t_end = 1.0 }
output = { every_steps = 1 }
"""


def peak(tmp_path, frames, form):
    """Peak memory [MB] of a run of so many frames, in a process of its own, and of one frame."""
    (tmp_path / "scene.toml").write_text(SCENE)
    given = [f"time.t_end={1e-4 * frames}", f"output.format={form}"]
    command = ["run", "scene.toml", "-o", f"{frames}", "--quiet"]
    for value in given:
        command += ["--set", value]
    main = "import sys; from fecloth.cli.main import main; sys.exit(main(sys.argv[1:]))"
    subprocess.run([sys.executable, "-c", main, *command], cwd=tmp_path, check=True)
    summary = json.loads((tmp_path / f"{frames}" / "summary.json").read_text())
    assert summary["frames"] == frames + 1
    return summary["peak_memory_MB"], summary["nodes"]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Compile what the runs call, which takes more memory than all that follows."""
    peak(tmp_path_factory.mktemp("compiled"), 2, "vtu")


@pytest.mark.stories
@pytest.mark.skipif(peak_memory() is None, reason="not on Windows")
def test_memory_does_not_grow_with_the_frames(tmp_path, compiled):
    """Frames of their own files, which are gathered into one at the end."""
    pytest.importorskip("h5py")
    few, nodes = peak(tmp_path, 30, "vtkhdf")
    many, _ = peak(tmp_path, 130, "vtkhdf")
    state = 2 * 3 * 8 * nodes / 1e6  # x and v
    assert 100 * state > 5  # so much would be more, if each frame's state were kept
    assert many - few < 4
