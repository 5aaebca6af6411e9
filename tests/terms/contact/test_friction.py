"""Friction: derivatives, the slope at which a sheet slides, its acceleration, its heat."""

import math
from dataclasses import replace

import meshio
import numpy as np
import pytest
import scipy.sparse as sparse
from conftest import flat
from support.obstacles import check_slopes, near
from support.over_step import Over
from support.tiers import stories_except

import fecloth as fc
from fecloth.terms.contact.bound_contact import Touched
from fecloth.terms.contact.friction import Grips
from fecloth.terms.contact.pairs import PairPlaces
from fecloth.terms.sliders import Sliders
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


def along(n, w):
    return w - n * (n * w).sum(axis=1, keepdims=True)


def stuck(system, x, t, rng, part):
    """The record of a cloth whose springs have this part of the stretch at which they slide."""
    term = system.bound[0]
    stretches = []
    for grips in term.grips(x, t):
        e = along(grips.n, rng.standard_normal(grips.n.shape))
        limit = part * term.friction * grips.push / grips.stiffness
        stretches.append(e * (limit / np.linalg.norm(e, axis=1))[:, None])
    return Touched(place=x, t=t, stretch=np.concatenate(stretches))


@pytest.mark.parametrize(
    ("over", "part"),
    [(False, 0.5), (True, 0.5), (True, 1.5)],
    ids=["between", "sticks", "slides"],
)
@pytest.mark.parametrize("name", SHAPES)
def test_force_and_tangent_are_derivatives_of_the_energy(name, over, part, rng):
    """Between two steps, and over a step, on shapes that move, turn and deform."""
    cloth, t, dt = fc.Cloth.rectangle(0.3, 0.2, h=0.1), 0.4, 0.01
    obstacle = fc.Obstacle(SHAPES[name], GAP, 0.7, 200.0)
    system = fc.System(cloth, FABRIC, [obstacle])
    x = near(cloth, obstacle, t)
    record = stuck(system, x, t, rng, part)
    if over:
        step = replace(StepDifference.between(x, dt, t), history=record)
        system = fc.System(cloth, FABRIC, [Over(obstacle, step)]).with_exact_tangents()
        t, x = t + dt, system.bound[0].contact.carried(x, t, t + dt)
    else:
        system = system.with_history((record,))
    x = x + 1e-8 * rng.standard_normal(x.shape)
    check_slopes(system, x, t, rng, size=1e-9, limit=3e-5)
    K = system.stiffness(fc.State(t, x, np.zeros_like(x))).toarray()
    assert abs(K - K.T).max() < 1e-10 * abs(K).max()


@pytest.mark.parametrize("name", SHAPES)
def test_friction_and_impulses_have_the_force_of_the_barrier(name):
    """λ n of all points, and h times it, are the force on the nodes; |∇φ| of the formula is 2."""
    cloth, t, h = fc.Cloth.rectangle(0.3, 0.2, h=0.1), 0.4, 0.007
    obstacle = fc.Obstacle(SHAPES[name], GAP, 0.7, 200.0)
    (term,) = fc.System(cloth, FABRIC, [obstacle]).bound
    x = near(cloth, obstacle, t)
    f = np.zeros_like(x)
    for grips in term.grips(x, t):
        grips.places.add_force(grips.push[:, None] * (grips.n @ term.rotation(t).T), f)
    np.testing.assert_allclose(f, term.push(x, t), atol=1e-12 * abs(f).max())
    begin, end = fc.State(t - 0.01, x, 0 * x), fc.State(t, x, 0 * x)
    touches = term.find_touches(begin, end, h)
    np.testing.assert_allclose(touches.rows.T @ touches.pushed, h * f.ravel(), atol=1e-12)


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


def slide(angle, mu, method, t_end=0.3, dt=0.01):
    """Run a sheet that was laid on a slope at rest; also return the direction downhill."""
    cloth = fc.Cloth.rectangle(0.2, 0.1, h=0.05)
    c, s = math.cos(angle), math.sin(angle)
    slope = fc.Obstacle(S.Plane((0, 0, 0), (s, 0, c)), gap=1e-3, friction=mu, stiffness=1e3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), slope])
    d = 1e-3 - RESTS * math.sqrt(c)
    x = np.column_stack([cloth.X @ np.array([[c, 0, -s], [0, 1, 0]])]) + d * np.array([s, 0, c])
    return fc.run(system, method, system.state(x), dt, t_end), np.array([c, 0, -s])


