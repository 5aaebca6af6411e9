"""What a linear solver offers, what a solve reports, and the checks that all solvers share."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.team import Call
from fecloth.errors import InputError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.reductions import BLOCK, nodes_of, squared_norm


@dataclass(frozen=True)
class SolveInfo:
    """Cost and accuracy of a solve."""

    name: str
    # iterations of conjugate gradients, or steps of refinement of a direct solver (mostly 0)
    iterations: int
    residual: float  # ‖b − A x‖ / ‖b‖, computed with A and the returned x
    # duration of the last ``prepare`` [s]: factorisation or preconditioner, and the analysis if
    # the pattern was new
    seconds_factor: float
    seconds_solve: float  # duration of this ``solve`` [s]


class LinearSolver(Protocol):
    """A solver of A x = b for a `BlockMatrix`."""

    symmetric: bool  # whether it takes symmetric matrices only
    prepared: int  # number of calls of `prepare` so far: it identifies the prepared matrix
    keeps_state: bool  # whether a solve may depend on more than the prepared matrix

    @property
    def name(self) -> str:
        """For reports, and the key of its prices in `nonlinear.context`."""

    def prepare(self, A: BlockMatrix) -> None:
        """Analyse the pattern if it is new, and factorise A or build the preconditioner.

        A must not change until the last `solve` with it. Raises `IndefiniteMatrix` if the solver
        needs a positive definite matrix, `SolveFailed` for a singular one.
        """

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """x (n, 3) with ‖b − A x‖ ≤ rtol ‖b‖, computed with A, and its `SolveInfo`.

        `guess` (n, 3) is a start, which a direct solver ignores. Raises `SolveFailed`, or
        `IndefiniteMatrix`, if no such x was found.
        """

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note that a step begins near x (n, 3) with J = wa M + wv D + wx K, before `prepare`."""

    def drop(self) -> None:
        """Forget the steps before, so that later steps do not depend on them."""


def check_arguments(
    A: BlockMatrix | None, b: np.ndarray, rtol: float
) -> tuple[BlockMatrix, np.ndarray, float]:
    """Validate the arguments of a solve: A, b as a contiguous array of floats (n, 3), and ‖b‖²."""
    if A is None:
        raise InputError("no matrix", "call prepare(A) without error before solve", "solve")
    if not 0 < rtol < 1:
        raise InputError(f"rtol = {rtol!r}", "must be between 0 and 1", "solve")
    b = np.ascontiguousarray(b, dtype=float)
    if b.shape != (len(A.pattern), 3):
        raise InputError(f"b of shape {b.shape}", f"must be ({len(A.pattern)}, 3)", "solve")
    bb = squared_norm(b)
    if not np.isfinite(bb):
        node = int(np.argmax(np.abs(b).sum(axis=1)))
        raise SolveFailed(f"b is not finite: ‖b‖² = {bb}, largest at node {node}")
    return A, b, bb


def block_rows(A: BlockMatrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arrays indptr, indices and values of a matrix."""
    return A.pattern.indptr, A.pattern.indices, A.values


def relative_residual(
    A: BlockMatrix, b: np.ndarray, bb: float, x: np.ndarray, r: np.ndarray
) -> float:
    """‖r‖ / ‖b‖ with bb = ‖b‖² > 0; writes r = b − A x to `r`."""
    n = len(b)
    sums = np.empty(-(-n // BLOCK))

    def call(part: slice) -> Call:
        return residual, (*block_rows(A), b, x, r, sums, part.start, part.stop)

    A.team.each(n, call, unit=BLOCK)
    return float(np.sqrt(sums.sum() / bb))


@kernel
def residual(
    indptr: Array, indices: Array, values: Array, b: Array, x: Array, r: Array, sums: Array,
    begin: int, end: int,
) -> None:  # fmt: skip
    """r = b − A x in rows begin … end − 1; writes ‖r‖² of each block of them to `sums`."""
    for block in range(begin // BLOCK, -(-end // BLOCK)):
        first, last = nodes_of(block, end)
        sums[block] = subtract_product(first, last, indptr, indices, values, b, x, r)


@inner
def subtract_product(
    begin: int, end: int, indptr: Array, indices: Array, values: Array, b: Array, x: Array, r: Array
) -> float:
    """r = b − A x in rows begin … end − 1; returns ‖r‖² of these."""
    rr = 0.0
    for i in range(begin, end):
        r1, r2, r3 = b[i, 0], b[i, 1], b[i, 2]
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2]
            r1 -= values[s, 0, 0] * x1 + values[s, 0, 1] * x2 + values[s, 0, 2] * x3
            r2 -= values[s, 1, 0] * x1 + values[s, 1, 1] * x2 + values[s, 1, 2] * x3
            r3 -= values[s, 2, 0] * x1 + values[s, 2, 1] * x2 + values[s, 2, 2] * x3
        r[i, 0] = r1
        r[i, 1] = r2
        r[i, 2] = r3
        rr += r1 * r1 + r2 * r2 + r3 * r3
    return rr
