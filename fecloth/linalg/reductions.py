"""Sums over the nodes, computed on the calling thread.

BLAS is not used because it starts its own threads even for such short sums. On a busy machine
these threads wait for each other, and a run of 8,000 triangles took ten times as long.
"""

import math

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel, rounded_kernel

# Nodes in a block: sums over all nodes are sums of the sums of blocks, so that their bits do not
# depend on the number of threads. Another number gives other bits, to round-off.
BLOCK = 256


def size(a: np.ndarray) -> float:
    """‖a‖ of (n, 3)."""
    return math.sqrt(squared_norm(a))


def longest(vectors: np.ndarray) -> float:
    """The length of the longest of vectors (n, 3)."""
    return math.sqrt(float(np.einsum("ni,ni->n", vectors, vectors).max()))


def mean(weights: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Σ w_i y_i / Σ w_i, (3,), of (n, 3)."""
    average: np.ndarray = weighted_sum(weights, y, np.zeros(3)) / weights.sum()
    return average


@rounded_kernel
def weighted_sum(weights: Array, y: Array, total: Array) -> Array:
    """`total` (3,) + Σ w_i y_i of (n,) and (n, 3)."""
    for i in range(len(y)):
        for k in range(3):
            total[k] += weights[i] * y[i, k]
    return total


def rms(weights: np.ndarray, y: np.ndarray) -> float:
    """√(Σ w_i ‖y_i‖² / Σ w_i) of (n, 3)."""
    return math.sqrt(weighted_dot(weights, y, y) / weights.sum())


@kernel
def dot(a: Array, b: Array) -> float:
    """Σ a_i · b_i of (n, 3)."""
    total = 0.0
    for i in range(len(a)):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total


def squared_norm(a: np.ndarray) -> float:
    """‖a‖² of (n, 3)."""
    return dot(a, a)


@kernel
def weighted_dot(w: Array, a: Array, b: Array) -> float:
    """Σ w_i a_i · b_i of (n,) and (n, 3)."""
    total = 0.0
    for i in range(len(a)):
        total += w[i] * (a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2])
    return total


@inner
def nodes_of(block: int, n: int) -> tuple[int, int]:
    """The first node of a block of n nodes, and the end: one more than its last node."""
    begin = block * BLOCK
    return begin, min(begin + BLOCK, n)


@inner
def total(sums: Array) -> float:
    """The sum of the blocks' sums, in order."""
    result = 0.0
    for block in range(len(sums)):
        result += sums[block]
    return result


class NodeSums:
    """The sums over a whole cloth; arrays a, b, y are (n, 3) and weights (n,).

    This class is for one process that holds the whole cloth. Where each of several processes
    holds a part of it, an object with the same functions takes its place, which adds up the sums
    of all processes.
    """

    def total(self, part: float) -> float:
        """The sum over the cloth of a number that a process has summed over its part."""
        return part

    dot = staticmethod(dot)
    norm = staticmethod(size)
    rms = staticmethod(rms)
    mean = staticmethod(mean)
