"""Levels of dt where the error, the work or the stability limit chooses the steps."""

import numpy as np
import pytest

import fecloth as fc

SCENE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.2, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 100.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
probes = [{ name = "tip", where = "right" }]
time = { TIME, t_end = 0.2 }
"""
CHOSEN = {
    "error": 'method = "bdf2", rtol = 0.3',
    "work": 'method = "auto"',
    "stability": 'method = "central_difference"',
}


def levels(tmp_path, time, **options):
    file = tmp_path / "swing.toml"
    mass = 'mass = "lumped"\n' if "central" in time else ""
    file.write_text(mass + SCENE.replace("TIME", time))
    return fc.study.converge(file, "tip.z", refine="dt", **{"levels": 3} | options)


@pytest.mark.parametrize("time", CHOSEN.values(), ids=CHOSEN)
def test_each_level_takes_the_steps_of_the_level_before_in_halves(time, tmp_path):
    study = levels(tmp_path, time)
    first, second, third = (row["sizes"] for row in study.levels)
    assert not np.allclose(first[:5], first[0], rtol=1e-9) or "central" in time
    assert second == pytest.approx(np.repeat(first, 2) / 2)
    assert third == pytest.approx(np.repeat(first, 4) / 4)
    steps = [row["steps"] for row in study.table]
    assert steps == [steps[0], 2 * steps[0], 4 * steps[0]]


def test_the_values_have_the_order_of_the_method(tmp_path):
    """Against fixed steps that are far smaller."""
    fixed = levels(tmp_path, 'method = "bdf2", dt = 0.001').table[-1]["value"]
    study = levels(tmp_path, CHOSEN["error"], levels=4)
    *_, before, last = (abs(row["value"] - fixed) for row in study.table)
    assert 2.5 < before / last < 6
