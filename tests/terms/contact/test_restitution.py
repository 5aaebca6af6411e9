"""What impacts leave: impulses at the end of a step, their ledger, and fast obstacles."""

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sparse
from conftest import flat
from support.tiers import stories_except

import fecloth as fc
from fecloth.integrators.impacts import Places, find_step, is_impact
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.terms import find_no_membrane
from fecloth.simulation.fixed_step import FixedStep

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

GAP = 1e-3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
FLOOR = fc.shapes.Plane((0, 0, 0), (0, 0, 1))


def places(G, m, v, pushed):
    """Places with the rows G (m, f) of nodes with masses m (f,) and velocities v (f,)."""
    mass = sparse.diags(m).tocsc()
    return Places(mass, lambda b: b / m, sparse.csr_matrix(G), G @ v, np.asarray(pushed))


def test_the_impulses_of_connected_places_are_those_of_least_squares(rng):
    """Places with e = 0 that nothing limits: min |M^-1/2 G' L + M^1/2 v|, L >= 0, by another way.

    Half of the places are redundant.
    """
    G = rng.standard_normal((6, 9))
    G = np.vstack([G, G[:3] + G[3:]])
    v, m = rng.standard_normal(9), rng.uniform(0.5, 2.0, 9)
    expected, _ = scipy.optimize.nnls((G / np.sqrt(m)).T, -np.sqrt(m) * v)
    touching = places(G, m, v, np.zeros(9))
    impulses, q = touching.solve(np.zeros(9), np.full(9, 1e3))
    np.testing.assert_allclose(G.T @ impulses, G.T @ expected, atol=1e-5)  # `COMPLIANCE`
    np.testing.assert_allclose(q, G.T @ impulses / m, atol=1e-8)
    assert (expected > 0).sum() > 2


def test_a_step_towards_the_impulses_ends_where_the_slope_is_0(rng):
    """Of places that begin and end to give way along it, by the impulses themselves."""
    faster, closing = rng.standard_normal((2, 40))
    gives, most = rng.uniform(0.1, 1.0, 40), rng.uniform(0.1, 2.0, 40)
    faster[0], gives[1] = 0.0, np.inf

    def slope(s):
        change = np.clip((closing - s * faster) / gives, 0.0, most) - np.clip(
            closing / gives, 0.0, most
        )
        return 0.5 * s - faster @ change

    for part, expected in ((0.3, 0.0), (0.9, 0.1)):  # of the rise along the whole step
        begin = -part * slope(1.0)
        s = find_step(begin, 0.5, faster, closing, gives, most)
        assert slope(s) + begin == pytest.approx(expected * slope(1.0), abs=1e-12)


def test_a_barrier_may_push_less_but_not_more_where_nothing_strikes():
    """Three places of 2 kg: one that would be thrown back, one in rest, and one that sinks."""
    pushed = np.array([0.5, 0.5, 0.6])
    touching = places(np.eye(3), np.full(3, 2.0), np.array([0.1, -0.2, -0.9]), pushed)
    impulses, _ = touching.find_impulses(np.zeros(3), np.zeros(3, bool))
    np.testing.assert_allclose(impulses, [0.0, 0.4, 0.6], atol=1e-6)


def test_impulses_are_limited_by_those_that_each_place_needs_alone():
    """100 |u_free| + c over the own change of speed; a place that pins hold has its barrier's."""
    touching = places(np.diag([1.0, 2.0, 0.0]), np.full(3, 4.0), np.full(3, -3.0), np.full(3, 0.5))
    np.testing.assert_allclose(touching.own, [0.25, 1.0, 0.0])
    most = touching.limits(np.array([1.0, 0.0, 0.0]), np.array([True, False, True]))
    np.testing.assert_allclose(most, [0.5 + 100 * 4 / 0.25, 0.5, 0.5])


