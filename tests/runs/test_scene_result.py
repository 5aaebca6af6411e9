"""`run_scene` returns what `run` returns, from the files of its folder."""

from dataclasses import fields

import numpy as np
import pytest

import fecloth as fc

SCENE = """
fabric = {areal_density = 0.2, tensile_stiffness = 1000.0}
terms = [{type = "StVK"}, {type = "Gravity"}]
pins = [{where = "left"}]
probes = [{name = "tip", where = "right"}]
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25 }
time = { method = "implicit_midpoint", dt = 0.01, t_end = 0.1 }
"""


def build():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25)
    return fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], ["left"])


@pytest.mark.filterwarnings("ignore:.*error in time")
def test_it_has_the_arrays_of_run_bit_for_bit(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    result = fc.run_scene(fc.load_scene(tmp_path / "scene.toml"), tmp_path / "out")
    assert isinstance(result, fc.Result)
    assert result.status == "done"
    system = build()
    tip = [fc.Probe("tip", "right")]
    same = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=0.01, t_end=0.1, probes=tip)
    np.testing.assert_array_equal(result.times, same.times)
    np.testing.assert_array_equal(result.state.x, same.state.x)
    for name in ("energies", "observed"):
        ours, theirs = getattr(result, name), getattr(same, name)
        assert ours.keys() == theirs.keys()
        for key, values in theirs.items():
            np.testing.assert_array_equal(ours[key], values)
    assert {field.name for field in fields(fc.Result)} <= vars(result).keys()
    for name in ("newton", "linear", "shape", "time_error", "quantities"):
        assert getattr(result, name) == getattr(same, name)
    assert "done after 10 steps at t = 0.1 s" in repr(result)


def test_a_failed_run_has_the_arrays_up_to_its_last_good_step(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    method = '{type = "symplectic_euler", beyond_limit = true}'
    settings = [f"time.method={method}", "time.dt=0.02", "time.t_end=2"]
    result = fc.run_scene(fc.load_scene(tmp_path / "scene.toml", settings), tmp_path / "out")
    assert result.status == "failed"
    assert result.error is not None
    assert 1 < len(result.times) == len(result.observed["tip.z"]) == len(result.energies["StVK"])
    assert result.times[-1] == result.state.t
