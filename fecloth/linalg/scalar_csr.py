"""A matrix of 3×3 blocks as compressed rows of numbers, the format of direct solvers."""

from __future__ import annotations

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.errors import SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern


class ScalarRows:
    """A block matrix as compressed rows of numbers: the full matrix or its upper triangle.

    Row 3 i + c has row c of the blocks `first[i]` … of block row i, in their order. For the upper
    triangle the first block is the diagonal block, of which only the entries from column c on are
    used.
    """

    def __init__(self, pattern: BlockPattern, upper: bool):
        self.pattern, self.upper = pattern, upper
        self.first = pattern.diagonal if upper else pattern.indptr[:-1]
        n, blocks = len(pattern), int((pattern.indptr[1:] - self.first).sum())
        count = 9 * blocks - 3 * n * upper
        columns, starts = np.empty(count, np.int32), np.empty(3 * n + 1, np.int32)
        _expand_pattern(pattern.indptr, pattern.indices, self.first, upper, columns, starts)
        self.arrays = np.empty(count), columns, starts

    def refill(self, A: BlockMatrix) -> None:
        """Copy the values of A; raise `SolveFailed` if one is not finite."""
        if not _expand_values(A.pattern.indptr, self.first, A.values, self.upper, self.arrays[0]):
            node = A.pattern.rows[~np.isfinite(A.values).all(axis=(1, 2))][0]
            raise SolveFailed(f"A is not finite, first in the row of node {node}")


@kernel
def _expand_pattern(
    indptr: Array, indices: Array, first: Array, upper: bool, columns: Array, starts: Array
) -> None:
    k = 0
    for i in range(len(first)):
        for c in range(3):
            starts[3 * i + c] = k
            for d in range(c if upper else 0, 3):
                columns[k] = 3 * indices[first[i]] + d
                k += 1
            for s in range(first[i] + 1, indptr[i + 1]):
                for d in range(3):
                    columns[k + d] = 3 * indices[s] + d
                k += 3
    starts[3 * len(first)] = k


@kernel
def _expand_values(indptr: Array, first: Array, values: Array, upper: bool, data: Array) -> bool:
    """Fill `data`; return True if all values are finite, that is if 0 times their sum is 0."""
    k, zero = 0, 0.0
    for i in range(len(first)):
        for c in range(3):
            for d in range(c if upper else 0, 3):
                data[k] = values[first[i], c, d]
                zero += 0.0 * data[k]
                k += 1
            for s in range(first[i] + 1, indptr[i + 1]):
                v1, v2, v3 = values[s, c, 0], values[s, c, 1], values[s, c, 2]
                data[k], data[k + 1], data[k + 2] = v1, v2, v3
                zero += 0.0 * (v1 + v2 + v3)
                k += 3
    return zero == 0.0
