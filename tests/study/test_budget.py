"""`budget`: closed forms of its parts, when samples replace them, its words and its mistakes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.scene_texts import STRING
from support.strips import grip_force as force
from support.strips import gripped

import fecloth as fc
from fecloth.cli.main import main
from fecloth.errors import InputError
from fecloth.simulation.quantity import parse_quantity
from fecloth.study import tuning
from fecloth.study.budgeting import work as budgets
from fecloth.study.budgeting.budget import tolerance_of_data
from fecloth.study.budgeting.inputs import Inputs, read_inputs
from fecloth.study.budgeting.result import _shown, make_budget
from fecloth.study.budgeting.work import Work, probing_change, spread
from fecloth.study.constants_read import with_estimates
from fecloth.study.parameters import Parameter
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Run

FORCE = "reaction.right.x"
SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.25, pattern = "right" }
terms = [{ type = "StVK" }, { type = "Gravity", acceleration = [9.81, 0.0, 0.0] }]
pins = [{ where = "left" }]
equilibrium = {}
probes = [{ name = "tip", where = "right" }]
interest = { end = ["tip.x"] }
[fabric]
areal_density = 0.2
tensile_stiffness = 2000.0
poisson_ratio = 0.0
"""
STRETCH = 0.2 * 9.81 / (2 * 2000.0)  # of a strip that hangs: ρ g L²/(2 Y)
CORRELATED = """
[fabric.uncertainty]
areal_density = "5 %"
tensile_stiffness = "5 %"
correlation = [["areal_density", "tensile_stiffness", {}]]
"""


def pulled(h, stiffness=1000.0, drawn=0.02, factors=(1.0, 0.0), least=0.0):
    """A strip between two grips that is refused on some meshes, or with another stiffness."""
    if h < least or (least and stiffness != 1000.0):
        raise InputError("a number", "is refused")
    return gripped(h, stiffness * sum(factors), drawn=drawn)


def column(h, drawn=0.0):
    """A strip that buckles where it is pressed together."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    fabric = fc.Fabric(0.2, 100.0, 0.0, bending_rigidity=1e-3)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], ["left", "right"])
    x = system.rest().x * [1.0 + drawn, 1.0, 1.0]
    x[:, 2] = 1e-3 * np.sin(np.pi * cloth.X[:, 0])
    return cloth, system, None, system.state(x)


def thrown(h, dt):
    """A strip in free flight."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 1.0), [fc.Gravity()])
    return cloth, system, fc.Newmark(), system.rest()


def parts_of_force(by_stiffness, by_drawn):
    """Both parts of the uncertainty of the force."""
    slope = 0.5 * 1000.0 * (3 * 1.02**2 - 1) / 2
    return force() / 1000.0 * by_stiffness, slope * by_drawn


def scene_at(folder, text="", base=SCENE):
    path = folder / "strip.toml"
    path.write_text(base + text)
    return str(path)


# --- parts ----------------------------------------------------------------------------------------


def test_input_by_its_closed_form():
    answer = fc.budget(pulled, {"stiffness": "10 %", "drawn": 0.001}, None, FORCE, h=0.5)
    parts = parts_of_force(100.0, 0.001)
    assert answer.value == pytest.approx(force(), rel=1e-9)
    assert answer.input == pytest.approx(math.hypot(*parts), rel=1e-4)
    assert answer.shares[0] == pytest.approx(np.square(parts), rel=1e-4)
    assert answer.total == pytest.approx(answer.input, rel=1e-9)
    assert (answer.time, answer.solver, answer.start, answer.data) == (0.0, 0.0, 0.0, 0.0)
    assert answer.space < 1e-9
    assert math.isnan(answer.difference)
    assert not answer.agrees


