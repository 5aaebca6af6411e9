"""Static equilibrium: closed forms, quadratic convergence, and what has none is reported."""

import warnings
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from conftest import flat
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar
from support.inflated import enclosed

import fecloth as fc
from fecloth.nonlinear.eigenpairs import least_eigenpairs, least_stiffness
from fecloth.nonlinear.static_equation import StaticEquation
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.rest_stability import RestStability
from fecloth.verify import observed_order
from studies.references.closed_forms import hanging_strip, hanging_strip_mean

DOWN = fc.Gravity((0.0, 0.0, -9.81))


def solved(system, state, **options):
    """The equilibrium and its iterations; its residual is recomputed here."""
    iterations = []
    result = fc.equilibrium(system, state, report=iterations.append, **options)
    f = system.constraints.project(system.force(result))
    scale = sum(np.linalg.norm(part) for part in parts(system, result))
    assert np.linalg.norm(f) < max(1e-8 * scale, 1e-11)  # of about 1e3 N/m × 1 m, rounded
    assert result.residual <= options.get("tolerance", 1e-9)
    assert not result.v.any()
    assert result.state is result
    assert result.t == state.t
    return result, iterations


def parts(system, state):
    """The forces of the terms, of which those on what the pins hold are the reactions."""
    for term in system.bound:
        f = np.zeros_like(state.x)
        term.add_force(state.x, 0 * state.x, state.t, f)
        yield f


def loads(system, state):
    """The forces of the terms along the free directions."""
    return [system.constraints.project(f) for f in parts(system, state)]


# --- solutions known otherwise --------------------------------------------------------------------


def test_hanging_strip_meets_the_closed_form():
    errors = []
    for h in (0.1, 0.05, 0.025):
        cloth = fc.Cloth.rectangle(0.2, 1.0, h=h, pattern="right")
        fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=20.0)  # 10 % strain at the clamp
        terms = [fc.StVK(), fc.Gravity((0.0, -9.81, 0.0))]
        system = fc.System(cloth, fabric, terms, pins=["top"])
        result, iterations = solved(system, system.rest())
        assert len(iterations) < 10
        down = system.rest().x[:, 1] - result.x[:, 1]
        mean = np.vdot(system.nodal_mass, down) / system.nodal_mass.sum()
        errors.append(abs(mean / hanging_strip_mean(1.0, 20.0, 0.2) - 1))
    assert errors[-1] < 1e-3
    exact = hanging_strip(1 - cloth.X[:, 1], 1.0, 20.0, 0.2)
    np.testing.assert_allclose(down, exact, rtol=0, atol=0.003 * exact.max())
    np.testing.assert_allclose(observed_order([4, 2, 1], errors), 2.0, atol=0.1)