def test_connected_places_with_different_speeds_gain_no_energy():
    """A place that does not close is pushed by one that bounces: together they would gain."""
    G = np.array([[1.0, 0.0], [0.8, -0.6]])
    v = np.array([-1.0, -2.0])
    c = np.array([1.0, 2.0])  # the second: more than the speed with which it closes
    touching = places(G, np.ones(2), v, np.zeros(2))
    impulses, _ = touching.find_impulses(c, np.ones(2, bool))
    assert impulses @ (G @ (G.T @ impulses) + 2 * G @ v) <= 1e-5
    assert impulses[0] > 0.5


def test_places_without_a_common_node_are_judged_apart():
    touching = places(
        np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.ones(3),
        np.array([-1.0, -1.0, -1.0]),
        np.zeros(3),
    )
    gains = touching.gains_energy(np.ones(3), np.array([5.0, 4.0, 2.0]))
    np.testing.assert_array_equal(gains, [True, True, False])


@pytest.mark.parametrize(("part", "strikes"), [(0.8, True), (1.25, False)])
def test_an_approach_that_two_steps_of_the_forces_explain_is_no_impact(part, strikes):
    before = np.array([-1.0])
    assert is_impact(before, before - part * 0.5) == strikes
    assert not is_impact(-before, before)


def test_a_sheet_that_falls_over_one_step_stays_on_the_plane():
    cloth, dt = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right"), 0.01
    floor = fc.Obstacle(FLOOR, GAP, restitution=1.0)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity(), floor])
    start = system.state(flat(cloth) + [0, 0, GAP + 9.81 * 1.2 * dt**2])
    run = fc.run(system, fc.BDF2(), start, dt=dt, t_end=10 * dt)
    assert abs(run.state.v[:, 2]).max() < 1e-3
    assert run.state.x[:, 2].max() < GAP


def bounce(method, v, dt, phase, e, mass="lumped", slide=0.0):
    """The part of its speed with which a flat sheet leaves a plane, and the run."""
    cloth = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right")
    floor = fc.Obstacle(FLOOR, GAP, restitution=e)
    system = fc.System(cloth, FABRIC, [fc.StVK(), floor], mass=mass)
    x = flat(cloth) + [0, 0, GAP + (2 + phase) * v * dt]
    start = system.state(x, 0 * x - [slide, 0, v])
    given = {"dt": dt, "t_end": 8 * dt + 3 * GAP / v, "newton": fc.Newton(tolerance=1e-12)}
    run = fc.run(system, method, start, **given)
    velocity = system.nodal_mass @ run.state.v / system.total_mass
    assert velocity[0] == pytest.approx(-slide, abs=1e-9)
    return velocity[2] / v, run


