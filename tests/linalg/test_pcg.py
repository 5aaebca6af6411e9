"""Conjugate gradients: numbers of iterations against theory, and rejected input."""

import numpy as np
import pytest
from support.matrices import load, sheet

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.conjugate_gradients import CONVERGED, STANDS_STILL
from fecloth.linalg.mixed_precision import status_of_round


def prepared(A, **options):
    solver = select.PCG(**options)
    solver.prepare(A)
    return solver


@pytest.mark.parametrize("signs", [(-1, 1, 1), (1, 1, -1), (-1, -1, 1), (1, -1, -1), (1, 1, 0)])
def test_prepare_rejects_an_indefinite_diagonal_block(signs):
    A = sheet()
    A.values[A.pattern.diagonal[40]] = np.diag(signs)
    with pytest.raises(IndefiniteMatrix, match="node 40"):
        select.PCG().prepare(A)


def test_solve_failed_states_the_residual():
    A = sheet(mass=1e-4)
    solver = prepared(A, max_iterations=5)
    with pytest.raises(SolveFailed, match=r"max_iterations = 5.*relative residual") as caught:
        solver.solve(load(A), rtol=1e-8)
    assert not isinstance(caught.value, IndefiniteMatrix)
    assert 1e-8 < caught.value.residual < 100
    assert f"{caught.value.residual:.2e}" in str(caught.value)
    assert caught.value.rtol == 1e-8


def test_solve_below_round_off_fails():
    A = sheet(mass=1e-5)
    solver = prepared(A)
    with pytest.raises(SolveFailed, match="round-off") as caught:
        solver.solve(load(A), rtol=1e-17)
    assert 1e-17 < caught.value.residual < 1e-9


def spectrum(values):
    """Pairs of nodes [[I, s Q], [s Qᵀ, I]], Q a rotation: eigenvalues 1 ± s, diagonal blocks I."""
    n = 2 * len(values)
    pairs = np.arange(n, dtype=np.int32).reshape(-1, 2)
    A = BlockMatrix.zeros(BlockPattern.union(n, [pairs]))
    slots = A.pattern.slots(pairs)
    rng = np.random.default_rng(0)
    for slot, s in zip(slots, values, strict=True):
        Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        A.values[slot[0, 0]] = A.values[slot[1, 1]] = np.eye(3)
        A.values[slot[0, 1]], A.values[slot[1, 0]] = s * Q, s * Q.T
    return A


@pytest.mark.parametrize("distinct", [1, 3, 6])
def test_iterations_equal_the_number_of_distinct_eigenvalues(distinct):
    A = spectrum(np.repeat(np.linspace(0.2, 0.9, distinct), 20))  # 1 ± s: 2 · distinct of them
    solver = prepared(A)
    _, info = solver.solve(load(A), rtol=1e-9)
    assert info.iterations == 2 * distinct


def test_iterations_obey_chebyshev_bound_and_come_near_it():
    s = 0.998
    A = spectrum(s * np.cos(np.pi * (np.arange(400) + 0.5) / 800))
    kappa = (1 + s) / (1 - s)
    solver = prepared(A)
    for rtol in (1e-2, 1e-4, 1e-6):
        _, info = solver.solve(load(A), rtol=rtol)
        # The bound holds for the A-norm of the error; the residual adds a factor √κ.
        bound = 0.5 * np.sqrt(kappa) * np.log(2 * np.sqrt(kappa) / rtol)
        assert 0.2 * bound < info.iterations < bound


def test_an_indefinite_matrix_leaves_a_direction_of_descent():
    """The iterate so far lowers ½ xᵀAx − bᵀx, and b points along it."""
    A = sheet(mass=1e-3)
    A.values[A.pattern.diagonal] -= 0.3 * A.values[A.pattern.diagonal]
    b, solver = load(A), prepared(A)
    with pytest.raises(IndefiniteMatrix) as caught:
        solver.solve(b)
    x = caught.value.so_far
    Ax = (A.to_scipy() @ x.ravel()).reshape(x.shape)
    assert 0.5 * (x * Ax).sum() - (b * x).sum() < 0 < (b * x).sum()


def test_a_round_in_float64_must_halve_the_residual():
    rtol = 1e-4
    assert status_of_round(1.0, 0.5, rtol) == CONVERGED
    assert status_of_round(1.0, 0.51, rtol) == STANDS_STILL
    assert status_of_round(1.5e-4, 1e-4, rtol) == CONVERGED  # near enough
