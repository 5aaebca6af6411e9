"""Conjugate gradients in float32 and float64: products, decisions, portions and threads."""

from dataclasses import replace

import numpy as np
import pytest
from support.matrices import load, relative, sheet

from fecloth.compiled.team import Team
from fecloth.compiled.threads import ONLY
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.conjugate_gradients import CONVERGED, INDEFINITE
from fecloth.linalg.mixed_precision import BEGIN, Work, solve_by_cg
from fecloth.linalg.pcg import PCG, invert_blocks
from fecloth.linalg.products import multiply
from fecloth.linalg.protocol import BlockRows, block_rows

SINGLE_RTOL = 1e-3  # the smallest tolerance for which float32 is used
IN_SINGLE, IN_DOUBLE = 1e-2, 0.99 * SINGLE_RTOL


def solved(A, b, rtol, limits=(10_000,), guess=None):
    """The progress and x of a solve in portions up to these iterations."""
    inverse = np.empty((len(b), 6))
    assert invert_blocks(A.pattern.diagonal, A.values, inverse) < 0
    work = Work.allocate(len(b), len(A.values))
    x = np.zeros_like(b) if guess is None else guess.copy()
    progress = BEGIN
    for limit in limits:
        args = block_rows(A), inverse, b, x, work, rtol, limit, progress, ONLY
        progress = solve_by_cg(*args)
    return progress, x


def is_from_single(x, b):
    """Whether x / ‖b‖, the result of iterations from x = 0, has numbers of float32."""
    numbers = x / np.sqrt(np.sum(b * b))
    return np.allclose(numbers, numbers.astype(np.float32), rtol=1e-14, atol=0)


def pair(gap, direction=(1.0, 1.0)):
    """A of two nodes with the eigenvalues 2 − gap, and `gap` for equal displacements; and b."""
    pattern = BlockPattern.union(2, [np.array([[0, 1]], np.int32)])
    A = BlockMatrix.zeros(pattern)
    A.values[:] = np.eye(3)
    A.values[A.pattern.rows != A.pattern.indices] *= gap - 1
    return A, np.outer(direction, [1.0, 2.0, -1.0])


@pytest.mark.parametrize("precision", [np.float64, np.float32])
def test_a_product_is_the_one_of_dense_matrices(precision):
    """Rows of 1 to 6 blocks; what follows the last block in memory is not a number."""
    rng = np.random.default_rng(3)
    indptr = np.cumsum([0, 1, 2, 3, 4, 5, 6], dtype=np.int32)
    indices = np.concatenate([rng.permutation(6)[:k] for k in range(1, 7)]).astype(np.int32)
    memory = np.full(9 * len(indices) + 1, np.nan, precision)
    values = memory[:-1].reshape(-1, 3, 3)
    values[:] = rng.normal(size=values.shape)
    p = np.zeros((6, 4), precision)
    p[:, :3] = rng.normal(size=(6, 3))
    q = np.full((6, 3), 7.0, precision)
    multiply(1, 6, BlockRows(indptr, indices, values), p, q)
    dense = np.zeros((6, 3, 6, 3))
    for i in range(6):
        for s in range(indptr[i], indptr[i + 1]):
            dense[i, :, indices[s]] = values[s]
    expected = np.einsum("icjd,jd->ic", dense, p[:, :3].astype(float))
    np.testing.assert_allclose(q[1:], expected[1:], atol=50 * np.finfo(precision).eps)
    assert (q[0] == 7.0).all()  # rows before `begin` are not written


def test_a_rough_solve_is_in_float32_and_its_residual_in_float64():
    A = sheet(mass=0.02)
    b = 1e-30 * load(A)  # ‖b‖² is 0 in float32
    progress, x = solved(A, b, SINGLE_RTOL)
    assert progress.status == CONVERGED
    assert progress.reached == pytest.approx(relative(A, x, b), rel=1e-9)
    assert progress.reached <= SINGLE_RTOL
    double, y = solved(A, b, IN_DOUBLE)
    assert abs(double.iterations - progress.iterations) <= 1
    exact = np.linalg.solve(A.to_scipy().toarray(), b.ravel()).reshape(b.shape)
    assert np.abs(x - exact).max() < 1e-2 * np.abs(exact).max()
    assert np.abs(y - exact).max() < 1e-2 * np.abs(exact).max()
    assert is_from_single(x, b)
    assert not is_from_single(y, b)


def test_float64_goes_on_where_float32_is_not_accurate_enough():
    """x is 1e5 times as long as b, so that A x has the round-off of large terms."""
    A = sheet(mass=1e-5)
    b = A @ np.ones((len(A.pattern), 3))
    progress, x = solved(A, b, SINGLE_RTOL)
    assert progress.status == CONVERGED
    assert relative(A, x, b) <= SINGLE_RTOL
    assert not is_from_single(x, b)


@pytest.mark.parametrize("rtol", [IN_SINGLE, IN_DOUBLE])
def test_a_first_guess_is_improved(rtol):
    A = sheet(mass=0.02)
    b = load(A)
    _, near = solved(A, b, 0.03)
    cold, _ = solved(A, b, rtol)
    warm, x = solved(A, b, rtol, guess=near)
    assert 0 < warm.iterations < cold.iterations
    assert relative(A, x, b) <= rtol
    done, y = solved(A, b, rtol, guess=x)
    assert done.iterations == 0
    np.testing.assert_array_equal(x, y)
    solver = PCG()
    solver.prepare(A)
    assert not solver.solve(0 * b, rtol, guess=near)[0].any()


@pytest.mark.parametrize("rtol", [IN_SINGLE, IN_DOUBLE])
def test_portions_do_not_change_a_bit(rtol):
    A = sheet(mass=1e-3)
    b = load(A)
    whole, x = solved(A, b, rtol)
    assert whole.iterations > 12
    portions, y = solved(A, b, rtol, limits=(1, 5, 12, 10_000))
    assert portions.iterations == whole.iterations
    np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("gap", [1e-8, -1e-8, -0.5])
def test_float64_decides_whether_a_matrix_is_indefinite(gap):
    A, b = pair(gap, direction=(2.0, 1.0))
    statuses = [solved(A, b, rtol)[0].status for rtol in (IN_SINGLE, IN_DOUBLE)]
    expected = CONVERGED if gap > 0 else INDEFINITE
    assert statuses == [expected, expected]


@pytest.mark.parametrize("rtol", [IN_SINGLE, 1e-8])
def test_threads_do_not_change_a_bit(rtol):
    A = sheet(m=40, mass=1e-3)
    b = load(A)
    results = []
    for threads in (1, 2, 3):
        solver = PCG()
        solver.prepare(replace(A, team=Team(threads)))
        results.append(solver.solve(b, rtol))
    for x, info in results[1:]:
        np.testing.assert_array_equal(x, results[0][0])
        assert info.iterations == results[0][1].iterations
