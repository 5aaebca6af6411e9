"""Order, momentum and equivalences of every method."""

import numpy as np
import pytest
from conftest import affine, flat, taut_start
from support.linear_term import LinearDamping, LinearMembrane
from support.tiers import MASSES, in_turn

import fecloth as fc
from fecloth.integrators import METHODS, MethodTraits
from fecloth.verify import VerificationFailed, check_integrator

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ALL = [method() for method in METHODS.values()]
TIGHT = fc.Newton(tolerance=1e-12)


@pytest.mark.stories
@pytest.mark.parametrize(("method", "mass"), in_turn(ALL, MASSES), ids=str)
def test_order_with_moved_pins(method, mass, small, isotropic):
    shake = fc.Pin("boundary", motion=lambda t: [0.0, 0.0, 0.01 * (1 - np.cos(60 * t))])
    terms = [fc.StVK(), fc.StrainRateDamping(0.002), fc.Gravity()]
    system = fc.System(small, isotropic, terms, pins=[shake], mass=mass)
    check_integrator(system, method, taut_start(system), t_end=0.005, steps=(40, 80, 160, 320))


def momenta(system, state):
    p = system.scalar_mass @ state.v
    return p.sum(axis=0), np.cross(state.x, p).sum(axis=0)


@pytest.mark.parametrize(("method", "mass"), in_turn(ALL, MASSES), ids=str)
def test_momentum_of_a_free_cloth(method, mass, small, isotropic, rng):
    system = fc.System(small, isotropic, [fc.StVK(), fc.StrainRateDamping(0.005)], mass=mass)
    x = affine(small, [[1.1, 0.0], [0.1, 1.05], [0.0, 0.2]])
    v = np.cross([1.0, 2.0, 3.0], x) + [0.5, -0.2, 0.1] + 0.05 * rng.standard_normal(x.shape)
    state = system.state(x, v)
    linear, angular = momenta(system, state)
    for new, _ in fc.march(system, method, state, 2e-3, 0.04, solver="direct", newton=TIGHT):
        now_linear, now_angular = momenta(system, new)
        assert np.linalg.norm(now_linear - linear) < 1e-13 * system.nodal_mass.sum() * 40
        if isinstance(method, fc.ImplicitMidpoint | fc.EnergyMomentum):
            assert np.linalg.norm(now_angular - angular) < 1e-11 * np.linalg.norm(angular)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_angular_momentum_that_backward_euler_loses(mass, small, isotropic):
    """L₁ − L₀ = Σ x₁ × M (v₁ − v₀) + (x₁ − x₀) × M v₀ = 0 + dt Σ v₁ × M v₀."""
    system = fc.System(small, isotropic, [fc.StVK(), fc.StrainRateDamping(0.005)], mass=mass)
    x, dt = 1.1 * flat(small), 5e-3
    state = system.state(x, np.cross([0.0, 0.0, 8.0], x))
    end = 4 * dt  # later steps lose little more than the round-off of the forces
    for new, _ in fc.march(
        system, fc.BackwardEuler(), state, dt, end, solver="direct", newton=TIGHT
    ):
        loss = momenta(system, new)[1] - momenta(system, state)[1]
        formula = dt * np.cross(new.v, system.scalar_mass @ state.v).sum(axis=0)
        assert np.linalg.norm(formula) > 1e-4 * np.linalg.norm(momenta(system, state)[1])
        assert np.linalg.norm(loss - formula) < 1e-9 * np.linalg.norm(formula)
        state = new


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_linearised_step_is_backward_euler_on_a_linear_problem(mass, small, isotropic):
    shake = fc.Pin("left", motion=lambda t: [0.0, 0.0, 0.05 * np.sin(20 * t)])
    terms = [LinearMembrane(), LinearDamping(0.01), fc.Gravity()]
    system = fc.System(small, isotropic, terms, pins=[shake], mass=mass)
    start = taut_start(system, 1.2)
    ends = [
        fc.run(system, method, start, 5e-3, 0.03, solver="direct", newton=TIGHT).state
        for method in (fc.BackwardEuler(), fc.LinearlyImplicitEuler())
    ]
    np.testing.assert_allclose(ends[0].x, ends[1].x, atol=1e-12)
    np.testing.assert_allclose(ends[0].v, ends[1].v, atol=1e-9)


