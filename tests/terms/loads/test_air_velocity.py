"""The velocity of the air: gusts, and the gradient of a field."""

import numpy as np
import pytest

from fecloth.terms.loads import air_velocity

FIRST = (5.60084809682312, 1.3329103208778412, -0.9822617048592297)  # m/s, of seed 3 at the origin


def test_gusts_equal_seeds_give_equal_gusts(rng):
    x = rng.standard_normal((5, 3))
    one, same, other = (air_velocity.Gusts((5.0, 0.0, 0.0), 0.2, 1.0, seed) for seed in (3, 3, 4))
    assert np.array_equal(one.velocity(x, 0.7), same.velocity(x, 0.7))
    assert abs(one.velocity(x, 0.7) - other.velocity(x, 0.7)).min(axis=1).max() > 0.1
    # the same on every machine and NumPy
    np.testing.assert_allclose(one.velocity(np.zeros((1, 3)), 0.0)[0], FIRST, rtol=1e-12)


@pytest.mark.stories
def test_gusts_have_the_given_intensity_and_length():
    """Averaged over seeds: mean U, variance σ², covariance along their axis σ² e^(−r²/(2 ℓ²))."""
    U, length = np.array([5.0, 0.0, 0.0]), 0.5
    x = np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]])
    u = np.array(
        [
            air_velocity.Gusts(tuple(U), 0.2, length, seed).velocity(x, 1.0) - U
            for seed in range(4000)
        ]
    )
    assert abs(u.mean(axis=0)).max() < 0.08
    np.testing.assert_allclose((u**2).mean(axis=(0, 1)), 1.0, rtol=0.06)
    _, a, _ = air_velocity.Gusts(tuple(U), 0.2, length)._waves()
    assert 0.5 * np.sum(a**2) == pytest.approx(3.0, rel=1e-12)
    # a wave's share of the longitudinal covariance is E[(1 − k₁²/k²) cos k₁ r]/(2/3)
    K = np.random.default_rng(0).standard_normal((400_000, 3))
    weight = 1.5 * (1 - K[:, 0] ** 2 / np.sum(K**2, axis=1))
    expected = np.mean(weight * np.cos(K[:, 0]))
    assert np.mean(u[:, 0, 0] * u[:, 1, 0]) == pytest.approx(expected, abs=0.06)


def test_gusts_have_no_divergence_and_move_with_the_mean(rng):
    gusts = air_velocity.Gusts((5.0, 1.0, -2.0), 0.3, 0.4, seed=1)
    x = rng.standard_normal((7, 3))
    gradient = gusts.gradient(x, 0.3)
    assert abs(np.einsum("mii->m", gradient)).max() < 1e-12 * abs(gradient).max()
    difference = air_velocity.Field(gusts.velocity).gradient(x, 0.3)
    np.testing.assert_allclose(gradient, difference, atol=1e-8 * abs(gradient).max())
    later = gusts.velocity(x + 2.0 * np.array(gusts.mean), 2.0)
    np.testing.assert_allclose(later, gusts.velocity(x, 0.0), rtol=1e-9)


def test_the_step_of_the_gradient_keeps_its_error_small(rng):
    """A step 10 times as long leaves out too much of the field, a shorter one loses digits."""
    x = rng.uniform(-3.0, 3.0, (500, 3))
    field = air_velocity.Field(lambda y, t: 10.0 * np.sin(y))
    exact = 10.0 * np.cos(x)
    error = np.einsum("mii->mi", field.gradient(x, 0.0)) - exact
    assert np.abs(error).max() < 6e-11 * 10.0