def test_a_slack_counts_by_the_slope_of_its_quantity(tmp_path):
    """The force at 15 mm after 5 mm of slack has the slope of the one at 10 mm."""
    pins = (
        '[{ where = "left" }, { where = "right", name = "grip", motion = ["0.02 * t", "0", "0"] }]'
    )
    text = SCENE.replace('[{ where = "left" }]', pins).replace('"tip"', '"grip"')
    text = text.replace("equilibrium = {}", "equilibrium = { load_steps = 20 }")
    text = text.replace("[9.81, 0.0, 0.0]", "[0.0, 0.0, 0.0]").replace("tip.x", "grip.x")
    place = "reaction.grip.x at grip.x = 15 mm after 5 mm"
    known = {"slack": "0.1 mm", "fabric.tensile_stiffness": "2 %", "fabric.poisson_ratio": 0.01}
    answer = fc.budget(scene_at(tmp_path, "", text), known, None, place)
    value = 0.5 * force(2000.0, 0.01)
    assert answer.value == pytest.approx(value, rel=1e-3)
    by_slack = 0.25 * 2000.0 * (3 * 1.01**2 - 1) / 2 * 1e-4
    assert answer.input == pytest.approx(math.hypot(0.02 * value, by_slack), rel=2e-2)
    assert dict(zip(answer.parameters, answer.shares[0], strict=True))["slack"] == pytest.approx(
        by_slack**2, rel=2e-2
    )


@pytest.mark.parametrize(("rho", "parts"), [(1, 0.0), (-1, 2.0)])
def test_correlated_inputs_add_or_cancel(tmp_path, rho, parts):
    """The stretch is as ρ/Y: (u/q)² = 0.05² (1 + 1 − 2 ρ)."""
    answer = fc.budget(scene_at(tmp_path, CORRELATED.format(rho)))
    assert answer.parameters == ("fabric.areal_density", "fabric.tensile_stiffness")
    assert answer.input[0] == pytest.approx(0.05 * STRETCH * parts, rel=0.01, abs=1e-3 * STRETCH)


def test_time_space_and_solver_are_halves_of_what_converge_says(tmp_path):
    study = fc.study.of(scene_at(tmp_path, base=STRING), cache=tmp_path)
    answer, refined = study.budget(quantity="middle.z"), study.converge("middle.z", levels=3)
    assert answer.value == refined.value
    assert answer.space == 0.5 * refined.estimate.uncertainty > 0
    assert answer.time == 0.5 * 3.0 * refined.shares["time step"] > 0
    assert answer.solver == 0.5 * 3.0 * refined.shares["solver"] > 0
    added = answer.space + answer.time + answer.solver
    assert added == pytest.approx(0.5 * refined.uncertainty, rel=1e-12)
    assert answer.total == pytest.approx(
        math.sqrt(answer.space**2 + answer.time**2 + answer.solver**2), rel=1e-12
    )


@pytest.fixture
def refined(monkeypatch):
    """Budgets whose levels are summarised with these changes of a limit."""
    known = fc.study.converge(pulled, FORCE, levels=3, h=0.5)

    def refined(**changes):
        result = replace(known, **changes)
        monkeypatch.setattr(budgets, "summarise", lambda *given: result)
        return result

    refined.estimate = known.estimate
    return refined


def test_the_share_of_a_gap_belongs_to_the_mesh(refined):
    shares = {"mesh": 9.0, "gap": 4.0 / 3.0, "time step": 0.2, "solver": 0.04}
    estimate = replace(refined.estimate, uncertainty=3.0)
    refined(value=7.0, uncertainty=1.0, estimate=estimate, shares=shares)
    answer = fc.budget(pulled, quantity=FORCE, h=0.5)
    assert answer.start == 0.0
    assert (answer.value, answer.space) == (7.0, 2.5)
    assert (answer.time, answer.solver) == (pytest.approx(0.3), pytest.approx(0.06))


@pytest.mark.parametrize(("measured", "agrees"), [(8.5, True), (8.7, False)])
def test_the_distance_of_states_is_a_part_of_the_total(measured, agrees, refined):
    several = {"value": 7.0, "uncertainty": 0.8, "states": ((7.0, 4.0), (6.2, 5.0))}
    refined(verdict="several states: …", **several)
    asked = pulled, None, {FORCE: (measured, 1e-3)}, FORCE
    answer = fc.budget(*asked, h=0.5)
    assert answer.start == pytest.approx(0.8)
    assert answer.total == pytest.approx(0.8, rel=1e-3)
    assert answer.agrees == agrees
    assert any("several states" in words for words in answer.notes())


