"""Friction: derivatives, the slope at which a sheet slides, its acceleration, its heat."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import flat
from support.obstacles import near
from support.over_step import Over
from support.tiers import stories_except

import fecloth as fc
from fecloth.terms.contact import friction
from fecloth.terms.step_difference import StepDifference

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

S = fc.shapes
UP = (0, 0, 1)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
GAP = 0.02
TURN = fc.Rotation((0.1, 0, 0), (0.1, 0.2, 1), "0.5*t")
MOVED = {"motion": ("0.02*t", 0, "0.1*t"), "rotate": TURN}
SHAPES = {
    "plane": S.Plane((0, 0, 0), (0.1, -0.05, 1)),
    "sphere": S.Sphere((0.15, 0.1, -0.3), 0.3, **MOVED),
    "cylinder": S.Cylinder((0.15, 0.1, -0.2), (1, 0.2, 0), 0.2, **MOVED),
    "sdf": S.Sdf("2*z - 0.02*sin(20*x)*cos(10*y) + (0.5 + t)*(x - 0.15)**2", radius=0.1, **MOVED),
}


RESTS = 0.0254e-3  # below the gap, at p(s) = 0.2 g/κ with κ = 1000 Pa


def relative_errors(system, t, x, v, of_energy, size=1e-7):
    """Of the force against the energy, K and D against the force, by differences over `size`."""
    rng = np.random.default_rng(1)
    s = rng.standard_normal(x.shape)
    speed = np.linalg.norm(v, axis=1).mean()

    def at(dx=0.0, dv=0.0):
        return fc.State(t, x + dx * s, v + dv * s)

    term, errors = system.bound[0], []
    if of_energy:
        slope = (term.energy(at(size).x, t) - term.energy(at(-size).x, t)) / (2 * size)
        errors.append(abs(slope / -np.vdot(system.force(at()), s) - 1))
    for tangent, ways in (
        (system.stiffness(at()), (at(size), at(-size), size)),
        (system.damping(at()), (at(0, size * speed), at(0, -size * speed), size * speed)),
    ):
        exact = -(tangent @ s.ravel())
        if np.linalg.norm(exact):
            change = (system.force(ways[0]) - system.force(ways[1])).ravel() / (2 * ways[2])
            errors.append(np.linalg.norm(change - exact) / np.linalg.norm(exact))
    return errors


@pytest.mark.parametrize("speed", [1.0, 1e-4], ids=["slides", "creeps"])
@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_at_a_state(name, speed, rng):
    """The exact tangents, by x not symmetric, on shapes that move, turn and deform."""
    cloth, t = fc.Cloth.rectangle(0.3, 0.2, h=0.1), 0.4
    obstacle = fc.Obstacle(SHAPES[name], GAP, 0.7, 200.0)
    system = fc.System(cloth, FABRIC, [obstacle])
    x = near(cloth, obstacle, t)
    v = obstacle.shape.velocity(x, t) + speed * rng.standard_normal(x.shape)
    errors = relative_errors(system, t, x, v, of_energy=False)
    assert len(errors) == 2
    assert max(errors) < 3e-5
    assert not system.symmetric


@pytest.mark.parametrize("way", [0.03, 1e-6], ids=["slides", "creeps"])
@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_over_a_step(name, way, rng):
    """The friction over a step has a potential, and its tangent is symmetric."""
    cloth, t, dt = fc.Cloth.rectangle(0.3, 0.2, h=0.1), 0.4, 0.01
    restitution = 0.0 if way > 1e-3 else 1.0  # which round-off hides at the lower speed
    obstacle = fc.Obstacle(SHAPES[name], GAP, 0.7, 200.0, restitution)
    x = near(cloth, obstacle, t)
    last = fc.integrators.bdf2.Change(
        0.6 * dt, way * rng.standard_normal(x.shape), np.zeros_like(x)
    )
    state = fc.State(t, x, np.zeros_like(x))
    for step in (
        StepDifference(x, dt, dt, ((1.0, x),), t=t),
        fc.BDF2().difference(state, dt, last),
        fc.BDF2().difference(state, dt, None),
    ):
        system = fc.System(cloth, FABRIC, [Over(obstacle, step)])
        end = x + obstacle.shape.velocity(x, t) * dt + 0.01 * way * rng.standard_normal(x.shape)
        still, size = np.zeros_like(x), 1e-7 if way > 1e-3 else 2e-10
        errors = relative_errors(system, t + dt, end, still, of_energy=True, size=size)
        assert max(errors) < 3e-5
        K = system.stiffness(fc.State(t + dt, end, np.zeros_like(x))).toarray()
        assert abs(K - K.T).max() < 1e-10 * abs(K).max()


@pytest.mark.parametrize("name", SHAPES)
def test_the_work_of_an_obstacle_is_the_change_of_its_energy_in_time(name):
    """Of a cloth at rest, without friction; with it, its force at the surface does work besides."""
    cloth, t, dt = fc.Cloth.rectangle(0.3, 0.2, h=0.1), 0.4, 1e-6
    obstacle = fc.Obstacle(SHAPES[name], GAP, 0.0, 200.0, restitution=1.0)
    x = near(cloth, obstacle, t)
    term, rubs = (
        fc.System(cloth, FABRIC, [each]).bound[0].over_step(StepDifference.between(x, dt, t))
        for each in (obstacle, replace(obstacle, friction=0.7))
    )
    change = 0.5 * (term.energy(x, t + 2 * dt) - term.energy(x, t))  # as the force, at t + dt
    assert term.contact.supplies == obstacle.shape.moves
    assert term.work(x) == pytest.approx(change, rel=1e-5, abs=1e-18)
    f, push = np.zeros_like(x), np.zeros_like(x)
    end = x + dt * np.array([0.1, 0.2, 0.0])
    rubs.add_force(end, x, t + dt, f)
    term.add_force(end, x, t + dt, push)
    rubbing = dt * np.vdot(f - push, obstacle.shape.velocity(x, t))
    assert rubs.work(end) - term.work(end) == pytest.approx(rubbing, rel=1e-5, abs=1e-18)


def test_the_factor_is_the_derivative_of_the_potential():
    y, h = np.linspace(1e-4, 2e-3, 40), 1e-8
    slope = (friction.potential(y + h, 1e-3) - friction.potential(y - h, 1e-3)) / (2 * h)
    np.testing.assert_allclose(friction.factor(y, 1e-3) * y, slope, rtol=1e-6)
    assert friction.factor(np.array([2.0]), 1e-3)[0] == 0.5


def test_the_potential_of_friction_goes_on_without_a_jump_where_sliding_begins():
    """f₀(y) = y beyond ε, and below it the cubic that meets it with its slope and curvature."""
    eps = 1e-3
    at, beyond = friction.potential(np.array([1 - 1e-9, 1.0]) * eps, eps)
    assert at == pytest.approx(beyond, rel=2e-9)
    assert beyond == eps
    assert friction.potential(np.array([0.0, 3 * eps]), eps) == pytest.approx([eps / 3, 3 * eps])


def slide(angle, mu, method, t_end=0.3, dt=0.01):
    """Mean velocity down a slope [m/s] of a sheet that was laid on it at rest, and the run."""
    cloth = fc.Cloth.rectangle(0.2, 0.1, h=0.05)
    c, s = math.cos(angle), math.sin(angle)
    slope = fc.Obstacle(S.Plane((0, 0, 0), (s, 0, c)), gap=1e-3, friction=mu, stiffness=1e3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), slope])
    d = 1e-3 - RESTS * math.sqrt(c)
    x = np.column_stack([cloth.X @ np.array([[c, 0, -s], [0, 1, 0]])]) + d * np.array([s, 0, c])
    run = fc.run(system, method, system.state(x), dt, t_end)
    return float(run.state.v.mean(axis=0) @ [c, 0, -s]), run


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=["be", "bdf2"])
@pytest.mark.parametrize("mu", [0.2, 0.7])
def test_a_sheet_slides_from_the_angle_of_friction_on(mu, method):
    """2 % below tan φ = μ it creeps slower than ε; above it accelerates by g (sin φ − μ cos φ)."""
    below, above = math.atan(0.98 * mu), math.atan(1.02 * mu)
    assert 0 < slide(below, mu, method)[0] < 1e-3 * 0.2
    expected = 9.81 * (math.sin(above) - mu * math.cos(above)) * 0.3
    assert slide(above, mu, method)[0] == pytest.approx(expected, rel=0.3)  # with ε, of 0.2 mm/s
    steep = math.atan(mu) + 0.4
    expected = 9.81 * (math.sin(steep) - mu * math.cos(steep)) * 0.3
    assert slide(steep, mu, method)[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize(
    "method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()), ids=["be", "bdf2"]
)
def test_the_heat_of_friction_is_in_the_ledger(method):
    """It is μ N times the way, and what gravity has given is the rest."""
    _, run = slide(0.6, 0.3, method)
    way = run.observed["mean_displacement.x"][-1] / math.cos(0.6)
    normal = 0.2 * 9.81 * math.cos(0.6) * 0.02
    heat = run.energies["dissipated:Obstacle"][-1]
    assert heat == pytest.approx(0.3 * normal * way, rel=0.03)
    assert abs(run.energies["remainder"]).max() < 0.01 * heat


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_a_table_that_moves_drags_the_cloth_along_and_does_the_work():
    cloth = fc.Cloth.rectangle(0.2, 0.1, h=0.05)
    table = S.Plane((0, 0, 0), UP, motion=("0.5*t", 0, 0))
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, FABRIC, [*terms, fc.Obstacle(table, friction=0.3, stiffness=1e3)])
    start = system.state(flat(cloth) + [0, 0, 1e-3 - RESTS])
    steps = 17  # of sliding; backward Euler has the heat of the velocities at their ends
    for method, factor in ((fc.BackwardEuler(), 1 - 1 / steps), (fc.BDF2(), 1.0)):
        run = fc.run(system, method, start, 0.01, 0.3)
        speed = run.state.v[:, 0].mean()  # 0.3 g t, until it goes with the table at 0.17 s
        assert speed == pytest.approx(0.5, rel=0.01)
        energies = {name: column[-1] for name, column in run.energies.items()}
        mass = 0.2 * 0.02
        assert energies["work:Obstacle"] == pytest.approx(mass * 0.5**2, rel=0.04)
        heat = 0.5 * mass * 0.5**2 * factor
        assert energies["dissipated:Obstacle"] == pytest.approx(heat, rel=0.02)
        assert abs(run.energies["remainder"]).max() < 0.02 * energies["work:Obstacle"]


@pytest.mark.parametrize("dt", stories_except([0.005, 0.04], 0.04))
def test_a_dragged_strip_does_not_stick_and_slip_by_turns(dt):
    """At long steps too the pull on it stays μ m g, after the 0.1 s in which all of it starts."""
    cloth = fc.Cloth.rectangle(0.4, 0.02, 0.02, pattern="right")
    plane = fc.Obstacle(S.Plane((0, 0, 0), UP), friction=0.5)
    terms = [fc.StVK(), fc.Gravity(), fc.StrainRateDamping(time=1e-3), plane]
    pin = fc.Pin("right", motion=("0.05*t", 0, 0))
    system = fc.System(cloth, fc.Fabric(0.2, 50.0, 0.0), terms, [pin])
    start = system.state(flat(cloth) + [0, 0, 0.99e-3])
    result = fc.run(system, fc.BackwardEuler(), start, dt, 0.4)
    pull, carried = (result.observed[f"reaction:{name}"] for name in ("right.x", "Obstacle.z"))
    late = np.asarray(result.times) > 0.2
    weight = 0.2 * 0.4 * 0.02 * 9.81 * (1 - 1 / 40)  # without what the pin carries
    assert pull[late] == pytest.approx(0.5 * weight, rel=0.06)  # it still swings a little
    assert carried[late] == pytest.approx(weight, rel=0.02)


@pytest.mark.parametrize("method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()))
@pytest.mark.parametrize("kind", ["turns", "accelerates"])
def test_a_patch_sticks_to_a_plate_that_turns_or_accelerates(kind, method):
    """By BDF2 it drifted by a twelfth of its radius in half a second, in steps of 20 ms."""
    moved = {
        "turns": {"rotate": fc.Rotation((0, 0, 0), (0, 0, 1), "4*t")},
        "accelerates": {"motion": ("0.75*t**2", 0, 0)},
    }[kind]
    plate = fc.shapes.Plane((0, 0, 0), (0, 0, 1), **moved)
    cloth = fc.Cloth.rectangle(0.03, 0.03, 0.015, "right")
    terms = [fc.StVK(), fc.Gravity(), fc.Obstacle(plate, 1e-3, friction=0.5)]
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), terms)
    x = flat(cloth) + [0.105, -0.015, 0.9e-3]
    v = np.cross([0, 0, 4.0 if kind == "turns" else 0.0], x)
    run = fc.run(system, method, system.state(x, v), 0.02, 0.5, newton=fc.Newton(1e-10))
    pose = plate.pose(0.5)
    carried = pose.to_space(x)
    assert np.linalg.norm((run.state.x - carried)[:, :2], axis=1).max() < 1e-5
    assert np.linalg.norm((carried - x)[:, :2], axis=1).min() > 0.1
