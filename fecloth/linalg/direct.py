"""Direct solvers for a `BlockMatrix`: PARDISO of the Intel MKL, rslab, and SciPy's SuperLU."""

import time
import weakref

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import SuperLU as SuperLUFactor
from scipy.sparse.linalg import splu

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg import mkl_pardiso
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.mkl_pardiso import Phase
from fecloth.linalg.protocol import SolveInfo, check_arguments, relative_residual

EPS = np.finfo(float).eps
# Refinements of a solution: if two do not reduce the residual, it is at round-off, or A is
# nearly singular.
MOST_REFINEMENTS = 2


class Direct:
    """Base of direct solvers, which solve with a factor of the matrix that was prepared last.

    A subclass supplies `name`; ``_analyse(pattern)``, which sets ``_rows``; ``_factorise(A)``,
    which returns the number of entries of the factor; and ``_apply(b)``, which returns A⁻¹ b.
    """

    name: str
    keeps_state = False
    _rows: "ScalarRows"

    def __init__(self, symmetric: bool = True):
        self.symmetric = symmetric
        self.prepared = 0
        self.entries = 0
        self._A: BlockMatrix | None = None
        self._pattern: BlockPattern | None = None
        self._seconds = 0.0

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Nothing to do: every step is solved alike."""

    def drop(self) -> None:
        """Nothing to do: a solve depends on the prepared matrix only."""

    def prepare(self, A: BlockMatrix) -> None:
        """Factorise A; the analysis is reused as long as the pattern is the same.

        Raises `IndefiniteMatrix` for a symmetric solver if A is not positive definite, and
        `SolveFailed` if A is not finite or has no factor. After an error there is no matrix.
        """
        begin = time.perf_counter()
        self._A = None
        self.prepared += 1
        if not A.pattern.same_as(self._pattern):
            self._pattern = None  # until the analysis has succeeded
            self._analyse(A.pattern)
            self._pattern = A.pattern
        self._rows.refill(A)
        self.entries = self._factorise(A)
        self._A = A
        self._seconds = time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3); return x (n, 3) and its `SolveInfo`. `guess` is not used.

        x is refined, x += A⁻¹ (b − A x), until the residual is at most `rtol`. No method
        reduces the residual below the round-off of its own evaluation (Oettli and Prager
        1964). Therefore a residual of this size, up to 1e-6, is accepted in place of `rtol`.
        Raises `SolveFailed` if A is singular or nearly singular, or b is not finite, and
        `InputError` for wrong arguments.
        """
        begin = time.perf_counter()
        A, b, bb = check_arguments(self._A, b, rtol)
        x = np.zeros_like(b)
        r = b.copy()
        solves = 0
        reached = float(bb > 0.0)  # ‖r‖ / ‖b‖ with x = 0
        while not reached <= rtol and solves <= MOST_REFINEMENTS:  # also if it is not a number
            x += self._apply(r)
            reached = relative_residual(A, b, bb, x, r)
            solves += 1
        if not reached <= rtol:
            # the round-off of b − A x is a multiple of EPS times |b| + |A| |x|
            terms = abs(b.ravel()) + abs(A.to_scipy()) @ abs(x.ravel())
            roundoff = 32 * EPS * np.linalg.norm(terms) / np.sqrt(bb)
            if not reached <= min(roundoff, 1e-6):
                reason = f"{self.name}: A is singular or nearly singular"
                raise SolveFailed(reason, reached, rtol)
        refinements = max(solves - 1, 0)
        seconds = time.perf_counter() - begin
        return x, SolveInfo(self.name, refinements, reached, self._seconds, seconds)

    def _analyse(self, pattern: BlockPattern) -> None:
        """Find the rows of a pattern, and do what its factors have in common."""
        raise NotImplementedError

    def _factorise(self, A: BlockMatrix) -> int:
        """Make the factor of A, whose numbers are in the rows; return its number of entries."""
        raise NotImplementedError

    def _apply(self, b: np.ndarray) -> np.ndarray:
        """A⁻¹ b (n, 3) by the factor."""
        raise NotImplementedError