def test_states_that_are_not_known_leave_no_total(refined):
    refined(value=7.0, may_have_other_states=True, states=((7.0, 4.0),))
    answer = fc.budget(pulled, None, {FORCE: (8.7, 1e-3)}, FORCE, h=0.5)
    assert math.isnan(answer.total)
    assert "wrong" not in answer.verdict


def test_a_measured_energy_by_its_bare_name_has_units_of_energy():
    """½ Y E² W L of a stretched strip, with E = (s² − 1)/2."""
    energy = 0.5 * 1000.0 * ((1.02**2 - 1) / 2) ** 2 * 0.5
    measured = {"StVK": (f"{1e3 * energy} mJ", "1 mJ")}
    answer = fc.budget(pulled, None, measured, "StVK", h=0.5)
    assert answer.difference == pytest.approx(0.0, abs=1e-9)
    assert answer.data == pytest.approx(1e-3)


def test_a_part_whose_run_failed_is_not_known(monkeypatch):
    levels, run = budgets.levels_to_run, budgets.run_quantities

    def one_more(problem, *given):
        return [*levels(problem, *given), Run(problem, "half of the gap")]

    def fail_last(runs, *given):
        rows = run(runs, *given)
        return [*rows[:-1], {**rows[-1], "status": "failed", "cause": "it stopped"}]

    monkeypatch.setattr(budgets, "levels_to_run", one_more)
    monkeypatch.setattr(budgets, "run_quantities", fail_last)
    answer = fc.budget(pulled, None, {FORCE: (1.0, 0.1)}, FORCE, h=0.5)
    assert math.isnan(answer.space)
    assert math.isnan(answer.total)
    assert "not known (missing parts: mesh, time step, solver)" in answer.verdict
    assert any("it stopped" in words for words in answer.notes())
    assert answer.exit_status == 3


def test_starts_are_disturbed_and_their_spread_counts():
    """In free flight the end is the start, moved."""
    tip = fc.Probe("tip", "right")
    sizes = {"h": 0.5, "dt": 0.05, "t_end": 0.1, "probes": [tip]}
    answer = fc.budget(thrown, {"start": 3}, None, "tip.z", seed=5, **sizes)
    setup = StudyProblem.of(thrown, 0.5, 0.05, 0.1, (tip,)).setup()
    at = setup.cloth.nodes("right")
    heights = [setup.disturbed(seed).start.x[at, 2].mean() for seed in (6, 7, 8)]
    assert answer.start == pytest.approx(np.std(heights, ddof=1), rel=1e-6)
    assert answer.total == pytest.approx(math.hypot(answer.start, answer.solver), rel=1e-6)


def test_a_disturbance_is_smooth_small_upward_and_keeps_pins():
    setup = StudyProblem.of(column, 0.05).setup()
    moved = [setup.disturbed(seed).start.x - setup.start.x for seed in (1, 1, 2)]
    assert np.array_equal(moved[0], moved[1])
    assert not np.allclose(moved[0], moved[2], atol=1e-5)
    for way in moved:
        assert not way[setup.cloth.nodes("left")].any()
        assert 2e-4 < way[:, 2].max() <= 1e-3 * setup.cloth.extent
        assert way[:, 2].min() >= 0.0
        assert np.abs(way[:, :2]).max() < 1e-5  # along the mean normal
    inner = (np.abs(setup.cloth.X[:, 0] - 0.5) < 0.5 - 1e-9)[setup.cloth.triangles].all(axis=1)
    heights = moved[0][setup.cloth.triangles[inner], 2]
    assert np.ptp(heights, axis=1).max() < 0.5 * heights.max()


def test_all_parts_add_up_by_their_squares():
    known = dict(zip(("space", "time", "solver", "input", "start"), (1, 2, 4, 8, 16), strict=True))
    answer = made({"value": 5.0, **known}, {"sag": (2.0, 32.0)})
    assert answer.total == pytest.approx(math.sqrt(sum(4**k for k in range(6))))
    assert (answer.data, answer.difference, answer.value) == (32.0, 3.0, 5.0)


# --- samples --------------------------------------------------------------------------------------


