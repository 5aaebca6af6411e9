import numpy as np
import pytest

import fecloth as fc
from fecloth.linalg.reductions import dot, mean, rms, size, squared_norm, weighted_dot


@pytest.fixture
def arrays():
    rng = np.random.default_rng(3)
    return rng.uniform(0.5, 2.0, 50), *rng.standard_normal((2, 50, 3))


def test_sums_agree_with_numpy(arrays):
    w, a, b = arrays
    assert dot(a, b) == pytest.approx((a * b).sum(), rel=1e-13)
    assert weighted_dot(w, a, b) == pytest.approx((w[:, None] * a * b).sum(), rel=1e-13)
    assert squared_norm(a) == pytest.approx((a**2).sum(), rel=1e-13)
    assert size(a) == pytest.approx(np.sqrt((a**2).sum()), rel=1e-13)
    assert mean(w, a) == pytest.approx(np.average(a, axis=0, weights=w), rel=1e-13)
    assert rms(w, a) == pytest.approx(np.sqrt(np.average((a**2).sum(axis=1), weights=w)), rel=1e-13)


def test_sums_of_numbers_not_finite_are_not_finite(arrays):
    _, a, b = arrays
    a[7, 2] = np.nan
    assert np.isnan([dot(a, b), squared_norm(a), size(a)]).all()
    assert dot(np.zeros((0, 3)), np.zeros((0, 3))) == size(np.zeros((0, 3))) == 0


def test_the_sums_of_a_system_are_these(arrays):
    w, a, b = arrays
    sums = fc.System.sums
    assert (sums.dot(a, b), sums.norm(a), sums.rms(w, a)) == (dot(a, b), size(a), rms(w, a))
    np.testing.assert_array_equal(sums.mean(w, a), mean(w, a))
