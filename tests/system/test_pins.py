"""Pins and slides in a run of every method, and their prescribed motion."""

import numpy as np
import pytest
from conftest import affine, flat
from support.linear_term import LinearDamping, LinearMembrane
from support.tiers import MASSES, in_turn

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.system.constraints import Constraints

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ALL = [method() for method in METHODS.values()]


T0 = 0.3  # s, where the runs begin
SLOPED = np.array([1.0, -2.0, 2.0]) / 3
SLIDES = [
    {"direction": (0, 1, 0)},
    {"normal": (1, 0, 0)},
    {"direction": tuple(SLOPED)},
    {"normal": tuple(SLOPED)},
]


def shake(t):
    return np.array([0.02 * np.sin(30 * t), 5.0, 0.05 * np.sin(40 * t)])


def speed(t):
    return np.array([0.6 * np.cos(30 * t), 0.0, 2 * np.cos(40 * t)])


@pytest.fixture(scope="module", params=in_turn(ALL, SLIDES, MASSES), ids=str)
def run(request, small, isotropic):
    """A linear cloth with damping, of which a part is fixed, one is moved, and two slide."""
    method, free, mass = request.param
    right, left = small.nodes("right"), small.nodes("left")
    pins = [
        fc.Pin(left[:2], name="fixed"),
        fc.Pin(right[:2], shake, speed, name="moved"),
        fc.Slide(left[2:], **free, name="slide"),
        fc.Slide(right[2:], shake, speed, normal=tuple(SLOPED), name="moved slide"),
    ]
    terms = [LinearMembrane(), LinearDamping(0.01), fc.Gravity((2.0, -3.0, -9.81))]
    system = fc.System(small, isotropic, terms, pins, mass=mass)
    start = system.state(affine(small, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]]), t=T0)
    newton = fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, 5e-3, T0 + 0.1, solver="direct", newton=newton)
    return system, method, start, result


def part(run, name):
    """Its pin, how far its nodes have come, and their velocity."""
    system, _, start, result = run
    pin, nodes = system.constraints.groups[name]
    return pin, (result.state.x - start.x)[nodes], result.state.v[nodes]


def test_a_fixed_pin_stays_to_the_last_bit(run):
    _, way, v = part(run, "fixed")
    assert not way.any()
    assert not v.any()
    free = np.setdiff1d(np.arange(len(run[2].x)), run[0].constraints.nodes)
    assert abs(run[3].state.x - run[2].x)[free].max(axis=1).min() > 1e-5


def test_a_moved_pin_follows_the_changes_of_its_motion(run):
    """From the run's own start time."""
    _, way, v = part(run, "moved")
    expected = np.tile(shake(T0 + 0.1) - shake(T0), (len(way), 1))
    np.testing.assert_allclose(way, expected, rtol=0, atol=4e-15)
    assert np.array_equal(v, np.tile(speed(T0 + 0.1), (len(v), 1)))


def test_nodes_leave_their_line_or_plane_in_no_method(run):
    pin, way, v = part(run, "slide")
    across = np.eye(3) - pin.projector
    assert abs(way @ across).max() < 1e-15
    assert abs(v @ across).max() < 1e-15
    assert np.linalg.norm(way @ pin.projector, axis=1).min() > 1e-4
    reaction = np.array([run[3].observed[f"reaction:slide.{c}"][-1] for c in "xyz"])
    assert np.linalg.norm(reaction) > 0.01
    np.testing.assert_allclose(pin.projector @ reaction, 0.0, atol=1e-14)
    pin, way, _ = part(run, "moved slide")
    np.testing.assert_allclose((way - shake(T0 + 0.1) + shake(T0)) @ SLOPED, 0.0, atol=1e-15)


def test_the_ledger_closes_with_a_moved_slide(run):
    energies = run[3].energies
    assert abs(energies["pins"]).max() > 1e-3
    assert abs(energies["remainder"]).max() < 1e-10 * abs(energies["total"]).max()


def test_velocity_is_a_central_difference_or_the_argument():
    """The difference over ± 1e-5 s errs by 1e-10/6 of the third derivative."""
    pin = fc.Pin("left", lambda t: [np.sin(7 * t), t**2, 2.0])
    for t in (0.0, 0.4, 3.0):
        assert pin.speed(t) == pytest.approx([7 * np.cos(7 * t), 2 * t, 0.0], abs=7**3 * 1e-10)
        assert pin.displacement(t) == pytest.approx([np.sin(7 * t), t**2, 2.0], abs=1e-15)
    told = fc.Pin("left", lambda t: [t, 0.0, 0.0], velocity=lambda t: [1.0, 0.0, t])
    assert told.speed(0.5).tolist() == [1.0, 0.0, 0.5]
    formulas = fc.Pin("left", lambda t: [t, 0.0, 0.0], velocity=["1", 0, "t * Y"])
    there = formulas.at(np.array([[0.0, 2.0], [0.0, 4.0]]))
    assert there.speed(0.5).tolist() == [[1.0, 0.0, 1.0], [1.0, 0.0, 2.0]]
    assert not fc.Pin("left").speed(1.0).any()
    assert not fc.Pin("left").displacement(1.0).any()


