"""The study of tuning: its references are exact enough, its grid finds the cheapest setting."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import Line, Setting
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


def test_reference_of_another_scene_is_refused():
    other = next(one for one in TWELVE if one.name == "folds")
    with pytest.raises(Exception, match="is missing or belongs to another scene"):
        references.read(other)


def test_the_strip_has_the_sag_of_the_closed_form():
    """The strip of hanging_strip.toml sags by 23.426817 mm."""
    strip = references.read(next(one for one in TWELVE if one.name == "strip"))
    assert strip.values["sag"] == pytest.approx(0.023426817, rel=1e-5)


def exhaustive(errors, longest=math.inf, kind=grid.ExhaustiveSearch):
    """A search on made-up errors and seconds, by method: both are multiplied by `errors`."""

    class Made:
        """Errors h² + dt and costs 1/(h² dt)."""

        quantities = ("x",)
        left = 1e9
        settings = SimpleNamespace(can_be_finer=lambda setting: (True, True))

        def __init__(self):
            self.rows = {}

        def run(self, setting, most):
            h, dt = 2 ** (-setting.i / 2), 2.0**-setting.j
            worse = errors[setting.line.method]
            row = {"status": "ok", "cpu_seconds": worse * 0.01 / (h**2 * dt)}
            self.rows[setting] = row | {"error": worse * (0.3 * h**2 + 0.1 * dt)}

        def is_ok(self, setting):
            return setting in self.rows

        def took(self, setting):
            return self.rows[setting]["cpu_seconds"]

        def allows(self, seconds):
            return True

    limit = SimpleNamespace(
        uncertainty=np.zeros(1), error=lambda row: np.array([row["error"]]), is_known=True
    )
    made = kind(Made(), limit, 0.01, longest)
    made.add_lines([Line(method) for method in errors])
    assert made.run() == ""
    return made


def test_search_finds_the_cheapest_setting_that_meets_the_tolerance():
    made = exhaustive({"quick": 1.0, "slow": 4.0})
    every = exhaustive({"quick": 1.0, "slow": 4.0})
    for method, i, j in itertools.product(("quick", "slow"), range(20), range(10)):
        every.bench.run(Setting(Line(method), i, j), 0.0)
    assert made.bench.took(grid.meeting(made)[0]) == every.bench.took(grid.meeting(every)[0])
    assert len(made.bench.rows) < len(every.bench.rows) / 2


def test_search_leaves_no_setting_out_for_what_its_line_promises():
    made = exhaustive({"quick": 1.0, "slow": 4.0})
    usual = exhaustive({"quick": 1.0, "slow": 4.0}, kind=Search)
    assert usual.bench.rows.keys() < made.bench.rows.keys()


def test_search_stops_at_the_longest_time():
    made = exhaustive({"quick": 1.0}, longest=0.05)
    assert made.bench.rows
    assert not grid.meeting(made)


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
