"""The asymmetry of a stiffness matrix, and its symmetric part."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.eigenpairs import symmetrise


@pytest.fixture
def system():
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    return fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()])


def random_matrix(system, rng):
    K = BlockMatrix.zeros(system.pattern)
    K.values[:] = rng.standard_normal(K.values.shape)
    return K


@pytest.mark.parametrize("part", [1e-3, 0.5, 2.0])
def test_the_asymmetry_is_the_antisymmetric_part_over_the_symmetric_one(system, rng, part):
    """Of K = S + ε A it is ε ‖A‖ / ‖S‖."""
    random = random_matrix(system, rng)
    values = random.values.copy()
    symmetrise(system, random)
    symmetric = random.values
    K = BlockMatrix(system.pattern, symmetric + part * (values - symmetric))
    S = random.to_scipy().toarray()
    A = (K.to_scipy().toarray() - S) / part
    assert np.array_equal(S, S.T)
    np.testing.assert_allclose(A, -A.T, atol=1e-12)
    expected = part * np.linalg.norm(A) / np.linalg.norm(S)
    assert symmetrise(system, K) == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(K.to_scipy().toarray(), S, atol=1e-12)


def test_a_matrix_of_zeros_is_symmetric(system):
    assert symmetrise(system, BlockMatrix.zeros(system.pattern)) == 0.0
