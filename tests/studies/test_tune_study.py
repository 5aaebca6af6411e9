"""The study of tuning: its references are exact enough, its grid finds the cheapest setting."""

import pytest

from fecloth.study.problem import StudyProblem
from studies.tune import contact, grid, references, unseen
from studies.tune.scenes import TWELVE

pytestmark = pytest.mark.stories

LIMITED = [one for one in TWELVE if one.has_limit]


@pytest.mark.parametrize("tried", LIMITED, ids=lambda one: one.name)
def test_reference_is_known_to_a_tenth_of_the_tolerance(tried):
    stored = references._file()[tried.name]
    assert stored["scene"] == references.fingerprint(tried)
    assert len(stored["quantities"]) == len(references.quantities_of(tried))
    for one in stored["quantities"].values():
        assert 0 < one["uncertainty"] <= tried.tolerance / 10


def test_the_strip_has_the_sag_of_the_closed_form():
    """The strip of hanging_strip.toml sags by 23.426817 mm."""
    strip = references.read(next(one for one in TWELVE if one.name == "strip"))
    assert strip.values["sag"] == pytest.approx(0.023426817, rel=1e-5)


@pytest.mark.parametrize("tried", LIMITED, ids=lambda one: one.name)
def test_the_stored_best_settings_are_settings_of_the_scene(tried):
    problem = StudyProblem.of(tried.scene())
    for choice in grid.read_best(tried):
        tables = problem.choose(**choice).tables
        assert tables["cloth"]["h"] == choice["h"]
        assert tables["cloth"]["element"] == choice["element"]


@pytest.mark.parametrize("drawn", [unseen, contact], ids=["unseen", "contact"])
def test_a_seed_draws_the_same_scenes_and_another_draws_others(drawn):
    first, again, other = (drawn.draw(seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    for tried in (*first, *other):
        assert tried.scene().build().system.cloth.area > 0


def test_the_reference_of_a_scene_with_contact_has_a_finer_gap():
    for tried in contact.draw(3):
        scene, fine = tried.scene(), tried.scene(tried.fine)
        assert fine.terms[-1].gap == pytest.approx(scene.terms[-1].gap / contact.FINER, rel=1e-2)
