"""The product of a matrix of 3×3 blocks and a vector, four numbers at once."""

import numpy as np

from fecloth.compiled.jit import Array, inner
from fecloth.compiled.lanes import load, multiply_add, repeat, rotate, sum_of
from fecloth.linalg.protocol import BlockRows


@inner
def multiply(begin: int, end: int, A: BlockRows, p: Array, q: Array) -> None:
    """q (n, 3) = A p of rows begin … end − 1; the fourth numbers of p (n, 4) are 0.

    A row of a block is multiplied at once, with the number that follows it in memory for a
    fourth one. Two blocks have sums of their own, so that no addition waits for the one before.
    """
    indices = A.indices
    values = A.values
    zero = repeat(values.dtype.type(0))
    for node in range(begin, end):
        i = np.uintp(node)  # not negative: the compiler need not look
        a1 = a2 = a3 = b1 = b2 = b3 = zero
        s = np.uintp(A.indptr[i])
        stop = np.uintp(A.indptr[i + 1])
        while s + np.uintp(2) < stop:
            t = s + np.uintp(1)
            y = load(p, (np.uintp(indices[s]),))
            z = load(p, (np.uintp(indices[t]),))
            a1 = multiply_add(load(values, (s, 0)), y, a1)
            a2 = multiply_add(load(values, (s, 1)), y, a2)
            a3 = multiply_add(load(values, (s, 2)), y, a3)
            b1 = multiply_add(load(values, (t, 0)), z, b1)
            b2 = multiply_add(load(values, (t, 1)), z, b2)
            b3 = multiply_add(load(values, (t, 2)), z, b3)
            s = t + np.uintp(1)
        while s < stop:  # nothing follows the last row of the last block: a number before it
            y = load(p, (np.uintp(indices[s]),))
            a1 = multiply_add(load(values, (s, 0)), y, a1)
            a2 = multiply_add(load(values, (s, 1)), y, a2)
            b3 = multiply_add(load(values, (s, 1, 2)), rotate(y), b3)
            s += np.uintp(1)
        q[i, 0] = sum_of(a1, b1)
        q[i, 1] = sum_of(a2, b2)
        q[i, 2] = sum_of(a3, b3)
