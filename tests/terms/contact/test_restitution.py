"""What a contact dissipates: the law over a step, bounces, and the ledger of fast obstacles."""

import numpy as np
import pytest
from conftest import flat
from fecloth.terms.contact.restitution import MOST_DAMPING, Approach
from support.tiers import stories_except

import fecloth as fc
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.terms import find_no_membrane
from fecloth.simulation.fixed_step import FixedStep
from fecloth.terms.contact import barrier, restitution
from fecloth.terms.step_difference import StepDifference

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

GAP = 1e-3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
FLOOR = fc.shapes.Plane((0, 0, 0), (0, 0, 1))


@pytest.mark.parametrize(("e", "y"), [(0.5, 1.4), (0.05, 20.0)])
def test_the_damping_of_a_restitution(e, y):
    """y = 1.4 leaves a half, y = 20 a twentieth."""
    assert restitution.damping(e) == pytest.approx(y, rel=0.03)
    y = restitution.damping(0.9)
    assert y - np.log1p(y) == pytest.approx(-0.9 * y - np.log1p(-0.9 * y), rel=1e-9)


def test_the_rates_of_slow_touches_are_limited():
    assert restitution.rates(0.0, np.array([0.0, 1.0])).tolist() == [MOST_DAMPING, MOST_DAMPING]
    assert restitution.rates(1.0, np.array([0.0, 1.0])).tolist() == [0.0, 0.0]
    c = restitution.rates(0.5, np.array([0.0, 1e-5, 2.0]))
    assert c.tolist() == pytest.approx([MOST_DAMPING, MOST_DAMPING, 1.43275 / 2.0], rel=1e-3)
    assert MOST_DAMPING == 400.0


@pytest.mark.parametrize(("s0", "a"), [(0.5, 0.0), (3.0, 40.0), (0.6, 5.0), (0.3, 2.0)])
def test_the_law_over_a_step_has_a_potential(s0, a):
    law, h = Approach(np.full(50, s0), np.full(50, a)), 1e-6
    s = np.linspace(0.05, 0.99, 50)
    force = barrier.pressure(s) * np.maximum(0.0, 1 - a * (s - s0))
    by_energy = (law.value(s - h) - law.value(s + h)) / (2 * h)
    np.testing.assert_allclose(by_energy, force, rtol=1e-6, atol=1e-8 * force.max())
    slope = (law.factor(s - h) * barrier.pressure(s - h)) - law.factor(s + h) * barrier.pressure(
        s + h
    )
    smooth = abs(1 - a * (s - s0)) > 1e-3
    expected = (slope / (2 * h))[smooth]
    np.testing.assert_allclose(law.curvature(s)[smooth], expected, rtol=1e-5, atol=1e-6)
    assert (law.lost(s) >= 0).all()
    assert np.isinf(law.value(np.array([0.0, *s[1:]]))[0])


def test_an_approach_raises_the_pressure_and_a_retreat_never_sticks():
    cloth, dt = fc.Cloth.rectangle(0.1, 0.05, 0.05, "right"), 1e-3
    (term,) = fc.System(cloth, FABRIC, [fc.Obstacle(FLOOR, GAP, 0.0, 50.0, 0.0)]).bound
    push = []
    for way in (-1e-4, 0.0, 1e-6, 1e-4):
        x, f = flat(cloth) + [0, 0, 0.5 * GAP], np.zeros((len(cloth.X), 3))
        over = term.over_step(StepDifference.between(x - [0, 0, way], dt, 0.0))
        over.add_force(x, x, dt, f)
        push.append(f[:, 2].sum())
        lost = -(push[-1] - push[min(1, len(push) - 1)]) * way if way else 0.0
        if way > 0:
            assert over.dissipation(x) == pytest.approx(lost, rel=1e-9)
    elastic = -50.0 * 0.005 * (-barrier.pressure(np.array(0.5)))
    np.testing.assert_allclose(push, elastic * np.array([41.0, 1.0, 0.6, 0.0]), rtol=1e-9)


def bounce(method, v, dt, phase, e, stiffness=2000.0):
    """The part of its speed with which a flat sheet leaves a plane, and the run."""
    cloth = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right")
    floor = fc.Obstacle(FLOOR, GAP, stiffness=stiffness, restitution=e)
    system = fc.System(cloth, FABRIC, [fc.StVK(), floor])
    x = flat(cloth) + [0, 0, GAP + (2 + phase) * v * dt]
    start = system.state(x, 0 * x - [0, 0, v])
    steps = 8 if e == 0 else 20 + round(GAP / v / dt)
    given = {"dt": dt, "t_end": steps * dt, "newton": fc.Newton(tolerance=1e-12)}
    run = fc.run(system, method, start, **given)
    return system.nodal_mass @ run.state.v[:, 2] / system.total_mass / v, run


IMPACTS = [(1.0, 0.01)]
IMPACTS += [
    pytest.param(*impact, marks=pytest.mark.stories)
    for impact in ((0.1, 0.01), (5.0, 0.01), (1.0, 1e-3))
]


