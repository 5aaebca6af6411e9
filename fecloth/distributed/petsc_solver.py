"""PETSc's Krylov solvers on the rows that a process owns.

Options: conjugate gradients (BiCGStab where the matrix is not symmetric) on the residual
itself. Smoothed aggregation (GAMG) takes the rigid motions of the present shape as its near
null space. Its smoother is a symmetric Gauss-Seidel sweep on the rows of each process:
Jacobi's with Chebyshev's polynomial takes many more iterations on compressed cloth. It keeps
its interpolation.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from fecloth.distributed.partition import Part
from fecloth.errors import IndefiniteMatrix, SolveFailed, amount
from fecloth.linalg.block_matrix import BlockMatrix

GAMG: dict[str, object] = {
    "pc_type": "gamg",
    "pc_gamg_type": "agg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.0,
    "pc_gamg_reuse_interpolation": 1,
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "sor",
}
OF_OLD = {"ksp_type": "chebyshev", "ksp_max_it": 2, "pc_type": "jacobi"}  # GAMG fails with "sor"
OPTIONS: dict[str, dict[str, object]] = {
    "block Jacobi": {"pc_type": "pbjacobi", "ksp_max_it": 5000},
    "GAMG": GAMG | {"ksp_max_it": 1000},
    "MUMPS": {
        "pc_factor_mat_solver_type": "mumps",
        "mat_mumps_icntl_35": 2,  # blocks of low rank: less time and memory on fine meshes
        "mat_mumps_cntl_7": 1e-9,
        "mat_mumps_icntl_14": 100,  # percent more space than it expects to need
        "ksp_max_it": 10,
    },
}
OLD_PETSC = (3, 20)  # older versions need the options `OF_OLD`
ROWS_AT_ONCE = 20_000  # of nodes whose blocks are copied together, which saves memory
# Times rtol: what the true residual may be. Round-off takes it above the residual of the
# recurrence, at which the iteration ends.
LARGEST_RESIDUAL = 2.0


class TooManyIterations(SolveFailed):
    """The iteration was given up."""


class SpoiledPreconditioner(IndefiniteMatrix):
    """The preconditioner, and perhaps the matrix, is not positive definite."""


def load() -> Any:
    """The module PETSc of petsc4py, initialised; `launch.load` has loaded what it needs."""
    import petsc4py

    petsc4py.init(["fecloth", "-no_signal_handler"])
    from petsc4py import PETSc

    return PETSc


class PetscSolver:
    """A process's share of the matrix and of a solver, which `begin` makes.

    Of the `matrix` of the part the rows of own nodes are used; `owned` are the numbers of nodes
    that each process owns, `numbers` (n,) the row of the whole matrix of each node of the part.
    """

    def __init__(self, part: Part, matrix: BlockMatrix, owned: Sequence[int], numbers: np.ndarray):
        self.petsc = load()
        self.matrix = matrix
        self.own = int(part.is_own.sum())
        self.size = 3 * sum(owned)
        self.blocks = _blocks_of(part, matrix)
        pattern = matrix.pattern
        integer = self.petsc.IntType
        # The matrix of the own rows by blocks of 3 × 3, in compressed rows: `starts` has where
        # each row begins, and `columns` the column of each block. The rows follow one another.
        rows = numbers[pattern.rows[self.blocks]]
        self.first = int(rows[0])
        self.columns = numbers[pattern.indices[self.blocks]].astype(integer)
        blocks_of_row = np.bincount(rows - self.first, minlength=self.own)
        self.starts = np.append(0, np.cumsum(blocks_of_row)).astype(integer)
        self.kind = ""
        self.ksp: Any = None
        self.A: Any = None
        self.b: Any = None
        self.x: Any = None
        self.r: Any = None

    def begin(self, kind: str, symmetric: bool) -> None:
        """Make a solver of a kind, a key of `OPTIONS`, in place of the one before.

        The matrix and the vectors are kept, unless the kind needs another type of matrix.
        """
        # MUMPS takes the upper half of a symmetric matrix, and then a third of the memory.
        half = kind == "MUMPS" and symmetric
        if self.A is None or half != (self.A.getType() == "mpisbaij"):
            self.destroy()
            self.A = self._make_matrix(half)
            self.b, self.x = self.A.createVecs()
            self.r = self.b.duplicate()
        elif self.ksp:
            self.ksp.destroy()
        self.kind = kind
        self.ksp = self._make_ksp(symmetric)

    def destroy(self) -> None:
        """Free the memory: on several processes petsc4py keeps what Python only drops."""
        for petsc_object in (self.ksp, self.A, self.b, self.x, self.r):
            if petsc_object:
                petsc_object.destroy()

    def _make_matrix(self, half: bool) -> Any:
        """The matrix (3n, 3n) of PETSc, without values, with space for the own rows.

        With `half` only the blocks of the upper half are stored.
        """
        PETSc = self.petsc
        first = self.first
        columns = self.columns
        A = PETSc.Mat().create(comm=PETSc.COMM_WORLD)
        A.setSizes(((3 * self.own, self.size), (3 * self.own, self.size)), bsize=3)
        A.setType("mpisbaij" if half else PETSc.Mat.Type.AIJ)
        rows = np.repeat(np.arange(self.own), np.diff(self.starts))
        is_own_column = (columns >= first) & (columns < first + self.own)
        is_stored = columns - first >= rows if half else np.ones(len(columns), bool)
        # PETSc stores the own columns of a row apart from the others, and wants both numbers.
        counts = [
            np.bincount(rows[is_own_column & is_stored], minlength=self.own),
            np.bincount(rows[~is_own_column & is_stored], minlength=self.own),
        ]
        if not half:  # numbers of this type: 3 in each of the 3 rows of a block
            counts = [3 * np.repeat(count, 3) for count in counts]
        A.setPreallocationNNZ(tuple(count.astype(PETSc.IntType) for count in counts))
        A.setOption(PETSc.Mat.Option.ROW_ORIENTED, False)  # `_fill` gives blocks by columns
        if half:
            A.setOption(PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True)
        return A

    def _fill(self) -> None:
        """Copy the values of the own rows to PETSc's matrix.

        `ROWS_AT_ONCE` rows of blocks are copied together: the copy of all would need as much
        memory as the matrix.
        """
        values = self.matrix.values[self.blocks]
        starts = self.starts
        A = self.A
        for row in range(0, self.own, ROWS_AT_ONCE):
            end = min(row + ROWS_AT_ONCE, self.own)
            blocks = slice(starts[row], starts[end])
            rows = np.arange(self.first + row, self.first + end, dtype=starts.dtype)
            by_column = np.ascontiguousarray(values[blocks].transpose(0, 2, 1))
            starts_here = starts[row : end + 1] - starts[row]
            A.setValuesBlockedIJV(starts_here, self.columns[blocks], by_column, rowmap=rows)
        A.assemble()

    def _make_ksp(self, symmetric: bool) -> Any:
        """The solver of the present kind, with the options of `OPTIONS`.

        Options of the environment variable PETSC_OPTIONS, such as -fecloth_gamg_ksp_max_it, go
        before these.
        """
        PETSc = self.petsc
        is_direct = self.kind == "MUMPS"
        ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
        ksp.setOptionsPrefix(f"fecloth_{self.kind.lower().replace(' ', '_')}_")
        ksp.setOperators(self.A)
        if is_direct:  # corrections by the factor, which is of low rank and so not exact
            ksp.setType("richardson")
            ksp.getPC().setType("cholesky" if symmetric else "lu")
        else:
            ksp.setType("cg" if symmetric else "bcgs")
        options = {"ksp_norm_type": "unpreconditioned"} | OPTIONS[self.kind]
        if self.kind == "GAMG" and PETSc.Sys.getVersion() < OLD_PETSC:
            options |= {f"mg_levels_{name}": value for name, value in OF_OLD.items()}
        table = PETSc.Options(ksp.getOptionsPrefix())
        for name, value in options.items():
            if not table.hasName(name):
                table[name] = value
        ksp.setFromOptions()
        return ksp

    def prepare(self, shape: np.ndarray, anew: bool) -> float:
        """Take the present values of the matrix; return the seconds that this took.

        GAMG makes a new preconditioner only with `anew`, which needs the `shape` (own, 3), the
        positions of own nodes [m]; the others always make one. Raise `SolveFailed` if PETSc
        fails, and `IndefiniteMatrix` if a factor has negative pivots.
        """
        begin = time.perf_counter()
        self._fill()
        if self.kind == "GAMG":
            if anew:
                self._set_rigid_motions(shape)
            self.ksp.getPC().setReusePreconditioner(not anew)
        self.ksp.setOperators(self.A)  # without this call the factor of old values stays
        try:
            self.ksp.setUp()
        except self.petsc.Error as error:
            raise SolveFailed(f"PETSc {self.kind}: {error}") from error
        if self.kind == "MUMPS" and self.ksp.getPC().getType() == "cholesky":
            negative_pivots = self.ksp.getPC().getFactorMatrix().getMumpsInfog(12)
            if negative_pivots:
                raise IndefiniteMatrix(f"{negative_pivots} pivots of MUMPS are negative")
        return time.perf_counter() - begin

    def _set_rigid_motions(self, shape: np.ndarray) -> None:
        """Give GAMG the rigid motions of positions (own, 3)."""
        PETSc = self.petsc
        place = PETSc.Vec().createMPI((3 * self.own, self.size), bsize=3, comm=PETSc.COMM_WORLD)
        place.array[:] = shape.ravel()
        motions = PETSc.NullSpace().createRigidBody(place)
        self.A.setNearNullSpace(motions)
        motions.destroy()
        place.destroy()

    def solve(
        self, b: np.ndarray, rtol: float, guess: np.ndarray | None
    ) -> tuple[np.ndarray, int, float]:
        """Solve A x = b; return x (own, 3), the iterations, and ‖b − A x‖ / ‖b‖.

        b and the `guess` are (own, 3), the rows of own nodes. Raise `SolveFailed`, or a kind of
        it, if the solve fails or if this true residual is above `LARGEST_RESIDUAL` × `rtol`.
        """
        self.b.array[:] = b.ravel()
        self.x.array[:] = 0.0 if guess is None else guess.ravel()
        self.ksp.setInitialGuessNonzero(guess is not None)
        self.ksp.setTolerances(rtol=rtol, atol=0.0)
        self.ksp.solve(self.b, self.x)
        self._check(self.ksp.getConvergedReason())
        self.A.mult(self.x, self.r)
        self.r.aypx(-1.0, self.b)
        residual = self.r.norm() / self.b.norm()
        if not residual <= LARGEST_RESIDUAL * rtol:
            raise SolveFailed(f"PETSc {self.kind}: residual {residual:.1e}, not {rtol:.1e}")
        return self.x.array.reshape(-1, 3).copy(), self.ksp.getIterationNumber(), residual

    def _check(self, reason: int) -> None:
        """Raise the error that fits the `reason`, by PETSc, for which a solve ended.

        A negative reason is a failure: `IndefiniteMatrix`, `SpoiledPreconditioner`,
        `TooManyIterations`, or `SolveFailed` for any other.
        """
        reasons = self.petsc.KSP.ConvergedReason
        if reason >= 0:
            return
        if reason == reasons.DIVERGED_INDEFINITE_MAT:
            raise IndefiniteMatrix("PETSc met a direction of negative curvature")
        if reason == reasons.DIVERGED_INDEFINITE_PC:
            raise SpoiledPreconditioner(f"PETSc's {self.kind} is not positive definite")
        if reason == reasons.DIVERGED_MAX_IT:
            most = amount(self.ksp.getIterationNumber(), "iteration")
            raise TooManyIterations(f"PETSc {self.kind} did not converge in {most}")
        raise SolveFailed(f"PETSc {self.kind} failed (KSPConvergedReason {reason})")


def _blocks_of(part: Part, matrix: BlockMatrix) -> slice | np.ndarray:
    """The blocks in the rows of own nodes: a slice where these follow one another."""
    indptr = matrix.pattern.indptr
    own = part.own
    if isinstance(own, slice):
        return slice(int(indptr[own.start]), int(indptr[own.stop]))
    return np.flatnonzero(part.is_own[matrix.pattern.rows])
