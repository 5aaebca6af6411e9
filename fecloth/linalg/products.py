"""The product of a matrix of 3×3 blocks and a vector, four numbers at once."""

import numpy as np

from fecloth.compiled.jit import Array, inner
from fecloth.compiled.lanes import load, multiply_add, reordered, repeat, sum_of
from fecloth.linalg.protocol import BlockRows

rotate = reordered(3, 0, 1, 2)


@inner
def multiply(begin: int, end: int, A: BlockRows, p: Array, q: Array) -> float:
    """q (n, 3) = A p of rows begin … end − 1; returns their part of pᵀq.

    The fourth numbers of p (n, 4) are 0.

    A row of a block is multiplied at once, with the number that follows it in memory for a
    fourth one. Two blocks have sums of their own, so that no addition waits for the one before.
    """
    indices = A.indices
    values = A.values.reshape(A.values.size)  # faster than three indices, see `lane_blocks`
    zero = repeat(values.dtype.type(0))
    pq = 0.0
    for node in range(begin, end):
        i = np.uintp(node)  # not negative: the compiler need not look
        a1 = a2 = a3 = b1 = b2 = b3 = zero
        s = np.uintp(A.indptr[i])
        stop = np.uintp(A.indptr[i + np.uintp(1)])
        k = np.uintp(9) * s
        while s + np.uintp(2) < stop:
            y = load(p, (np.uintp(indices[s]),))
            z = load(p, (np.uintp(indices[s + np.uintp(1)]),))
            a1 = multiply_add(load(values, (k,)), y, a1)
            a2 = multiply_add(load(values, (k + np.uintp(3),)), y, a2)
            a3 = multiply_add(load(values, (k + np.uintp(6),)), y, a3)
            b1 = multiply_add(load(values, (k + np.uintp(9),)), z, b1)
            b2 = multiply_add(load(values, (k + np.uintp(12),)), z, b2)
            b3 = multiply_add(load(values, (k + np.uintp(15),)), z, b3)
            s += np.uintp(2)
            k += np.uintp(18)
        while s < stop:  # nothing follows the last row of the last block: a number before it
            y = load(p, (np.uintp(indices[s]),))
            a1 = multiply_add(load(values, (k,)), y, a1)
            a2 = multiply_add(load(values, (k + np.uintp(3),)), y, a2)
            b3 = multiply_add(load(values, (k + np.uintp(5),)), rotate(y), b3)
            s += np.uintp(1)
            k += np.uintp(9)
        q1, q2, q3 = sum_of(a1, b1), sum_of(a2, b2), sum_of(a3, b3)
        q[i, 0] = q1
        q[i, 1] = q2
        q[i, 2] = q3
        pq += p[i, 0] * q1 + p[i, 1] * q2 + p[i, 2] * q3
    return pq