@pytest.mark.parametrize("mu", stories_except([0.2, 0.7], 0.2))
@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=["be", "bdf2"])
def test_a_sheet_sticks_below_the_angle_of_friction_and_slides_above_it(mu, method):
    """2 % below tan φ = μ it does not creep; 2 % above its speed is g (sin φ − μ cos φ) t."""
    below, above = math.atan(0.98 * mu), math.atan(1.02 * mu)
    run, _ = slide(below, mu, method, t_end=2.0)
    times, place = np.asarray(run.times), run.observed["mean_displacement.x"]
    assert abs(place[-1] - place[np.searchsorted(times, 1.0)]) < 1e-12  # 1e-7 m is wanted
    for angle in (above, math.atan(mu) + 0.4):
        run, downhill = slide(angle, mu, method)
        expected = 9.81 * (math.sin(angle) - mu * math.cos(angle)) * 0.3
        assert run.state.v.mean(axis=0) @ downhill == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("rises", "part"), [(0.0, 2.0), (1.0, 2.5)], ids=["stays", "leaves"])
def test_the_heat_of_a_step_is_what_its_springs_do_not_store(rises, part):
    """μN (w − e) after a way w = 3 e, of which μN e/2 stays stored where the sheet still touches.

    A spring slides at the stretch e = μλ/k = μ p(s) gap/100.
    """
    cloth, s, mu = fc.Cloth.rectangle(0.2, 0.1, 0.05), 0.9, 0.5
    plane = fc.Obstacle(S.Plane((0, 0, 0), UP), GAP, mu, 1e3)
    (term,) = fc.System(cloth, FABRIC, [plane]).bound
    x = flat(cloth) + [0, 0, s * GAP]
    p = 2 * (s - 1) * math.log(s) + (s - 1) ** 2 / s
    e, push = mu * p * GAP / 100, 1e3 * p * cloth.area
    step = StepDifference.between(x, 0.01, 0.0)
    over = term.over_step(replace(step, history=Touched(place=x, t=0.0)))
    heat = over.dissipation(x + [0.6 * 3 * e, 0.8 * 3 * e, rises * GAP])
    assert heat == pytest.approx(part * mu * push * e, rel=1e-9)


def test_no_spring_slides_between_steps_and_an_impact_makes_it_stiffer_for_one_step():
    """k = 100 κA/gap; under a force F it gives way by μF/k, but by gap/1000 at most."""
    cloth, kappa = fc.Cloth.rectangle(0.2, 0.1, 0.05), 1e3
    (term,) = fc.System(cloth, FABRIC, [fc.Obstacle(S.Plane((0, 0, 0), UP), GAP, 0.5, kappa)]).bound
    x = flat(cloth) + [0, 0, 0.9 * GAP]
    k = 100 * kappa * cloth.area / GAP
    w = 5e-4 * GAP  # more than the stretch at which it slides
    e = np.tile([w, 0.0, 0.0], (len(x), 1))
    held = term.with_history(Touched(place=x, t=0.0, stretch=e)).held(0.0)
    assert held.energy(x) == pytest.approx(0.5 * k * w**2, rel=1e-9)
    (grips,) = term.grips(x, 0.0)
    struck = Touched(place=x, t=0.0, forces=500 * grips.push)
    f = np.zeros_like(x)
    term.spring(struck, 0.0).add_force(x + e, f)
    np.testing.assert_allclose(f[:, 0], -0.5 * 0.5 * struck.forces, rtol=1e-9)


