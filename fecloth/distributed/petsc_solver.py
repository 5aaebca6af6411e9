"""PETSc's Krylov solvers on the rows that a process owns.

Options: conjugate gradients (BiCGStab where the matrix is not symmetric) on the residual itself.
Smoothed aggregation (GAMG) takes the rigid motions of the present shape as its near null space. Its
smoother is Chebyshev's polynomial with point-block Jacobi. It keeps its interpolation when the
matrix changes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from fecloth.distributed.distributed_solver import TooManyIterations
from fecloth.distributed.partition import Part
from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix

GAMG: dict[str, object] = {
    "pc_type": "gamg",
    "pc_gamg_type": "agg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.0,
    "pc_gamg_reuse_interpolation": 1,
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "pbjacobi",
}
OPTIONS: dict[str, dict[str, object]] = {
    "block Jacobi": {"pc_type": "pbjacobi", "ksp_max_it": 5000},
    "GAMG": GAMG | {"ksp_max_it": 1000},
    "MUMPS": {"pc_factor_mat_solver_type": "mumps", "ksp_max_it": 10},
}
OLD = (3, 20)  # before, GAMG failed with point-block smoothers
ROWS = 20_000  # of nodes whose blocks are copied at once
LOST = 2.0  # times rtol: what the true residual may be above that of the recurrence


def load() -> Any:
    """The module PETSc of petsc4py, initialised; of the wheel dolfinx-solver-real too."""
    with suppress(ImportError):
        import dolfinx_solver  # noqa: F401  # its libraries must be loaded first
    import petsc4py

    petsc4py.init(["fecloth", "-no_signal_handler"])
    from petsc4py import PETSc

    return PETSc


class PetscSolver:
    """A process's share of a solver.

    Parameters
    ----------
    part, matrix
        The part and its matrix, of which the rows of own nodes are used.
    kind
        A key of `OPTIONS`.
    owned
        Number of nodes that each process owns.
    numbers
        (n,) row of the whole matrix of each node of the part.
    """

    def __init__(
        self,
        part: Part,
        matrix: BlockMatrix,
        kind: str,
        symmetric: bool,
        owned: Sequence[int],
        numbers: np.ndarray,
    ):
        self.petsc, self.matrix, self.kind = load(), matrix, kind
        self.own, self.size = int(part.is_own.sum()), 3 * sum(owned)
        self.blocks = _blocks_of(part, matrix)
        self.A = self._make_matrix(numbers)
        self.b, self.x = self.A.createVecs()
        self.ksp = self._make_ksp(symmetric)

    def _make_matrix(self, numbers: np.ndarray) -> Any:
        """The matrix (3n, 3n), rows of own nodes here, with space for its pattern."""
        PETSc, pattern = self.petsc, self.matrix.pattern
        A = PETSc.Mat().create(comm=PETSc.COMM_WORLD)
        A.setSizes(((3 * self.own, self.size), (3 * self.own, self.size)), bsize=3)
        A.setType(PETSc.Mat.Type.AIJ)
        rows, columns = pattern.rows[self.blocks], numbers[pattern.indices[self.blocks]]
        first = numbers[rows[0]]  # own rows follow one another
        is_here = (columns >= first) & (columns < first + self.own)
        count = np.bincount(numbers[rows] - first, minlength=self.own)
        here = np.bincount(numbers[rows[is_here]] - first, minlength=self.own)
        counts = (3 * np.repeat(c, 3) for c in (here, count - here))
        A.setPreallocationNNZ(tuple(c.astype(PETSc.IntType) for c in counts))
        A.setOption(PETSc.Mat.Option.ROW_ORIENTED, False)
        self.columns = columns.astype(PETSc.IntType)
        self.starts = np.append(0, np.cumsum(count)).astype(PETSc.IntType)
        self.first = int(first)
        return A

    def _fill(self) -> None:
        """Copy the blocks to PETSc, for some rows at once to save memory."""
        values, starts, A = self.matrix.values[self.blocks], self.starts, self.A
        for row in range(0, self.own, ROWS):
            end = min(row + ROWS, self.own)
            part = slice(starts[row], starts[end])
            rows = np.arange(self.first + row, self.first + end, dtype=starts.dtype)
            by_column = np.ascontiguousarray(values[part].transpose(0, 2, 1))
            own = starts[row : end + 1] - starts[row], self.columns[part], by_column
            A.setValuesBlockedIJV(*own, rowmap=rows)
        A.assemble()

    def _make_ksp(self, symmetric: bool) -> Any:
        PETSc = self.petsc
        ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
        ksp.setOptionsPrefix(f"fecloth{id(self) % 10**6}_")
        options: dict[str, object] = {
            "ksp_type": "cg" if symmetric else "bcgs",
            "ksp_norm_type": "unpreconditioned",
        }
        options |= OPTIONS[self.kind]
        if self.kind == "MUMPS":
            options |= {"ksp_type": "richardson", "pc_type": "cholesky" if symmetric else "lu"}
        if self.kind == "GAMG" and PETSc.Sys.getVersion() < OLD:
            options["mg_levels_pc_type"] = "jacobi"
        table = PETSc.Options(ksp.getOptionsPrefix())
        for name, value in options.items():
            table[name] = value
        ksp.setOperators(self.A)
        ksp.setFromOptions()
        return ksp

    def prepare(self, shape: np.ndarray, anew: bool) -> float:
        """Take the present values; `anew` renews the preconditioner. Returns the seconds."""
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
            negative = self.ksp.getPC().getFactorMatrix().getMumpsInfog(12)
            if negative:
                raise IndefiniteMatrix(f"{negative} pivots of MUMPS are negative")
        return time.perf_counter() - begin

    def _set_rigid_motions(self, shape: np.ndarray) -> None:
        PETSc = self.petsc
        place = PETSc.Vec().createMPI((3 * self.own, self.size), bsize=3, comm=PETSc.COMM_WORLD)
        place.array[:] = shape.ravel()
        self.A.setNearNullSpace(PETSc.NullSpace().createRigidBody(place))

    def solve(
        self, b: np.ndarray, rtol: float, guess: np.ndarray | None
    ) -> tuple[np.ndarray, int, float]:
        """x of own nodes, the iterations, and ‖b − A x‖ / ‖b‖.

        Raises
        ------
        IndefiniteMatrix, SolveFailed
            On all processes alike.
        """
        self.b.array[:] = b.ravel()
        self.x.array[:] = 0.0 if guess is None else guess.ravel()
        self.ksp.setInitialGuessNonzero(guess is not None)
        self.ksp.setTolerances(rtol=rtol, atol=0.0)
        self.ksp.solve(self.b, self.x)
        self._check(self.ksp.getConvergedReason())
        r = self.b.duplicate()
        self.A.mult(self.x, r)
        r.aypx(-1.0, self.b)
        residual = r.norm() / self.b.norm()
        if not residual <= LOST * rtol:
            raise SolveFailed(f"PETSc {self.kind}: residual {residual:.1e}, not {rtol:.1e}")
        return self.x.array.reshape(-1, 3).copy(), self.ksp.getIterationNumber(), residual

    def _check(self, reason: int) -> None:
        """Raise the error that a negative reason of PETSc stands for."""
        reasons = self.petsc.KSP.ConvergedReason
        if reason >= 0:
            return
        if reason in (reasons.DIVERGED_INDEFINITE_MAT, reasons.DIVERGED_INDEFINITE_PC):
            raise IndefiniteMatrix("PETSc met a direction of negative curvature")
        if reason == reasons.DIVERGED_MAX_IT:
            most = self.ksp.getIterationNumber()
            raise TooManyIterations(f"PETSc {self.kind} did not converge in {most} iterations")
        raise SolveFailed(f"PETSc {self.kind} failed (KSPConvergedReason {reason})")


def _blocks_of(part: Part, matrix: BlockMatrix) -> slice | np.ndarray:
    """The blocks in the rows of own nodes: a slice where these follow one another."""
    indptr, own = matrix.pattern.indptr, part.own
    if isinstance(own, slice):
        return slice(int(indptr[own.start]), int(indptr[own.stop]))
    return np.flatnonzero(part.is_own[matrix.pattern.rows])