def test_a_cloth_that_starts_squeezed():
    """In compression the tangent is indefinite: the definite one and σ M lead out of it."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    pin = fc.Pin(lambda X: (abs(X[:, 0] - 0.5) > 0.5 - 1e-9) & (X[:, 1] > 1 - 1e-9))
    system = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending(), DOWN], pins=[pin])
    x = flat(cloth)
    x[:, 0] *= 0.8
    _, iterations = solved(system, system.state(x))
    assert len(iterations) < 60
    assert iterations[-1].shift == 0


def dome(cloth):
    """Positions of a disk of 0.5 m, blown up by 5 cm."""
    x = flat(cloth)
    x[:, 2] = 0.05 * (1 - np.sum(cloth.X**2, axis=1) / 0.25)
    x[cloth.nodes("boundary"), 2] = 0.0
    return x


def test_gas_couples_all_nodes():
    """What is found also balances the plain pressure p₀ V₀/V less the ambient one."""
    cloth = fc.Cloth.disk(0.5, 0.05)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    terms = [fc.StVK(), fc.Gas(pressure=103325.0, volume=0.02)]
    system = fc.System(cloth, fabric, terms, pins=["boundary"])
    x = dome(cloth)
    result, iterations = solved(system, system.state(x))
    assert quadratic(iterations)  # with the dense part left out it is not
    p = 103325.0 * 0.02 / enclosed(cloth, result.x) - 101325.0
    blown = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(p)], pins=["boundary"])
    f, (pull, push) = blown.force(result), loads(blown, result)
    assert np.linalg.norm(system.constraints.project(f)) < 1e-5 * np.linalg.norm(push)
    assert np.linalg.norm(pull) > 0.1


# --- loads that grow in steps ---------------------------------------------------------------------


def clamped_strip(load, cells, element, bending=1e-3):
    """A strip 1 m long, one cell wide, clamped, and the place where its length counts from.

    Its thickness of 5 mm keeps it from stretching.
    """
    fabric = fc.Fabric(0.1, 12 * bending / 0.005**2, bending_rigidity=bending)
    cloth = fc.Cloth.rectangle(1.0, 1 / cells, 1 / cells, "right", element)
    pressure = fc.Pressure(load * bending, tangent="exact")
    terms = [fc.StVK(), fc.PlateBending(), pressure]
    return fc.System(cloth, fabric, terms, pins=[fc.Pin("left", clamp=True)]), [0, 0.5 / cells, 0]


def strip_of_hinges(load, cells, bending=1e-3):
    """The strip under `load` B_eff/L³, whose slope is zero between two held columns of nodes."""
    h = 1 / (cells - 0.5)
    effective = 1 / np.linalg.inv(fc.bending_tensor("cross"))[0, 0]
    fabric = fc.Fabric(0.1, 12 * bending / 0.005**2, bending_rigidity=bending)
    cloth = fc.Cloth.rectangle(cells * h, h, h, "cross")
    pressure = fc.Pressure(load * effective * bending, tangent="exact")
    clamp = fc.Pin(lambda X: X[:, 0] < 1.01 * h)
    terms = [fc.StVK(), fc.HingeBending(), pressure]
    return fc.System(cloth, fabric, terms, pins=[clamp]), [0.5 * h, 0.5 * h, 0]


def blown_elastica(load):
    """Position of the tip of the inextensible strip under a follower pressure, and its angle.

    What lies between a point and the tip carries p times their distance d, across it, at its
    middle, so B κ = p d²/2. From the tip this is an initial value problem; what it gives is turned
    so that the clamp lies along x.
    """

    def rates(s, y):  # from the tip backwards, along x there: position and angle
        return [-np.cos(y[2]), -np.sin(y[2]), -load * (y[0] ** 2 + y[1] ** 2) / 2]

    x, z, angle = solve_ivp(rates, (0, 1), [0, 0, 0], rtol=1e-10, atol=1e-12).y[:, -1]
    end = -complex(x, z) * np.exp(-1j * angle)
    return np.array([end.real, 0.0, end.imag]), np.degrees(-angle)


@pytest.mark.stories
@pytest.mark.parametrize(
    ("make", "load", "cells", "least_turn", "error", "order"),
    [
        (strip_of_hinges, 20.0, (40, 80), 150, 0.012, (0.74, 2.15)),  # first order, as its clamp
        (strip_of_hinges, 60.0, (40, 80), 230, 0.012, (0.74, 2.15)),
        (partial(clamped_strip, element="P1"), 20.0, (20, 40), 150, 4e-4, (1.85, 2.15)),
        (partial(clamped_strip, element="P2"), 20.0, (10, 20), 150, 7e-4, (1.85, 2.15)),
    ],
)
def test_a_follower_pressure_turns_a_strip_round(make, load, cells, least_turn, error, order):
    """In ten load steps to the elastica."""
    expected, turn = blown_elastica(load)
    assert turn > least_turn
    errors = []
    for count in cells:
        system, origin = make(load, count)
        result, iterations = solved(system, system.rest(), load_steps=10)
        firsts = [it.load for it in iterations if it.number == 1]
        assert firsts == pytest.approx(np.arange(1, 11) / 10)
        tip = result.x[system.cloth.nodes("right")].mean(axis=0) - origin
        errors.append(np.linalg.norm(tip - expected))
    assert errors[1] < error
    assert order[0] < np.log2(errors[0] / errors[1]) < order[1]


@pytest.mark.stories
def test_load_steps_find_an_equilibrium_that_one_step_does_not():
    system, _ = strip_of_hinges(60.0, 40)
    with pytest.raises(fc.EquilibriumFailed, match="more load_steps"):
        fc.equilibrium(system, system.rest(), max_iterations=25)
    whole, iterations = solved(system, system.rest(), load_steps=2, max_iterations=25)
    increments = np.diff([0.0] + sorted({it.load for it in iterations}))
    assert increments.min() < 0.25  # halved where 25 iterations did not do, and
    assert (np.diff(increments) > 1e-9).any()  # grown again
    fine, _ = solved(system, system.rest(), load_steps=40)
    np.testing.assert_allclose(whole.x, fine.x, atol=1e-7)


def limit_pressure():
    """Largest p a/μ that a neo-Hookean disk of radius a, held at its rim, can bear.

    The membrane of `test_pressure.shooting` with S₁ = μ (1 − 1/(λ₁⁴λ₂²)) and S₂ likewise. With
    p = μ = 1 an integration from the centre with the stretch λ₀ ends at the rim r = R = a: each
    λ₀ gives one p a/μ, and their largest is the limit.
    """

    def rates(R, y):
        r, h, _ = y
        Q, l2 = np.hypot(h, r * r / 2), r / R
        l1 = brentq(lambda l1: l1 - 1 / (l1**3 * l2**2) - Q / R, 1e-2, 1e3, xtol=1e-13)
        dr, dz = l1 * h / Q, -l1 * r * r / 2 / Q
        return [dr, (1 - 1 / (l2**4 * l1**2)) * r / R + r * dz, dz]

    def rim(R, y):
        return y[0] - R

    rim.terminal = True

    def pressure(stretch):
        start = [stretch * 1e-6, 1e-6 * stretch * (1 - stretch**-6), 0.0]
        return solve_ivp(rates, (1e-6, 100), start, events=rim, rtol=1e-8, atol=1e-10).t[-1]

    best = minimize_scalar(lambda l0: -pressure(l0), bounds=(1.2, 4), method="bounded")
    return -best.fun


@pytest.mark.stories
def test_load_steps_end_at_the_limit_load():
    """Above its limit pressure a rubber membrane has no equilibrium; the error names the load."""
    shear, radius = 1000.0 / 3, 0.5
    cloth = fc.Cloth.disk(radius, 0.05)
    fabric = fc.Fabric(0.2, 3 * shear, 0.5)
    terms = [fc.NeoHookean(), fc.Pressure(2.2 * shear / radius)]
    system = fc.System(cloth, fabric, terms, pins=["boundary"])
    with pytest.raises(fc.EquilibriumFailed, match=r"ended at 0\.\d+ of the loads: ") as failure:
        fc.equilibrium(system, system.rest(), load_steps=5, max_iterations=25)
    reached = failure.value.load
    assert 2.2 * reached == pytest.approx(limit_pressure(), rel=0.01)
    pull, load = loads(system, failure.value.state)
    assert np.linalg.norm(pull + reached * load) < 1e-8 * np.linalg.norm(load)


def test_every_load_grows_in_steps():
    """Each step balances its part of the loads; at the end it is what is found at once."""
    cloth = fc.Cloth.disk(0.5, 0.1)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    wind = fc.Wind((0.0, 0.0, 5.0), normal=1.2)
    gas = fc.Gas(pressure=103325.0, volume=0.02)
    hang = [DOWN, fc.PointForce((0.1, 0.0), (0, 0, -0.5)), fc.UserForce((0, "0.1 * x", 1.0))]
    x = dome(cloth)
    for outside in ([gas], hang, [wind], [fc.Pressure(50.0)]):
        system = fc.System(cloth, fabric, [fc.StVK(), *outside], pins=["boundary"])
        assert [getattr(t, "load", False) for t in system.bound] == [False] + [True] * len(outside)
        whole, _ = solved(system, system.state(x))
        steps, iterations = solved(system, system.state(x), load_steps=4)
        assert {it.load for it in iterations} == {0.25, 0.5, 0.75, 1.0}
        assert all(it.residual < 1e-8 for it, after in pairwise(iterations) if after.number == 1)
        np.testing.assert_allclose(steps.x, whole.x, atol=1e-7)


def test_part_of_the_loads_has_its_part_of_the_potential(isotropic):
    """What the line search compares is the potential of the forces: −∂/∂x of it, at any part."""
    cloth = fc.Cloth.disk(0.5, 0.1)
    terms = [fc.StVK(), DOWN, fc.Gas(pressure=103325.0, volume=0.02)]
    system = fc.System(cloth, isotropic, terms, pins=["boundary"])
    x = dome(cloth)
    for load in (0.25, 1.0):
        equation = StaticEquation(system, system.rest(), load)
        f = -equation.residual(x, 0.0)[0]
        step = 1e-6 * f / abs(f).max()
        slope = equation.potential(x + step) - equation.potential(x - step)
        assert slope == pytest.approx(-2 * np.vdot(f, step), rel=1e-6)


# --- convergence ----------------------------------------------------------------------------------


def quadratic(iterations):
    """Each of the last two exact full steps squares the residual, down to round-off."""
    r = np.array([it.residual for it in iterations if it.shift == 0 and it.length == 1])
    r = r[-3:]
    return (
        len(r) == 3 and 1e-7 < r[0] < 0.05 and all(b < max(20 * a**2, 1e-9) for a, b in pairwise(r))
    )


def test_convergence_is_quadratic_near_the_solution():
    cloth = fc.Cloth.disk(0.5, 0.05)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    for load in (DOWN, fc.Pressure(500.0)):
        system = fc.System(cloth, fabric, [fc.StVK(), load], pins=["boundary"])
        _, iterations = solved(system, system.rest())
        assert quadratic(iterations)


# --- what has no equilibrium ----------------------------------------------------------------------


def test_slack_triangles_are_counted(isotropic):
    """Cut short on its way, a squeezed cloth without bending says how much of it is slack."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.2)
    system = fc.System(cloth, isotropic, [fc.StVK(), DOWN], pins=["left"])
    state = system.state(0.8 * flat(cloth))
    with pytest.raises(fc.EquilibriumFailed, match=r"allows no more; \d+ of \d+ triangles") as e:
        fc.equilibrium(system, state, max_iterations=1)
    assert "bending stiffness" in str(e.value)


