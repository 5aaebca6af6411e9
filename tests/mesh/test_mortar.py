"""Mortar weights, held against their defining integrals."""

import numpy as np
import pytest
from scipy.integrate import quad

from fecloth.mesh.mortar import _multipliers, mortar_weights

PLACES = np.array([0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.8, 0.93, 1.0])
LEADING = np.array([0.0, 0.3, 0.62, 1.0])


def nodes(corners: np.ndarray, degree: int) -> np.ndarray:
    """Places of all nodes of an edge."""
    if degree == 1:
        return corners
    return np.insert(corners, np.arange(1, len(corners)), (corners[1:] + corners[:-1]) / 2)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", [(PLACES, LEADING), (LEADING, PLACES)], ids=["finer", "coarser"])
def test_polynomials_of_the_degree_are_followed_exactly(degree, pair):
    places, leading = pair
    W = mortar_weights(places, leading, degree)
    for power in range(degree + 1):
        values = W @ nodes(leading, degree) ** power
        np.testing.assert_allclose(values, nodes(places, degree) ** power, atol=1e-14)


def test_weights_of_thirds_that_follow_halves():
    """By hand: ψ₁ = 1 on the first third and 2 − 3 ξ on the second one; ∫ ψ₁ φ₁ = 1/3."""
    W = mortar_weights(np.linspace(0, 1, 4), np.linspace(0, 1, 3), 1).toarray()

    def psi(s):
        return 1.0 if s < 1 / 3 else 2 - 3 * (3 * s - 1)

    def of_leader(s):  # the hat of the middle of the edge that leads
        return 1 - abs(2 * s - 1)

    integral, _ = quad(lambda s: psi(s) * of_leader(s), 0, 2 / 3, points=[1 / 3, 1 / 2])
    # 3 ∫ ψ₁ Φ₁, as ∫ ψ₁ φ₁ = 1/3 and Φ₁ is 0 at the ends
    assert W[1, 1] == pytest.approx(3 * integral, abs=1e-14)
    np.testing.assert_allclose(W[1], [7 / 24, 3 / 4, -1 / 24], atol=1e-14)
    np.testing.assert_allclose(W[::-1, ::-1], W, atol=1e-14)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_force_of_a_constant_stress_is_passed_on_exactly(degree):
    """Σ over the nodes that follow of W_ij ∫ φ_i = ∫ Φ_j: work of a constant traction."""
    W = mortar_weights(PLACES, LEADING, degree)

    def integrals(corners):
        sizes = np.diff(corners)[:, None]
        local = sizes * (np.array([[1, 1]]) / 2 if degree == 1 else np.array([[1, 4, 1]]) / 6)
        total = np.zeros(degree * len(sizes) + 1)
        for e, row in enumerate(local):
            total[degree * e : degree * e + degree + 1] += row
        return total

    np.testing.assert_allclose(W.T @ integrals(PLACES), integrals(LEADING), atol=1e-15)


def test_weights_are_local():
    """Ten times as many nodes have as many leaders each."""
    W = mortar_weights(np.linspace(0, 1, 301), np.linspace(0, 1, 201), 2)
    assert np.diff(W.indptr).max() <= 6


@pytest.mark.parametrize("degree", [1, 2])
def test_the_multipliers_contain_the_polynomials_of_the_degree_below(degree):
    """So the error of a traction that they stand for has the order of the elements."""
    s = np.linspace(0.01, 0.99, 40)
    psi = _multipliers(PLACES, s, degree)
    for power in range(degree):
        np.testing.assert_allclose(psi @ nodes(PLACES, degree) ** power, s**power, atol=1e-14)
