"""Uncertainty of refined values: known sequences, bad ones, and coverage over many."""

import numpy as np
import pytest

from fecloth.study.uncertainty import estimate_uncertainty, observed_order

H4 = np.array([0.8, 0.4, 0.2, 0.1])


@pytest.mark.parametrize("sizes", [H4, H4[1:], 0.1 * np.array([1, 1.3, 1.9, 2.2, 3.1])])
@pytest.mark.parametrize(("order", "theory"), [(1, 1), (2, 2), (1.4, 2), (4, 4), (3, 3)])
def test_a_pure_power_is_found_and_the_uncertainty_is_its_error_times_a_quarter_more(
    sizes, order, theory
):
    values = 7.0 - 0.3 * sizes**order
    result = estimate_uncertainty(sizes, values, theory)
    error = 0.3 * min(sizes) ** order
    assert result.order == pytest.approx(order, abs=1e-3)
    assert result.limit == pytest.approx(7.0, abs=1e-3 * error)
    assert result.uncertainty == pytest.approx(1.25 * error, rel=2e-3)
    assert (result.value, result.behaviour) == (7.0 - error, "monotone")


def test_two_terms_are_covered_before_the_asymptotic_range():
    for second in (0.5, 3.0, 10.0):
        for sizes in (H4[1:], H4):
            result = estimate_uncertainty(sizes, 1 + sizes**2 + second * sizes**4, theory=2)
            assert result.uncertainty > 0.1**2 + second * 0.1**4


@pytest.mark.parametrize(
    ("values", "behaviour", "spread"),
    [
        ([1.0, 1.2, 0.9], "oscillating", 0.3),
        ([1.0, 1.1, 1.3], "diverging", 0.3),
        ([1.0, 2.0, 3.0], "diverging", 2.0),  # of order 0 exactly
        ([2.0, 1.1, 1.2, 1.15], "oscillating", 0.1),  # of the three finest
        ([1.0, 1.1, 1.3, 1.7], "diverging", 0.6),
        ([2.0, 2.0, 2.0], "constant", 0.0),
        ([0.0, 0.0, 0.0, 0.0], "constant", 0.0),
    ],
)
def test_values_that_do_not_converge_are_uncertain_by_three_times_their_range(
    values, behaviour, spread
):
    result = estimate_uncertainty(H4[-len(values) :], values, theory=2)
    assert result.behaviour == behaviour
    assert result.value == result.limit == values[-1]
    assert result.uncertainty == pytest.approx(3 * spread, rel=1e-12)


@pytest.mark.parametrize("levels", [3, 4])
@pytest.mark.parametrize(("order", "is_order"), [(4.4, True), (4.6, False), (11.99, False)])
def test_an_order_far_above_the_theory_is_none_and_the_uncertainty_does_not_use_it(
    order, is_order, levels
):
    sizes = H4[-levels:]
    result = estimate_uncertainty(sizes, 1 + sizes**order, theory=2)
    assert (result.behaviour == "monotone") == is_order
    if is_order:
        assert result.order == pytest.approx(order, abs=1e-3)
    else:
        assert np.isnan(result.order)
        assert result.limit == result.value
        assert result.uncertainty >= 3 * np.ptp(1 + sizes[-3:] ** order)


def test_levels_of_two_states_have_no_order():
    """A disc that drapes in 5, 4 and 4 folds: once 0.52274 ± 0.00067, 0.5825 is another state."""
    result = estimate_uncertainty([10.0, 7.3, 5.1], [0.566, 0.52297, 0.52274], theory=2)
    assert np.isnan(result.order)
    assert result.behaviour == "without order"
    assert result.uncertainty > 0.5825 - result.value


def scattered(sizes, amount, order=2):
    """5 + hᵖ and a scatter of this size that no fit of an order near p hides; its last part."""
    power = sizes**order
    seen = np.column_stack([np.ones(len(sizes)), power, power * np.log(sizes)])
    scatter = amount * np.linalg.svd(seen.T)[2][3]  # orthogonal to what a fit can change
    return 5 + power + scatter, abs(scatter[-1])


def test_the_uncertainty_has_the_scatter_of_the_fit_by_hand():
    """U = 1.25 |φ_fit(h₁) − φ₀| + σ + |φ₁ − φ_fit(h₁)|; one degree of freedom is left for σ."""
    values, last = scattered(H4, 2e-4)
    result = estimate_uncertainty(H4, values, theory=2)
    assert result.order == pytest.approx(2, abs=1e-4)
    assert result.limit == pytest.approx(5, abs=1e-6)
    assert result.scatter == pytest.approx(2e-4, rel=1e-4)
    assert result.scatter < result.data_range
    assert result.uncertainty == pytest.approx(1.25 * 0.1**2 + 2e-4 + last, rel=1e-4)