def test_motion_for_each_node_follows_the_order_of_indices(small):
    motion = {5: [1.0, 0.0, 0.0], 2: [0.0, 2.0, 0.0]}
    pin = fc.Pin([5, 2], motion=lambda t: t * np.array([motion[5], motion[2]]))
    x, v = Constraints.bind([pin], small).target(0.0, 1.0, flat(small))
    for node, way in motion.items():
        assert x[node] - flat(small)[node] == pytest.approx(way)
        assert v[node] == pytest.approx(way)


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.BDF2()], ids=repr)
def test_motion_is_not_evaluated_before_the_start(method, small, isotropic):
    """One that has no value before, as √t³; its difference does not reach back either."""
    asked = []

    def motion(t):
        asked.append(t)
        return [0.0, 0.0, (t - 0.5) ** 1.5]  # complex before t = 0.5

    pins = [fc.Pin("left", lambda t: motion(0.5 + t))]
    system = fc.System(small, isotropic, [fc.StVK()], pins)
    end = fc.run(system, method, system.rest(), 1e-6, 5e-6).state  # less than the difference
    assert min(asked) >= 0.5
    left = small.nodes("left")
    assert end.x[left, 2] == pytest.approx(5e-6**1.5)
    far = fc.Pin("left", lambda t: [t**1.5, t**2, 0.0])
    assert far.speed(1.0, since=1.0) == pytest.approx([1.5, 2.0, 0.0], abs=1e-9)


# --- formulas -------------------------------------------------------------------------------------


def test_formulas_in_python_are_those_of_scenes(small, isotropic):
    """Of t alone, and of X and Y with a row for each node; numbers count as formulas."""
    left = small.nodes("left")
    pin = fc.Pin("left", motion=["0", 0, "0.1*sin(t) + 0.2*Y*t**2"])
    bound, _ = Constraints.bind([pin], small).groups["left"]
    Y = small.X[left, 1]
    zero = np.zeros_like(Y)
    shown = np.column_stack([zero, zero, 0.1 * np.sin(0.3) + 0.2 * Y * 0.3**2])
    np.testing.assert_allclose(bound.displacement(0.3), shown, rtol=1e-15, atol=0)
    speed = np.column_stack([zero, zero, 0.1 * np.cos(0.3) + 0.4 * Y * 0.3])
    np.testing.assert_allclose(bound.speed(0.3), speed, rtol=1e-15, atol=0)
    system = fc.System(small, isotropic, [fc.StVK(), fc.Gravity()], [pin])
    start = system.rest()
    end = fc.run(system, fc.BDF2(), start, 5e-3, 0.02).state
    change = bound.displacement(0.02) - bound.displacement(0.0)
    np.testing.assert_allclose(end.x[left], start.x[left] + change, rtol=0, atol=1e-15)
    assert np.array_equal(end.v[left], bound.speed(0.02))


def test_the_speed_of_formulas_is_exact_and_needs_no_other_time():
    pin = fc.Slide("left", ["log(1 - t)", "0", "0.1*sin(2*pi*t)"], normal=(0, 0, 1))
    for t in (0.0, 0.3, 0.999999):
        exact = [-1 / (1 - t), 0.0, 0.2 * np.pi * np.cos(2 * np.pi * t)]
        assert pin.speed(t) == pytest.approx(exact, rel=1e-15)
    assert fc.Pin("left", ["sqrt(t)**3", 0, 0]).speed(0.0, since=0.0).tolist() == pytest.approx(
        [(4 - 8**0.5) * 1e-5**0.5 / 2, 0.0, 0.0]
    )  # 0 times infinity by the chain rule: a difference quotient


GENERAL = ["0.1*(t*Y)**1.5", "0.02*sin(9*t)*(1 - Y)", "0.03*sin(7*t + 2*Y)*where(t < 0.4, t, 0.4)"]
OF_TIME = ["exp(-t)*(1 + t)**1.7", "0.02*sin(9*t)", "where(t < 0.4, t, 0.4)"]


@pytest.mark.parametrize("motion", [GENERAL, OF_TIME, ["0.1*Y**t", 0, 0]])
@pytest.mark.parametrize("nodes", [1, 3, 21])
def test_times_evaluated_at_once_have_the_bits_of_single_ones(motion, nodes, rng):
    pin = fc.Pin("left", motion).at(rng.uniform(0.1, 1.0, (nodes, 2)))
    times = np.append(rng.uniform(0.01, 1.0, 60), [2.0, 1.0])
    for some in (times, times[-2:], times[-1:]):
        path, speed = pin.over_steps(0.5 * some, some)
        assert path.shape == speed.shape == (len(some), nodes if "Y" in str(motion) else 1, 3)
        for row, t in enumerate(some.tolist()):
            change = pin.displacement(t) - pin.displacement(0.5 * t)
            assert np.array_equal(path[row].ravel(), change.ravel())
            assert np.array_equal(speed[row].ravel(), pin.speed(t).ravel())
