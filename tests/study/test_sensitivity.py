"""`sensitivity`: closed forms, what is refused, what has no derivative, and what it prints."""

import math

import numpy as np
import pytest
from support.strips import TIP, grip_force, scene_file
from support.strips import gripped as strip

import fecloth as fc
from fecloth.errors import InputError
from fecloth.simulation.load_steps import LoadSteps
from fecloth.study import sensitivities
from fecloth.study.derived_cases import LARGEST_ERROR
from fecloth.study.parameters import Parameter
from fecloth.study.runs import Runs
from fecloth.study.sensitivities import describe_weak_terms, weights_of_twins

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 0.25
h = 0.25
pattern = "right"
[fabric]
areal_density = 0.2
tensile_stiffness = [2000.0, 1500.0]
poisson_ratio = 0.2
shear_stiffness = 300.0
[[terms]]
type = "StVK"
[[terms]]
type = "Gravity"
acceleration = [9.81, 0.0, 0.0]
[[pins]]
where = "left"
[[probes]]
name = "tip"
where = "right"
[interest]
quantities = ["tip.x"]
[equilibrium]
"""


def drum(h, stiffness=1000.0, density=0.2, stretch=1.01):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    fabric = fc.Fabric(density, stiffness, 0.3)
    system = fc.System(cloth, fabric, [fc.StVK()], pins=["boundary"])
    x = np.column_stack([stretch * cloth.X, np.zeros(len(cloth.X))])
    return cloth, system, fc.BackwardEuler(), system.state(x)


def beam(h, B=1.0, g=1e-3):
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    fabric = fc.Fabric(0.2, 1e4, 0.0, bending_rigidity=B)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -g))]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("left", clamp=True)])
    return cloth, system, None, system.rest()


scene = scene_file(SCENE, "strip")


def test_frequency_of_a_drum_goes_with_the_root_of_tension_over_density():
    """f is as √(T/ρ), T = s S = Y s (s² − 1)/2: the stress does not change across."""
    asked = ["stiffness", "density", "stretch"]
    answer = fc.sensitivity(drum, asked, "frequency(1)", h=0.25, dt=0.1, t_end=1.0)
    s = 1.01
    assert answer.elasticity == pytest.approx([0.5, -0.5, s**2 / (s**2 - 1)], rel=1e-5)
    tension = (s**2 - 1) / 2 * s * 1000 / 0.7
    assert answer.value == pytest.approx(math.sqrt(tension / (2 * 0.2)), rel=0.1)
    assert answer.checked < 1e-4


def test_tip_of_a_cantilever_goes_with_load_over_rigidity():
    answer = fc.sensitivity(beam, ["B", "g"], "tip.z", h=0.125, probes=TIP)
    assert answer.elasticity == pytest.approx([-1.0, 1.0], abs=1e-5)
    assert answer.value == pytest.approx(-0.2 * 1e-3 / 8, rel=0.02)
    assert answer.derivative[0] == pytest.approx(-answer.value, rel=1e-5)


def test_force_of_a_strip_by_its_closed_form():
    asked = ["stiffness", "drawn", "length"]
    answer = fc.sensitivity(strip, asked, ["reaction.right.x"], h=0.25)
    s = 1.02
    assert answer.value[0] == pytest.approx(grip_force(), rel=1e-9)
    slope = 0.5 * 1000 * (3 * s**2 - 1) / 2
    assert answer.derivative[0] == pytest.approx([answer.value[0] / 1000, slope, 0.0], abs=1e-4)
    assert answer.checked[0] < 1e-5


@pytest.mark.parametrize("follow", [False, True])
def test_a_strip_that_a_force_on_its_edge_pulls(follow):
    """q = Y s (s² − 1)/2 with the stretch s, so that ds/dq = 2/(Y (3 s² − 1))."""

    def pulled(h, q=50.0, stiffness=1000.0):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h)
        load = fc.EdgeForce("right", normal=q, follow=follow)
        system = fc.System(cloth, fc.Fabric(0.2, stiffness), [fc.StVK(), load], ["left"])
        return cloth, system, None, system.rest()

    answer = fc.sensitivity(pulled, ["q", "stiffness"], "tip.x", h=0.25, probes=TIP)
    s = max(np.roots([500.0, 0.0, -500.0, -50.0]).real)
    slope = 2 / (1000 * (3 * s**2 - 1))
    assert answer.value == pytest.approx(s, rel=1e-7)
    assert answer.derivative == pytest.approx([slope, -slope * 50 / 1000], rel=1e-5)
    assert answer.checked < 1e-5


def test_a_force_that_follows_a_swinging_edge():
    def swinging(h, q=3.0):
        cloth = fc.Cloth.rectangle(0.5, 0.25, h)
        lift = fc.EdgeForce("right", (0.0, 0.0, f"{q!r} * (1 + sin(20 * t))"), follow=True)
        pull = fc.EdgeForce("right", normal=4 * q, tangent=q, follow=True)
        fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
        system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), lift, pull], ["left"])
        return cloth, system, fc.ImplicitMidpoint(), system.rest()

    answer = fc.sensitivity(swinging, ["q"], "tip.z", h=0.125, dt=0.01, t_end=0.1, probes=TIP)
    assert abs(answer.elasticity[0]) > 0.1
    assert answer.checked < 1e-4


def test_a_pair_of_numbers_of_a_scene_has_two_derivatives(scene):
    keys = ["fabric.tensile_stiffness.0", "fabric.tensile_stiffness.1", "terms.1.acceleration.0"]
    answer = fc.sensitivity(str(scene), keys, "tip.x")
    along, across, load = answer.elasticity * answer.value / (answer.value - 1.0)
    assert along + across == pytest.approx(-1.0, abs=0.03)
    assert load == pytest.approx(1.0, abs=0.03)
    assert abs(across) < 0.05


def test_the_key_of_a_pair_stands_for_both_numbers(scene):
    answer = fc.sensitivity(str(scene), "fabric.tensile_stiffness", "tip.x", check=False)
    assert answer.parameters == ("fabric.tensile_stiffness.0", "fabric.tensile_stiffness.1")


def test_all_numbers_of_fabric_and_terms_but_zeros_by_default(scene):
    answer = fc.sensitivity(str(scene))
    assert answer.quantities == ("tip.x",)
    assert "fabric.shear_stiffness" in answer.parameters
    assert "terms.1.acceleration.0" in answer.parameters
    assert "terms.1.acceleration.2" not in answer.parameters
    assert not any(name.startswith(("cloth", "pins")) for name in answer.parameters)


def test_a_zero_needs_a_scale_and_has_no_elasticity(scene):
    key = "terms.1.acceleration.1"
    answer = fc.sensitivity(str(scene), key, "tip.y", scale={key: 2.0})
    assert np.isnan(answer.elasticity[0])
    assert answer.derivative[0] > 0
    assert answer.checked < 1e-4
    change = 2 * answer.derivative[0]
    assert f"it changes for +2 of {key} by {change:+.2g} m;" in answer.verdict


def test_h_and_other_meshes_of_a_function_are_refused():
    def wide(h, width=1.0):
        cloth = fc.Cloth.rectangle(width, 0.5, h if width > 1.0 else 0.5 * h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], ["boundary"])
        return cloth, system, None, system.rest()

    with pytest.raises(InputError, match="changes the mesh or the held nodes"):
        fc.sensitivity(wide, "width", "area", h=0.25)


def test_values_of_arguments_are_those_of_the_mapping():
    answer = fc.sensitivity(strip, {"stiffness": 500.0}, "reaction.right.x", h=0.25, check=False)
    assert answer.value == pytest.approx(grip_force(500.0))
    assert np.isnan(answer.checked)
    assert "not checked" in answer.verdict


def test_a_function_of_the_result_is_a_quantity():
    def longest(result):
        return float(result.state.x[:, 0].max()) ** 2

    answer = fc.sensitivity(strip, ["drawn"], longest, h=0.25)
    assert answer.derivative[0] == pytest.approx(2 * 1.02, rel=1e-6)


def test_a_function_of_an_energy_has_a_derivative_where_nothing_moves():
    def held(h, stiffness=1000.0):
        _, system, _, start = strip(h, stiffness)
        return system.cloth, system, fc.BackwardEuler(), start

    def energy(result):
        return float(result.energies["StVK"][-1])

    answer = fc.sensitivity(held, ["stiffness"], energy, h=0.25, dt=0.01, t_end=0.02)
    assert answer.elasticity[0] == pytest.approx(1.0, rel=1e-6)


def test_a_function_of_all_nodes_is_as_smooth_as_its_nodes(scene):
    """The stretch of a hanging strip depends on density over stiffness alone."""

    def stretch(result):
        return float(result.state.x[:, 0].mean()) - 0.5

    keys = "fabric.areal_density", "fabric.tensile_stiffness.0", "fabric.tensile_stiffness.1"
    answer = fc.sensitivity(str(scene), [*keys, "fabric.shear_stiffness"], stretch)
    assert answer.elasticity[0] == pytest.approx(-answer.elasticity[1:].sum(), rel=1e-4)
    assert answer.checked < 1e-5


def crumpled(h, stiffness=1000.0, squeeze=0.6):
    """A sheet without bending, squeezed and let go: its folds grow without order."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    fabric, terms = fc.Fabric(0.2, stiffness), [fc.StVK(), fc.Gravity()]
    system, X = fc.System(cloth, fabric, terms, pins=["left"]), cloth.X
    z = 0.05 * np.sin(9 * X[:, 0]) * np.cos(7 * X[:, 1])
    return cloth, system, fc.BackwardEuler(), system.state(np.column_stack([squeeze * X, z]))


