"""P2 without bending, against closed forms: the catenary, and the waves of a taut strip."""

import pytest

from studies.evidence.models.strains import STRAINS, slack, taut


@pytest.mark.parametrize("strain", STRAINS)
def test_frequencies_of_a_taut_strip_converge_with_order_4(strain):
    coarse, fine = (taut(h, strain) for h in (1 / 4, 1 / 8))
    assert 1.7e-3 < coarse < 2.5e-3
    assert 10 < coarse / fine < 16
    assert fine == pytest.approx(taut(1 / 8, "pointwise"), rel=1e-6)


def test_a_slack_strip_locks_with_the_pointwise_strain_only():
    locked, free = (slack(1 / 4, strain) for strain in ("pointwise", "interpolated"))
    assert 0.03 < locked < 0.04
    assert abs(free) < 5e-4
    assert slack(1 / 4, "interpolated", 1e7) == pytest.approx(free, abs=1e-4)
    assert 3.5 < locked / slack(1 / 8, "pointwise") < 4.5
