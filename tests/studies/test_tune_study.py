"""The study of tuning: its references are exact enough, its grid finds the cheapest setting."""

import math

import pytest

from studies.tune import contact, grid, references, unseen
from studies.tune.grid import Combination, Found, Node
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


def test_reference_of_another_scene_is_refused():
    other = next(one for one in TWELVE if one.name == "folds")
    with pytest.raises(Exception, match="is missing or belongs to another scene"):
        references.read(other)


def test_the_strip_has_the_sag_of_the_closed_form():
    """The strip of hanging_strip.toml sags by 23.426817 mm."""
    strip = references.read(next(one for one in TWELVE if one.name == "strip"))
    assert strip.values["sag"] == pytest.approx(0.023426817, rel=1e-5)


def fake(node: Node) -> Found:
    """Errors h² + dt and costs 1/(h² dt) of one method, four times both of the other."""
    h, dt = 2 ** (-node.i / 2), 2.0**-node.j
    worse = 1.0 if node.combination.method == "good" else 4.0
    error = worse * (0.3 * h**2 + 0.1 * dt)
    return Found(node, None, "ok", worse * 0.01 / (h**2 * dt), error)


def test_search_finds_the_cheapest_setting_that_meets_the_tolerance():
    tried = LIMITED[0]
    combinations = [Combination("P1", "good"), Combination("P1", "bad")]
    done = list(grid._in_order_of_cost(tried, combinations, fake, math.inf))
    every = [fake(Node(c, i, j)) for c in combinations for i in range(20) for j in range(10)]
    cheapest = min(grid._good(tried, every), key=lambda one: one.seconds)
    assert grid.best_of(tried, done)[0] == cheapest.node
    assert len(done) < len(every) / 2


def test_search_stops_at_the_longest_time():
    tried = LIMITED[0]
    done = list(grid._in_order_of_cost(tried, [Combination("P1", "good")], fake, 0.05))
    assert done
    assert not grid.best_of(tried, done)


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
