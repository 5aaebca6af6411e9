"""What is predicted of a run, against what comes; warnings where there is reason, only there."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.planned import warnings_before
from support.strips import scene_file

import fecloth as fc
from fecloth.cli.main import main
from fecloth.scene import plan
from fecloth.scene.scene import load_scene
from fecloth.simulation import dimensionless
from fecloth.simulation.doubts.units import find_values_in_other_units
from studies.evidence.simplify.numbers import Numbers, table

TEXT = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.05, pattern = "cross" }
terms = [{ type = "StVK" }, { type = "HingeBending" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.02 }
[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
poisson_ratio = 0.3
bending_rigidity = 1e-4
"""


scene = scene_file(TEXT, "sheet")


def warnings_of(scene, *overrides):
    return [str(doubt) for doubt in load_scene(scene, overrides).build().doubts()]


SOFT = ["fabric.tensile_stiffness=10", "fabric.areal_density=0.4"]
MIDPOINT = "time.method=implicit_midpoint"
TERMS = 'terms=[{{type="StVK"}}, {{type="{}"}}, {{type="Gravity"}}, {{type="{}"{}}}]'
HUNG = ['start={plane="xz"}', "terms.2.acceleration=[0, 0, -0.01]"]
EULER = ["time.method=backward_euler", "time.dt=0.03", "time.t_end=0.09"]

NOTES = {  # overrides for the note, and what takes it away
    "starts in a plane": (HUNG, ['start={position=["X", "0.001 * sin(9 * X)", "Y"]}']),
    "the pins lie on a line": (
        ["fabric.bending_rigidity=2e-3"],
        ["pins.0={inside='X < 0.051'}"],
    ),
    "removes about 25 %": (EULER, ["time.method=bdf2"]),
    "may gain energy": ([MIDPOINT], ["time.method=energy_momentum"]),
    "and damping takes 5e-10 % a step from them": (
        [MIDPOINT, TERMS.format("HingeBending", "MassDamping", ", rate=1e-9")],
        [TERMS.format("HingeBending", "StrainRateDamping", ", time=0.01")],
    ),
}


@pytest.mark.parametrize("words", NOTES)
def test_a_fact_that_makes_nothing_wrong_is_a_note_and_no_warning(words, scene):
    overrides, other = NOTES[words]
    problem = load_scene(scene, overrides).build()
    (note,) = problem.notes()
    assert note.startswith("note: ")
    assert words in note
    assert note in plan.plan(problem, "")
    assert problem.doubts() == []
    assert load_scene(scene, [*overrides, *other]).build().notes() == []


@pytest.mark.parametrize(
    ("dt", "steps", "settles"), [(80, 4, 0), (125, 4, 1), (125, 8, 1), (125, 12.5, 0)]
)
def test_few_long_steps_of_backward_euler_seek_a_state_of_rest(dt, steps, settles, scene):
    given = ["time.method=backward_euler", f"time.dt={dt}", f"time.t_end={dt * steps}"]
    assert any("is large" in words for words in warnings_of(scene, *given)) != settles


def notes_of(scene, *overrides):
    return load_scene(scene, overrides).build().notes()


def test_no_note_of_a_plane_that_the_cloth_leaves(scene):
    assert notes_of(scene, *HUNG, 'start.velocity=["0", "1e-3", "0"]') == []
    assert notes_of(scene, *HUNG, "terms.2.acceleration=[0, 1e-3, -0.01]") == []
    motion = 'pins.0.motion=["0", "1e-3 * sin(t)", "0"]'
    assert notes_of(scene, *HUNG, motion, "time.t_end=1") == []


def test_no_warning_without_a_reason(scene):
    assert warnings_of(scene) == []
    damped = TERMS.format("HingeBending", "StrainRateDamping", ", time=0.001")
    assert warnings_of(scene, MIDPOINT, damped) == []
    assert warnings_of(scene, *SOFT, "pins=[]") == []
    assert warnings_of(scene, *SOFT, "terms.2.acceleration=[0, 0, -1]") == []
    assert warnings_of(scene, *EULER, TERMS.format("HingeBending", "MassDamping", ", rate=3")) == []


