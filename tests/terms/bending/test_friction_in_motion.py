"""`BendingFriction` in runs: heat, steps in time and of loads, explicit limits, scenes."""

import warnings

import meshio
import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.nonlinear.newton import StageEquation
from fecloth.scene.scene import Scene
from fecloth.stability.critical_step import critical_dt, rate_bounds
from fecloth.stability.lanczos_estimate import estimate

TIGHT = fc.Newton(tolerance=1e-12, reuse=False)
B, HB = 2e-5, 3e-4
L = 0.2


def strip(hysteresis=2 * HB, m=20.0, membrane=200.0, pins=None, n=8, density=0.2, more=()):
    cloth = fc.Cloth.rectangle(L, 0.05, h=L / n, pattern="right")
    fabric = fc.Fabric(density, membrane, bending_rigidity=B, bending_hysteresis=hysteresis)
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(m), fc.Gravity(), *more]
    pins = [fc.Pin("left", clamp=True)] if pins is None else pins
    return fc.System(cloth, fabric, terms, pins)


def fall(system, method, dt, t_end=0.1, **given):
    solver = {} if method.traits.explicit else {"solver": "direct", "newton": TIGHT}
    return fc.run(system, method, system.rest(), dt=dt, t_end=t_end, **solver, **given)


def test_energy_and_heat_balance_the_work():
    """A strip that falls under its weight, swings, and loses energy by friction alone."""
    energies = fall(strip(n=4), fc.EnergyMomentum(), 4e-3, 0.2).energies
    work = np.ptp(energies["Gravity"])
    heat = energies["dissipated:BendingFriction"]
    assert heat[-1] > 0.02 * work
    assert (np.diff(heat) >= 0).all()
    assert np.abs(energies["remainder"]).max() < 1e-8 * work


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.ImplicitMidpoint()])
def test_a_step_lowers_a_potential_whose_slope_is_its_residual(method, rng):
    """Newton's iteration is led by the energy of sliders over the step, and by damping."""
    system, dt = strip(more=[fc.MassDamping(300.0)]), 4e-3
    start = system.rest()
    over = method.over_step(system, start, dt, system.start_history(start))
    equation = StageEquation(over, method.stage(start, dt), "on_failure")
    for speed in (1e-3, 0.3):  # sliders stick, or slide
        q = system.constraints.project(speed * rng.standard_normal(start.x.shape))
        step = 1e-5 * system.constraints.project(rng.standard_normal(start.x.shape))
        slope = equation.potential(q + step) - equation.potential(q - step)
        residual = np.vdot(equation.residual(q, 1.0)[0], 2 * step)
        assert slope == pytest.approx(residual, rel=1e-5)
    assert over.bound[2].dissipation(equation.stage.at(q)[0]) > 0.0


