"""Pattern, slots and products of the 3×3-block matrix against dense arrays and SciPy."""

import numpy as np
import pytest
import scipy.sparse as sparse
from support.drawn import drawn

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern, add_mass


def nodes_and_stencils(st):
    """Number of nodes, and up to three stencils of up to 6 rows with 1 to 4 nodes per row."""

    def stencils(n, width):
        row = st.lists(st.integers(0, n - 1), min_size=width, max_size=width)
        rows = st.lists(row, max_size=6)
        return rows.map(lambda rows: np.array(rows, np.int32).reshape(-1, width))

    def of(n):
        stencil = st.integers(1, 4).flatmap(lambda width: stencils(n, width))
        return st.tuples(st.just(n), st.lists(stencil, max_size=3))

    return st.integers(1, 9).flatmap(of)


def coupled(n, stencils):
    """(n, n) bool, by definition: the pairs of nodes of each row, and each node with itself."""
    table = np.eye(n, dtype=bool)
    for row in (row for stencil in stencils for row in stencil):
        table[np.ix_(row, row)] = True
    return table


def filled(pattern, rng):
    """A matrix of random blocks."""
    return BlockMatrix(pattern, rng.standard_normal((len(pattern.indices), 3, 3)))


def dense(A):
    """Dense matrix (3n, 3n), block by block."""
    n = len(A.pattern)
    full = np.zeros((n, 3, n, 3))
    for i in range(n):
        for s in range(A.pattern.indptr[i], A.pattern.indptr[i + 1]):
            full[i, :, A.pattern.indices[s], :] = A.values[s]
    return full.reshape(3 * n, 3 * n)


@drawn(lambda st: [nodes_and_stencils(st)], max_examples=50)
def test_union_couples_exactly_the_nodes_of_each_row(given_):
    n, stencils = given_
    pattern = BlockPattern.union(n, stencils)
    table = np.zeros((n, n), int)
    np.add.at(table, (pattern.rows, pattern.indices), 1)
    assert np.array_equal(table, coupled(n, stencils).astype(int))  # each pair once
    assert len(pattern) == n
    for i in range(n):
        row = pattern.indices[pattern.indptr[i] : pattern.indptr[i + 1]]
        assert (np.diff(row) > 0).all()


@drawn(lambda st: [nodes_and_stencils(st)], max_examples=50)
def test_slots_are_the_blocks_of_the_pairs(given_):
    n, stencils = given_
    pattern = BlockPattern.union(n, stencils)
    for stencil in stencils:
        slots = pattern.slots(stencil)
        m, k = stencil.shape
        assert slots.shape == (m, k, k)
        assert np.array_equal(pattern.rows[slots], np.repeat(stencil[:, :, None], k, axis=2))
        assert np.array_equal(pattern.indices[slots], np.repeat(stencil[:, None], k, axis=1))
    assert np.array_equal(pattern.indices[pattern.diagonal], np.arange(n))
    assert np.array_equal(pattern.rows[pattern.diagonal], np.arange(n))


@drawn(lambda st: [nodes_and_stencils(st), st.integers(0, 2**32 - 1)], max_examples=50)
def test_product_and_scipy_are_the_dense_matrix(given_, seed):
    n, stencils = given_
    rng = np.random.default_rng(seed)
    A, x = filled(BlockPattern.union(n, stencils), rng), rng.standard_normal((n, 3))
    full = dense(A)
    converted = A.to_scipy()
    assert isinstance(converted, sparse.bsr_matrix)
    assert converted.blocksize == (3, 3)
    assert np.array_equal(converted.toarray(), full)
    np.testing.assert_allclose((A @ x).ravel(), full @ x.ravel(), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose((A @ x).ravel(), converted @ x.ravel(), rtol=1e-13, atol=1e-13)


def test_add_mass_adds_the_mass_times_the_identity(sheet, rng):
    mass = sheet.mass("consistent")
    A = filled(BlockPattern.union(len(sheet.X), [sheet.stencil]), rng)
    before = A.to_scipy()
    rows = np.repeat(np.arange(len(sheet.X)), np.diff(mass.indptr))
    pairs = np.column_stack([rows, mass.indices]).astype(np.int32)
    slots = np.ascontiguousarray(A.pattern.slots(pairs)[:, 0, 1])
    add_mass(slots, mass.data, 2.5, A.values)
    added = (A.to_scipy() - before).toarray()
    np.testing.assert_allclose(added, np.kron(2.5 * mass.toarray(), np.eye(3)), atol=1e-14)


def test_slots_of_an_uncoupled_pair_are_rejected():
    pattern = BlockPattern.union(4, [np.array([[0, 1]], np.int32)])
    with pytest.raises(InputError, match=r"nodes \[0, 3\]: are not all coupled"):
        pattern.slots(np.array([[0, 1], [0, 3]], np.int32))