@pytest.mark.stories
def test_folds_that_change_leave_no_derivative_and_the_answer_says_so():
    run = {"h": 0.2, "dt": 0.01, "probes": [fc.Probe("tip", "right")]}
    asked = crumpled, ["stiffness", "squeeze"], "tip.z"
    assert fc.sensitivity(*asked, t_end=0.2, **run).checked < 1e-3
    answer = fc.sensitivity(*asked, t_end=1.0, **run)
    assert answer.checked > LARGEST_ERROR
    assert np.isnan(answer.derivative).all()
    assert "no derivative here" in answer.verdict
    assert any("folds that change" in words for words in answer.notes())
    assert answer.exit_status == 3


@pytest.fixture
def twins_of(monkeypatch):
    """The derivatives of a run that takes no time, and the values of its twin runs."""

    def made_up(slopes, value):
        def rows(runs, how):
            answer = {"status": "ok", "sizes": [], "method": "", "why": ""}
            if "changes" not in runs[0].arguments:
                return [answer | {"values": [1.0], "slopes": [slopes]}]
            changes = [np.array(run.arguments["changes"]) for run in runs]
            return [answer | {"values": [value(change)]} for change in changes]

        monkeypatch.setattr(sensitivities, "run_all", rows)

    return made_up


@pytest.mark.parametrize("bend", [8e4, 1.25e5])
def test_the_sentence_on_one_per_cent_holds_or_says_how_far(bend, twins_of):
    """q = 1 + s + bend s³/100: at a change of 1 % twin runs are off ∂q/∂s = 1 by bend · 1e-6."""
    twins_of([1.0], lambda change: 1 + change[0] + 0.01 * bend * change[0] ** 3)
    answer = fc.sensitivity(strip, ["drawn"], "area", h=0.25)
    assert answer.checked < LARGEST_ERROR
    holds = 1e-2 if bend < 1e5 else sensitivities.WIDE_CHANGE
    assert answer.holds == holds
    assert ("holds up to ± 0.03 %, not for 1 %" in answer.verdict) == (bend > 1e5)


