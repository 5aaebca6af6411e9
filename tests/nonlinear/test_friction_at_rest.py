"""Equilibria with friction: against closed forms, along a path of load steps, from any start."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import flat
from support.tiers import stories_except

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps
from studies.contact.references import capstan_at_rest

S = fc.shapes
UP = (0, 0, 1)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
GAP = 1e-3


@pytest.mark.stories
@pytest.mark.parametrize("case", [(0.3, 90), (0.6, 90), (0.3, 180)])
def test_a_strip_round_a_cylinder_meets_the_capstan_equation(case):
    mu, degrees = case
    ratio = capstan_at_rest(mu, math.radians(degrees))
    assert ratio == pytest.approx(math.exp(mu * math.radians(degrees)), rel=0.01)


def on_a_slope(part, mu=0.3, lift=0.0):
    """A sheet on a slope of the angle atan(part × μ), and the direction down it."""
    angle = math.atan(part * mu)
    c, s = math.cos(angle), math.sin(angle)
    cloth = fc.Cloth.rectangle(0.2, 0.1, h=0.05)
    slope = fc.Obstacle(S.Plane((0, 0, 0), (s, 0, c)), gap=GAP, friction=mu, stiffness=1e3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), slope])
    x = cloth.X @ np.array([[c, 0, -s], [0, 1, 0]]) + (0.97 * GAP + lift) * np.array([s, 0, c])
    return system, system.state(x), np.array([c, 0, -s])


@pytest.mark.parametrize("load_steps", stories_except([None, 3], None))
def test_a_sheet_holds_on_a_slope_below_the_angle_of_friction(load_steps):
    """It gives way by the stretch F/k of the springs to its anchors, k = 100 κ A/gap."""
    part, places = 0.8, []
    for lift in (0.0, 4 * GAP):  # without any normal force at the start, too
        system, start, down = on_a_slope(part, lift=lift)
        end = fc.equilibrium(system, start, load_steps=load_steps)
        places.append((end.x - start.x) @ down)
        assert "depends on the way there" in end.reason
        assert not end.warnings
    shear = 0.2 * 9.81 * math.sin(math.atan(part * 0.3))  # per area
    np.testing.assert_allclose(places, shear / (100 * 1e3 / GAP), rtol=1e-3)


@pytest.mark.parametrize("load_steps", stories_except([None, 2], None))
def test_a_sheet_slides_off_a_slope_above_the_angle_of_friction(load_steps):
    system, start, _ = on_a_slope(1.25)
    with pytest.raises(fc.EquilibriumFailed, match="neither pins nor friction hold the cloth"):
        fc.equilibrium(system, start, load_steps=load_steps)


def dragged(pull, table=None, steps=4):
    """A run in load steps of a strip on a table, the end of which is pulled by formulas of t."""
    cloth = fc.Cloth.rectangle(0.4, 0.02, 0.02, pattern="right")
    plane = fc.Obstacle(S.Plane((0, 0, 0), UP, motion=table), friction=0.5)
    pin = fc.Pin("right", motion=(pull, 0, 0))
    system = fc.System(cloth, fc.Fabric(0.2, 50.0), [fc.StVK(), fc.Gravity(), plane], [pin])
    return fc.run(system, LoadSteps(steps), system.state(flat(cloth) + [0, 0, 0.99e-3]), t_end=1.0)


WEIGHT = 0.2 * 0.4 * 0.02 * 9.81 * (1 - 1 / 40)  # without what the pin carries


def test_a_dragged_strip_is_held_by_friction_and_heats():
    run = dragged("0.05*t")
    pull = run.observed["reaction:right.x"][1:]
    np.testing.assert_allclose(pull, 0.5 * WEIGHT * run.times[1:], rtol=0.02)
    heat = np.diff(run.energies["dissipated:Obstacle"])
    np.testing.assert_allclose(heat, pull * 0.05 / 4, rtol=0.06)  # the far end stays behind
    assert abs(run.energies["remainder"]).max() < 1e-9 * heat.sum()
    assert any("number of load steps, here 4" in words for words in run.accounts.words())


@pytest.mark.stories
def test_a_table_that_moves_does_the_work_of_a_pull():
    pulled, carried = dragged("0.05*t"), dragged("0*t", table=("-0.05*t", 0, 0))
    for name in ("reaction:right.x", "least_distance:Obstacle"):
        np.testing.assert_allclose(carried.observed[name][1:], pulled.observed[name][1:], rtol=1e-6)
    energies = [run.energies["dissipated:Obstacle"][-1] for run in (pulled, carried)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-6)
    assert carried.energies["work:Obstacle"][-1] > energies[1]


@pytest.mark.stories
def test_a_pull_back_and_forth_dissipates():
    """Force against way is a loop, whose area is the heat: of the full loads in its second half."""
    run = dragged("0.02*(1 - abs(2*t - 1))", steps=8)
    pull = run.observed["reaction:right.x"][1:] / (0.5 * WEIGHT * run.times[1:])
    np.testing.assert_allclose(pull, [1] * 4 + [-1] * 4, rtol=0.03)
    heat = run.energies["dissipated:Obstacle"][-1]
    assert heat == pytest.approx(
        abs(run.observed["reaction:right.x"][1:]).sum() * 0.04 / 8, rel=0.1
    )
    assert run.energies["pins"][-1] > 0.75 * heat  # the mean of two forces, where the pull turns


@pytest.mark.stories
def test_a_table_that_turns_and_moves_takes_the_cloth_along():
    cloth = fc.Cloth.rectangle(0.2, 0.2, h=0.1)
    turn = fc.Rotation((0.1, 0.1, 0), UP, "0.6*t")
    shape = S.Plane((0, 0, 0), UP, rotate=turn, motion=(0, 0, "0.1*t"))
    table = fc.Obstacle(shape, gap=GAP, friction=2.0, stiffness=1e3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), table])
    x = flat(cloth) + [0, 0, 0.975e-3]
    end = fc.equilibrium(system, system.state(x), load_steps=3)
    np.testing.assert_allclose(end.x[:, :2], shape.pose(1.0).to_space(x)[:, :2], atol=1e-6)


@pytest.mark.stories
def test_a_layer_is_pulled_off_another_in_any_order_of_the_terms():
    """The pull is μ times the force of one layer on the other."""
    pytest.importorskip("ipctk")
    lower, upper = fc.Cloth.rectangle(0.3, 0.1, h=0.03), fc.Cloth.rectangle(0.1, 0.06, h=0.024)
    cloth = fc.Cloth.join([lower, upper], names=["lower", "apron"])
    x, on = flat(cloth), cloth.nodes("apron")
    x[on] += [0.1 - x[on, 0].min(), 0.02 - x[on, 1].min(), 1.9e-3]
    grip = fc.Pin(on[x[on, 0] > x[on, 0].max() - 1e-9], motion=("0.01*t", 0, 0), name="grip")
    floor = fc.Obstacle(S.Plane((0, 0, -0.05), UP), friction=0.2)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.SelfContact(gap=2e-3, friction=0.4)]
    fabric, ends = fc.Fabric(0.2, 200.0, bending_rigidity=1e-5), []
    for ordered in ([*terms, floor], [floor, *terms[::-1]]):
        system = fc.System(cloth, fabric, ordered, ["lower", grip])
        run = fc.run(system, LoadSteps(5), system.state(x), t_end=1.0)
        pull, lift = (run.observed[f"reaction:grip.{c}"][-1] for c in "xz")
        assert pull == pytest.approx(0.4 * (0.2 * 0.1 * 0.06 * 9.81 - lift), rel=0.01)
        ends.append(run.state.x)
    np.testing.assert_allclose(*ends, atol=1e-9 * 0.01)


def test_a_restitution_does_not_count_at_rest():
    """With a speed over the increment, the pressure of an obstacle would be another one."""
    system, start, _ = on_a_slope(0.5)
    *terms, slope = system.terms
    places = []
    for restitution in (0.5, 1.0):
        changed = replace(slope, restitution=restitution)
        each = fc.System(system.cloth, system.fabric, [*terms, changed])
        places.append(fc.equilibrium(each, start).x)
    np.testing.assert_allclose(*places, atol=1e-9)