def test_the_linear_equation_is_solved_to_its_tolerance(isotropic):
    """Its error with "auto" is small beside the method's own error in time."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.02)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])

    def run(method, dt, tolerance):
        newton = fc.Newton(tolerance=tolerance)
        start = taut_start(system)
        steps = list(fc.march(system, method, start, dt, 0.02, solver="pcg", newton=newton))
        return steps[-1][0].x, max(info.counts.residual for _, info in steps)

    loose, residual = run(fc.LinearlyImplicitEuler(), 1e-3, "auto")
    assert 1e-5 < residual <= 1e-4
    tight, residual = run(fc.LinearlyImplicitEuler(), 1e-3, 1e-9)
    assert residual <= 1e-9
    exact, _ = run(fc.ImplicitMidpoint(), 1e-4, 1e-8)
    assert np.linalg.norm(loose - tight) < 2e-3 * np.linalg.norm(tight - exact)


@pytest.mark.stories
@pytest.mark.parametrize(("method", "tangent"), in_turn(ALL, ["symmetric", "exact"]), ids=str)
def test_order_with_damping(method, tangent, small, isotropic):
    damping = fc.StrainRateDamping(0.002, tangent=tangent)
    system = fc.System(small, isotropic, [fc.StVK(), damping, fc.Gravity()], pins=["boundary"])
    check_integrator(system, method, taut_start(system), t_end=0.005, steps=(40, 80, 160, 320))


def test_check_integrator_detects_a_wrong_order(small, isotropic):
    class Claims(fc.BackwardEuler):
        traits = MethodTraits(order=2)

    system = fc.System(small, isotropic, [fc.StVK()], pins=["boundary"])
    with pytest.raises(VerificationFailed, match="expected 2"):
        check_integrator(system, Claims(), taut_start(system), t_end=0.005)


def test_result_is_invariant_under_renumbering_and_rotation(small, isotropic, rng):
    """Taut scene, direct solver: only the growth of round-off separates the runs."""
    terms = [fc.StVK(), fc.StrainRateDamping(0.002)]

    def end(cloth, turn, order):
        system = fc.System(cloth, isotropic, terms, pins=["boundary"])
        start = taut_start(system)
        state = system.state(start.x @ turn.T, start.v @ turn.T)
        run = fc.run(
            system, fc.ImplicitMidpoint(), state, 2e-3, 0.04, solver="direct", newton=TIGHT
        )
        x = np.empty_like(run.state.x)
        x[order] = run.state.x
        return x

    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    shuffle = rng.permutation(len(small.X))  # new node i is old node shuffle[i]
    inverse = np.argsort(shuffle)
    triangles = inverse[small.triangles][rng.permutation(len(small.triangles))]
    sets = {"boundary": inverse[small.nodes("boundary")]}
    other = fc.Cloth.from_arrays(small.X[shuffle], triangles, sets)
    plain = end(small, np.eye(3), np.arange(len(small.X)))
    turned = end(small, turn, np.arange(len(small.X)))
    renumbered = end(other, np.eye(3), shuffle[other.source_nodes])
    np.testing.assert_allclose(turned, plain @ turn.T, atol=1e-11)
    np.testing.assert_allclose(renumbered, plain, atol=1e-11)


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.EnergyMomentum(), fc.GeneralizedAlpha()])
def test_methods_conserve_their_invariants_on_quadratic_triangles(quadratic, orthotropic, method):
    """All conserve momentum; energy–momentum also energy and angular momentum."""
    system = fc.System(quadratic, orthotropic, [fc.StVK()])
    x = 1.05 * system.rest().x
    spin = np.array([1.0, -2.0, 3.0])
    start = system.state(x, np.cross(spin, x) + [1.0, 0.5, 2.0])
    newton = fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, 2e-4, 4e-3, solver="direct", newton=newton)
    end, M = result.state, system.scalar_mass
    before, after = (M @ s.v for s in (start, end))
    np.testing.assert_allclose(after.sum(axis=0), before.sum(axis=0), rtol=1e-9)
    if isinstance(method, fc.EnergyMomentum):
        total = result.energies["kinetic"] + result.energies["StVK"]
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        turning = [np.cross(s.x, M @ s.v).sum(axis=0) for s in (start, end)]
        np.testing.assert_allclose(turning[1], turning[0], rtol=1e-8, atol=1e-12)