@pytest.mark.parametrize(("part", "exists"), [(0.8, True), (1.25, False)])
def test_one_per_cent_from_the_twin_runs_is_the_limit(part, exists, monkeypatch):
    def check(opened, sought, slopes, row, runs, step):
        return np.array([part * 0.01]), ""

    monkeypatch.setattr(sensitivities, "_check_by_twin_runs", check)
    answer = fc.sensitivity(strip, ["drawn"], "reaction.right.x", h=0.25)
    assert np.isfinite(answer.derivative[0]) == exists
    assert ("no derivative here" in answer.verdict) != exists


def test_twin_runs_tell_of_a_number_that_counts_little(twins_of):
    """q = 1 + Y + 0.02 B, with a derivative by B that is wrong by a half: 1 % of all changes."""
    largest = []

    def value(change):
        largest.append(np.abs(change).max())
        return 1.0 + change @ [1.0, 0.02]

    twins_of([1.0, 0.03], value)
    answer = fc.sensitivity(strip, ["stiffness", "drawn"], "area", h=0.25)
    assert answer.checked == pytest.approx(0.01 * 17.1667 / (1 + 0.03 * 17.1667), rel=1e-4)
    assert "no derivative here" in answer.verdict
    assert max(largest) <= 0.0101


def test_weights_of_twin_runs():
    """Parts of 1/2, 1/4, 1/4 and 0 of four numbers count as 1, 1, 1 and the most."""
    slopes = np.array([[2.0, -1.0, 1.0, 0.0]])
    assert weights_of_twins(slopes, 3e-4).tolist() == [1.0, 1.0, 1.0, 30.0]
    assert weights_of_twins(slopes, 1e-2).tolist() == [1.0, 1.0, 1.0, 1.0]
    assert weights_of_twins(np.array([[1.0, 0.0], [1.0, 0.1]]), 1e-3) == pytest.approx([1.0, 5.5])