def test_samples_of_a_linear_problem_have_the_spread_of_the_first_order():
    given = {"stiffness": "5 %", "drawn": 0.0005}
    first = fc.budget(pulled, given, None, FORCE, h=0.5)
    drawn = fc.budget(pulled, given, None, FORCE, h=0.5, samples=16)
    assert drawn.input == pytest.approx(first.input, rel=0.15)
    assert drawn.input != first.input
    assert not drawn.shares.size
    assert not first.remarks


def test_samples_have_mean_deviation_and_correlation():
    """Constants that must be positive are so, however uncertain they are; others are normal."""
    parameters = [Parameter("fabric.tensile_stiffness", 100.0, 100.0)]
    parameters += [Parameter("fabric.shear_stiffness", 10.0, 10.0)]
    parameters += [Parameter("fabric.poisson_ratio", 0.1, 0.1), Parameter("g", -9.81, 9.81)]
    u = np.array([50.0, 5.0, 0.05, 1.0])
    rho = np.eye(4)
    rho[0, 1] = rho[1, 0] = 0.8
    rho[0, 2] = rho[2, 0] = -0.5
    V = rho * np.outer(u, u)
    inputs = Inputs(tuple(parameters), V)
    drawn = np.array([list(each.values()) for each in inputs.samples(4096, 0)])
    assert drawn.mean(axis=0) == pytest.approx([100.0, 10.0, 0.1, -9.81], rel=0.01)
    assert np.cov(drawn.T) == pytest.approx(V, rel=0.06, abs=0.02 * u.max())
    assert np.corrcoef(drawn.T) == pytest.approx(rho, abs=0.02)
    assert drawn[:, :2].min() > 0
    assert drawn[:, 2].min() < 0
    assert inputs.samples(5, 1) == inputs.samples(5, 1) != inputs.samples(5, 2)


def test_samples_of_full_correlation():
    parameters = tuple(Parameter(name, 1.0, 1.0) for name in ("a", "b"))
    inputs = Inputs(parameters, 0.01 * np.ones((2, 2)))
    drawn = np.array([list(each.values()) for each in inputs.samples(16, 0)])
    assert drawn[:, 0] == pytest.approx(drawn[:, 1], abs=1e-9)
    assert np.ptp(drawn[:, 0]) > 0.1


def test_a_strip_that_buckles_is_sampled(monkeypatch):
    monkeypatch.setattr(budgets, "SAMPLES", 4)
    answer = fc.budget(column, {"drawn": 0.005}, None, FORCE, h=0.25)
    assert answer.remarks[0].startswith(f"The first order does not hold for {FORCE}: samples")
    assert 0 < answer.input < 100 * 0.25 * 0.005  # of which half would be without buckling
    assert not answer.shares.size


@pytest.mark.parametrize(("bend", "holds"), [(0.2, True), (0.3125, False)])
def test_the_first_order_holds_up_to_a_quarter_of_the_uncertainty(monkeypatch, bend, holds):
    """Of q = x + bend x², u = 1: samples at ±1 lie by `bend` off."""
    inputs = Inputs((Parameter("x", 0.0, 1.0),), np.eye(1))
    work = Work(None, [parse_quantity("sag")])

    def run(self, changed, starts=None):
        x = np.array([values["x"] for _, values in changed])
        return (x + bend * x**2)[:, None], ""

    monkeypatch.setattr(Work, "run", run)
    assert work.first_order_holds(inputs, np.array([[1.0]])) == [holds]
    assert work.first_order_holds(inputs, np.array([[1.6]])) == [False]


def test_a_probing_change_moves_every_quantity_by_one_deviation():
    V = np.diag([4.0, 9.0])
    change = probing_change(np.array([[1.0, 0.0], [-1.0, 0.0]]), V)  # as reactions of two grips
    assert change == pytest.approx([2.0, 0.0])
    both = probing_change(np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]]), V)
    assert np.abs(both) == pytest.approx([math.sqrt(2), 3 / math.sqrt(2)])
    assert probing_change(np.zeros((2, 2)), V) == pytest.approx([2.0, 3.0])


