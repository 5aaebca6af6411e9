"""What points tell of the unknowns: closed forms of linear regression, thresholds, repeats."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from fecloth.study.fitting.evaluation import Column, Evaluation
from fecloth.study.fitting.measured import Measured
from fecloth.study.fitting.mistakes import far_in_repeats
from fecloth.study.fitting.statistics import LARGEST_UNCERTAINTY, WRONG_LAW, _groups, statistics
from fecloth.study.fitting.words import mean_and_next

# of a threshold
BOTH_SIDES = pytest.mark.parametrize(("factor", "is_below"), [(0.8, True), (1.25, False)])


def column_of(J, r, scatter=None):
    """Residuals r of a curve, in units of their uncertainty, with ∂r/∂u = J."""
    points = Measured("f", "f", "N", 0 * r, 1 + 0 * r, np.arange(len(r)), scatter)
    specimen = SimpleNamespace(experiment=SimpleNamespace(fitted=True))
    return Column(specimen, points, r, J)


def facts_of(J, r, scatter=None):
    """Statistics of one curve."""
    J, r = np.array(J, dtype=float), np.array(r, dtype=float)
    return statistics(Evaluation(np.zeros(J.shape[1]), {}, (column_of(J, r, scatter),)))


X = np.linspace(1.0, 10.0, 10)


def test_covariance_of_a_straight_line():
    """y = a x + b: the inverse of [[Σx², Σx], [Σx, n]], by least squares."""
    facts = facts_of(np.stack([X, np.ones(10)], axis=1), 0.1 * (-1.0) ** np.arange(10))
    expected = np.linalg.inv([[X @ X, X.sum()], [X.sum(), 10.0]])
    assert facts.covariance == pytest.approx(expected, rel=1e-9)
    assert facts.misfit == pytest.approx(10 * 0.01 / 8)
    assert facts.quantile == pytest.approx(scipy.stats.t.ppf(0.975, 8))


def test_residuals_larger_than_sigma_widen_the_covariance():
    r = 2.0 * (-1.0) ** np.arange(10)
    facts = facts_of(X[:, None], r)
    assert facts.misfit == pytest.approx(40 / 9)
    assert facts.covariance[0, 0] == pytest.approx(40 / 9 / (X @ X), rel=1e-9)


@BOTH_SIDES
def test_threshold_of_what_is_told(factor, is_below):
    """A column of length s has the uncertainty 1/s."""
    J = np.zeros((10, 2))
    J[:5, 0], J[5:, 1] = 10.0, 1 / (factor * LARGEST_UNCERTAINTY) / np.sqrt(5)
    facts = facts_of(J, np.zeros(10))
    assert facts.told.tolist() == [True, is_below]
    assert facts.together == (() if is_below else ((1,),))


def test_only_the_sum_of_two_unknowns_is_told():
    J = np.stack([X, X, X**2, 0 * X], axis=1)
    facts = facts_of(J, np.zeros(10))
    assert facts.told.tolist() == [False, False, True, False]
    assert facts.together == ((0, 1), (3,))


def test_an_unknown_with_a_small_part_in_what_is_not_told_is_named_with_the_other():
    """As 1/G − 2 ν/Y₁ of a soft shear: G/Y₁ is small, yet neither is told by itself."""
    J = np.stack([X, 0.03 * X, X**2], axis=1)
    assert facts_of(J, np.zeros(10)).together == ((0, 1),)


@pytest.mark.parametrize(("cosine", "groups"), [(0.04, ((0,), (1,))), (0.0625, ((0, 1),))])
def test_threshold_of_what_is_told_together(cosine, groups):
    """All but one direction w is not told: P = 1 − w wᵀ, with two equal components of w."""
    square = cosine / (1 + cosine)
    told = np.array([square**0.5, square**0.5, (1 - 2 * square) ** 0.5])
    _, _, directions = np.linalg.svd(told[None])
    assert _groups(directions[1:], np.array([True, True, False])) == groups


@pytest.mark.parametrize(("size", "freedom"), [(0.8e-2, 9), (1.25e-2, 8)])
def test_a_combination_that_is_hardly_known_takes_no_degree_of_freedom(size, freedom):
    J = np.zeros((10, 2))
    J[:5, 0] = 10.0
    J[5:, 1] = size / np.sqrt(5)
    assert facts_of(J, np.ones(10)).misfit == pytest.approx(10 / freedom)


def test_fewer_points_than_unknowns():
    facts = facts_of([[10.0, 10.0]], [0.0])
    assert facts.together == ((0, 1),)
    assert np.isnan(facts.misfit)
    assert not facts.law_fails


@BOTH_SIDES
def test_threshold_of_the_law(factor, is_below):
    """Residuals whose probability by χ² is 0.8 and 1.25 times the level."""
    chi = scipy.stats.chi2.isf(factor * WRONG_LAW, 9)
    r = np.sqrt(chi / 10) * np.ones(10)
    facts = facts_of(X[:, None], r)
    assert facts.probability == pytest.approx(factor * WRONG_LAW, rel=1e-6)
    assert facts.law_fails == is_below


def test_covariance_from_repeats_is_the_scatter_of_their_fits():
    """Each repeat is a line of its own: var(a) = Σ(a_r − ā)²/(R (R − 1))."""
    slopes = np.array([-0.3, 0.1, 0.2])
    facts = facts_of(X[:, None], np.zeros(10), scatter=np.outer(slopes, X))
    assert facts.covariance[0, 0] == pytest.approx(slopes @ slopes / (3 * 2), rel=1e-9)
    assert facts.quantile == pytest.approx(scipy.stats.t.ppf(0.975, 2))


@BOTH_SIDES
def test_repeats_that_scatter_much_do_not_tell(factor, is_below):
    """The slopes of two repeats: ± d, so that the mean has the uncertainty d."""
    slopes = factor * LARGEST_UNCERTAINTY * np.array([-1.0, 1.0])
    facts = facts_of(X[:, None], np.zeros(10), scatter=np.outer(slopes, X))
    assert facts.told.tolist() == [is_below]


@BOTH_SIDES
def test_threshold_of_the_law_by_repeats(factor, is_below):
    """Repeats that differ in one way only: F with 1 and R − 1 degrees of freedom."""
    scatter = np.outer([-0.3, 0.1, 0.2], X)
    mean = scipy.stats.f.isf(factor * WRONG_LAW, 1, 2)
    facts = facts_of(X[:, None], np.sqrt(mean * 9 / 10) * np.ones(10), scatter=scatter)
    assert facts.probability == pytest.approx(factor * WRONG_LAW, rel=1e-6)
    assert facts.law_fails == is_below


def test_residuals_that_follow_each_other_count_as_fewer_points():
    """A mean of n points: Σ ρ^|i−j|/n², with the correlation ρ of residuals next to each other."""
    r = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    rho = 3 / 10  # of 9 products 6 are positive
    facts = facts_of(np.ones((10, 1)), r)
    places = np.arange(10)
    expected = (rho ** np.abs(np.subtract.outer(places, places))).sum() / 100
    assert facts.covariance[0, 0] == pytest.approx(expected * 10 / 9, rel=1e-9)


def test_the_worst_curve_tells_that_the_law_is_wrong():
    """χ² of 9 of 10 points alone, times two curves: pooled with a good curve it would be hidden."""
    size = np.sqrt(scipy.stats.chi2.isf(0.4 * WRONG_LAW, 9.5) / 10)
    columns = [column_of(X[:, None], f * np.ones(10)) for f in (size, 0.0)]
    facts = statistics(Evaluation(np.zeros(1), {}, tuple(columns)))
    assert facts.probability == pytest.approx(0.8 * WRONG_LAW, rel=1e-6)
    assert facts.law_fails


def coverage(scatter_of):
    """How often the interval of the slope of a line, fitted to noisy points, has the true one."""
    random, count, covered = np.random.default_rng(3), 400, 0
    for _ in range(count):
        curves = scatter_of(random)  # (R, 10) errors of repeats, or of a single curve
        mean, R = curves.mean(axis=0), len(curves)
        sigma = 1.0
        if R > 1:
            sigma = np.sqrt(((curves - mean) ** 2).sum() / (10 * (R - 1)) / R)
        error = (X @ mean) / (X @ X)
        r, J = (error * X - mean) / sigma, X[:, None] / sigma
        scatter = None if R == 1 else (curves - mean) / sigma
        facts = facts_of(J, r, scatter=scatter)
        covered += abs(error) <= facts.quantile * np.sqrt(facts.covariance[0, 0])
    return covered / count


def test_intervals_of_independent_errors_cover():
    assert 0.94 <= coverage(lambda random: random.standard_normal((1, 10))) <= 0.99


def test_intervals_of_repeats_cover_errors_that_a_repeat_shares():
    """A repeat that is stiffer is stiffer everywhere: its points are not independent."""

    def shared(random):
        return 0.3 * np.outer(random.standard_normal(4), X) + 0.1 * random.standard_normal((4, 10))

    assert 0.94 <= coverage(shared) <= 0.99


def test_single_points_of_repeats_are_named_and_other_shapes_are_not():
    s = np.linspace(0.0, 1.0, 36)
    rng = np.random.default_rng(0)
    curves = np.outer([0.95, 1.0, 1.05], s) + 0.3 * np.outer([1.0, 0.0, -1.0], s**3)
    curves += 2e-3 * rng.normal(size=curves.shape)
    assert far_in_repeats(curves - curves.mean(axis=0)) == []
    curves[1, 20] *= 1.25
    curves[2, 9] *= 1.01
    assert far_in_repeats(curves - curves.mean(axis=0)) == [(1, 20)]


def test_the_next_of_three_slacks():
    mean, u = mean_and_next([1e-3, 2e-3, 3e-3])
    assert (mean, u) == pytest.approx((2e-3, 4.3026527 / 2 * 1e-3 * np.sqrt(4 / 3)))
    assert np.isnan(mean_and_next([1e-3])[1])
