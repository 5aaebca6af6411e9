"""States of an equilibrium: from plain rows, and of a disc that drapes."""

from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.quantity import parse_quantity
from fecloth.study import states
from fecloth.study.laying import describe_state, lay, ways_of_laying
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs
from fecloth.study.states import find_states, may_have_others, run_other_starts

pytestmark = pytest.mark.filterwarnings("ignore")

SAG = parse_quantity("sag")


def row(value, folds=None, compressed=0.5, **more):
    source = SimpleNamespace(probes=())
    problem = SimpleNamespace(source=source, cloth_for=lambda quantity: None)
    return {
        "status": "ok",
        "problem": problem,
        "folds": folds,
        "compressed": compressed,
        "ends": {"sag": [0.0, value]},
        "columns": {},
        "times": [0.0, 1.0],
        "displacement": [[0.0]],
        "velocity": [[0.0]],
        "doubts": [],
        **more,
    }


@pytest.fixture
def same_branch(monkeypatch):
    """The shapes of plain rows are not known."""
    monkeypatch.setattr(states, "leaves_branch", lambda levels: False)


def start(value, folds=None, level=2, **more):
    return row(value, folds, **more) | {"level": level}


@pytest.mark.usefixtures("same_branch")
def test_levels_with_other_folds_are_several_states():
    levels = [row(0.566, 5.0), row(0.52297, 4.0), row(0.52274, 4.0)]
    result = find_states(SAG, levels, [start(0.5228, 4.0)], uncertainty=7e-4)
    assert result.states == ((0.52274, 4.0), (0.566, 5.0))
    assert result.distance == pytest.approx(0.566 - 0.52274)
    assert result.why == "several states: 0.523 with 4 folds, 0.566 with 5 folds"


@pytest.mark.usefixtures("same_branch")
@pytest.mark.parametrize(
    ("value", "folds", "uncertainty", "is_other"),
    [
        (0.58, 5.0, 1e-3, True),
        (0.58, 4.0, 1e-3, True),  # another state with as many folds
        (0.58, 4.0, 0.1, False),  # within the uncertainty
        (0.58, 5.0, 0.1, True),
        (0.5202, 4.0, 1e-5, False),  # the same for an engineer
        (0.5202, 4.0, np.nan, False),  # no limit is seen
        (0.58, 4.0, np.nan, True),
    ],
)
def test_a_start_has_another_state_by_its_folds_or_its_value(value, folds, uncertainty, is_other):
    levels = [row(0.53, 4.0), row(0.522, 4.0), row(0.52, 4.0)]
    result = find_states(SAG, levels, [start(0.52, 4.0), start(value, folds)], uncertainty)
    assert (len(result.states) == 2) == bool(result.why) == is_other
    assert result.distance == pytest.approx((value - 0.52) * is_other)


@pytest.mark.usefixtures("same_branch")
def test_a_start_is_compared_with_its_own_level():
    levels = [row(0.60), row(0.55), row(0.52)]
    assert not find_states(SAG, levels, [start(0.60, level=0)], 1e-3).why
    assert find_states(SAG, levels, [start(0.60)], 1e-3).why == "several states: 0.52, 0.6"


def test_without_another_start_at_rest_nothing_is_known():
    levels = [row(0.60), row(0.55), row(0.52)]
    unstable = Doubt(DoubtKind.INSTABILITY, "words", "remedy").entry()
    for starts in ([], [start(0.8, status="failed")], [start(0.8, doubts=[unstable])]):
        assert find_states(SAG, levels, starts, 1e-3).is_unknown
    for part in (0.0, 0.0099):  # in tension: one state only
        others = [row(0.6, 5.0, part), row(0.55, 4.0, part), row(0.52, 4.0, part)]
        assert find_states(SAG, others, [], 1e-3) == states.States()
        assert not may_have_others(others[-1])


