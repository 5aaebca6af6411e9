"""What a linear solver offers, what a solve reports, and the checks that all solvers share."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.team import Call
from fecloth.errors import InputError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.reductions import BLOCK, nodes_of, squared_norm


@dataclass(frozen=True)
class SolveInfo:
    """Cost and accuracy of a solve.

    Attributes
    ----------
    name
        Name of the solver.
    iterations
        Iterations of conjugate gradients, or steps of refinement of a direct solver (mostly 0).
    residual
        ‖b − A x‖ / ‖b‖, computed with A and the returned x.
    seconds_factor
        Duration of the last ``prepare`` [s]: factorisation or preconditioner, and the analysis
        if the pattern was new.
    seconds_solve
        Duration of this ``solve`` [s].
    """

    name: str
    iterations: int
    residual: float
    seconds_factor: float
    seconds_solve: float


class LinearSolver(Protocol):
    """A solver of A x = b for a `BlockMatrix`.

    Attributes
    ----------
    symmetric
        Whether it takes symmetric matrices only.
    prepared
        Number of calls of `prepare` so far: it identifies the prepared matrix.
    keeps_state
        Whether a solve may depend on more than the prepared matrix.
    """

    symmetric: bool
    prepared: int
    keeps_state: bool

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
        """Note that a step begins near x (n, 3), with matrices J = wa M + wv D + wx K.

        It is called before `prepare`.
        """

    def drop(self) -> None:
        """Forget the steps before, so that later steps do not depend on them."""


def check_arguments(
    A: BlockMatrix | None, b: np.ndarray, rtol: float
) -> tuple[BlockMatrix, np.ndarray, float]:
    """Check the arguments of a solve; return A, b (n, 3) as contiguous floats, and ‖b‖².

    Raises `InputError` for wrong ones, and `SolveFailed` if b is not finite.
    """
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


class BlockRows(NamedTuple):
    """The arrays of a matrix of 3×3 blocks, for kernels: see `BlockPattern`.

    Attributes
    ----------
    indptr
        (n + 1,) row i has the blocks indptr[i] … indptr[i + 1] − 1.
    indices
        (b,) column of each block.
    values
        (b, 3, 3) the blocks.
    """

    indptr: np.ndarray
    indices: np.ndarray
    values: np.ndarray


def block_rows(A: BlockMatrix) -> BlockRows:
    """The arrays of a matrix."""
    return BlockRows(A.pattern.indptr, A.pattern.indices, A.values)


def relative_residual(
    A: BlockMatrix, b: np.ndarray, bb: float, x: np.ndarray, r: np.ndarray
) -> float:
    """‖r‖ / ‖b‖ with bb = ‖b‖² > 0; writes r = b − A x to `r`."""
    n = len(b)
    sums = np.empty(-(-n // BLOCK))

    def call(part: slice) -> Call:
        return residual, (block_rows(A), b, x, r, sums, part.start, part.stop)

    A.team.each(n, call, unit=BLOCK)
    return float(np.sqrt(sums.sum() / bb))


def remainder(A: BlockMatrix, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """b − A x, (n, 3)."""
    r = np.empty_like(b)
    relative_residual(A, b, 1.0, x, r)
    return r


@kernel
def residual(A: BlockRows, b: Array, x: Array, r: Array, sums: Array, begin: int, end: int) -> None:
    """r = b − A x in rows begin … end − 1; writes ‖r‖² of each block of rows to `sums`."""
    for block in range(begin // BLOCK, -(-end // BLOCK)):
        first, last = nodes_of(block, end)
        sums[block] = subtract_product(first, last, A, b, x, r)


@inner
def subtract_product(begin: int, end: int, A: BlockRows, b: Array, x: Array, r: Array) -> float:
    """r = b − A x in rows begin … end − 1; returns ‖r‖² of these rows.

    b, x and r are (n, 3); r may be the array of b.
    """
    indptr = A.indptr
    indices = A.indices
    values = A.values
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