@pytest.mark.parametrize("method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()))
@pytest.mark.parametrize(("v", "dt"), IMPACTS)
def test_a_cloth_does_not_bounce(method, v, dt):
    """At any phase of the contact in the step; no step gains energy."""
    for phase in (0.05, 0.55, 0.9):
        left, run = bounce(method, v, dt, phase, 0.0)
        assert 0.0 <= left < 0.05
        total = run.energies["total"]
        assert (np.diff(total) <= 1e-9 * total[0]).all()
        assert abs(run.energies["remainder"]).max() < 1e-6 * total[0]
        assert run.energies["dissipated:Obstacle"][-1] > 0.0


@pytest.mark.parametrize("dt", stories_except([1e-4, 1e-3, 0.01], 0.01))
def test_no_elastic_bounce_gains_energy_with_bdf2(dt):
    """Where steps do not resolve it, steps of backward Euler take their place."""
    for phase in (0.05, 0.3, 0.55, 0.8):
        left, run = bounce(fc.BDF2(), 1.0, dt, phase, 1.0)
        assert left < 1.0
        assert run.energies["total"].max() <= run.energies["total"][0] * (1 + 1e-9)


@pytest.mark.parametrize(
    ("e", "v"), [(0.5, 1.0), pytest.param(1.0, 0.1, marks=pytest.mark.stories)]
)
def test_a_bounce_that_steps_resolve_leaves_its_part_of_the_speed(e, v):
    left, run = bounce(fc.BDF2(), v, GAP / (50 * v), 0.3, e)
    assert left == pytest.approx(e, abs=0.05)
    assert run.energies["total"].max() <= run.energies["total"][0] * (1 + 1e-9)


@pytest.mark.parametrize(
    ("e", "part", "warns"),
    [
        (1.0, 0.8, False),
        (1.0, 1.25, True),
        pytest.param(0.5, 1.25, True, marks=pytest.mark.stories),
        (0.0, 9, False),
    ],
)
def test_a_bounce_that_steps_do_not_resolve_is_a_warning(e, part, warns):
    """Resolved are steps up to gap/(50 v), with the speed v of the first touch."""
    v = 1.0
    _, run = bounce(fc.BDF2(), v, part * GAP / (50 * v), 0.3, e)
    said = [words for words in run.warnings if "are not resolved" in words]
    assert len(said) == warns
    if warns:
        assert "bounces off Obstacle" in said[0]
        assert "with 1 m/s" in said[0]
        assert "dt = 2e-05 s resolves them" in said[0]


def test_steps_that_follow_their_error_are_told_to_bound_the_longest():
    cloth = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right")
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Obstacle(FLOOR, GAP, restitution=1.0)])
    start = system.state(flat(cloth) + [0, 0, 0.01], np.tile([0, 0, -1.0], (len(cloth.X), 1)))
    run = fc.run(system, fc.Adaptive(fc.BDF2(), rtol=1.0, shortest=1e-3), start, t_end=0.02)
    (said,) = (words for words in run.warnings if "are not resolved" in words)
    assert "longest = 2e-05 s resolves them" in said


@pytest.mark.stories
@pytest.mark.parametrize("e", [0.0, 1.0])
def test_the_automatic_tolerance_solves_an_impact(e):
    """Judged by its corrections alone, Newton's iteration ended deep in the gap: the remainder was
    169 times the kinetic energy for e = 0, and 1.6 times for e = 1, where it is 0.35 times."""
    cloth = fc.Cloth.rectangle(0.2, 0.1, 0.03)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.Obstacle(FLOOR, GAP, restitution=e)]
    system, x = fc.System(cloth, FABRIC, terms), flat(cloth)
    x[:, 2] = 0.3 * x[:, 0] + 3e-3
    start = system.state(x, 0 * x - [0, 0, 1.0])
    runs = [
        fc.run(system, fc.BDF2(), start, dt=5e-3, t_end=0.03, newton=fc.Newton(tolerance))
        for tolerance in ("auto", 1e-9)
    ]
    by_auto, exact = (run.energies["remainder"] for run in runs)
    assert abs(by_auto - exact).max() < 0.02 * runs[0].energies["kinetic"][0]
    assert runs[0].newton < runs[1].newton


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
        system, method, system.rest(), dt=2e-3, t_end=0.02, newton=fc.Newton(tolerance=1e-11)
    )
    work, numerical = run.energies["work:Obstacle"][-1], run.energies["numerical"][-1]
    assert work > 1e-6
    assert abs(run.energies["remainder"][-1]) < 0.03 * work
    assert -0.01 * work < numerical < work + run.energies["total"][0]


@pytest.mark.parametrize("value", [-0.1, 1.1, "half", True])
def test_a_restitution_lies_between_0_and_1(value):
    with pytest.raises(fc.InputError, match="restitution"):
        fc.Obstacle(FLOOR, restitution=value)


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
