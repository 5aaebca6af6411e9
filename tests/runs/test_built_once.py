"""Each part of a scene is made once while it runs; the warm-up on two triangles is not counted."""

from collections import Counter

import pytest

import fecloth as fc
from fecloth.fabric.panel import Panel
from fecloth.output import frame_arrays
from fecloth.runs import run_scene
from fecloth.scene.scene import load_scene
from fecloth.simulation import fixed_step
from fecloth.simulation.probes import Observer
from fecloth.system.constraints import Constraints

TEXT = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left", motion = ["0", "0", "0.1 * t"] }]
probes = [{ name = "tip", where = "right" }]
time = { method = "central_difference", dt = 1e-4, t_end = 8e-4 }
output = { frames = 4 }
expect = { sag = { value = 0.0, absolute = 1.0 } }
"""
MAKERS = (
    (fc.System, "__init__"),
    (fc.Fabric, "__post_init__"),
    (Panel, "cut"),
    (fc.Pin, "__post_init__"),
    (Constraints, "bind"),
    (fc.Ledger, "open"),
    (Observer, "bind"),
)


@pytest.fixture
def counts(monkeypatch):
    """Calls by name, counted from here on."""
    found = Counter()

    def count(owner, name, title):
        original = getattr(owner, name)

        def counted(*args, **kwargs):
            found[title] += 1
            return original(*args, **kwargs)

        monkeypatch.setattr(owner, name, counted)

    for cls, name in MAKERS:
        count(cls, name, f"{cls.__name__}.{name}")
    count(fixed_step, "refuse_unstable", "refuse_unstable")
    count(frame_arrays, "stretches_of", "principal_stretches")
    monkeypatch.setattr(run_scene, "compile_kernels", lambda problem: None)
    return found


@pytest.mark.parametrize("method", ["central_difference", "bdf2"])
def test_a_run_makes_each_part_of_its_scene_once(method, counts, tmp_path):
    (tmp_path / "scene.toml").write_text(TEXT)
    scene = load_scene(tmp_path / "scene.toml", [f"time.method={method}"])
    outcome = run_scene.run_scene(scene, tmp_path / "out")
    assert outcome.status == "done"
    assert outcome.summary["frames"] == 5
    assert counts.pop("principal_stretches") == 5 + 1  # frames, and the picture of the report
    made = {f"{cls.__name__}.{name}" for cls, name in MAKERS} | {"refuse_unstable"}
    assert counts == dict.fromkeys(made, 1)