def test_all_samples_that_fail_leave_no_answer():
    given = {"stiffness": "1 %"}, {FORCE: (10.0, 0.1)}, FORCE
    answer = fc.budget(pulled, *given, h=0.5, samples=3, least=0.01)
    assert math.isnan(answer.total)
    assert not answer.agrees
    assert "its uncertainty is not known" in answer.verdict
    assert "wrong" not in answer.verdict
    assert answer.remarks == ("Samples: 3 of 3 do not count; sample 1: a number: is refused",)
    assert answer.exit_status == 3
    answer.figure()


def test_a_spread_leaves_out_runs_that_failed():
    values = np.array([[1.0, 10.0], [np.nan, np.nan], [3.0, 10.0]])
    assert spread(values) == pytest.approx([math.sqrt(2), 0.0])
    assert np.isnan(spread(values[:2])).all()


# --- tables ---------------------------------------------------------------------------------------


def test_presets_carry_uncertainties_which_entries_replace(tmp_path):
    base = SCENE.partition("[fabric]")[0] + "[fabric]\npreset = 'cotton'\n"
    problem = StudyProblem.of(scene_at(tmp_path, base=base))
    fabric = fc.Fabric.preset("cotton")
    standard = fabric.uncertainty.standard(fabric)
    plain = read_inputs(problem, {})
    assert dict(zip(plain.names, np.sqrt(np.diag(plain.covariance)), strict=True)) == (
        pytest.approx({f"fabric.{key}": u for key, u in standard.items()})
    )
    given = {"fabric": {"areal_density": "1 g/m^2", "tensile_stiffness": [3.0, "1 %"]}}
    given |= {"terms.1.acceleration": "2 %", "terms.1.acceleration.2": "1 cm/s^2", "start": 4}
    other = read_inputs(problem, given)
    deviations = dict(zip(other.names, np.sqrt(np.diag(other.covariance)), strict=True))
    assert deviations["fabric.areal_density"] == pytest.approx(1e-3)
    assert deviations["fabric.tensile_stiffness.0"] == pytest.approx(3.0)
    assert deviations["fabric.tensile_stiffness.1"] == pytest.approx(
        0.01 * fabric.tensile_stiffness[1]
    )
    assert deviations["terms.1.acceleration.0"] == pytest.approx(0.1962)
    assert deviations["terms.1.acceleration.2"] == pytest.approx(0.01)
    assert "terms.1.acceleration.1" not in deviations
    assert deviations["fabric.shear_stiffness"] == pytest.approx(standard["shear_stiffness"])
    assert other.starts == 4


def test_the_rigidity_along_the_bias_that_nobody_measured_has_the_published_spread(tmp_path):
    """(√4 + √1)²/4 = 2.25 times 1e-4 N m, known to 52 %; no result changes by writing it out."""
    text = SCENE.replace('"StVK" }', '"StVK" }, { type = "PlateBending" }')
    path = scene_at(tmp_path, "bending_rigidity = [4e-4, 1e-4]\n", text)
    bare = StudyProblem.of(path)
    problem, estimated = with_estimates(bare)
    assert estimated == {"fabric.bias_rigidity": pytest.approx(0.52 * 2.25e-4)}
    plates = [each.source.fabrics["fabric"].plate() for each in (bare, problem)]
    assert plates[0] == pytest.approx(plates[1], rel=1e-14)
    inputs = read_inputs(problem, {"fabric.areal_density": "1 %"}, estimated)
    assert inputs.names == ["fabric.areal_density", "fabric.bias_rigidity"]
    assert inputs.moved(-np.sqrt(np.diag(inputs.covariance)))[1] == pytest.approx(
        2.25e-4 * np.exp(-0.52)
    )
    for stated in (0.0, "unknown"):
        inputs = read_inputs(problem, {"fabric.bias_rigidity": stated}, estimated)
        assert not inputs.names
        assert ("fabric.bias_rigidity" in inputs.unknown) == (stated == "unknown")
    assert with_estimates(StudyProblem.of(scene_at(tmp_path)))[1] == {}  # no term reads it