def test_a_scatter_of_coarse_levels_counts_less_by_hand():
    """Weights 1/h with the mean 1; σ is that of the fit with them, which is the smaller one."""
    sizes = np.array([0.4, 0.3, 0.2, 0.1])
    power, root = sizes**2, np.sqrt(4 / sizes / np.sum(1 / sizes))
    seen = np.column_stack([np.ones(4), power, power * np.log(sizes)])
    scatter = 2e-4 * np.linalg.svd((seen * root[:, None]).T)[2][3] / root
    result = estimate_uncertainty(sizes, 5 + power + scatter, theory=2)
    assert result.scatter == pytest.approx(2e-4, rel=1e-4)
    by_hand = 1.25 * 0.1**2 + 2e-4 + abs(scatter[-1])
    assert result.uncertainty == pytest.approx(by_hand, rel=1e-4)


def test_an_order_below_a_half_is_fitted_with_both_powers_by_hand():
    """Of h − 0.6 h² the observed order is too low; the fit of h and h² is exact, with F = 3."""
    result = estimate_uncertainty(H4, 5 + H4 - 0.6 * H4**2, theory=2)
    assert result.order < 0.5
    assert result.limit == pytest.approx(5)
    assert result.uncertainty == pytest.approx(3 * (0.1 - 0.6 * 0.1**2))


def test_a_last_change_above_one_of_the_changes_before_is_scatter():
    """It diverges where the last change is above all others."""
    for last, behaviour in ((0.1, "monotone"), (0.25, "diverging")):
        values = 1 + np.cumsum([0.0, 0.2, 0.05, last])
        assert estimate_uncertainty(H4, values, theory=2).behaviour == behaviour


def test_the_uncertainty_of_a_fit_that_shows_scatter_only_by_hand():
    """U = 3 σ/Δ (|φ_fit(h₁) − φ₀| + σ + |φ₁ − φ_fit(h₁)|); five degrees of freedom."""
    sizes = np.linspace(1.0, 0.3, 8)
    values, last = scattered(sizes, 0.6)
    result = estimate_uncertainty(sizes, values, theory=2)
    assert (result.order, result.behaviour) == (pytest.approx(2, abs=1e-4), "monotone")
    deviation, spread = 0.6 / np.sqrt(5), np.ptp(values) / 7
    assert deviation > spread
    by_hand = 3 * deviation / spread * (0.3**2 + deviation + last)
    assert result.uncertainty == pytest.approx(by_hand, rel=1e-4)


def test_the_uncertainty_of_an_order_above_the_theory_has_the_scatter_too():
    """U = 3 |φ₁ − φ₂|/(2² − 1) + σ + |φ₁ − φ_fit(h₁)| of the two finest levels."""
    values, last = scattered(H4, 1e-5, order=3)
    result = estimate_uncertainty(H4, values, theory=2)
    assert result.order == pytest.approx(3, abs=1e-3)
    index = abs(values[-1] - values[-2])
    assert result.uncertainty == pytest.approx(index + 1e-5 + last, rel=1e-4)


@pytest.mark.parametrize(
    ("order", "trusted"), [(0.4, False), (0.625, True), (2 + 0.08, True), (2 + 0.125, False)]
)
def test_orders_from_a_half_to_a_tenth_above_the_theory_are_trusted(order, trusted):
    """U is 1.25 times the error, or 3 times the error of the theoretical order."""
    result = estimate_uncertainty(H4[1:], 7 + H4[1:] ** order, theory=2)
    last = 0.1**order if trusted else (0.2**order - 0.1**order) / 3
    assert result.uncertainty == pytest.approx((1.25 if trusted else 3.0) * last, rel=1e-6)


def test_scattered_values_are_covered_in_19_of_20(rng):
    """Meshes that are not nested: the error is h² times a random factor from 0.8 to 1.2."""
    sizes = np.array([1, 0.71, 0.5, 0.36])
    covered, ratio = [], []
    for _ in range(200):
        error = sizes**2 * rng.uniform(0.8, 1.2, 4)
        result = estimate_uncertainty(sizes, 5 + error, theory=2)
        covered.append(result.uncertainty >= error[-1])
        ratio.append(result.uncertainty / error[-1])
    assert np.mean(covered) >= 0.95
    assert np.median(ratio) < 5


def test_orders_of_three_levels():
    h = np.array([1.0, 1.5, 3.0])
    assert observed_order(h, h**-0.5) == pytest.approx(-0.5)
    assert observed_order(h, h**2.5) == pytest.approx(2.5)
    assert np.isnan(observed_order(h, np.array([0.0, 1.0, 0.5])))