class Pardiso(Direct):
    """PARDISO of the Intel MKL, through the library that pypardiso finds.

    If `symmetric`, the upper triangle has a Cholesky factor (PARDISO's matrix type 2), otherwise
    the matrix an LU factor (type 11).
    """

    name = "pardiso"

    def __init__(self, symmetric: bool = True):
        mkl_pardiso.routine()  # a missing library raises an error here and not in a time step
        super().__init__(symmetric)
        self._release: weakref.finalize[..., Pardiso] | None = None

    def _factorise(self, A: BlockMatrix) -> int:
        self._call(Phase.FACTORISE, self._nothing, self._nothing)
        return mkl_pardiso.entries(self._iparm)

    def _analyse(self, pattern: BlockPattern) -> None:
        """Release the old factor, and analyse a new pattern.

        The memory of PARDISO is released when this solver is deleted, or analyses again.
        """
        if self._release is not None:
            self._release()
        self._rows = ScalarRows(pattern, upper=self.symmetric)
        self._mtype = 2 if self.symmetric else 11
        self._handle = np.zeros(64, np.int64)
        self._iparm = mkl_pardiso.parameters()
        self._nothing = np.zeros(0)
        # The finalizer refers to the arrays and not to self, which it would keep alive.
        self._release = weakref.finalize(
            self,
            mkl_pardiso.pardiso,
            phase=Phase.RELEASE,
            mtype=self._mtype,
            handle=self._handle,
            rows=self._rows.arrays,
            iparm=self._iparm,
            b=self._nothing,
            x=self._nothing,
        )
        self._call(Phase.ANALYSE, self._nothing, self._nothing)

    def _apply(self, b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        self._call(Phase.SOLVE, b, x)
        return x

    def _call(self, phase: Phase, b: np.ndarray, x: np.ndarray) -> None:
        """Call PARDISO; raise `IndefiniteMatrix` or `SolveFailed` if it returns an error."""
        rows = self._rows.arrays
        error = mkl_pardiso.pardiso(phase, self._mtype, self._handle, rows, self._iparm, b, x)
        if error == -4 and self.symmetric:
            raise IndefiniteMatrix("pardiso found a pivot <= 0: A is not positive definite")
        if error:
            reason = mkl_pardiso.ERRORS.get(error, "see the documentation of the MKL")
            raise SolveFailed(f"pardiso returned error {error} in phase {phase:d}: {reason}")


class Rslab(Direct):
    """The supernodal factor of rslab: L D Lᵀ (Bunch and Kaufman 1977), otherwise L U.

    The threads of the matrix share the work; their number changes no bit.
    """

    name = "rslab"

    def __init__(self, symmetric: bool = True):
        import rslab  # a missing package raises an error here and not in a time step

        super().__init__(symmetric)
        self._rslab = rslab

    def _analyse(self, pattern: BlockPattern) -> None:
        self._rows = ScalarRows(pattern, upper=self.symmetric)
        numbers, columns, starts = self._rows.arrays
        n = len(starts) - 1
        # Row arrays, used as column arrays, give the transposed matrix: of the upper triangle the
        # lower one, which rslab reads. Without matching the analysis depends on the pattern alone.
        transposed = sparse.csc_matrix((np.ones_like(numbers), columns, starts), shape=(n, n))
        if self.symmetric:
            self._symbols = self._rslab.analyze(transposed, "ldlt", ordering="metis", threads=1)
        else:
            self._symbols = self._rslab.analyze(transposed, "lu", matching=False, threads=1)

    def _factorise(self, A: BlockMatrix) -> int:
        failure = IndefiniteMatrix if self.symmetric else SolveFailed
        numbers = self._rows.arrays[0]
        try:
            self._factor = self._symbols.factor(numbers, threads=A.team.count)
        except RuntimeError as error:  # a pivot is zero
            raise failure(f"rslab could not factorise A: {error}") from error
        if self.symmetric and self._factor.inertia[0] < 3 * len(A.pattern):
            raise failure("rslab found a pivot <= 0: A is not positive definite")
        return int(self._symbols.factor_nnz)

    def _apply(self, b: np.ndarray) -> np.ndarray:
        solve = self._factor.solve if self.symmetric else self._factor.solve_transpose
        x: np.ndarray = solve(b.ravel())
        return x.reshape(b.shape)


class SuperLU(Direct):
    """SciPy's SuperLU, where there is no other. Each ``prepare`` repeats the analysis.

    If `symmetric`, the pivots are on the diagonal, in minimum-degree order. The factor is copied
    to check their signs: this takes twice the memory, and a third more time. Otherwise SuperLU
    chooses the pivots (partial pivoting).
    """

    name = "superlu"

    def _analyse(self, pattern: BlockPattern) -> None:
        self._rows = ScalarRows(pattern, upper=False)

    def _factorise(self, A: BlockMatrix) -> int:
        n = 3 * len(A.pattern)
        # The row arrays of A, used as column arrays, give Aᵀ.
        self._lu = self._factor(sparse.csc_matrix(self._rows.arrays, shape=(n, n)))
        return int(self._lu.nnz)

    def _factor(self, transposed: sparse.csc_matrix) -> SuperLUFactor:
        """Return the factor of a matrix A, given as `transposed` = Aᵀ.

        If `symmetric`, raise `IndefiniteMatrix` unless A is positive definite; otherwise raise
        `SolveFailed` if A has no factor.
        """
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
        # Rows are interchanged only if a diagonal pivot is zero. Otherwise A = L D Lᵀ, and D,
        # the diagonal of U, has the signs of the eigenvalues.
        if (lu.perm_r != lu.perm_c).any() or not (lu.U.diagonal() > 0).all():
            raise failure("superlu found a pivot <= 0: A is not positive definite")
        return lu

    def _apply(self, b: np.ndarray) -> np.ndarray:
        x: np.ndarray = self._lu.solve(b.ravel(), trans="T")
        return x.reshape(b.shape)


class ScalarRows:
    """A block matrix as compressed rows of numbers: the full matrix or its upper triangle.

    Attributes
    ----------
    pattern
        The pattern of the block matrix.
    places
        Place of each number among the values of the block matrix.
    arrays
        The numbers, their columns, and the first number of each row.
    """

    def __init__(self, pattern: BlockPattern, upper: bool):
        """Find the rows of a pattern; with `upper` of its upper triangle alone."""
        self.pattern = pattern
        n = 3 * len(pattern)
        # a matrix whose "values" are their places: its rows show where each number comes from
        places = np.arange(9 * len(pattern.indices)).reshape(-1, 3, 3)
        blocks = sparse.bsr_matrix((places, pattern.indices, pattern.indptr), shape=(n, n))
        rows = blocks.tocsr()
        if upper:
            is_upper = rows.indices >= np.repeat(np.arange(n), np.diff(rows.indptr))
            starts = np.append(0, np.cumsum(is_upper, dtype=np.int32))[rows.indptr]
            numbers = rows.data[is_upper], rows.indices[is_upper], starts
            rows = sparse.csr_matrix(numbers, shape=(n, n))
        self.places = rows.data
        self.arrays = np.empty(len(rows.data)), rows.indices, rows.indptr

    def refill(self, A: BlockMatrix) -> None:
        """Copy the values of A; raise `SolveFailed` if one is not finite."""
        np.take(A.values.reshape(-1), self.places, out=self.arrays[0], mode="clip")
        if not np.isfinite(self.arrays[0]).all():
            node = A.pattern.rows[~np.isfinite(A.values).all(axis=(1, 2))][0]
            raise SolveFailed(f"A is not finite, first in the row of node {node}")
