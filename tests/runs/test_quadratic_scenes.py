"""Scenes with quadratic triangles: their frames, steps and refusals."""

import meshio
import numpy as np
import pytest

from fecloth.cli.main import main
from fecloth.output.frames import read_frame
from fecloth.scene.scene import load_scene

SCENE = """
cloth = { shape = "rectangle", width = 0.3, height = 0.2, h = 0.1, element = "P2" }
fabric = { areal_density = 0.2, tensile_stiffness = 100.0 }
time = { method = "bdf2", dt = 0.01, t_end = 0.05 }
output = { frames = 2 }
[[terms]]
type = "StVK"
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
"""


def test_a_scene_with_quadratic_triangles(tmp_path, run_command):
    file = tmp_path / "s.toml"
    file.write_text(SCENE)
    scene = load_scene(file)
    assert (scene.mass, scene.cloth.element) == ("consistent", "P2")
    assert main(["run", str(file), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    cloth = scene.mesh()
    frames = sorted((tmp_path / "out").rglob("*.vtu"))
    last = read_frame(frames[-1], cloth)
    assert last.t == pytest.approx(0.05)
    assert last.x[cloth.nodes("right"), 2].max() < -1e-3
    assert (
        f"{len(cloth.X)} nodes, {len(cloth.triangles)} quadratic tri"
        in run_command("mesh", file, "-o", tmp_path / "flat.vtu").out
    )
    flat = meshio.read(tmp_path / "flat.vtu")
    assert np.array_equal(flat.cells_dict["triangle6"], cloth.cells)


@pytest.mark.stories
def test_a_scene_with_explicit_steps_on_quadratic_triangles(tmp_path, capsys):
    """`mass = "lumped"` and the method's name suffice; it stays near the implicit run."""
    file, ends = tmp_path / "s.toml", []
    file.write_text(SCENE)
    bending = "\n[[terms]]\ntype = 'PlateBending'\n"
    for change in ("mass='lumped'", "mass='consistent'"):
        method = "central_difference" if "lumped" in change else "generalized_alpha"
        text = SCENE.replace('method = "bdf2", dt = 0.01', f"method = '{method}'")
        text = text.replace("[[pins]]", f"{bending}[[pins]]").replace(
            "tensile_stiffness", "bending_rigidity = 1e-4, tensile_stiffness"
        )
        file.write_text(f"{change}\n{text}")
        assert main(["run", str(file), "-o", str(tmp_path / method), "--quiet"]) == 0
        cloth = load_scene(file).mesh()
        last = read_frame(sorted((tmp_path / method).rglob("*.vtu"))[-1], cloth)
        ends.append(cloth.load() @ last.x[:, 2])
    assert ends[0] < -5e-4
    assert ends[0] == pytest.approx(ends[1], rel=0.01)