METHODS = stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dt", stories_except([0.01, 1e-3, 1e-4, 2e-5], 0.01, 1e-3))
@pytest.mark.parametrize("e", [0.0, 0.3, 0.7, 1.0])
def test_an_impact_leaves_its_part_of_the_speed_at_any_dt(method, dt, e):
    """At any phase of the contact in the step; the ledger has what it takes."""
    for phase in (0.05, 0.55, 0.9):
        left, run = bounce(method, 1.0, dt, phase, e)
        assert left == pytest.approx(e, abs=1e-6)
        energies = run.energies
        start = energies["total"][0]
        assert energies["kinetic"][-1] == pytest.approx(e**2 * start, abs=1e-6 * start)
        assert energies["impacts"][-1] != 0.0
        assert abs(energies["remainder"]).max() < 1e-3 * start


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_an_oblique_impact_takes_nothing_along_the_plane(mass):
    left, _ = bounce(fc.BackwardEuler(), 1.0, 1e-3, 0.4, 0.6, mass, slide=1.5)
    assert left == pytest.approx(0.6, abs=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_an_oblique_impact_with_friction_takes_its_part_of_the_impulse(method):
    """Coulomb: μ (1 + e) v_n along the plane."""
    cloth, dt, e = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right"), 0.01, 0.5
    floor = fc.Obstacle(FLOOR, GAP, friction=0.2, restitution=e)
    system = fc.System(cloth, FABRIC, [fc.StVK(), floor])
    x = flat(cloth) + [0, 0, GAP + 2.4 * dt]
    start = system.state(x, 0 * x + [2.0, 0, -1.0])
    run = fc.run(system, method, start, dt, 12 * dt, newton=fc.Newton(1e-10))
    velocity = system.nodal_mass @ run.state.v / system.total_mass
    assert velocity[0] == pytest.approx(2.0 - 0.2 * (1 + e), abs=1e-3)


def test_steps_that_follow_their_error_pass_an_impact():
    """No step is short enough for the jump of the velocity, which is no error."""
    cloth = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right")
    floor = fc.Obstacle(FLOOR, GAP, restitution=0.6)
    system = fc.System(cloth, FABRIC, [fc.StVK(), floor])
    x = flat(cloth) + [0, 0, 5e-3]
    start = system.state(x, 0 * x - [0, 0, 1.0])
    run = fc.run(system, fc.Adaptive(fc.BDF2(), rtol=1.0), start, t_end=0.02)
    assert run.state.v[:, 2].mean() == pytest.approx(0.6, abs=1e-3)
    assert run.steps < 60


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("e", stories_except([0.0, 0.5, 1.0], 0.5))
def test_sheets_that_meet_part_with_their_speed_and_keep_the_momentum(e, mass):
    pytest.importorskip("ipctk")
    sheets = fc.Cloth.rectangle(0.05, 0.05, 0.025), fc.Cloth.rectangle(0.05, 0.05, 0.0225)
    cloth = fc.Cloth.join(list(sheets), names=["lower", "upper"])
    terms = [fc.StVK(), fc.PlateBending(), fc.SelfContact(GAP, restitution=e)]
    system = fc.System(cloth, FABRIC, terms, mass=mass)
    dt, is_upper = 1e-3, np.arange(len(cloth.X)) >= len(sheets[0].X)
    x = flat(cloth) + np.where(is_upper[:, None], [3e-4, 2e-4, GAP + 2.4 * dt], 0.0)
    v = np.where(is_upper[:, None], [0.3, 0, -1.0], 0.0)
    run = fc.run(system, fc.BDF2(), system.state(x, v), dt, 5 * dt, newton=fc.Newton(1e-9))
    before, after = (system.mass_times(each).sum(axis=0) for each in (v, run.state.v))
    np.testing.assert_allclose(after, before, atol=1e-6 * np.linalg.norm(before))
    m = system.nodal_mass
    upper, lower = (
        np.average(run.state.v[sheet], axis=0, weights=m[sheet]) for sheet in (is_upper, ~is_upper)
    )
    assert (upper - lower)[2] == pytest.approx(e, abs=0.01)
    assert (upper - lower)[0] == pytest.approx(0.3, abs=0.01)


def test_the_derivative_of_a_bounce_is_that_of_its_jump():
    """The sheet leaves with e v: its derivatives by v and by e."""

    def problem(h, speed=1.0, e=0.6):
        cloth = fc.Cloth.rectangle(0.05, 0.05, h, "right")
        floor = fc.Obstacle(FLOOR, GAP, restitution=e)
        system = fc.System(cloth, FABRIC, [fc.StVK(), floor])
        x = flat(cloth) + [0, 0, GAP + 2.4e-3]
        return cloth, system, fc.BackwardEuler(), system.state(x, 0 * x - [0, 0, speed])

    def speed_at_end(result):
        return float(result.state.v[:, 2].mean())

    answer = fc.sensitivity(problem, ["speed", "e"], speed_at_end, h=0.05, dt=1e-3, t_end=0.01)
    np.testing.assert_allclose(answer.derivative, [0.6, 1.0], atol=1e-6)


MOVED = {
    "a ball at 10 m/s": fc.shapes.Sphere((0.05, 0.05, -0.055), 0.05, motion=(0, 0, "10*t")),
    "a box at 20 rad/s": fc.shapes.Box(
        (0.05, 0.05, -0.054),
        (0.08, 0.02, 0.1),
        rotate=fc.Rotation((0.05, 0.05, -0.054), (0, 1, 0), "20*t"),
    ),
    "a wave": fc.shapes.Sdf("z + 0.0108 - 0.01*sin(60*x - 120*t)"),
}


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()])
@pytest.mark.parametrize(
    ("name", "e"), [*((name, 1.0) for name in MOVED), ("a ball at 10 m/s", 0.0), ("a wave", 0.0)]
)
def test_the_ledger_of_a_fast_obstacle_closes(name, e, method):
    """Its work is what the cloth gets and dissipates, and the method gains none of it."""
    cloth = fc.Cloth.rectangle(0.1, 0.1, 0.05)
    terms = [fc.StVK(), fc.PlateBending(), fc.Obstacle(MOVED[name], GAP, restitution=e)]
    system = fc.System(cloth, FABRIC, terms)
    run = fc.run(
        system, method, system.rest(), dt=5e-4, t_end=0.02, newton=fc.Newton(tolerance=1e-11)
    )
    work = run.energies["work:Obstacle"][-1]
    lost = run.energies["numerical"][-1] + run.energies["impacts"][-1]
    assert work > 1e-6
    assert abs(run.energies["remainder"][-1]) < 0.04 * work
    assert -0.01 * work < lost < work + run.energies["total"][0]