# --- pins that move, and what is unstable ---------------------------------------------------------


def compressed_strip():
    """A flat strip between pins that are 2 % nearer to each other than its rest."""
    cloth = fc.Cloth.rectangle(0.4, 0.1, h=0.1, pattern="right")
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-4)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], ["left", "right"])
    return system, system.rest().x * [0.98, 1, 1]


def test_under_a_following_load_a_negative_symmetric_part_is_not_called_unstable():
    """K of a pulled sheet that can turn about its pins is not symmetric; the motion is stable."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.08)
    fabric = fc.Fabric(0.2, 200.0, 0.3, bending_rigidity=1e-5)
    pull = fc.EdgeForce("right", normal=20.0, tangent=1.0, follow=True)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), pull], ["left"])
    state = fc.equilibrium(system, system.rest(), load_steps=4)
    least, zero = least_stiffness(system, state)
    assert np.isnan(least)
    pairs = least_eigenpairs(system, state, 1, unit_mass=True)
    assert pairs.values[0] < -zero
    assert not pairs.are_symmetric
    assert not pairs.is_unstable
    words = RestStability.of(system, state, 4).words()
    assert "not known whether it is stable" in words


def test_an_unstable_equilibrium_warns_and_bending_the_start_finds_a_stable_one():
    system, x = compressed_strip()
    with pytest.warns(fc.FeclothWarning, match="the equilibrium is unstable.*bend the start"):
        flat = fc.equilibrium(system, system.state(x))
    assert len(flat.warnings) == 1
    bent = x + 1e-3 * fc.modes(system, flat, count=1).shapes[0]
    result = fc.equilibrium(system, system.state(bent))
    assert result.warnings == ()
    assert np.ptp(result.x[:, 2]) > 0.01


def test_a_definite_stiffness_needs_no_eigenvalue(monkeypatch):
    cloth = fc.Cloth.rectangle(0.4, 0.1, h=0.05, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), DOWN], ["boundary"])
    monkeypatch.setattr("fecloth.simulation.equilibrium.least_stiffness", None)
    assert fc.equilibrium(system, system.rest()).warnings == ()


def test_a_sheet_without_a_membrane_is_told_to_add_one():
    cloth = fc.Cloth.rectangle(0.4, 0.1, h=0.1, pattern="right")
    for terms in ([DOWN], [DOWN, fc.HingeBending()]):
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5), terms, ["left"])
        with pytest.raises(fc.EquilibriumFailed, match="add StVK"):
            fc.equilibrium(system, system.rest())
        held = fc.System(cloth, system.fabric, [*terms, fc.StVK()], ["left"])
        assert fc.equilibrium(held, held.rest()).warnings == ()


# --- what moves with the loads --------------------------------------------------------------------


def drawn(motion, fabric=None, terms=None):
    cloth = fc.Cloth.rectangle(0.2, 0.05, h=0.05)
    pins = [fc.Pin("left"), fc.Pin("right", motion=motion)]
    fabric = fabric or fc.Fabric(0.2, 1000.0)
    return fc.System(cloth, fabric, terms or [fc.StVK()], pins)


def test_load_steps_move_the_pins_and_a_run_goes_on_with_their_motion():
    """At t = 1: the pin does not jump back, and does not make its way again.

    Without load steps pins hold their nodes where they are: it is a start for a run.
    """
    system = drawn(("0.02*t", 0, 0))
    right = system.cloth.nodes("right")
    start = fc.equilibrium(system, system.rest())
    assert (start.t, start.x[right, 0]) == (0.0, pytest.approx(0.2))
    end = fc.equilibrium(system, system.rest(), load_steps=1)
    assert (end.t, end.x[right, 0]) == (1.0, pytest.approx(0.22))
    *_, (state, _) = fc.march(system, LoadSteps(1), system.rest(), t_end=1.0)
    np.testing.assert_allclose(end.x, state.x, atol=1e-12)
    run = fc.run(system, fc.BackwardEuler(), end, 0.05, 1.1)
    np.testing.assert_allclose(run.state.x[right, 0], 0.2 + 0.022, atol=1e-12)


@pytest.mark.parametrize(
    ("motion", "is_told"),
    [
        ((0.02, 0, 0), True),
        (("where(t > 2, 0.02, 0)", 0, 0), True),
        (("0.02*t", 0, 0), False),
        ((0, 0, 0), False),
    ],
)
@pytest.mark.parametrize("load_steps", [None, 1])
def test_a_motion_that_moves_nothing_is_warned_of(motion, is_told, load_steps):
    system = drawn(motion)
    with warnings.catch_warnings(record=True) as caught:
        end = fc.equilibrium(system, system.rest(), load_steps=load_steps)
    said = [str(each.message) for each in caught]
    assert end.warnings == ()
    if is_told:
        assert any("stand still" in each and "multiply it by t" in each for each in said)
        assert "pin 'right'" in str(end.doubts[0])
    elif load_steps:
        assert not said


def test_the_doubts_of_a_run_about_its_terms_are_those_of_an_equilibrium():
    twice = drawn(("0.02*t", 0, 0), terms=[fc.StVK(), fc.Springs(kind="biquadratic")])
    bare = drawn(
        ("0.02*t", 0, 0),
        fc.Fabric(0.2, 1e6, bending_rigidity=1e-5),
        [fc.HingeBending(), fc.Gravity()],
    )
    for system in (twice, bare):
        with pytest.warns(fc.FeclothWarning) as of_run:
            fc.run(system, fc.BackwardEuler(), system.rest(), 1e-3, 1e-3)
        said = [str(each.message) for each in of_run]
        try:
            with pytest.warns(fc.FeclothWarning) as of_rest:
                fc.equilibrium(system, system.rest(), load_steps=1, max_iterations=3)
        except fc.EquilibriumFailed:
            pass
        assert str(of_rest[0].message) in said


def test_the_work_of_a_pin_is_that_of_its_force_at_both_ends():
    """In three load steps of a linear spring it is exact; by the force at the end a third more."""
    system = drawn(("0.001*t", 0, 0))
    run = fc.run(system, LoadSteps(3), system.rest(), t_end=1.0)
    assert run.energies["pins"][-1] == pytest.approx(run.energies["StVK"][-1], rel=2e-3)


@pytest.mark.parametrize("rigidity", [1e-3, 1e-5])
def test_square_hung_by_its_corners_with_bending(rigidity):
    """From the flat state at rest, 1 478 triangles; the four corners carry the weight."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.04)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=rigidity)
    corners = fc.Pin(lambda X: (abs(X - 0.5) > 0.5 - 1e-9).all(axis=1))
    terms = [fc.StVK(), fc.HingeBending(), DOWN]
    system = fc.System(cloth, fabric, terms, pins=[corners])
    found, iterations = solved(system, system.rest())
    assert 1000 < len(cloth.triangles) <= 2000
    assert len(iterations) < 60
    carried = -system.force(found)[system.constraints.nodes]
    np.testing.assert_allclose(carried.sum(axis=0), [0, 0, 0.2 * 9.81], atol=1e-7)
    assert -0.5 < found.x[:, 2].min() < -0.02
    # a minimum of the energy: nearby admissible states have more
    rng = np.random.default_rng(1)
    for _ in range(5):
        noise = system.constraints.project(rng.standard_normal(found.x.shape))
        other = system.state(found.x + 1e-4 * noise)
        assert sum(system.energies(other).values()) > sum(system.energies(found).values())
