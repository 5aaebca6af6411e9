"""Direct solvers for a `BlockMatrix`: PARDISO of the Intel MKL, and SuperLU."""

from __future__ import annotations

import ctypes
import os
import time
import weakref
from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from . import pcg
from .blocks import BlockMatrix, BlockPattern
from .compiled import kernel
from .errors import IndefiniteMatrix, SolveFailed
from .pcg import SolveInfo

EPS = np.finfo(float).eps
CBWR_AUTO = 2  # MKL_CBWR_AUTO of mkl_service.h: the best instructions, always the same ones


class Pardiso:
    """PARDISO of the Intel MKL, through the library that pypardiso finds.

    Parameters
    ----------
    symmetric
        Cholesky (PARDISO's matrix type 2) on the upper triangle; else LU (type 11).
    """

    name = "pardiso"

    def __init__(self, symmetric: bool = True):
        _mkl_pardiso()  # fail here, not in a time step
        self.symmetric = symmetric
        self.prepared = 0
        self._A = self._pattern = self._release = None

    def prepare(self, A: BlockMatrix) -> None:
        """Factorise A; the analysis is kept while the pattern is the same object."""
        begin, self._A = time.perf_counter(), None
        self.prepared += 1
        if self._pattern is not A.pattern:
            self._analyse(A.pattern)
        self._rows.refill(A)
        self._call(22, self._nothing, self._nothing)
        self._A, self._seconds = A, time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """x (n, 3) and its `SolveInfo` for b (n, 3); `guess` is not used."""
        return _refined(self, b, rtol)

    def _analyse(self, pattern: BlockPattern) -> None:
        self._pattern = None
        if self._release is not None:
            self._release()
        self._rows = _ScalarRows(pattern, self.symmetric)
        self._mtype = 2 if self.symmetric else 11
        self._handle = np.zeros(64, np.int64)
        self._iparm = _pardiso_parameters()
        self._nothing = np.zeros(0)
        # The arrays, not self: a finalizer that knew self would keep it alive.
        kept = self._mtype, self._handle, self._rows.arrays, self._iparm
        self._release = weakref.finalize(self, _pardiso, -1, *kept, self._nothing, self._nothing)
        self._call(11, self._nothing, self._nothing)
        self._pattern = pattern

    def _apply(self, b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        self._call(33, b, x)
        return x

    def _call(self, phase, b, x) -> None:
        rows = self._rows.arrays
        error = _pardiso(phase, self._mtype, self._handle, rows, self._iparm, b, x)
        if error == -4 and self.symmetric:
            raise IndefiniteMatrix("pardiso met a pivot <= 0: A is not positive definite")
        if error:
            reason = PARDISO_ERRORS.get(error, "see the documentation of the MKL")
            raise SolveFailed(f"pardiso returned error {error} in phase {phase}: {reason}")


PARDISO_ERRORS = {
    -2: "not enough memory for the factor",
    -3: "the reordering failed",
    -4: "zero pivot, A is singular",
    -8: "the factor has more entries than 32-bit integers can count",
}


def _pardiso_parameters() -> np.ndarray:
    """The 64 switches, numbered from 1 in the MKL's documentation."""
    iparm = np.zeros(65, np.int32)
    iparm[1] = 1  # these values, not the defaults
    iparm[2] = 2  # nested dissection (METIS): 0.75 of the factor time of minimum degree
    iparm[8] = 0  # no refinement of its own; the default takes two steps and thrice the time
    iparm[10] = 13  # a pivot below 1e-13 of the largest entry is replaced (general matrices)
    # No scaling or matching (11, 13): both would make the analysis depend on the values of the
    # first matrix, and a run continued from a restart file differ from the uninterrupted one.
    iparm[35] = 1  # rows and columns count from 0
    return iparm[1:].copy()


def _pardiso(phase, mtype, handle, rows, iparm, b, x) -> int:
    """One call of MKL's ``pardiso``; returns its error code."""

    def number(value):
        return ctypes.byref(ctypes.c_int32(value))

    def array(a, kind=ctypes.c_int32):
        return a.ctypes.data_as(ctypes.POINTER(kind))

    data, columns, starts = rows
    error = ctypes.c_int32(0)
    real = ctypes.c_double
    _mkl_pardiso()(
        *(array(handle, ctypes.c_int64), number(1), number(1), number(mtype), number(phase)),
        *(number(len(starts) - 1), array(data, real), array(starts), array(columns)),
        *(None, number(1), array(iparm), number(0), array(b, real), array(x, real)),
        ctypes.byref(error),
    )
    return error.value


@cache
def _mkl_pardiso() -> Callable:
    """The C routine; loads the MKL (0.4 s) on the first call.

    Raises
    ------
    ImportError, OSError
        Where pypardiso or the MKL is missing.
    """
    import pypardiso

    # Taken from its module-wide solver: every further PyPardisoSolver() searches the disk anew.
    _make_reproducible(pypardiso.ps.libmkl)
    return pypardiso.ps._mkl_pardiso


def _make_reproducible(library) -> None:
    """The MKL's mode in which equal calls on equally many threads give equal bits.

    Otherwise sums depend on where arrays happen to lie, and the number of threads on how busy the
    machine is (oneMKL Developer Guide, Obtaining Numerically Reproducible Results). Refused, the
    MKL stays as the user, by MKL_CBWR, or another package has set it.
    """
    if "MKL_CBWR" not in os.environ:
        library.MKL_CBWR_Set(ctypes.c_int(CBWR_AUTO))
    library.MKL_Set_Dynamic(ctypes.c_int(0))


def threads() -> int | None:
    """Threads that PARDISO takes; None where the MKL is not loaded."""
    if not _mkl_pardiso.cache_info().currsize:
        return None
    import pypardiso

    return pypardiso.ps.libmkl.MKL_Get_Max_Threads()


class SuperLU:
    """SciPy's SuperLU, where there is no PARDISO; it repeats the analysis in each ``prepare``.

    Parameters
    ----------
    symmetric
        Pivots on the diagonal in an order of minimum degree; else partial pivoting. To see the
        signs of the pivots the factor is copied: twice the memory, a third more time.
    """

    name = "superlu"

    def __init__(self, symmetric: bool = True):
        self.symmetric = symmetric
        self.prepared = 0
        self._A = self._rows = None

    def prepare(self, A: BlockMatrix) -> None:
        """Factorise A."""
        begin, self._A = time.perf_counter(), None
        self.prepared += 1
        if self._rows is None or self._rows.pattern is not A.pattern:
            self._rows = _ScalarRows(A.pattern, upper=False)
        self._rows.refill(A)
        n = 3 * len(A.pattern)
        # The rows of A read as columns: Aᵀ.
        transposed = sparse.csc_matrix(self._rows.arrays, shape=(n, n))
        self._lu = self._factor(transposed)
        self._A, self._seconds = A, time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """x (n, 3) and its `SolveInfo` for b (n, 3); `guess` is not used."""
        return _refined(self, b, rtol)

    def _factor(self, transposed):
        failure = IndefiniteMatrix if self.symmetric else SolveFailed
        try:
            if not self.symmetric:
                return splu(transposed, permc_spec="COLAMD")
            lu = splu(
                transposed,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise failure(f"superlu could not factorise A: {error}") from error
        # Rows are interchanged only where a diagonal pivot is zero. Without that A = L D Lᵀ, and
        # D, the diagonal of U, has the signs of the eigenvalues.
        if (lu.perm_r != lu.perm_c).any() or not (lu.U.diagonal() > 0).all():
            raise failure("superlu met a pivot <= 0: A is not positive definite")
        return lu

    def _apply(self, b: np.ndarray) -> np.ndarray:
        return self._lu.solve(b.ravel(), trans="T").reshape(b.shape)


def _refined(
    solver: Pardiso | SuperLU, b: np.ndarray, rtol: float, steps: int = 2
) -> tuple[np.ndarray, SolveInfo]:
    """Solve with a factor and refine, x += A⁻¹ (b − A x), until the residual is good.

    Nothing reduces the residual below the round-off of its own evaluation (Oettli and Prager
    1964), so that is accepted in place of `rtol`, but nothing beyond 1e-6.
    """
    begin = time.perf_counter()
    b, bb = pcg.checked(solver._A, b, rtol)
    x, r, step, reached = np.zeros_like(b), b.copy(), 0, float(bb > 0.0)
    while not reached <= rtol and step <= steps:
        x += solver._apply(r)
        reached = pcg.relative_residual(solver._A, b, bb, x, r)
        step += 1
    if not reached <= rtol:
        roundoff = 32 * EPS * np.sqrt(_rounding(*pcg.block_rows(solver._A), b, x) / bb)
        if not reached <= min(roundoff, 1e-6):
            raise SolveFailed(f"{solver.name}: A is singular, or close to it", reached, rtol)
    refinements, seconds = max(step - 1, 0), time.perf_counter() - begin
    return x, SolveInfo(solver.name, refinements, reached, solver._seconds, seconds)


@kernel
def _rounding(indptr, indices, values, b, x):
    """‖ |b| + |A| |x| ‖²: times eps², the square of what round-off alone leaves of b − A x."""
    total = 0.0
    for i in range(len(b)):
        for c in range(3):
            row = abs(b[i, c])
            for s in range(indptr[i], indptr[i + 1]):
                for d in range(3):
                    row += abs(values[s, c, d] * x[indices[s], d])
            total += row * row
    return total


class _ScalarRows:
    """A block pattern as compressed rows of numbers, all of them or those of the upper triangle.

    Row 3 i + c takes its numbers from the blocks `first[i]` … of row i, in their order; of the
    diagonal block, then the first, an upper triangle has only the entries from c on.
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
        """Copy the values of A."""
        if not _expand_values(A.pattern.indptr, self.first, A.values, self.upper, self.arrays[0]):
            node = A.pattern.rows[~np.isfinite(A.values).all(axis=(1, 2))][0]
            raise SolveFailed(f"A is not finite, first in the row of node {node}")


@kernel
def _expand_pattern(indptr, indices, first, upper, columns, starts):
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
def _expand_values(indptr, first, values, upper, data):
    """True if all values are finite: 0 times their sum is 0."""
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