def test_modes_about_an_equilibrium_are_of_sliders_that_stick():
    with_friction, without = strip(density=0.02, n=4), strip(0.0, density=0.02, n=4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # it is in balance
        rest = fc.equilibrium(with_friction, with_friction.rest())
        stuck = fc.modes(with_friction, rest, count=1).frequencies[0]
    free = fc.modes(without, without.rest(), count=1).frequencies[0]
    flat = fc.modes(with_friction, with_friction.rest(), count=1).frequencies[0]
    assert flat == pytest.approx(free * np.sqrt(21.0), rel=1e-3)
    assert stuck > 0.8 * flat


@pytest.mark.parametrize(
    "name", stories_except(["backward_euler", "bdf2", "energy_momentum"], "bdf2")
)
def test_without_hysteresis_the_bits_are_those_without_the_term(name):
    system = strip(0.0)
    without = fc.System(
        system.cloth,
        system.fabric,
        [t for t in system.terms if "Friction" not in str(t)],
        system.pins,
    )
    ours, theirs = (fall(each, METHODS[name](), 4e-3, 0.04) for each in (system, without))
    assert np.array_equal(ours.state.x, theirs.state.x)
    assert np.array_equal(ours.state.v, theirs.state.v)
    for column, values in theirs.energies.items():
        assert np.array_equal(ours.energies[column], values), column
    ours, theirs = (fc.equilibrium(each, each.rest()) for each in (system, without))
    assert np.array_equal(ours.x, theirs.x)
    assert ours.reason == theirs.reason


def test_the_stiffness_of_sliders_counts_in_the_limit_of_explicit_steps():
    """Where bending limits the step, the limit falls with √(1 + m), also while sliders slide."""
    soft, stiff = (strip(membrane=1e-3, m=m) for m in (1e-9, 20.0))
    rest = stiff.rest()
    method = fc.CentralDifference()
    for limit in (critical_dt, estimate):
        ratio = limit(soft, rest, method) / limit(stiff, rest, method)
        assert ratio == pytest.approx(np.sqrt(21.0), rel=0.05)
    assert rate_bounds(stiff)[0] == pytest.approx(21.0 * rate_bounds(soft)[0], rel=0.05)
    bent = stiff.state(rest.x + 2 * rest.x[:, :1] ** 2 * [0, 0, 1])
    slid = stiff.with_history(stiff.start_history(rest))
    assert estimate(slid, bent, method) < 1.2 * estimate(stiff, rest, method)


SCENE = {
    "cloth": {"shape": "rectangle", "width": L, "height": 0.05, "h": 0.025, "pattern": "right"},
    "fabric": {
        "areal_density": 0.2,
        "tensile_stiffness": 200.0,
        "bending_rigidity": B,
        "bending_hysteresis": 2 * HB,
    },
    "terms": [{"type": name} for name in ("StVK", "PlateBending", "BendingFriction", "Gravity")],
    "pins": [{"where": "left", "clamp": True}],
}


def scene(hysteresis=2 * HB, **static):
    fabric = SCENE["fabric"] | {"bending_hysteresis": hysteresis}
    return Scene.model_validate({**SCENE, "fabric": fabric, "equilibrium": static})


@pytest.mark.stories
def test_a_scene_is_laid_or_shaken(tmp_path):
    system = strip()
    ends = {"laid": fc.equilibrium(system, system.rest())}
    ends["shaken"] = fc.equilibrium(system, system.rest(), friction="shaken")
    for friction, end in ends.items():
        result = fc.run_scene(scene(friction=friction), tmp_path / friction)
        assert result.state.x == pytest.approx(end.x, abs=1e-9)
        assert len(result.times) == 21
        cells = meshio.read(max((tmp_path / friction / "frames").glob("*.vtu"))).cell_data
        moments = cells["friction_moment"][0]
        assert np.abs(moments).max() == pytest.approx(HB if friction == "laid" else 0, abs=1e-9)
        assert np.abs(cells["slid_curvature"][0]).max() > 1
    assert np.abs(ends["laid"].x - ends["shaken"].x).max() > 1e-3


def test_an_arc_that_opens_against_damping():
    """Without a potential Newton's iteration ran in circles in the third step."""
    cloth = fc.Cloth.rectangle(0.04, 0.01, h=0.0025, pattern="right")
    fabric = fc.Fabric(0.163, 1000.0, bending_rigidity=6.57e-6, bending_hysteresis=3.236e-4)
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(), fc.MassDamping(20.0)]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    X, Y = cloth.X.T
    start = system.state(np.column_stack([np.sin(50 * X) / 50, Y, (1 - np.cos(50 * X)) / 50]))
    for _, info in fc.march(system, fc.ImplicitMidpoint(), start, 1e-3, 5e-3):
        assert info.counts.newton < 40


@pytest.mark.stories
def test_explicit_steps_at_the_limit_agree_with_implicit_ones():
    implicit = fall(strip(), fc.BDF2(), 5e-4, 0.15)
    explicit = fall(strip(), fc.CentralDifference(), None, 0.15)
    far = np.abs(implicit.state.x - strip().rest().x).max()
    assert np.abs(explicit.state.x - implicit.state.x).max() < 0.02 * far
    work = np.ptp(explicit.energies["Gravity"])
    assert np.abs(explicit.energies["remainder"]).max() < 1e-3 * work


@pytest.mark.stories
@pytest.mark.parametrize("name", ["backward_euler", "bdf2", "generalized_alpha"])
def test_the_ledger_has_the_work_of_clamps_that_turn(name):
    """The remainder is a small part of their work, as without friction."""
    turn = fc.Rotation((0, 0, 0), (0, 1, 0), "-1.0*t")
    system = strip(pins=[fc.Pin("left", clamp=True, rotate=turn)], density=0.02, n=4)
    energies = fall(system, METHODS[name](), 2e-3, 0.1).energies
    assert energies["dissipated:BendingFriction"][-1] > 0
    work = np.abs(np.diff(energies["pins"])).sum() + np.ptp(energies["Gravity"])
    assert np.abs(energies["remainder"]).max() < 0.02 * work