def test_an_uncertainty_of_zero_leaves_a_number_out(tmp_path):
    text = '[fabric.uncertainty]\nareal_density = "5 %"\ntensile_stiffness = "5 %"\n'
    problem = StudyProblem.of(scene_at(tmp_path, text))
    given = {"fabric.areal_density": 0.0, "terms.1.acceleration.0": "0 %"}
    assert read_inputs(problem, given).names == ["fabric.tensile_stiffness"]


def test_what_nobody_knows_is_not_0_and_leaves_no_verdict(tmp_path):
    """Poisson's ratio has no entry, the stiffness is "unknown"; no term reads a rigidity."""
    text = 'bending_rigidity = 1e-5\n[fabric.uncertainty]\ntensile_stiffness = "unknown"\n'
    path = scene_at(tmp_path, text + 'areal_density = "5 %"\n[measured]\n"tip.x" = [2.0, 0.1]\n')
    answer = fc.budget(path)
    assert answer.unknown == ("fabric.tensile_stiffness", "fabric.poisson_ratio")
    assert answer.input[0] == pytest.approx(0.05 * STRETCH, rel=0.01)
    assert answer.agrees[0] is None
    assert "no verdict on the model; the uncertainty of fabric.tensile_stiff" in answer.verdict
    assert "Counted as exact: terms.1.acceleration.0, the sizes" in answer.notes()[-1]
    told = fc.budget(path, {"fabric.tensile_stiffness": "5 %", "fabric.poisson_ratio": 0.0})
    assert told.unknown == ()
    assert told.agrees[0] is False


def test_specimen_and_law_are_parts_of_the_change_from_the_start(tmp_path):
    text = '[fabric.uncertainty]\nspecimen = "5 %"\nlaw = 0.1\n'
    answer = fc.budget(scene_at(tmp_path, text))
    change = answer.value[0] - 1.0
    assert answer.specimen[0] == pytest.approx(0.05 * change)
    assert answer.law[0] == pytest.approx(0.1 * change)


def test_what_replaces_an_entry_is_not_correlated(tmp_path):
    path = scene_at(tmp_path, CORRELATED.format(1.0))
    problem = StudyProblem.of(path)
    u = np.array([0.01, 100.0])
    assert read_inputs(problem, {}).covariance == pytest.approx(np.outer(u, u))
    other = read_inputs(problem, {"fabric.areal_density": 0.02}).covariance
    assert other == pytest.approx(np.diag([0.02, 100.0]) ** 2)


def test_an_item_of_an_argument_that_is_a_list():
    answer = fc.budget(pulled, {"factors.0": 0.1}, None, FORCE, h=0.5)
    assert answer.input == pytest.approx(0.1 * force(), rel=1e-4)


def test_a_scene_and_python_give_the_same_budget(tmp_path):
    uncertain = {"fabric.areal_density": "10 %", "terms.1.acceleration.0": 0.1}
    plain = fc.budget(scene_at(tmp_path), uncertain, {"tip.x": (1.0005, 1e-5)})
    table = '[uncertain]\nfabric.areal_density = "10 %"\nterms.1.acceleration.0 = 0.1\n'
    table += "[measured]\ntip.x = [1.0005, 1e-5]\n"
    answer = fc.budget(scene_at(tmp_path, table))
    assert answer.table.rows == plain.table.rows
    expected = STRETCH * math.hypot(0.1, 0.1 / 9.81)
    assert answer.input[0] == pytest.approx(expected, rel=0.01)
    assert answer.data[0] == 1e-5


def test_without_interest_the_measured_quantities_count(tmp_path):
    base = SCENE.replace('interest = { end = ["tip.x"] }', "")
    answer = fc.budget(scene_at(tmp_path, base=base), measured={"tip.x": (1.0, "1 %")})
    assert answer.quantities == ("tip.x",)
    assert answer.data[0] == 0.01


def test_what_was_measured_of_other_quantities_waits(tmp_path):
    path = scene_at(tmp_path, '[measured]\n"tip.x" = [1.0, "1 %"]\n')
    answer = fc.budget(path, quantity="sag")
    assert math.isnan(answer.difference)
    assert answer.data == 0.0


def test_a_problem_that_fails_has_no_budget():
    with pytest.raises(fc.study.StudyFailed, match="levels failed"):
        fc.budget(pulled, {"drawn": 0.1}, None, FORCE, h=0.5, least=0.2)


