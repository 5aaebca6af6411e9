"""The study of tuning: its references are exact enough, its grid finds the cheapest setting."""

import pytest

from studies.tune import references
from studies.tune.scenes import TWELVE

pytestmark = pytest.mark.stories

LIMITED = [each for each in TWELVE if each.has_limit]


@pytest.mark.parametrize("tried", LIMITED, ids=lambda each: each.name)
def test_reference_is_known_to_a_tenth_of_the_tolerance(tried):
    stored = references._file()[tried.name]
    assert stored["scene"] == references.fingerprint(tried)
    assert len(stored["quantities"]) == len(references.quantities_of(tried))
    for each in stored["quantities"].values():
        assert 0 < each["uncertainty"] <= tried.tolerance / 10


def test_the_strip_has_the_sag_of_the_closed_form():
    """The strip of hanging_strip.toml sags by 23.426817 mm."""
    strip = references.read(next(each for each in TWELVE if each.name == "strip"))
    assert strip.values["sag"] == pytest.approx(0.023426817, rel=1e-5)
