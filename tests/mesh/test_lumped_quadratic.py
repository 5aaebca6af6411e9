"""Lumped masses of quadratic triangles, and explicit methods on them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from support.tiers import in_turn, stories_except

import fecloth as fc
from fecloth.stability import critical_dt, element_bound, estimate, rate_bounds

TERMS = {
    "interpolated": [fc.StVK()],
    "pointwise": [fc.StVK(strain="pointwise")],
    "plate": [fc.StVK(), fc.PlateBending()],
    "stiff plate": [fc.StVK(), fc.PlateBending()],
    "damped": [
        fc.StVK(),
        fc.PlateBending(),
        fc.StrainRateDamping(1e-4),
        fc.BendingDamping(1e-3),
        fc.MassDamping(2.0),
    ],
}


def growth(system, method, dt, steps):
    """Largest displacement after small random ones, over theirs; infinite if a step fails."""
    rest, size = system.rest(), 1e-6
    noise = size * np.random.default_rng(0).standard_normal(rest.x.shape)
    start = system.state(system.constraints.hold(rest.x + noise, rest.x))
    try:
        end = list(fc.march(system, method, start, dt, steps * dt))[-1][0]
    except fc.StepFailed:
        return np.inf
    return np.abs(end.x - rest.x).max() / size


FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
PATTERNS = ["right", "cross", "equilateral", "unstructured"]


def square(pattern, h, **options):
    return fc.Cloth.rectangle(1.0, 1.0, h, pattern, element="P2", **options)


def test_masses_are_the_scaled_diagonal_of_the_consistent_ones():
    """1/19 at corners, 16/57 at midpoints; two densities keep the mass of each triangle."""
    triangle = fc.Cloth.from_arrays(
        [(0, 0), (2, 0), (0, 1)], [(0, 1, 2)], renumber=False, element="P2"
    )
    computed = triangle.mass("lumped", np.array([3.0])).diagonal()[triangle.stencil[0]]
    np.testing.assert_allclose(computed, 3.0 * np.array([3, 3, 3, 16, 16, 16]) / 57, rtol=1e-13)
    cloth = square("unstructured", 0.3)
    density = np.linspace(0.1, 0.4, len(cloth.triangles))
    lumped, consistent = (cloth.mass(kind, density) for kind in ("lumped", "consistent"))
    assert lumped.sum() == pytest.approx(consistent.sum(), rel=1e-13)
    u, v = np.ones(len(cloth.X)), cloth.X[:, 0]
    assert u @ lumped @ v == pytest.approx(u @ consistent @ v, rel=1e-13)  # exact for linear u v


def frequency_errors(pattern, n, mass, stretch=1.1):
    """Errors of the four lowest ω = π √(T/ρ) √(i² + j²)/L, with T and ρ in the material frame."""
    system = fc.System(square(pattern, 1 / n), FABRIC, [fc.StVK()], ["boundary"], mass)
    tension = 1000.0 / 0.7 * (stretch**2 - 1) / 2
    state = system.state(stretch * system.rest().x)
    across = system.free[system.free % 3 == 2]
    K, M = (A.tocsr()[across][:, across] for A in (system.stiffness(state), system.mass))
    start = np.random.default_rng(0).standard_normal(len(across))
    squares = np.sort(eigsh(K.tocsc(), 4, M.tocsc(), sigma=0, v0=start)[0])
    return np.sqrt(squares / (np.pi**2 * tension / 0.2 * np.array([2, 5, 5, 8]))) - 1


@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "right"))
def test_frequencies_of_a_taut_square(pattern):
    """Order 2 with lumped masses, from below; order 4 with consistent ones, from above."""
    coarse, fine = (frequency_errors(pattern, n, "lumped") for n in (16, 32))
    assert (fine < 0).all()
    assert (fine > -4e-4).all()
    np.testing.assert_allclose(np.log2(coarse / fine), 2, atol=0.15)
    coarse, fine = (frequency_errors(pattern, n, "consistent") for n in (8, 16))
    assert (fine > 0).all()
    assert (fine < 1.7e-4).all()
    np.testing.assert_allclose(np.log2(coarse / fine), 4, atol=0.15)


def test_mass_damping_weight_and_forces_per_mass_are_shared_as_mass_is():
    system = fc.System(square("cross", 0.5), FABRIC, [fc.MassDamping(3.0)], mass="lumped")
    v = np.random.default_rng(0).standard_normal((len(system.cloth.X), 3))
    force = system.force(system.state(system.rest().x, v))
    np.testing.assert_allclose(force, -3.0 * system.nodal_mass[:, None] * v, rtol=1e-13)
    assert abs(system.damping(system.rest()) - 3.0 * system.mass).max() < 1e-15
    assert rate_bounds(system) == pytest.approx((0.0, 3.0), rel=1e-13)
    for load in (fc.UserForce((0, 0, 5.0), per="mass"), fc.Gravity((0, 0, 5.0))):
        pull = fc.System(system.cloth, FABRIC, [load], mass="lumped")
        np.testing.assert_allclose(pull.force(pull.rest())[:, 2], 5.0 * pull.nodal_mass, rtol=1e-13)


@pytest.mark.parametrize(("terms", "pattern"), in_turn(list(TERMS), PATTERNS[::-1]))
def test_steps_are_stable_up_to_the_limit(pattern, terms):
    """A small motion stays small below the limit and explodes above; the bound is close to it."""
    fabric = replace(FABRIC, bending_rigidity=10.0) if terms == "stiff plate" else FABRIC
    system = fc.System(square(pattern, 0.25), fabric, TERMS[terms], ["left"], "lumped")
    for kind in (fc.SymplecticEuler, fc.CentralDifference):
        limit = critical_dt(system, system.rest(), kind())
        bound = element_bound(system, kind())
        assert estimate(system, system.rest(), kind()) == pytest.approx(limit, rel=0.03)
        assert bound <= limit < (2.2 if terms == "stiff plate" else 1.35) * bound
        assert growth(system, kind(), 0.95 * limit, 100) < 20
        assert growth(system, kind(beyond_limit=True), 1.05 * limit, 200) > 1e3
