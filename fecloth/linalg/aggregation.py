"""Aggregates of coupled nodes: coarse unknowns of multigrid, prolongator P and matrix Pᵀ A P.

Source: Vaněk, Mandel and Brezina (1996), Algebraic multigrid by smoothed aggregation for second
and fourth order elliptic problems, sections 4.1 (aggregates) and 3 (prolongator).

An aggregate has six unknowns, the sizes of its rigid motions: "nodes" 2a and 2a + 1 of the
coarse matrix are the first three and the last three motions of aggregate a.
"""

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, kernel
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern

# A motion depends on the motions before it if orthogonalisation leaves less than this share of
# its size. This is far above round-off, which is about 1e-16.
DEPENDENT_SHARE = 1e-10
# Damping of the Jacobi step that smooths a prolongator: 4/3 over the largest eigenvalue of D⁻¹ A
# (Vaněk et al.), which is about 2.3.
JACOBI_DAMPING = 0.6
# Place of each entry of a symmetric 3×3 block among the entries 11, 22, 33, 23, 13, 12.
ENTRIES_OF_BLOCK = [[0, 5, 4], [5, 1, 3], [4, 3, 2]]


@kernel
def aggregate(indptr: Array, indices: Array) -> Array:
    """Return the number of the aggregate of each node of a pattern, (n,) int32.

    `indptr` and `indices` are as in `BlockPattern`. An aggregate is a node with all its
    neighbours. A node that is left over joins the aggregate of a neighbour.
    """
    n = len(indptr) - 1
    count = 0
    of_node = np.full(n, -1, np.int32)
    for i in range(n):  # a node makes an aggregate with its neighbours if none of them has one
        row = indices[indptr[i] : indptr[i + 1]]
        taken = False
        for j in row:
            taken = taken or of_node[j] >= 0
        if not taken:
            for j in row:
                of_node[j] = count
            count += 1
    # A node left over joins a neighbour's aggregate. It is marked by + n, and no other node joins
    # through it: so an aggregate remains small.
    for i in range(n):
        if of_node[i] < 0:
            for j in indices[indptr[i] : indptr[i + 1]]:
                if 0 <= of_node[j] < count:
                    of_node[i] = of_node[j] + n
                    break
    for i in range(n):  # remove the marks
        if of_node[i] >= n:
            of_node[i] -= n
    return of_node


def coarse_pattern(pattern: BlockPattern, of_node: np.ndarray) -> BlockPattern:
    """The pattern of Pᵀ A P, with two "nodes" for each aggregate."""
    n = len(pattern)
    A = sparse.csr_matrix((np.ones_like(pattern.indices), pattern.indices, pattern.indptr))
    T = sparse.csr_matrix((np.ones(n, np.int32), of_node, np.arange(n + 1)))
    P = A @ T
    pairs = sparse.kron(P.T @ (A @ P), np.ones((2, 2)), format="csr")
    pairs.sort_indices()
    return BlockPattern(pairs.indptr, pairs.indices)


def rigid_motions(x: np.ndarray) -> np.ndarray:
    """(6, n, 3) displacements of nodes at x (n, 3): three translations, three rotations.

    The rotations are e × (x − centre) about the axes e through the mean position.
    """
    arm = x - x.mean(axis=0)
    axes = np.eye(3)[:, None]
    translations = np.broadcast_to(axes, (3, *x.shape))
    rotations = np.cross(axes, arm)
    return np.concatenate([translations, rotations])


def is_coupled(A: BlockMatrix) -> np.ndarray:
    """(n, 3) whether a component of a node is coupled to another node; if pinned it is not."""
    is_filled = A.values.any(axis=2)
    blocks: np.ndarray = np.add.reduceat(is_filled, A.pattern.indptr[:-1], dtype=np.int32)
    return blocks > 1  # the block on the diagonal is always filled


def orthonormalise(of_node: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """Make the motions orthonormal on each of the m aggregates: B = Q R; return R (6, 2m, 3).

    `of_node` (n,) is the aggregate of each node. The `motions` (6, n, 3) are B, and are
    overwritten with Q. A motion that depends on the motions before it becomes zero. R has the
    same six motions at the 2m coarse nodes.
    """
    m = of_node.max() + 1
    R = np.zeros((6, m, 6))

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:  # (m,) one for each aggregate
        return np.bincount(of_node, np.einsum("nc,nc->n", a, b), m)

    for k, motion in enumerate(motions):
        before = dot(motion, motion)
        for _ in range(2):  # Gram and Schmidt's method, twice: once leaves round-off
            for j in range(k):
                overlap = dot(motions[j], motion)
                R[k, :, j] += overlap
                motion -= overlap[of_node, None] * motions[j]
        after = dot(motion, motion)
        is_independent = after > DEPENDENT_SHARE**2 * before
        size = np.sqrt(np.where(is_independent, after, 0.0))
        R[k, :, k] = size
        motion *= np.divide(1.0, size, where=size > 0.0, out=np.zeros(m))[of_node, None]
    return R.reshape(6, 2 * m, 3)


def prolongator(
    A: BlockMatrix, inverse: np.ndarray, of_node: np.ndarray, motions: np.ndarray
) -> sparse.bsr_matrix:
    """The smoothed prolongator P (3n, 6m) = (I − ω D⁻¹ A) T, with ω = `JACOBI_DAMPING`.

    `inverse` (n, 6) is D⁻¹, see `pcg.invert_blocks`. `motions` (6, n, 3) are the columns of T
    for each aggregate, and `of_node` (n,) is the aggregate of each node.
    """
    n = len(of_node)
    starts = np.arange(n + 1)
    T = sparse.bsr_matrix((motions.transpose(1, 2, 0), of_node, starts))
    inverse_D = sparse.bsr_matrix((inverse[:, ENTRIES_OF_BLOCK], starts[:-1], starts))
    P = -JACOBI_DAMPING * inverse_D @ (A.shared @ T)
    # T has a block only where a node meets its own aggregate, and P has a block there, too
    is_own_aggregate = P.indices == np.repeat(of_node, np.diff(P.indptr))
    P.data[is_own_aggregate] += T.data
    return P


def coarse_matrix(A: BlockMatrix, P: sparse.bsr_matrix, pattern: BlockPattern) -> BlockMatrix:
    """Pᵀ A P on its pattern, with 1 on the diagonal where P has an empty column."""
    product = P.T @ (A.shared @ P)
    product.sort_indices()
    values = product.tobsr((3, 3)).data
    diagonal = pattern.diagonal[:, None], range(3), range(3)
    values[diagonal] += values[diagonal] == 0.0
    return BlockMatrix(pattern, values, A.team)
