"""Values far beyond any cloth are refused by name, without a warning of NumPy."""

import pytest
from support.wrong_calls import fan

import fecloth as fc
from fecloth.simulation.step_times import coarse_clock
from fecloth.system.pins import Motion

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.1 }
"""


def load(tmp_path, *overrides):
    (tmp_path / "sheet.toml").write_text(SCENE + "#" * 800_000)  # of at most 1e6 bytes
    return fc.load_scene(tmp_path / "sheet.toml", overrides)


@pytest.mark.parametrize(
    "override",
    [
        'start.velocity=["0.5e6","0","0"]',  # of at most 1e6 m/s
        "terms.1.acceleration=[0,0,2e16]",  # of a node of 0.0125 kg, with at most 1e15 N
        "time.dt=1.25e-8",  # 8 of at most 10 million steps
    ],
)
def test_large_values_within_their_limits_are_allowed(override, tmp_path):
    """What is beyond them is refused in `tests/messages/mistakes.txt`."""
    load(tmp_path, override).build()


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


@pytest.mark.parametrize(("degrees", "parts"), [(355, 6), (180, 3), (359.9, 40)])
def test_a_fan_of_less_is_allowed(degrees, parts):
    assert len(fan(degrees, parts).triangles) == parts
