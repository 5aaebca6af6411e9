"""Pins in a run, and their prescribed motion."""

import numpy as np
import pytest
from conftest import flat
from support.tiers import MASSES, in_turn

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.system.constraints import Constraints

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ALL = [method() for method in METHODS.values()]


def end_of_run(cloth, fabric, pins, method=ALL[0], t=0.0, **options):
    """State after four steps of 5 ms from `t`, with gravity and a start out of the plane."""
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=pins, **options)
    start = system.state(flat(cloth) + [0.0, 0.0, 0.7], np.full((len(cloth.X), 3), 0.1), t)
    return start, fc.run(system, method, start, 5e-3, t + 0.02, solver="direct").state


@pytest.mark.parametrize(("method", "mass"), in_turn(ALL, MASSES), ids=str)
def test_a_fixed_pin_stays_to_the_last_bit(method, mass, small, isotropic):
    start, end = end_of_run(small, isotropic, ["left", fc.Pin([3])], method, mass=mass)
    held = np.union1d(small.nodes("left"), [3])
    others = np.setdiff1d(np.arange(len(small.X)), held)
    assert np.array_equal(end.x[held], start.x[held])
    assert not end.v[held].any()
    assert abs(end.x - start.x)[others].max(axis=1).min() > 1e-5


@pytest.mark.parametrize(("method", "mass"), in_turn(ALL, MASSES), ids=str)
def test_moved_pin_follows_its_motion(method, mass, small, isotropic):
    """Only the changes of the motion count, from the run's own start time."""

    def motion(t):
        return np.array([np.sin(9 * t), 5.0, 0.3 * t])

    def velocity(t):
        return np.array([9 * np.cos(9 * t), 0.0, 0.3])

    pins = [fc.Pin("left", motion, velocity)]
    start, end = end_of_run(small, isotropic, pins, method, t=0.3, mass=mass)
    held = small.nodes("left")
    expected = start.x[held] + motion(0.32) - motion(0.3)
    np.testing.assert_allclose(end.x[held], expected, rtol=0, atol=4e-15)
    assert np.array_equal(end.v[held], np.tile(velocity(0.32), (len(held), 1)))


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
    start, end = end_of_run(small, isotropic, [pin])
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
