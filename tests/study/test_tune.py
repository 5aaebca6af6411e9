"""The command that chooses a setting by its error and its cost."""

import math

import fecloth as fc


def pulled_strip(h, dt):
    """A strip, held at its left edge, that its weight begins to stretch."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="cross")
    terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, 200.0), terms, pins=["left"])
    return cloth, system, fc.ImplicitMidpoint(), system.rest()


def test_a_motion_is_tuned_and_runs_that_only_measure_seconds_have_no_error():
    tip = [fc.Probe("tip", "right")]
    tuned = fc.tune(pulled_strip, "3%", "tip.x", h=0.1, dt=0.005, t_end=0.05, probes=tip)
    assert tuned.proved
    assert 0 < tuned.error < 0.03
    rows = [row for row in tuned.table.rows if row["status"] == "ok"]
    assert any("error %" not in row for row in rows)
    assert all(math.isfinite(row["error %"]) for row in rows if row["run"] != "search")