def implausible(fabric, cloth):
    system = fc.System(cloth, fabric, [fc.StVK()])
    return warnings_before(system, 0.01, doubts=[find_values_in_other_units])


def test_every_published_fabric_is_of_a_fabrics_magnitude(sheet):
    for name in fc.Fabric.presets():
        assert implausible(fc.Fabric.preset(name), sheet) == []


def test_a_roof_membrane_is_no_mistake_and_a_hem_in_another_unit_is_one(sheet):
    """What else is one has its limits in tests/simulation/doubts/test_doubt_thresholds.py."""
    roof = fc.Fabric.sheet(E=1520e6, nu=0.3, thickness=0.82e-3, rho=1050 / 0.82)
    assert implausible(roof, sheet) == []
    (told,) = implausible(fc.Fabric(0.5, 1520e6), sheet)
    assert "Fabric.sheet" in told
    left = sheet.X[sheet.triangles, 0].mean(axis=1) < 0.5
    regions = {"body": np.flatnonzero(left), "hem": np.flatnonzero(~left)}
    parted = fc.Cloth.from_arrays(sheet.X, sheet.triangles, regions=regions)
    (told,) = implausible({"body": roof, "hem": fc.Fabric(1e-4, 1000.0)}, parted)
    assert told.startswith("hem.areal_density = 0.0001 kg/m²")


WEIGHTS = [  # overrides, L [m], B [N m], its words
    ([], 1.0, 1e-4, "the reach from the pins"),
    (["pins.0.where=boundary"], 0.5, 1e-4, "twice the reach from the pins around"),
    (["pins.0.where=corners"], 1.25**0.5, 1e-4, "twice the reach from the pins around"),
    (["fabric.bending_rigidity=[1e-4, 2e-5]"], 1.0, 2e-5, "the reach from the pins"),
]


@pytest.mark.parametrize(("overrides", "length", "rigidity", "words"), WEIGHTS)
def test_plan_states_weight_over_bending_stiffness(
    overrides, length, rigidity, words, scene, capsys
):
    number = 0.2 * 9.81 * length**3 / rigidity
    assert main(["info", str(scene), *(f"--set={each}" for each in overrides)]) == 0
    told = (
        f"weight over bending stiffness: ρ g L³/B = {number:.3g} with L = {length:.3g} m, {words}"
    )
    assert told in capsys.readouterr().out
    rows = {row["formula"]: row["value"] for row in table(Numbers.of(load_scene(scene, overrides)))}
    assert rows["ρ g L³/B"] == pytest.approx(number, rel=1e-9)


@pytest.mark.parametrize("angle", [0.01, 0.1, 0.5])
def test_the_loss_of_a_swing_is_that_of_an_oscillator(angle):
    kept = fc.stability.amplification(fc.BackwardEuler(), angle, 0.0) ** (2 * math.pi / angle)
    assert dimensionless.swing_loss(angle) == pytest.approx(1 - kept, rel=1e-9)


def test_the_wave_runs_as_predicted():
    """A fifth of a strip is pushed along: the front is where half of the first wave has come."""
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    cloth = fc.Cloth.rectangle(1.0, 0.01, h=0.005, pattern="right")
    pins = [fc.Slide("boundary", direction=(1, 0, 0))]  # no contraction across: a plane wave
    system = fc.System(cloth, fabric, [fc.StVK()], pins)
    x, pushed = system.rest().x, cloth.X[:, 0] < 0.2 - 1e-9
    v = np.column_stack([1e-3 * pushed, np.zeros((len(x), 2))])
    t = 0.6 / dimensionless.wave_speed(fabric)
    state = fc.run(system, fc.CentralDifference(), system.state(x, v), t_end=t).state
    front = cloth.X[state.v[:, 0] > 0.25e-3, 0].max()
    assert front == pytest.approx(0.2 + 0.6, abs=0.012)  # 1 - ν12 ν21 left out: 0.772


