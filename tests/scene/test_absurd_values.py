"""Values far beyond any cloth are refused by name, without a warning of NumPy."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError, MeshError
from fecloth.simulation.step_times import coarse_clock
from fecloth.system.pins import Motion

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.1 }
"""


def load(tmp_path, *overrides, text=SCENE):
    (tmp_path / "sheet.toml").write_text(text)
    return fc.load_scene(tmp_path / "sheet.toml", overrides)


def test_the_largest_speed_of_a_node_is_a_million_metres_a_second(tmp_path):
    load(tmp_path, 'start.velocity=["0.5e6","0","0"]').build()
    with pytest.raises(InputError, match="must be at most 1e"):
        load(tmp_path, 'start.velocity=["2e6","0","0"]').build()


def test_the_largest_force_on_a_node_is_1e15_newtons(tmp_path):
    heaviest = load(tmp_path).build().system.nodal_mass.max()
    load(tmp_path, f"terms.1.acceleration=[0,0,{0.5e15 / heaviest:.6e}]").build()
    with pytest.raises(InputError, match="must be at most 1e"):
        load(tmp_path, f"terms.1.acceleration=[0,0,{2e15 / heaviest:.6e}]").build()


def test_a_scene_has_at_most_ten_million_steps(tmp_path):
    load(tmp_path, f"time.dt={0.1 / 8e6!r}")
    with pytest.raises(InputError, match="makes 1.2e.07 steps"):
        load(tmp_path, f"time.dt={0.1 / 1.2e7!r}")


def test_a_file_of_more_than_a_million_bytes_is_no_scene(tmp_path):
    load(tmp_path, text=f"{SCENE}#{'-' * 800_000}")
    with pytest.raises(InputError, match="must have at most 1000000"):
        load(tmp_path, text=f"{SCENE}#{'-' * 1_200_000}")


def test_a_motion_of_the_place_is_checked_at_some_of_the_times(tmp_path, monkeypatch):
    """Times × nodes are at most a million."""
    counts = []
    monkeypatch.setattr(Motion, "check", lambda motion, times: counts.append(len(times)))
    few, many = (f"time.dt={0.1 / steps!r}" for steps in (1000, 1_000_000))
    for override in (few, many):
        load(tmp_path, override, 'pins.0.motion=["X*t","Y*t","0"]').build()
    assert counts[0] == 1001
    assert 300_000 < 3 * counts[1] <= 1_000_000


def test_ordinary_times_are_allowed():
    for t, dt in ((0.0, 1e-9), (1.0, 1e-9), (3600.0, 1e-8), (1e6, 1e-3), (1e12, 1.0)):
        assert coarse_clock(t, dt) == ""
    assert coarse_clock(1e12, 1e-5)


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.Adaptive(fc.BDF2())], ids=str)
def test_chosen_steps_below_the_rounding_of_the_time_fail(method):
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.25, "right")
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], ["left"])
    start = system.state(system.rest().x, t=1e12)
    with pytest.raises(fc.StepFailed, match="is known to") as failed:
        list(fc.march(system, method, start, t_end=1e12 + 10))
    assert "Start earlier" in str(failed.value)


# --- meshes ---------------------------------------------------------------------------------------


def fan(degrees: float, parts: int, is_closed: bool = False):
    """Triangles around the origin, that turn by so many degrees altogether."""
    angles = np.radians(np.linspace(0.0, degrees, parts + 1))
    radii = 1.0 + 0.1 * np.arange(parts + 1)  # a spiral, so that no nodes coincide
    X = np.vstack([[0.0, 0.0], np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])])
    return X, [[0, i, i + 1] for i in range(1, parts + 1)]


@pytest.mark.parametrize(("degrees", "parts"), [(365, 6), (400, 8), (500, 9), (1000, 30)])
def test_a_fan_of_more_than_360_degrees_is_refused(degrees, parts):
    with pytest.raises(MeshError, match="their angles add up to more than 360°: node 0"):
        fc.Cloth.from_arrays(*fan(degrees, parts))


def test_a_fan_of_two_turns_has_nodes_on_edges_and_is_refused_for_them():
    with pytest.raises(MeshError, match="nodes in the middle of an edge .*: node 1, node 7"):
        fc.Cloth.from_arrays(*fan(720, 12))


@pytest.mark.parametrize(("degrees", "parts"), [(355, 6), (180, 3), (359.9, 40)])
def test_a_fan_of_less_is_allowed(degrees, parts):
    assert len(fc.Cloth.from_arrays(*fan(degrees, parts)).triangles) == parts