def test_an_answer_is_read_from_the_store(scene, tmp_path, capsys):
    asked = {"parameters": "fabric.shear_stiffness", "cache": tmp_path}
    first = fc.sensitivity(str(scene), **asked)
    capsys.readouterr()
    again = fc.sensitivity(str(scene), **asked)
    assert "cases already stored: 1 of 1" in capsys.readouterr().err
    assert again.derivative == pytest.approx(first.derivative, abs=0.0)


def test_report_has_bars_with_the_largest_first(scene, tmp_path):
    answer = fc.sensitivity(str(scene))
    sizes = [abs(row["% for 1 %"]) for row in answer.table]
    assert sizes == sorted(sizes, reverse=True)
    bars = answer.figure().axes[0].patches
    assert [bar.get_width() for bar in bars] == sorted(sizes)
    assert answer.report(tmp_path).exists()


def test_the_width_is_the_unit_of_changes():
    parameter = Parameter("p", -2.0, 2.0)
    assert parameter.at(0.5) == -1.0


def test_terms_whose_numbers_hardly_count_are_named_up_to_the_tolerance(scene, capsys):
    text = scene.read_text().replace(
        "[[pins]]", '[[terms]]\ntype = "Pressure"\npressure = 0.5\n[[pins]]'
    )
    scene.write_text(text)
    answer = fc.sensitivity(str(scene), "terms.2.pressure", "tip.x", check=False)
    opened = fc.study.of(str(scene)).problem
    part = abs(answer.elasticity[0])
    for tolerance, named in ((1.25 * part, True), (0.8 * part, False)):
        runs = Runs(quiet=True)
        words = describe_weak_terms(opened, opened.quantities, tolerance, runs)
        assert ("terms.2.pressure of Pressure" in words) == named


def test_a_scale_whose_change_is_lost_in_round_off_is_named(scene):
    key = "terms.1.acceleration.1"
    answer = fc.sensitivity(str(scene), key, "tip.y", scale={key: 1e-9})
    assert np.isnan(answer.derivative[0])
    assert any("lost in round-off" in words for words in answer.notes())


@pytest.mark.parametrize(("z", "word", "colour"), [(0.1, "+", "C0"), (-0.1, "-", "C3")])
def test_a_quantity_below_zero_that_falls_is_said_to_fall(z, word, colour):
    def end(result):
        return z * float(result.state.x[:, 0].max())

    answer = fc.sensitivity(strip, ["drawn"], end, h=0.25)
    assert answer.elasticity[0] > 0
    assert f"1 % more of drawn by {word}0.02 %" in answer.verdict
    from matplotlib.colors import to_rgba

    assert answer.figure().axes[0].patches[0].get_facecolor() == to_rgba(colour)