def test_a_stretch_turns_with_the_body_and_is_kept_in_its_frame():
    cloth, dt = fc.Cloth.rectangle(0.2, 0.1, 0.05), 0.1
    plane = S.Plane((0, 0, 0), UP, rotate=fc.Rotation((0.1, 0, 0), UP, "3*t"))
    (term,) = fc.System(cloth, FABRIC, [fc.Obstacle(plane, GAP, 0.5, 1e3)]).bound
    x = flat(cloth) + [0, 0, 0.9 * GAP]
    e = np.tile([1e-7, 2e-7, 0.0], (len(x), 1))
    record = Touched(place=x, t=0.0, stretch=e)
    over = term.over_step(replace(StepDifference.between(x, dt, 0.0), history=record))
    end = plane.pose(dt).to_space(x)
    (springs,) = over.friction.springs
    np.testing.assert_allclose(springs.stretch(end), e @ plane.pose(dt).R.T, atol=1e-15)
    np.testing.assert_allclose(over.commit(end, dt).stretch, e, atol=1e-15)


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize(
    "method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()), ids=["be", "bdf2"]
)
def test_the_heat_of_friction_is_in_the_ledger(method):
    """It is μ N times the way, and what gravity has given is the rest."""
    run, _ = slide(0.6, 0.3, method)
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


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=["be", "bdf2"])
@pytest.mark.parametrize("kind", ["turns", "accelerates"])
def test_a_patch_sticks_to_a_plate_that_turns_or_accelerates(kind, method):
    """To 1e-4 of the way, in steps of 20 ms."""
    moved = {
        "turns": {"rotate": fc.Rotation((0, 0, 0), (0, 0, 1), "4*t")},
        "accelerates": {"motion": ("1.5*t**2", 0, 0)},
    }[kind]
    plate = fc.shapes.Plane((0, 0, 0), (0, 0, 1), **moved)
    cloth = fc.Cloth.rectangle(0.03, 0.03, 0.015, "right")
    terms = [fc.StVK(), fc.Gravity(), fc.Obstacle(plate, 1e-3, friction=0.5)]
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), terms)
    x = flat(cloth) + [0.105, -0.015, 0.9e-3]
    v = np.cross([0, 0, 4.0 if kind == "turns" else 0.0], x)
    run = fc.run(system, method, system.state(x, v), 0.02, 0.5, newton=fc.Newton(1e-10))
    carried = plate.pose(0.5).to_space(x)
    way = np.linalg.norm((carried - x)[:, :2], axis=1).min()
    assert np.linalg.norm((run.state.x - carried)[:, :2], axis=1).max() < 1e-4 * way


SHAKEN = {"A": 5e-3, "omega": 40.0, "mu": 0.5}  # A ω² = 8 m/s² > μ g = 4.9 m/s²


def shaken_block(t_end, A, omega, mu, g=9.81, dt=1e-6):
    """Displacement of a rigid block on a plate at A sin ωt − A ω t at each dt, and if it sticks.

    It sticks while the plate accelerates by less than μ g, and slips from there with ± μ g until
    both velocities are the same: the scalar equation of Coulomb's law by small steps.
    """
    x = v = 0.0
    slips, sticks, places = False, [], []
    for t in np.arange(1, round(t_end / dt) + 1) * dt:
        plate_v = A * omega * (math.cos(omega * t) - 1)
        plate_a = -A * omega**2 * math.sin(omega * t)
        before = plate_v - v
        if not slips and abs(plate_a) > mu * g:
            slips = True
            before = plate_a
        if slips:
            v += dt * math.copysign(mu * g, before)
            slips = (plate_v - v) * before > 0
        if not slips:
            v = plate_v
        x += dt * v
        sticks.append(not slips)
        places.append(x)
    return np.array(places), np.array(sticks)


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=["be", "bdf2"])
def test_a_block_on_a_shaken_plate_sticks_and_slips_as_the_scalar_equation_says(method):
    """The displacement at every step, and where it sticks and slips, over two periods."""
    t_end, dt = 4 * math.pi / SHAKEN["omega"], 5e-4
    A, omega, mu = SHAKEN.values()
    formula = f"{A}*(sin({omega}*t) - {omega}*t)"
    plate = S.Plane((0, 0, 0), UP, motion=(formula, 0, 0))
    cloth = fc.Cloth.rectangle(0.03, 0.03, 0.03, "right")
    terms = [fc.StVK(), fc.Gravity(), fc.Obstacle(plate, 1e-3, friction=mu, stiffness=1e3)]
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), terms)
    start = system.state(flat(cloth) + [0, 0, 1e-3 - RESTS])
    run = fc.run(system, method, start, dt, t_end)
    exact, sticks = shaken_block(t_end, A, omega, mu)
    times = np.asarray(run.times)
    steps = np.rint(times[1:] / 1e-6).astype(int) - 1
    assert run.observed["mean_displacement.x"][1:] == pytest.approx(exact[steps], abs=0.02 * A)
    plate_x = A * (np.sin(omega * times) - omega * times)
    way = abs(np.diff(run.observed["mean_displacement.x"]) - np.diff(plate_x))
    # the phases change at the exact times to five steps
    counts = np.convolve(sticks[steps], np.ones(11), "same")
    assert way[counts == 11].max() < min(1e-3 * way.max(), way[counts == 0].min())
    assert (counts == 11).sum() > 30
    assert (counts == 0).sum() > 300