def test_a_quantity_without_a_value_is_said_to_have_none():
    def missing(result):
        return math.nan

    with pytest.raises(fc.study.StudyFailed, match="missing has no value on a level"):
        fc.budget(pulled, {}, None, missing, h=0.5)
    answer = fc.study.converge(pulled, missing, h=0.5, levels=3)
    assert answer.verdict == "not known: missing has no value on a level"


# --- words ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "u", "shown"),
    [
        (1.000491, 1.1e-4, "1.00049"),
        (1.000491, 0.0, "1"),
        (62.0, 5.1, "62"),
        (-0.0358583, 1.5e-7, "-0.0358583"),
        (0.0, 1.0, "0"),
        (3.14159, math.nan, "3.142"),
    ],
)
def test_a_value_has_the_digits_that_its_uncertainty_needs(value, u, shown):
    assert _shown(value, u) == shown


ZEROS = dict.fromkeys(("space", "time", "solver", "input", "start"), 0.0)


def made(known, measured, shares=(), names=("fabric.bending_rigidity",)):
    """The budget of a sag with these parts."""
    problem = SimpleNamespace(name="drape", first=SimpleNamespace(energies=[]))
    parts = np.atleast_2d(shares) if len(shares) else np.zeros((0, 0))
    columns = {name: np.array([float(value)]) for name, value in known.items()}
    return make_budget(
        opened=problem,
        quantities=[parse_quantity("sag")],
        values_and_parts=columns,
        measured=measured,
        parameters=names,
        shares=parts,
        is_single=True,
    )


