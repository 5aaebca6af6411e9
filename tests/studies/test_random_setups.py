"""Random set-ups of the study of trust: how they are drawn, and their verdicts."""

import numpy as np
import pytest

from studies.evidence.trust.drawn import draw
from studies.evidence.trust.random_setups import findings_of, is_judged, verdict

pytestmark = pytest.mark.stories


def test_a_seed_draws_the_same_set_up_with_finer_steps():
    drawn = draw(1, 16)
    run, finer = drawn.build(), drawn.build(4)
    assert draw(1, 16).words == drawn.words != draw(2, 16).words
    assert finer.dt == pytest.approx(run.dt / 4)
    assert finer.t_end == run.t_end
    assert np.array_equal(finer.state.x, run.state.x)


def row(error, kinds="", stated=0.02):
    row = {"status": "ok", "failed": False, "counts": True, "error": error, "kinds": kinds}
    row |= {"stated": stated, "apart": 1e-6}
    return row | {"error_of_deformation": error, "stated_of_deformation": stated}


def test_verdicts():
    assert verdict(row(0.01)) == "good, silent"
    assert verdict(row(0.01, "time")) == "good, warned"
    assert verdict(row(0.01, "intersection")) == "good in time, passes through itself"
    assert verdict(row(0.01, "time, intersection")) == "good, warned"
    assert verdict(row(0.05, "time")) == "between, warned"
    assert verdict(row(0.2)) == "wrong, silent"
    assert verdict(row(0.01) | {"counts": False}) == "does not count"
    assert verdict(row(0.01) | {"failed": True}) == "failed"


def test_findings():
    rows = [row(0.01)] * 19 + [row(0.01, "time"), row(0.2, "time", stated=0.3)]
    assert all(finding.is_met for finding in findings_of(rows, 21))
    assert not all(finding.is_met for finding in findings_of([*rows, row(0.2, stated=0.3)], 1))
    assert not all(finding.is_met for finding in findings_of([*rows, row(0.01, "time")], 1))
    assert not all(
        finding.is_met for finding in findings_of([*rows, *[row(0.01, stated=0.009)] * 3], 1)
    )
    assert not all(
        finding.is_met for finding in findings_of([*rows, *[row(0.01, stated=0.051)] * 3], 1)
    )
    assert not is_judged(row(0.5))


@pytest.mark.parametrize(("silent", "met"), [(2, True), (3, False)])
def test_an_error_that_is_not_resolved_counts_as_no_number(silent, met):
    """Of eight set-ups with a number and two or three without one, 80 % and 73 % have one."""
    none = row(0.01, stated=1.0)
    assert is_judged(none)
    (share,) = (
        finding
        for finding in findings_of([row(0.01)] * 8 + [none] * silent, 1)
        if "with a number" in finding.what
    )
    assert share.value == pytest.approx(8 / (8 + silent))
    assert share.is_met == met