@pytest.mark.parametrize("kind", stories_except(["mesh", "piece"], "piece"))
def test_a_patch_sticks_to_a_mesh_and_to_another_piece(kind, tmp_path):
    """On a slope 2 % below the angle of friction, of triangles that are no multiples of its own."""
    pytest.importorskip("ipctk")
    angle, gap, pins = math.atan(0.98 * 0.5), 2e-3, []
    patch, ground = fc.Cloth.rectangle(0.1, 0.1, h=0.028), fc.Cloth.rectangle(0.4, 0.2, h=0.05)
    x = flat(patch) @ [[0.97, 0.24, 0], [-0.24, 0.97, 0], [0, 0, 1]] + [0.1, 0.04, 0.97 * gap]
    if kind == "mesh":
        cells = [("triangle", ground.triangles.astype(np.int32))]
        meshio.write_points_cells(tmp_path / "ground.ply", flat(ground), cells)
        cloth, contact = patch, fc.MeshObstacle(tmp_path / "ground.ply", gap, 0.5)
    else:
        cloth, x = fc.Cloth.join([patch, ground], ["patch", "ground"]), np.vstack([x, flat(ground)])
        contact, pins = fc.SelfContact(gap, friction=0.5), ["ground"]
    g = fc.Gravity((9.81 * math.sin(angle), 0, -9.81 * math.cos(angle)))
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), [fc.StVK(), g, contact], pins)
    states = [each for each, _ in fc.march(system, fc.BDF2(), system.state(x), 0.01, 0.6)]
    way = states[-1].x - states[29].x
    assert np.linalg.norm(way, axis=1).max() < 1e-7 * 0.3
    assert (states[-1].x - x)[: len(patch.X), 0].max() < 1e-3


def test_no_friction_is_above_its_secant_parabola(rng):
    """φ(e') ≤ φ(e) + φ'·(e' − e) + (e' − e)·H (e' − e)/2, with the energy's own slope."""
    sliders = Sliders.of_contact(rng.uniform(1.0, 2.0, 200), rng.uniform(0.5, 1.0, 200))
    e, other = rng.standard_normal((2, 200, 3))
    knee = sliders.limit[:, None] / sliders.moments  # |e| at s_y
    np.testing.assert_allclose(sliders.secant(5 * knee), sliders.tangent(5 * knee))
    e *= rng.uniform(0.1, 3.9, (200, 1)) * knee / np.linalg.norm(e, axis=1)[:, None]
    way = other - e
    H = sliders.secant(e)
    parabola = sliders.energy(e) + np.einsum("mi,mi->m", sliders.moment(e), way)
    parabola += 0.5 * np.einsum("mi,mij,mj->m", way, H, way)
    above = parabola - sliders.energy(other)
    assert above.min() > -1e-12
    sticks = np.linalg.norm(sliders.moment(e), axis=1) < 0.999 * sliders.moments[:, 0]
    assert 10 < sticks.sum() < 190
    np.testing.assert_allclose(H[sticks], sliders.tangent(e)[sticks])
    touching = sliders.energy(e) - 2 * np.einsum("mi,mi->m", sliders.moment(e), e)
    touching += 2 * np.einsum("mi,mij,mj->m", e, H, e)
    np.testing.assert_allclose(touching, sliders.energy(-e))  # the least such H