PINNED = {  # the pins, and what the plan says of them
    "[{where='left'}]": "pins: left (11 nodes), on a line, about which the cloth is free to turn",
    "[{where='boundary', name='rim'}]": "pins: rim (60 nodes)",
    "[{inside='X < 1e-3 and Y < 1e-3'}, {inside='X < 0.06 and Y > 0.01'}]": (
        "pins: pin0 (1 node), pin1 (30 nodes)"
    ),
    "[]": "pins: none",
}


@pytest.mark.parametrize("pins", PINNED)
def test_plan_states_the_nodes_of_each_pin(pins, scene):
    built = load_scene(scene, [f"pins={pins}"]).build()
    assert PINNED[pins] in plan.plan(built, "why")


def test_the_plan_is_printed_before_the_first_step(scene, tmp_path, run_command):
    arguments = ["run", str(scene), "-o", str(tmp_path / "out"), "--set", "terms.1.type=StVK"]
    told = run_command(*arguments, "-v").err
    log = (tmp_path / "out" / "run.log").read_text()
    plan_words = ("431 nodes", "terms: StVK.1, StVK.2, Gravity", "pins: left (11 nodes)")
    limit = "fastest wave in the fabric 74.1"
    warning = "check: StVK stands 2 times"
    for words in (*plan_words, limit, warning):
        assert words in told
        assert words in log
    told = run_command(*arguments, "--overwrite").err
    assert (tmp_path / "out" / "run.log").read_text().count("431 nodes") == 1
    assert limit not in told
    assert warning in told
    explicit = ["time.method=central_difference", "time.dt=1e-4", "time.t_end=2e-4"]
    sets = [word for value in explicit for word in ("--set", value)]
    assert limit in run_command(*arguments, "--overwrite", *sets).err
    assert not any(words in told for words in plan_words)
    assert "MB, with a factor" in run_command("info", scene).out


# --- the scenes of the first pages ----------------------------------------------------------------

ROOT = Path(__file__).parents[2]


@pytest.fixture(params=["napkin.toml", "flag.toml"])
def shown(request, tmp_path):
    """The scene that the first steps show, and the one that the README names."""
    path = ROOT / "studies" / "scenes" / request.param
    if request.param == "napkin.toml":
        page = (ROOT / "docs" / "first_steps.md").read_text(encoding="utf-8")
        path = tmp_path / request.param
        path.write_text(re.search(r"```toml\n(.*?)```", page, re.DOTALL)[1], encoding="utf-8")
    return path


def test_no_warning_before_a_scene_of_the_first_pages_runs(shown):
    assert load_scene(shown).build().doubts() == []


@pytest.mark.stories
def test_no_warning_while_a_scene_of_the_first_pages_runs(shown, tmp_path):
    """But of small errors that grow where a cloth folds or flutters. Of the flag a second runs."""
    changes = ["time.t_end=1"] if shown.name == "flag.toml" else []
    outcome = fc.run_scene(load_scene(shown, changes), tmp_path / "out")
    assert outcome.status == "done"
    grown = [words for words in outcome.summary["warnings"] if "small errors have grown" in words]
    assert outcome.summary["warnings"] == grown
    assert not grown or shown.name in ("flag.toml", "napkin.toml")
    assert outcome.summary["intersecting_pairs"] == 0


@pytest.mark.parametrize(("share", "warned"), [(0.8, False), (1.25, True)])
def test_a_step_longer_than_the_run_is_named(share, warned, scene):
    given = ("time.method=backward_euler", "time.t_end=0.01", f"time.dt={0.01 * share}")
    assert (
        any("is longer than the run of 0.01 s" in w for w in warnings_of(scene, *given)) == warned
    )
