"""Doubts are objects: what follows from one depends on its kind, never on its words."""

import json
import warnings

import numpy as np
import pytest
from support.matrices import hide
from support.planned import warnings_before
from support.wrong_calls import START, SYSTEM

import fecloth as fc
from fecloth.linalg.prices import Prices
from fecloth.simulation.doubts.course import find_slow_factors

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 0.5
h = 0.25
pattern = "right"
[fabric]
areal_density = 150
tensile_stiffness = 1000.0
poisson_ratio = 0.3
[[terms]]
type = "StVK"
[[terms]]
type = "Gravity"
acceleration = [0, 0, -981]
[[pins]]
where = "left"
[time]
method = "backward_euler"
dt = 0.05
t_end = 0.2
"""


def test_the_summary_has_kind_words_and_remedy(tmp_path):
    (tmp_path / "strip.toml").write_text(SCENE)
    outcome = fc.run_scene(fc.load_scene(tmp_path / "strip.toml"), tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    first = summary["doubts"][0]
    assert first == {
        "kind": "units",
        "words": "areal_density = 150 kg/m²: cloth has 0.01 to 1",
        "remedy": "If you meant g/m², write 0.15",
    }
    assert "check: areal_density = 150" in (tmp_path / "out" / "run.log").read_text()
    spoiling = [doubt for doubt in outcome.doubts if doubt.kind.spoils]
    assert summary["warnings"] == list(outcome.warnings) == list(map(str, spoiling))
    assert [fc.Doubt.of_entry(entry) for entry in summary["doubts"]] == list(outcome.doubts)


@pytest.mark.parametrize(
    ("remedy", "sentence"),
    [("", "words"), ("take P2", "words; take P2"), ("Take P2", "words. Take P2")],
)
def test_the_sentence_of_a_doubt_ends_with_its_remedy(remedy, sentence):
    assert str(fc.Doubt(fc.DoubtKind.MESH, "words", remedy)) == sentence


def test_a_kind_spoils_an_answer_or_asks_for_a_check_or_is_a_note():
    kinds = {label: set() for label in ("warning", "check", "note")}
    for kind in fc.DoubtKind:
        kinds[kind.label].add(kind.value)
        assert kind.spoils == (kind.label == "warning")
    assert kinds["check"] == {"units", "terms", "no_effect", "pins", "step", "speed"}
    assert kinds["note"] == {"start", "mesh", "edges", "weight", "round_off", "wrinkles"}


def test_notes_and_mistakes_are_no_warnings_of_a_result():
    """A sheet of a heavy fabric, without bending, that folds as finely as its mesh."""
    cloth = fc.Cloth.rectangle(0.6, 0.6, h=0.1, pattern="cross")
    fabric = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=1e-5)
    system = fc.System(cloth, fabric, [fc.StVK()], pins=["boundary"])
    start = system.state(0.98 * system.rest().x)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fc.run(system, fc.BackwardEuler(), start, 1e-3, 2e-3)
    assert [doubt.kind.value for doubt in result.doubts] == ["no_effect"]
    assert result.warnings == ()
    assert [str(w.message) for w in caught] == [str(result.doubts[0])]
    assert "warning" not in repr(result)


def test_a_run_whose_factors_would_be_faster_says_so_with_the_factor(monkeypatch):
    method, system, start = fc.BDF2(), SYSTEM, START
    for packages, said in (((), False), (("pypardiso",), False), (("rslab",), True)):
        hide(monkeypatch, *packages)
        for chosen in (method, fc.CentralDifference()):
            words = warnings_before(system, 0.01, method=chosen, doubts=[find_slow_factors])
            assert bool(words) == (said and chosen is method)
    factors = Prices.of(system.pattern).factors
    ratio = np.divide(
        *(factors[name].factor * factors[name].entries for name in ("superlu", "rslab"))
    )
    with pytest.warns(fc.FeclothWarning, match=f"about {ratio:.0f} times as long as by rslab"):
        fc.equilibrium(system, start, tolerance=1e-6)
