"""Several contacts: one first guess, steps that are repeated, what cannot be met is named."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.integrators.protocol import refuse_crossed, take_step
from fecloth.integrators.step import Step
from fecloth.mesh.surface import find_intersections
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.scene.scene import scene_of
from fecloth.simulation.fixed_step import FixedStep
from fecloth.terms.contact.guess import Way, find_guess

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

pytest.importorskip("ipctk")
GAP = 1e-3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
FLOOR = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), gap=GAP, friction=0.3)
ITSELF = fc.SelfContact(GAP, friction=0.3)


def two_layers(contacts, speed):
    """Two tilted sheets of 12 cm, one above the other, that fall on a plane."""
    lower, upper = (fc.Cloth.rectangle(0.12, 0.12, h) for h in (0.05, 0.055))
    cloth = fc.Cloth.join([lower, upper], names=["lower", "upper"])
    x = np.vstack([np.column_stack([each.X, 0 * each.X[:, 0]]) for each in (lower, upper)])
    x[:, 2] = 0.006 + 0.05 * (x[:, 0] + 0.3 * x[:, 1])
    x[len(lower.X) :] += 0.004
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), *contacts]
    system = fc.System(cloth, FABRIC, terms)
    return system, system.state(x, np.zeros_like(x) - [0, 0, speed])


def crosses(system, x):
    return len(find_intersections(system.cloth.triangles, x)) > 0


@pytest.mark.stories
def test_the_order_of_the_contacts_changes_the_motion_by_less_than_a_hundred_thousandth():
    """The motion amplifies round-off of the start a thousandfold and more."""
    ends = []
    for contacts, moved in (([ITSELF, FLOOR], 0), ([FLOOR, ITSELF], 0), ([ITSELF, FLOOR], 1)):
        system, start = two_layers(contacts, 3.0)
        start = system.state(start.x * (1 + 1e-13 * moved), start.v)
        given = system, fc.BackwardEuler(), start, 0.005, 0.05
        *_, (state, _) = fc.march(*given, newton=fc.Newton(tolerance=1e-11), solver="direct")
        assert not crosses(system, state.x)
        assert state.x[:, 2].min() > 0
        ends.append(state.x)
    for end in ends[1:]:
        assert abs(end - ends[0]).max() < 1e-5 * abs(start.x).max()


class Stubborn:
    """A method that solves no step longer than `most`."""

    traits = fc.BackwardEuler().traits

    def __init__(self, most):
        self.most, self.sizes = most, []

    def step(self, system, state, dt, solver, memory=None, history=None):
        self.sizes.append(dt)
        if dt > self.most:
            raise NewtonFailed("too long", np.nan, "")
        new = replace(state, t=state.t + dt)
        return Step(new, new, dt, Counts())


def step_of(method, horizon=1.0, memory=None):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1.0, pattern="right")
    obstacle = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)), gap=GAP)
    system = fc.System(cloth, FABRIC, [fc.StVK(), obstacle])
    return FixedStep(method, 1.0).step(system, system.rest(), horizon, None, memory)


@pytest.mark.parametrize(("most", "repeated"), [(1.25, 0), (0.8, 1), (0.4, 2), (0.1, 4)])
def test_a_step_that_fails_is_repeated_over_half_of_it(most, repeated):
    step = step_of(Stubborn(most))
    assert (step.counts.rejected, step.size) == (repeated, 0.5**repeated)
    assert step.memory.size == min(1.0, 2 * step.size)  # the next one is twice as long again
    assert step.memory.method_memory == step.size


def test_the_log_says_which_step_was_repeated_and_how_long_it_was(tmp_path, monkeypatch):
    def fails_above(method, system, state, dt, *others):
        if dt > 0.003:
            raise NewtonFailed("too long", np.nan, "")
        return take_step(method, system, state, dt, *others)

    monkeypatch.setattr("fecloth.simulation.fixed_step.take_step", fails_above)
    plane = {"type": "Plane", "point": [0, 0, -1], "normal": [0, 0, 1]}
    scene = {
        "cloth": {"shape": "rectangle", "width": 1.0, "height": 1.0, "h": 1.0},
        "fabric": {"areal_density": 0.2, "tensile_stiffness": 100.0},
        "terms": [
            {"type": "StVK"},
            {"type": "Obstacle", "shape": plane},
        ],
        "time": {"method": "bdf2", "dt": 0.01, "t_end": 0.02},
    }
    fc.run_scene(scene_of(scene), tmp_path / "out")
    words = "step 1 to 0.0025 s is repeated with 0.0025 s, after 2 longer attempts without"
    assert (tmp_path / "out" / "run.log").read_text().count(words) == 1


def test_a_state_that_has_crossed_is_refused_by_name():
    system, start = two_layers([ITSELF, FLOOR], 1.0)
    refuse_crossed(system, start)
    below = start.x - [0, 0, 0.01]
    with pytest.raises(NewtonFailed, match="Obstacle: the cloth has passed through"):
        refuse_crossed(system, system.state(below))
    through = start.x.copy()
    through[len(through) // 2 :, 2] -= 0.004  # the upper sheet is tilted into the lower one
    through[-3:, 2] += 0.004
    with pytest.raises(NewtonFailed, match="SelfContact: the cloth has passed through"):
        refuse_crossed(system, system.state(through))


def thrown(speed):
    """A free sheet above a ball, thrown at it: the centre of the ball is below a triangle."""
    cloth = fc.Cloth.rectangle(0.15, 0.15, 0.05)
    ball = fc.Obstacle(fc.shapes.Sphere((0.075, 0.075, 0), 0.05), GAP)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), ball])
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 0.055)])
    return system, system.state(x, np.zeros_like(x) - [0, 0, speed])


@pytest.mark.parametrize(("way", "leaps"), [(0.0, False), (0.14, True)])
def test_a_step_to_the_other_side_of_an_obstacle_is_refused_by_name(way, leaps):
    system, old = thrown(20.0)
    new = system.state(old.x - [0, 0, way], t=0.01)
    refuse_crossed(system, new)
    refusal = pytest.raises(NewtonFailed, match="Obstacle: .* on the other side of it")
    with refusal if leaps else nullcontext():
        refuse_crossed(system, new, old)


def test_the_error_in_space_of_a_state_that_has_crossed_is_no_error():
    """A run ends with its result, whatever is known of it."""
    system, start = two_layers([ITSELF, FLOOR], 1.0)
    below = system.state(start.x - [0, 0, 0.01])
    densities = [fc.space_error(system, state).density for state in (below, start)]
    np.testing.assert_allclose(*densities, atol=1e-12)
    with pytest.raises(fc.InputError, match="inside"):
        next(fc.march(system, fc.BackwardEuler(), below, 0.01, 0.1))


def test_a_held_node_that_is_led_into_an_obstacle_is_named():
    cloth = fc.Cloth.rectangle(0.1, 0.1, 0.05, pattern="right")
    down = fc.Pin("left", motion=(0, 0, "-t"))
    ball = fc.Obstacle(fc.shapes.Sphere((0, 0.05, -0.06), 0.05), gap=GAP)
    below = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)), gap=GAP)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), ball, below]
    system = fc.System(cloth, FABRIC, terms, [down])
    with pytest.raises(fc.StepFailed, match=r"held nodes? into Obstacle.*: \d") as failure:
        for _ in fc.march(system, fc.BackwardEuler(), system.rest(), 0.005, 0.1):
            pass
    assert failure.value.t < 0.02


class Wall:
    """A contact that stops each node at `parts` of its way, and all at `free` of it."""

    body, supplies = None, False

    def __init__(self, parts, free=1.0, allowed=True):
        self.own, self.free, self.allowed = np.array(parts), free, allowed

    def parts(self, begin, end, t):
        return self.own

    def free_part(self, begin, end, t):
        return self.free

    def allows(self, x, t):
        return self.allowed


def guess_of(*walls):
    start, x = np.zeros((2, 3)), np.ones((2, 3))
    ways = [Way(wall, start, start, 1.0) for wall in walls]
    there = find_guess(ways, x, hold=lambda x: x)
    return None if there is None else there[:, 0].tolist()


def test_each_node_stops_at_its_first_obstacle_and_all_go_the_least_free_part():
    first, second = Wall([0.5, 1.0]), Wall([0.25, 0.75], free=0.5)
    assert guess_of(first) == [0.5, 1.0]
    assert guess_of(first, second) == guess_of(second, first) == [0.125, 0.375]
    assert guess_of(Wall([1.0, 1.0]), Wall([1.0, 1.0])) == [1.0, 1.0]
    assert guess_of(first, Wall([1.0, 1.0], allowed=False)) is None


def test_a_contact_alone_is_trusted_with_what_it_has_limited_itself():
    wall = Wall([1.0, 1.0], free=0.5, allowed=False)
    assert guess_of(wall) == [0.5, 0.5]
    assert guess_of(wall, wall) is None


def test_nodes_beside_a_held_one_may_go_farther_than_the_body():
    class Needle(Wall):
        supplies = True

        def allows(self, x, t):
            return x[1, 0] >= 2.0

    start, carried = np.zeros((2, 3)), np.ones((2, 3))
    needle = Needle([1.0, 1.0], free=0.5)
    way = Way(needle, carried, start, 1.0)
    there = find_guess([way], carried + 0.1, lambda x: np.vstack([start[:1], x[1:]]))
    assert there[:, 0].tolist() == [0.0, 2.0]


def test_nodes_that_pins_hold_are_not_moved_by_a_guess():
    start, x = np.zeros((2, 3)), np.ones((2, 3))

    def hold(there):
        return np.vstack([x[:1], there[1:]])

    alone = find_guess([Way(Wall([0.5, 0.5]), start, start, 1.0)], x, hold)
    assert alone[:, 0].tolist() == [1.0, 0.5]
    refuses = Wall([0.5, 0.5], allowed=False)  # asked, as the pin leads where it has not looked
    assert find_guess([Way(refuses, start, start, 1.0)], x, hold) is None