@pytest.mark.parametrize(
    ("part", "agrees"), [(0.8, True), (0.99, True), (1.01, False), (1.25, False)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_it_agrees_within_twice_the_total(part, agrees, sign):
    known = ZEROS | {"value": 62.0, "input": 3.0}
    answer = made(known, {"sag": (62.0 - sign * part * 2 * 5.0, 4.0)})
    assert answer.total == pytest.approx(5.0)
    assert answer.agrees == agrees
    assert answer.difference == pytest.approx(sign * part * 10.0)


def test_the_verdict_says_parts_and_the_largest_one():
    known = ZEROS | {"value": 62.0, "space": 1.0, "input": 4.0, "start": 3.0, "solver": 1e-3}
    shares, names = [15.0, 1.0], ("fabric.bending_rigidity", "fabric.areal_density")
    words = "sag = 62 m ± 1 (mesh) ± 4 (fabric) ± 3 (start)"
    assert made(known, {}, shares, names).verdict == (
        f"{words}: uncertain by 5.1, of which 3.9 are of fabric.bending_rigidity"
    )
    near = made(known, {"sag": (61.6, 5.0)}, shares, names).verdict
    amount = "its uncertainty of 7.1, of which 5 are of the measurement"
    assert near == f"{words}; measured 61.6 ± 5: agrees within {amount}"
    apart = made(known, {"sag": (52.0, 5.0)}, shares, names).verdict
    assert "agrees within twice its uncertainty of 7.1, of which" in apart
    wrong = made(known, {"sag": (50.0, 0.5)}, shares, names).verdict
    assert wrong == f"{words}; measured 50 ± 0.5: the model is wrong by 12 ± 5.1"
    sampled = made(known, {}, names=("g", "B")).verdict
    assert sampled.endswith(
        "± 4 (inputs) ± 3 (start): uncertain by 5.1, of which 4 are of the inputs"
    )
    assert made(ZEROS | {"value": 1.0}, {}).verdict == "sag = 1 m: uncertain by 0"


@pytest.mark.parametrize(("part", "is_named"), [(0.8e-2, False), (1.25e-2, True)])
def test_parts_above_a_hundredth_of_the_total_are_named_and_drawn(part, is_named):
    answer = made(ZEROS | {"value": 1.0, "input": 1.0, "solver": part}, {})
    assert ("(solver)" in answer.verdict) == is_named
    labels = [bar.get_label() for bar in answer.figure().axes[0].containers]
    assert ("solver" in labels) == is_named


def test_the_figure_stacks_the_parts_of_the_variance():
    known = ZEROS | {"value": 1.0, "space": 1.0, "input": math.sqrt(3.0), "solver": 1e-3}
    answer = made(known, {}, [3.5, -0.5], ("fabric.bending_rigidity", "fabric.areal_density"))
    drawing = answer.figure()
    bars = drawing.axes[0].containers
    labels = [bar.get_label() for bar in bars]
    assert labels == ["mesh", "fabric.bending_rigidity"]
    widths = [bar.patches[0].get_width() for bar in bars]
    assert widths == pytest.approx([100 / 4.5, 350 / 4.5], rel=1e-5)
    assert bars[1].patches[0].get_x() == pytest.approx(widths[0])
    assert [text.get_text() for text in drawing.legends[0].get_texts()] == labels


# --- friction inside the fabric, tune, the command ------------------------------------------------

HELD = """
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.25, pattern = "right" }
pins = [{ where = "left", clamp = true }]
equilibrium = {}
probes = [{ name = "tip", where = "right" }]
interest = { end = ["tip.z"] }
[[terms]]
type = "StVK"
[[terms]]
type = "Gravity"
[[terms]]
type = "PlateBending"
[[terms]]
type = "BendingFriction"
[fabric]
areal_density = 0.01
tensile_stiffness = 2000.0
poisson_ratio = 0.0
bending_rigidity = 0.02
bending_hysteresis = 0.02
"""


@pytest.mark.stories
def test_both_ends_of_friction_are_told_and_do_not_count(tmp_path):
    path = scene_at(tmp_path, "[uncertain]\nfabric.bias_rigidity = 0.0\n", HELD)
    answer = fc.budget(path)
    study = fc.study.of(path)
    laid, shaken = (
        study.sweep(f"equilibrium.friction={end}", "tip.z").table["tip.z"][0]
        for end in ("laid", "shaken")
    )
    assert abs(shaken) > 1.2 * abs(laid)
    assert answer.remarks == (
        f"Both ends of the friction inside the fabric: tip.z {laid:.4g} laid, {shaken:.4g} shaken.",
    )
    assert answer.total[0] == answer.space[0]


def test_no_friction_no_ends(tmp_path):
    assert fc.budget(scene_at(tmp_path)).remarks == ()


def test_tune_takes_a_third_of_the_input_uncertainty(tmp_path, monkeypatch, capsys):
    path = scene_at(tmp_path, '[uncertain]\nfabric.tensile_stiffness = "10 %"\n')
    expected = 0.1 * STRETCH / 3
    result = tolerance_of_data(fc.study.of(path), None)
    assert result == pytest.approx(expected, rel=0.01)

    def stop(tolerance, budget):
        raise InputError(f"{tolerance:.6e}", "is given on")

    monkeypatch.setattr(tuning, "read_goal", stop)
    with pytest.raises(InputError, match=f"{result:.6e}"):
        fc.tune(path, to_data=True)
    assert f"tolerance by the data: {100 * result:.2g} %" in capsys.readouterr().err


def test_the_command_reads_tables_and_reuses_its_runs(tmp_path, run_command):
    text = (
        '[uncertain]\nfabric.areal_density = "10 %"\nfabric.tensile_stiffness = "10 %"\n'
        'fabric.poisson_ratio = 0.0\nstart = 2\n[measured]\n"tip.x" = [2.0, 0.1]\n'
    )
    command = ["budget", scene_at(tmp_path, text), "-o", str(tmp_path / "out")]
    first = run_command(*command)
    assert "the model is wrong by 1 ± 0.1" in first.out
    assert "start 2: ok" in first.err
    again = run_command(*command)
    assert ": ok" not in again.err
    assert again.out == first.out
    assert (tmp_path / "out" / "figure.png").exists()
    assert main([*command, "--samples", "1"]) == 2


def test_uncertain_and_measured_tables_share_runs(tmp_path):
    """Cases do not change with what is uncertain or measured."""
    plain = StudyProblem.of(scene_at(tmp_path))
    text = '[uncertain]\nstart = 2\n[measured]\n"tip.x" = [2.0, 0.1]\n'
    other = StudyProblem.of(scene_at(tmp_path, text))
    assert other.case() == plain.case()