@pytest.mark.parametrize(
    ("last", "leaves"),
    [(0.05, False), (0.099, False), (0.101, True), (0.3, True)],
)
@pytest.mark.parametrize("size", [1.0, 100.0])
def test_a_last_change_of_shape_as_large_as_the_one_before_leaves_the_branch(last, leaves, size):
    """Unless both are small beside the displacement: then the levels are one state."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    shape = np.ones((len(cloth.X), 3))
    rows = [row(0.5) for _ in range(3)]
    for each, factor in zip(rows, (size, size + 0.1, size + 0.1 + last), strict=True):
        each["problem"].cloth_for = lambda quantity: cloth
        each["displacement"] = factor * shape
        each["velocity"] = 0 * shape
    assert states.leaves_branch(rows) == (leaves and size == 1.0)
    result = find_states(SAG, rows, [start(0.5)], 1e-3)
    assert result.why.startswith("the levels are different") == (leaves and size == 1.0)
    assert result.is_unknown == (leaves and size == 1.0)  # so that no ± is stated


def test_a_fit_names_cloths_with_other_folds_on_the_finer_mesh():
    told = states.describe_several_states({"a": 5.0, "b": 4.0}, {"a": 4.0, "b": 4.0, "c": 2.0})
    assert len(told) == 1
    assert told[0].startswith("a: several states: 5 folds, and 4 on the finer mesh")


# --- ways of laying -------------------------------------------------------------------------------


def sheet(h, radius=0.0, width=0.3):
    if radius:
        cloth = fc.Cloth.disk(radius, h)
        pins = [fc.Pin(lambda X: np.hypot(*X.T) < 0.6 * radius)]
    else:
        cloth, pins = fc.Cloth.rectangle(width, 0.2, h), ["left"]
    fabric = fc.Fabric(0.15, 1000.0, bending_rigidity=1e-5)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins)
    return cloth, system, None, system.rest()


def test_a_round_cloth_is_laid_in_waves_and_its_pins_hold():
    setup = StudyProblem.of(sheet, h=0.03, arguments={"radius": 0.15}).setup()
    assert ways_of_laying(setup, 5.0) == ["waves 4", "waves 6", "flat 1", "waves 3"]
    for folds in (3, 4, 6):
        x = lay(setup, f"waves {folds}").start.x
        told = describe_state(setup, x)
        assert told["folds"] == folds
        held = setup.system.constraints.nodes
        np.testing.assert_array_equal(x[held], setup.start.x[held])
        assert x[:, 2].min() >= 0  # upward, away from what is below
        assert x[:, 2].max() == pytest.approx(0.02 * 0.3, rel=0.05)
    assert describe_state(setup, setup.start.x) == {"folds": 0.0, "compressed": 0.0}
    squeezed = setup.start.x * [0.99, 0.99, 1.0]
    assert describe_state(setup, squeezed)["compressed"] == pytest.approx(1.0)


@pytest.mark.parametrize("quiet", [False, True])
def test_other_starts_are_announced_with_what_they_may_take(quiet, monkeypatch, capsys):
    problem = SimpleNamespace(work=SimpleNamespace(seconds=2.0), first=None)
    level = row(0.5, case_seconds=3.0, problem=problem)
    monkeypatch.setattr(states, "ways_of_laying", lambda setup, folds: ["flat 1", "flat 2"])
    monkeypatch.setattr(states, "run_quantities", lambda runs, *how: [row(0.5, case_seconds=3.0)])
    assert len(run_other_starts([level], [SAG], Runs(quiet=quiet))) == 2
    told = capsys.readouterr().err
    assert ("up to 2 other starts, about 3 s each" in told) != quiet


def test_an_equilibrium_is_looked_for_in_twice_as_many_load_steps_too():
    setup = StudyProblem.of(sheet, h=0.05).setup()
    resting = setup.taking(LoadSteps(load_steps=3))
    assert ways_of_laying(resting, None) == ["in more steps", "flat 1", "flat 2", "dropped"]
    laid = lay(resting, "in more steps")
    assert laid.steps == LoadSteps(load_steps=6)
    np.testing.assert_array_equal(laid.start.x, setup.start.x)


def test_any_other_cloth_is_laid_flat_from_a_bent_start():
    setup = StudyProblem.of(sheet, h=0.05).setup()
    assert ways_of_laying(setup, None) == ["flat 1", "flat 2"]
    bent = setup.raised(0.01 * np.sin(np.pi * setup.cloth.X[:, 0] / 0.3))
    laid = [lay(bent, way).start.x for way in ("flat 1", "flat 2")]
    assert 0 < np.abs(laid[0] - laid[1]).max() <= 2e-3 * 0.3
    for x in laid:
        places = np.column_stack([setup.cloth.X, np.ones(len(x))])
        plane = places @ np.linalg.lstsq(places, x, rcond=None)[0]
        assert np.abs(x - plane).max() < 0.5 * np.abs(bent.start.x[:, 2]).max()


# --- the drape specimen ---------------------------------------------------------------------------


@pytest.mark.stories
def test_a_drape_is_not_said_to_be_known_better_than_its_states(tmp_path, monkeypatch):
    """On coarse meshes, a line of KES and a measured value: neither ± 0.0007 nor a wrong model."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "drape", "--test", "drape"]) == 0
    path = tmp_path / "drape.toml"
    before, _, rest = path.read_text().partition("[fabric]")
    kes = "[fabric]\nkes = { W = 15.0, EMT = [4, 6], G = 0.6, B = [0.06, 0.04] }\n\n"
    path.write_text(before + kes + rest[rest.index("[[terms]]") :])
    study = fc.study.of(fc.load_scene(path, ["cloth.h=0.05"]), cache=tmp_path)
    refined = study.converge("drape_coefficient", levels=3)
    starts = run_other_starts(refined.levels, [parse_quantity("drape_coefficient")], study.runs())
    assert starts
    coefficients = [row["columns"]["drape_coefficient"][-1] for row in starts]
    own = [refined.levels[row["level"]]["columns"]["drape_coefficient"][-1] for row in starts]
    apart = np.abs(np.subtract(coefficients, own)).max()
    assert apart > 1e-3  # they are other states
    assert refined.uncertainty >= apart
    assert not refined.converges
    measured = {"drape_coefficient": (refined.value + 0.08, 0.024)}
    answer = study.budget(measured=measured, quantity="drape_coefficient")
    assert answer.unknown  # a line of KES has no uncertainties: neither agrees nor does not
    assert answer.agrees is None
    assert 0.07 < abs(answer.difference) <= 2 * answer.total
    assert answer.total > apart / 2
    for row_of_level in refined.levels[1:]:
        assert row_of_level["newton"] < refined.levels[0]["newton"]