def test_an_obstacle_around_the_flat_cloth_says_nothing_of_the_membrane():
    """The cloth starts above the ball; flat, at z = 0, it would be inside of it."""
    cloth = fc.Cloth.rectangle(0.1, 0.1, 0.05)
    ball = fc.Obstacle(fc.shapes.Sphere((0.05, 0.05, 0.0), 0.05), 2e-3)
    assert ball.stencil(cloth) is not None
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), ball])
    start = system.state(flat(cloth) + [0, 0, 0.2])
    steps = FixedStep(fc.BackwardEuler(), 0.01)
    assert list(find_no_membrane(PlannedRun(system, start, steps, np.array([0.01])))) == []
    bare = fc.System(cloth, FABRIC, [fc.PlateBending(), ball])
    (doubt,) = find_no_membrane(PlannedRun(bare, start, steps, np.array([0.01])))
    assert "nan" not in doubt.words


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_impulses_at_an_edge_between_nodes_have_no_moment_about_it(e):
    """The edge points up, below triangles: all impulses go through it."""
    pytest.importorskip("ipctk")
    cloth = fc.Cloth.rectangle(0.2, 0.1, 0.05)
    turned = fc.Rotation((0.11, 0.05, 0.0), (0, 1, 0), "pi/4 + 0*t")
    roof = fc.shapes.Box((0.11, 0.05, 0.0), (0.02, 0.3, 0.02), rotate=turned)
    edge = np.array([0.11, 0.0, 0.02 * np.sqrt(0.5)])
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Obstacle(roof, GAP, restitution=e)])
    x = flat(cloth) + [0, 0, edge[2] + 1.2 * GAP]
    start = system.state(x, np.tile([0.0, 0.0, -1.0], (len(x), 1)))
    for state, info in fc.march(system, fc.BackwardEuler(), start, dt=1e-4, t_end=0.01):
        change = state.v - (info.result.unstruck or state).v
        if abs(change).max() > 0.1:
            break
    impulse = system.diagonal_mass[:, None] * change
    _, moments, _ = np.cross(state.x - edge, impulse).T
    assert abs(moments.sum()) < 0.05 * abs(moments).sum()  # a third, if each node stopped
    _, _, pushes = impulse.T
    assert (pushes != 0).sum() > 4


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=["be", "bdf2"])
def test_a_ball_lifts_triangles_with_nodes_that_are_held(method):
    """It rises by 2 mm a step: the free nodes must be faster than the points that it pushes."""
    cloth, tip, t_end = fc.Cloth.rectangle(0.2, 0.2, 0.1), -0.002, 0.02
    ball = fc.shapes.Sphere((0.107, 0.02, tip - 0.03), 0.03, motion=(0, 0, "0.5 * t"))
    terms = [fc.StVK(), fc.Obstacle(ball, GAP)]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, ["boundary"])
    result = fc.run(system, method, system.rest(), dt=0.004, t_end=t_end)
    assert result.state.x[:, 2].max() > tip + 0.5 * t_end
    assert system.bound[-1].allows(result.state.x, t_end)
