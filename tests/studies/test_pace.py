"""The table of implicit steps a CPU second: its errors and its comparison with MuJoCo."""

import pytest

from studies.evidence.benchmarks import pace


def test_errors_are_those_of_the_step():
    system = pace.make_system(6, bends=True)
    reference = pace.run_reference(system)
    extent = pace.rms(reference - system.rest().x).max()

    def error(dt):
        positions, seconds = pace.run_fecloth(system, "ImplicitMidpoint", dt)
        assert seconds > 0
        return pace.rms(positions - reference).max() / extent

    long, short = error(5e-3), error(2.5e-3)
    assert 1e-4 < long < 0.02
    assert long / short == pytest.approx(4.0, rel=0.25)  # second order


def test_the_linearised_step_is_compared_with_mujoco_on_800_triangles():
    def row(method, rate, dt=5.0, triangles=800):
        common = {"triangles": triangles, "terms": "StVK", "method": method, "dt [ms]": dt}
        return common | {"steps a CPU second": rate}

    mine = [row(pace.LINEARISED, 400.0), row(pace.LINEARISED, 1.0, dt=1.0)]
    (finding,) = pace.findings_of([*mine, row(pace.PEER, 600.0), row(pace.PEER, 1.0, triangles=9)])
    assert finding.value == 1.5
    assert not finding.is_met
    assert pace.findings_of([*mine, row(pace.PEER, "not installed")]) == []
