"""`simplify` of a user's function: its terms, h and dt."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.setup import Setup
from fecloth.study.function_source import with_terms

pytestmark = [
    pytest.mark.stories,
    pytest.mark.usefixtures("counted_work"),
    pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning"),
]
TIP = [fc.Probe("tip", "right")]
FABRIC = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-6)
AIR = fc.Drag(normal=1e-6)


def falling_strip(h, dt=0.01, bends=True, air=True):
    """Return a strip that falls; its drag is too small to matter."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    terms = [fc.StVK(), *[fc.HingeBending()] * bends, fc.Gravity(), *[AIR] * air]
    system = fc.System(cloth, FABRIC, terms, pins=["left"])
    return cloth, system, fc.BackwardEuler(), system.rest()


def end_of(h, dt=0.01, **parts):
    """Run the strip by the plain functions of fecloth; return the tip at the end."""
    _, system, method, start = falling_strip(h, **parts)
    run = fc.run(system, method, start, dt, 0.1, probes=TIP)
    return run.observed["tip.z"][-1]


@pytest.fixture(scope="module")
def simplified(counted_work):
    run = {"h": 0.1, "dt": 0.01, "t_end": 0.1, "probes": TIP, "repeats": 1}
    return fc.study.simplify(falling_strip, "5%", "tip.z", **run)


@pytest.mark.parametrize(
    ("variant", "changed"),
    [
        ("without Drag", {"air": False}),
        ("without HingeBending", {"bends": False}),
        ("h × 2", {"h": 0.2}),
        ("dt × 2", {"dt": 0.02}),
        ("dt × 0.5", {"dt": 0.005}),
    ],
)
def test_changes_are_those_of_runs_by_hand(simplified, variant, changed):
    (row,) = [row for row in simplified.table if row["variant"] == variant]
    full = end_of(0.1)
    expected = abs(end_of(**({"h": 0.1} | changed)) / full - 1)
    assert row["tip.z [%]"] == pytest.approx(100 * expected, rel=1e-3, abs=1e-5)


def test_what_is_needed_stays_and_the_rest_goes(simplified):
    assert simplified.scene is None
    assert simplified.file == "reduced.txt"
    first, *_ = simplified.reduced.splitlines()
    assert "Gravity" in first
    assert "Drag" not in first
    assert simplified.change <= 0.05
    verdicts = {row["variant"]: row["verdict"] for row in simplified.table}
    assert verdicts["without Gravity"] == "needed"
    assert not {name for name in verdicts if "explicit" in str(name)}  # the method is the user's


def test_the_list_of_what_is_left_is_written(simplified, tmp_path):
    simplified.report(tmp_path)
    assert (tmp_path / "reduced.txt").read_text() == simplified.reduced
    assert not (tmp_path / "reduced.toml").exists()


def test_a_function_without_a_file_and_an_equilibrium():
    def bent(h):
        return *falling_strip(h)[:2], None, falling_strip(h)[3]

    simplified = fc.study.simplify(bent, "5%", "tip.z", h=0.25, probes=TIP, repeats=1)
    kinds = {str(row["variant"]) for row in simplified.table}
    assert {"without Drag", "h × 0.5", "h × 2"} <= kinds
    assert not any(name.startswith("dt") for name in kinds)


def test_terms_are_kept_replaced_and_pointwise_as_listed():
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right", element="P2")
    terms = [fc.StVK(strain="interpolated"), fc.PlateBending(), fc.Gravity()]
    pins = [fc.Pin("left", clamp=True)]
    system = fc.System(cloth, FABRIC, terms, pins)
    setup = Setup(system, system.rest())
    kept = {"type": "StVK", "number": 0, "strain": "interpolated"}
    plate, gravity = {"type": "PlateBending", "number": 1}, {"type": "Gravity", "number": 2}
    same = with_terms(setup, [kept, plate, gravity]).system
    assert same.terms == system.terms
    assert same.pins == system.pins
    other = with_terms(setup, [kept | {"strain": "pointwise"}, gravity]).system
    assert other.terms == (fc.StVK(strain="pointwise"), fc.Gravity())
    assert not other.pins[0].clamp
    rough = system.rest().x + 1e-3 * np.random.default_rng(0).standard_normal((len(cloth.X), 3))
    by_hand = fc.System(cloth, FABRIC, other.terms, ["left"])
    assert np.array_equal(other.force(system.state(rough)), by_hand.force(system.state(rough)))