@pytest.mark.parametrize(
    ("axis", "least", "most"), [((0, 0, 1), 0.0, 0.05), ((1, 0, 0), 0.8, 1.05)]
)
def test_the_torque_on_two_layers_that_turn_together(axis, least, most):
    """None about their normal; about an axis in their plane up to μ λ times their distance."""
    pytest.importorskip("ipctk")
    gap, mu, d = 2e-3, 0.5, 1.8e-3
    layers = fc.Cloth.rectangle(0.1, 0.1, 0.03), fc.Cloth.rectangle(0.09, 0.09, 0.028)
    cloth = fc.Cloth.join(list(layers), ["lower", "upper"])
    x = np.vstack([flat(layers[0]), flat(layers[1]) + [5e-3, 5e-3, d]])
    (term,) = fc.System(cloth, FABRIC, [fc.SelfContact(gap, mu, stiffness=1e3)]).bound
    (grips,) = term.grips(x, 0.0)
    record = Touched(place=x, t=0.0)
    over = term.over_step(replace(StepDifference.between(x, 0.01, 0.0), history=record))
    turned = x @ fc.Rotation((0, 0, 0), axis, "t").matrix(0.04, since=0.0).T
    f = np.zeros_like(x)
    over.friction.add_force(turned, f)
    assert abs(f.sum(axis=0)).max() < 1e-12 * abs(f).sum()
    torque = np.linalg.norm(np.cross(turned, f).sum(axis=0))
    assert least <= torque / (mu * grips.push.sum() * d) <= most


def test_a_stretch_is_handed_on_to_the_pair_of_the_same_material_points():
    """From a triangle to the one beside it; with the other sign where the parts are exchanged."""
    before = PairPlaces(sparse.csr_matrix([[1, -0.5, -0.5, 0, 0], [0, 0, 0, 0, 1.0]]))
    after = PairPlaces(
        sparse.csr_matrix(
            [[1, -0.49, -0.48, -0.03, 0], [-1, 0.5, 0.5, 0, 0], [0, 0, 0, 1.0, 0], [0, 0, 0, 0, 1]]
        )
    )
    e, other = np.array([1.0, 2.0, 0.0]), np.array([0.0, 3.0, 0.0])
    handed = after.hand_on(before, np.array([e, other]))
    np.testing.assert_array_equal(handed, [e, -e, 0 * e, other])
    n = np.tile([0.0, 0.6, 0.8], (4, 1))  # only what lies along the new surface stays
    kinds = [Grips(before, n[:2], np.ones(2), np.ones(2))]
    grips = Grips(after, n, np.ones(4), np.ones(4))
    left = grips.hand_on(kinds, [np.array([e, other])])
    np.testing.assert_allclose(left, along(n, handed), atol=1e-15)
    assert grips.stored(left) == pytest.approx(0.5 * (left**2).sum(), rel=1e-12)


def on_a_plane(h, velocity=0.0, mu=0.4, **plate):
    """A sheet at rest on a plane, with a velocity along x."""
    cloth = fc.Cloth.rectangle(0.05, 0.05, h, "right")
    plane = fc.Obstacle(S.Plane((0, 0, 0), UP, **plate), 1e-3, friction=mu, stiffness=1e3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity(), plane])
    x = flat(cloth) + [0, 0, 1e-3 - RESTS]
    return cloth, system, fc.BDF2(), system.state(x, 0 * x + [velocity, 0, 0])


def slides_to_rest(h, speed=0.5, mu=0.4):
    return on_a_plane(h, speed, mu)


def begins_to_slip(h, jerk=80.0, mu=0.4):
    """The plane accelerates by `jerk` t."""
    return on_a_plane(h, mu=mu, motion=(f"{jerk!r}*t**3/6", 0, 0))


@pytest.mark.parametrize(
    "problem", stories_except([slides_to_rest, begins_to_slip], slides_to_rest)
)
def test_the_derivative_of_a_way_goes_through_stick_and_slip(problem):
    """v²/(2μg), and j t³/6 until μg/j, with μg from there: by v, j and μ."""
    g, v, j, mu, t_end = 9.81, 0.5, 80.0, 0.4, 0.15
    name, exact = "speed", [v / (mu * g), -(v**2) / (2 * mu**2 * g)]
    if problem is begins_to_slip:
        name, slips = "jerk", mu * g / j
        late = t_end - slips
        exact = [slips**3 / 6 + slips**2 / 2 * late, g * late**2 / 2]

    def way(result):
        return float(result.state.x[:, 0].mean())

    answer = fc.sensitivity(problem, [name, "mu"], way, h=0.05, dt=2.5e-3, t_end=t_end, check=False)
    np.testing.assert_allclose(answer.derivative, exact, rtol=0.015)
