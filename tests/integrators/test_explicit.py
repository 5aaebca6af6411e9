"""Explicit methods: order, momentum, pins, ledger; no matrix."""

import numpy as np
import pytest
from conftest import affine, taut_start
from support.linear_term import LinearDamping, LinearMembrane

import fecloth as fc
from fecloth.integrators import CentralDifference, ForwardEuler, SymplecticEuler
from fecloth.verify import check_integrator

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ALL = [kind(beyond_limit=True) for kind in (ForwardEuler, SymplecticEuler, CentralDifference)]
EULER, SYMPLECTIC, CENTRAL = ALL


def named(method):
    return type(method).__name__


@pytest.mark.parametrize("method", ALL, ids=named)
def test_order_with_damping_and_moved_pins(method, small, isotropic):
    shake = fc.Pin("left", motion=lambda t: [0.0, 0.0, 0.01 * (1 - np.cos(60 * t))])
    rail = fc.Slide("right", normal=(1.0, 0.0, 0.5))
    terms = [fc.StVK(), fc.StrainRateDamping(2e-4), fc.Gravity()]
    system = fc.System(small, isotropic, terms, pins=[shake, rail])
    check_integrator(system, method, taut_start(system), t_end=0.01, steps=(80, 160, 320, 640))


@pytest.mark.parametrize("method", ALL, ids=named)
def test_momentum_of_a_free_cloth(method, small, isotropic, rng):
    system = fc.System(small, isotropic, [fc.StVK(), fc.StrainRateDamping(2e-4)])
    x = affine(small, [[1.1, 0.0], [0.1, 1.05], [0.0, 0.2]])
    v = np.cross([1.0, 2.0, 3.0], x) + [0.5, -0.2, 0.1] + 0.05 * rng.standard_normal(x.shape)
    state = start = system.state(x, v)
    lost = np.zeros(3)  # x₁ × M v₁ − x₀ × M v₀ = dt v₀ × M Δv by forward Euler, nothing by others
    for new, info in fc.march(system, method, start, 1e-4, 0.02):
        if method == EULER:
            dv = new.v - state.v
            lost += info.dt * np.cross(state.v, system.nodal_mass[:, None] * dv).sum(axis=0)
        state = new
    before, after = (system.nodal_mass[:, None] * s.v for s in (start, state))
    np.testing.assert_allclose(after.sum(axis=0), before.sum(axis=0), rtol=1e-12)
    change = np.cross(state.x, after).sum(axis=0) - np.cross(start.x, before).sum(axis=0)
    np.testing.assert_allclose(change, lost, rtol=0, atol=1e-13)
    assert (np.linalg.norm(lost) > 1e-6) == (method == EULER)


@pytest.mark.parametrize("method", ALL, ids=named)
def test_ledger_closes_on_a_linear_problem(method, isotropic):
    """Moved pins, a slide, damping, gravity: nothing is left unexplained."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
    terms = [LinearMembrane(), LinearDamping(1e-4), fc.MassDamping(1.0), fc.Gravity()]
    shake = fc.Pin("left", lambda t: [0.02 * np.sin(30 * t), 0.0, 0.05 * np.sin(40 * t)])
    pins = [shake, fc.Slide("right", direction=(1, 2, 0))]
    system = fc.System(cloth, isotropic, terms, pins)
    start = system.state(affine(cloth, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]]))
    result = fc.run(system, method, start, 2e-4, 0.02, most_growth=np.inf)
    energies, left = result.energies, cloth.nodes("left")
    followed = start.x[left] + shake.displacement(0.02)
    np.testing.assert_allclose(result.state.x[left], followed, rtol=0, atol=4e-15)
    assert min(abs(energies[c]).max() for c in ("pins", "dissipated:LinearDamping")) > 1e-4
    assert abs(energies["numerical"]).max() > 1e-6
    assert abs(energies["remainder"]).max() < 1e-10 * abs(energies["total"]).max()


@pytest.mark.parametrize("method", ALL, ids=named)
def test_no_matrix_and_no_consistent_mass(method, small, isotropic, monkeypatch):
    def forbidden(*_):
        raise AssertionError("a matrix was made")

    system = fc.System(small, isotropic, [fc.StVK(), fc.Gravity()], ["left"])
    monkeypatch.setattr("fecloth.linalg.block_matrix.BlockMatrix.zeros", forbidden)
    run = {"solver": "direct", "time_error": "none"}
    result = fc.run(system, method, system.rest(), 1e-4, 1e-3, **run)
    assert result.solver == "none, as the method is explicit"
    consistent = fc.System(small, isotropic, [fc.StVK()], mass="consistent")
    with pytest.raises(fc.InputError, match="must be 'lumped': an explicit step divides"):
        next(fc.march(consistent, method, consistent.rest(), 1e-4, 1e-3))
