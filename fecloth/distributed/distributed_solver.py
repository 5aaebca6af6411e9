"""The linear solver of a cloth in parts, as the first process sees it."""

import time

import numpy as np

from fecloth.distributed.crew import Crew
from fecloth.distributed.petsc_solver import TooManyIterations
from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import SolveInfo

KINDS = {"auto": "block Jacobi", "pcg": "block Jacobi", "multigrid": "GAMG", "direct": "MUMPS"}
MOST = 150  # iterations with block Jacobi after which "auto" takes GAMG, whose setup costs as much
WORSE = 2.0  # times the iterations of a new hierarchy: then another one is made


class DistributedSolver:
    """PETSc's solver on all processes: a `LinearSolver`.

    "auto" begins with block Jacobi, which is best for short steps, and takes GAMG from the first
    solve on that needs more than 150 iterations. The hierarchy of GAMG is kept, while the matrix
    changes, until the iterations double. After a failure the solver is made anew.
    """

    def __init__(self, crew: Crew, nodes: int, choice: str, symmetric: bool):
        self.crew, self.choice, self.kind = crew, choice, KINDS[choice]
        self.symmetric, self.prepared, self.keeps_state = symmetric, 0, True
        self.x = np.zeros((nodes, 3))
        self.seconds_factor, self.first, self.last = 0.0, 0, 0
        numbers, at = np.empty(nodes, np.int32), 0
        for part in crew.parts:
            own = int(part.is_own.sum())
            numbers[part.own_nodes] = np.arange(at, at + own)
            at += own
        self.numbers = numbers
        self._create()

    def _create(self) -> None:
        crew, owned = self.crew, [int(part.is_own.sum()) for part in self.crew.parts]
        arguments = self.kind, self.symmetric, owned
        crew.each("create_solver", lambda part: (*arguments, self.numbers[part.nodes]))
        self.first, self.spoiled = 0, False

    @property
    def name(self) -> str:
        return f"PETSc {self.kind}"

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note the positions: GAMG must know their rigid motions."""
        self.x = x

    def drop(self) -> None:
        """Forget the hierarchy, and with "auto" the choice."""
        if self.kind != KINDS[self.choice]:
            self.kind = KINDS[self.choice]
            self._create()
        self.first = self.last = 0

    def prepare(self, A: BlockMatrix) -> None:
        """Take the matrix that the processes hold; A is what one process knows of it."""
        if self.choice == "auto" and self.kind != "GAMG" and self.last > MOST:
            self._change()
        self._prepare(anew=self.first == 0 or self.last > WORSE * self.first)
        self.prepared += 1

    def _prepare(self, anew: bool) -> None:
        begin = time.perf_counter()
        if self.spoiled:  # it would keep what it has found out about an indefinite matrix
            self._create()
        self.crew.each("prepare", lambda part: (self.x[part.own_nodes], anew))
        self.first = 0 if anew else self.first
        self.seconds_factor = time.perf_counter() - begin

    def _change(self) -> None:
        """Take GAMG from here on."""
        self.kind = "GAMG"
        self._create()

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        b = np.ascontiguousarray(b, dtype=float)
        if not b.any():
            return np.zeros_like(b), SolveInfo(self.name, 0, 0.0, self.seconds_factor, 0.0)
        begin, kept = time.perf_counter(), self.first > 0
        try:
            shares = self._solve(b, rtol, guess)
        except SolveFailed as failure:
            if kept and type(failure) is IndefiniteMatrix:  # found by a sound preconditioner
                raise
            self.first, self.spoiled = 0, True
            slow = isinstance(failure, TooManyIterations) and self.kind == "block Jacobi"
            if slow and self.choice == "auto":
                self._change()
            elif not (kept and self.kind == "GAMG"):
                raise
            self._prepare(anew=True)
            shares = self._solve(b, rtol, guess)
        rows, iterations, residual = zip(*shares, strict=True)
        x = np.empty_like(b)
        for part, own in zip(self.crew.parts, rows, strict=True):
            x[part.own_nodes] = own
        self.last = iterations[0]
        self.first = self.first or max(self.last, 1)
        seconds = time.perf_counter() - begin
        return x, SolveInfo(self.name, self.last, residual[0], self.seconds_factor, seconds)

    def _solve(self, b: np.ndarray, rtol: float, guess: np.ndarray | None) -> list:
        def own(part) -> tuple:
            start = None if guess is None else guess[part.own_nodes]
            return b[part.own_nodes], rtol, start

        return self.crew.each("solve", own)