def test_energies_are_in_joules(scene):
    answer = fc.sensitivity(str(scene), "fabric.shear_stiffness", ["StVK", "total"])
    assert all(" J; " in line for line in answer.verdict.splitlines())


def test_whole_numbers_of_a_function_are_left_out_unless_they_are_named():
    def counted(h, density=0.2, times=2):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
        loads = [fc.Gravity((0, 0, -1.0)) for _ in range(times)]
        system = fc.System(cloth, fc.Fabric(density, 1000.0), [fc.StVK(), *loads], ["boundary"])
        return cloth, system, None, system.rest()

    assert fc.sensitivity(counted, quantity="sag", h=0.25).parameters == ("density",)


def test_friction_changes_no_form_of_records():
    def sliding(h, friction=0.3, radius=0.3):
        cloth = fc.Cloth.rectangle(0.3, 0.3, h, pattern="right")
        ball = fc.Obstacle(
            fc.shapes.Sphere((0.15, 0.15, -radius - 1e-3), radius), gap=2e-3, friction=friction
        )
        terms = [fc.StVK(), fc.Gravity((1.0, 0, -9.81)), ball]
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms)
        return cloth, system, fc.BackwardEuler(), system.rest()

    answer = fc.sensitivity(
        sliding, ["friction", "radius"], "mean_displacement.x", h=0.15, dt=2e-3, t_end=0.02
    )
    assert answer.checked < 1e-2


def test_a_number_at_its_limit_ends_no_simplify(scene):
    """An obstacle far away whose restitution is 1 has no values on both sides of it."""
    obstacle = """[[terms]]
type = "Obstacle"
shape = { type = "Plane", point = [0.0, 0.0, -9.0], normal = [0.0, 0.0, 1.0] }
gap = 0.001
restitution = 1.0
"""
    scene.write_text(scene.read_text().replace("[[pins]]", obstacle + "[[pins]]"))
    opened = fc.study.of(str(scene)).problem
    words = describe_weak_terms(opened, opened.quantities, 0.01, Runs(quiet=True))
    assert "whether numbers of terms count is not known" in words
    assert "restitution" in words


@pytest.mark.parametrize("wrong_by", [0.008, 0.05])
def test_a_narrower_pair_of_twin_runs_is_no_looser(wrong_by, twins_of):
    """The quantity changes by 1e-5 of its value: its derivative is judged as any other."""
    twins_of([1e-5], lambda change: 1 + 1e-5 * (1 + wrong_by) * change[0])
    answer = fc.sensitivity(strip, ["drawn"], "area", h=0.25)
    assert answer.checked == pytest.approx(wrong_by, rel=1e-3)
    assert np.isfinite(answer.derivative[0]) == (wrong_by < LARGEST_ERROR)


# --- along a path on which the threads of a fabric slide ------------------------------------------

LAID, FALLS = LoadSteps(20), fc.BDF2()


def rubbing(method, hysteresis=6e-4, rigidity=2e-5):
    cloth = fc.Cloth.rectangle(0.2, 0.05, h=0.05, pattern="right")
    fabric = fc.Fabric(0.05, 200.0, bending_rigidity=rigidity, bending_hysteresis=hysteresis)
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    return cloth, system, method, system.rest()


@pytest.mark.stories
@pytest.mark.parametrize(
    ("method", "times"),
    [
        pytest.param(LAID, {"t_end": 1.0}, id="laid"),
        pytest.param(None, {}, id="at rest"),
        pytest.param(FALLS, {"dt": 4e-3, "t_end": 0.1}, id="falls"),
    ],
)
def test_the_place_depends_on_the_hysteresis_as_twin_runs_say(method, times):
    def problem(hysteresis=6e-4, rigidity=2e-5):
        return rubbing(method, hysteresis, rigidity)

    start = {"hysteresis": 6e-4, "rigidity": 2e-5}
    answer = fc.sensitivity(problem, start, "tip.z", probes=TIP, **times)
    assert answer.checked < 1e-4
    assert abs(answer.elasticity).min() > 1e-3
