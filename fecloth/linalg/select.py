"""Selection of a solver of A x = b for a `BlockMatrix`, by name or by the work of each.

`linalg.protocol.LinearSolver` says what they offer. The residual of every x that is returned has
been computed with A and found small enough.

The solver "auto" is conjugate gradients, multigrid or a factorisation: each matrix goes to the
solver whose solves have taken the least work on average. Conjugate gradients begin. All
averages begin with guesses. The averages of the solvers that are not in use fall slowly, so
that each is tried again at times: the dearer it was, the later. An iteration that takes
several times the guess of the cheapest other solver is given up; this counts as its average,
and the other one continues at once. If the step size changes by more than a factor of 2, all
begins anew. Where the pattern of the matrices changes, as with contact, what its analysis
costs is added, in proportion to how often it changed lately.

Work is counted in iterations of `PCG` and not in seconds, so that a run repeats bit for bit.
`studies.benchmarks.auto_solver` compares whole runs with the best solver's.
"""

import math
from collections.abc import Callable

import numpy as np

from fecloth.errors import IndefiniteMatrix, InputError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.direct import Pardiso, SuperLU
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import SolveInfo, check_arguments
from fecloth.validation import known

ASSEMBLY = 2.0  # work of a tangent, for each block in a row
CYCLE, AGE = 10.0, 4  # work of an iteration of multigrid; iterations for its coarse matrices
MULTIGRID = 150.0  # work of a solve with it, as a guess
REUSE = 0.8  # new factors for each solve with one, as a guess
SUPERLU = 8.0  # work of SuperLU over the work of PARDISO
PATTERN = {"pcg": 0.0, "direct": 320.0, "multigrid": 100.0}  # work of a new pattern
LOADING = 1e7  # iterations times nodes that take as long as loading the MKL, 0.4 s
LARGE = 2_000  # nodes from which on multigrid is considered
WEIGHT = 1 / 12  # of a new solve in the average, after 1/2, 1/3, … for the first ones
MEMORY = 0.998  # factor on the averages of the other solvers
GAIN = 0.85  # largest ratio of averages, another solver over the current one, for a change
PATIENCE = 1.5, 3.0  # guesses of another solver that an iteration may take, at first and later


class AutoSolver:
    """`PCG`, `Multigrid` or what `direct` makes, for a symmetric matrix; `name` says which."""

    symmetric = keeps_state = True
    _A: BlockMatrix | None

    def __init__(self, pattern: BlockPattern, direct: Callable[[], Pardiso | SuperLU]):
        self._nodes = len(pattern)
        self.prepared = 0
        self._make: dict[str, Callable[[], PCG | Pardiso | SuperLU]]
        self._make = {"pcg": PCG, "direct": direct}
        if self._nodes >= LARGE:
            self._make["multigrid"] = Multigrid
        self._row = len(pattern.indices) / self._nodes
        self.drop()

    def drop(self) -> None:
        """Reset to the initial state: remove all averages and solvers."""
        self._solvers: dict[str, PCG | Pardiso | SuperLU] = {}
        self._begun: tuple[float, float, np.ndarray] | None = None
        self._restart()

    def _restart(self) -> None:
        self._size: float | None = None  # wx/wa of the first step
        self._pattern: BlockPattern | None = None  # of the last matrix
        self._share = 0.0  # of recent matrices whose pattern was new
        self._work = 0.0  # since the last solve
        guesses = {mode: self.guess(mode) for mode in self._make if mode != "pcg"}
        self._average = {"pcg": min(guesses.values()), **guesses}
        self._average["direct"] += 0.0 if "direct" in self._solvers else LOADING / self._nodes
        self._solves = dict.fromkeys(self._make, 1)  # with each solver; the guess is one
        self._use("pcg")

    def _use(self, mode: str) -> None:
        if mode not in self._solvers:
            self._solvers[mode] = self._make[mode]()
            if mode != "pcg":
                self._average[mode] = min(self._average[mode], self.guess(mode))
        self._mode, self._solver = mode, self._solvers[mode]
        self.prepared = self.prepared + 1
        self._A = None
        if self._begun:
            self._solver.begin(*self._begun)

    @property
    def name(self) -> str:
        return self._solver.name

    def guess(self, mode: str) -> float:
        """The work for a matrix and a solve with a direct solver or multigrid."""
        if mode == "multigrid":
            return MULTIGRID + ASSEMBLY * self._row
        return REUSE * self._preparation(mode) + self._solution(mode, 0)

    def _price(self, mode: str) -> float:
        """The average work of a solve, with its share of the work of a new pattern."""
        return self._average[mode] + self._share * PATTERN[mode]

    def _preparation(self, mode: str) -> float:
        """The work of a tangent and of the factor that it takes."""
        if mode == "direct":
            factor = 1.1 * self._row * self._solution(mode, 0)
        else:
            factor = 0.0
        return ASSEMBLY * self._row + factor

    def _solution(self, mode: str, iterations: int) -> float:
        if mode == "direct":
            slow = mode in self._solvers and self._solvers[mode].name == "superlu"
            return (1 + iterations) * math.cbrt(self._nodes) * (SUPERLU if slow else 1.0)
        if mode == "multigrid":
            return CYCLE * (iterations + AGE)
        return float(iterations)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        self._begun = (wx, wa, x)
        size = wx / wa
        if self._size and not 0.25 <= size / self._size <= 4:
            self._restart()
        self._size = self._size or size
        self._solver.begin(wx, wa, x)

    def prepare(self, A: BlockMatrix) -> None:
        """Select a solver and let it prepare A."""
        is_new = self._pattern is not None and not A.pattern.same_as(self._pattern)
        self._pattern, self._share = A.pattern, self._share + WEIGHT * (is_new - self._share)
        cheapest = min(self._make, key=self._price)
        if self._price(cheapest) < GAIN * self._price(self._mode):
            self._use(cheapest)
        self._prepare(A)

    def _prepare(self, A: BlockMatrix) -> None:
        self.prepared = self.prepared + 1
        self._A = None
        self._work += self._preparation(self._mode)
        self._solver.prepare(A)
        self._A = A

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b: x (n, 3) and `SolveInfo`, by another solver if this takes too long."""
        A, _, _ = check_arguments(self._A, b, rtol)
        others = [mode for mode in self._make if mode not in ("pcg", self._mode)] or ["direct"]
        price, other = min((self.guess(m) + self._share * PATTERN[m], m) for m in others)
        limit = PATIENCE[self._solves[self._mode] > 1] * price
        if isinstance(self._solver, PCG):
            cost = CYCLE if self._mode == "multigrid" else 1.0
            self._solver.max_iterations = max(10, int(limit / cost))
        try:
            x, info = self._solver.solve(b, rtol, guess)
        except SolveFailed as failure:
            if isinstance(failure, IndefiniteMatrix) or self._mode == "direct":
                raise
            self._average[self._mode] = limit
            self._use(other)
            self._prepare(A)
            return self.solve(b, rtol, guess)
        self._work += self._solution(self._mode, info.iterations)
        old = self._average[self._mode]
        self._average = {mode: MEMORY * work for mode, work in self._average.items()}
        self._solves[self._mode] += 1
        weight = max(WEIGHT, 1 / self._solves[self._mode])
        self._average[self._mode] = old + weight * (self._work - old)
        self._work = 0.0
        return x, info


NAMES = ("direct", "pardiso", "superlu", "pcg", "multigrid")


def direct(symmetric: bool = True) -> Pardiso | SuperLU:
    """Create PARDISO if the MKL can be loaded, else SuperLU."""
    try:
        return Pardiso(symmetric)
    except (ImportError, OSError):
        return SuperLU(symmetric)


def choose(pattern: BlockPattern, symmetric: bool) -> tuple[Pardiso | SuperLU | AutoSolver, str]:
    """Create the solver "auto" for matrices of a pattern, and a text with what it compares."""
    # If they are not symmetric, it is a direct solver.
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    solver = AutoSolver(pattern, direct)
    price = solver.guess("direct")
    return solver, f"at first; a factor and a solve cost about as much as {price:.0f} iterations"


def create(name: str, symmetric: bool = True) -> Pardiso | SuperLU | PCG | Multigrid:
    """Create the solver with one of the `NAMES`; "direct" is PARDISO if available, else SuperLU."""
    what = f"solver {name!r}"
    where = "linalg.select.create"
    known(what, name, NAMES, where)
    if name in ("pcg", "multigrid"):
        if not symmetric:
            remedy = 'Use "auto" or "direct"; or EnergyMomentum with tangent = "symmetric".'
            raise InputError(what, "supports symmetric matrices only", where, remedy)
        return PCG() if name == "pcg" else Multigrid()
    if name == "pardiso":
        try:
            return Pardiso(symmetric)
        except (ImportError, OSError) as error:
            remedy = 'Install pypardiso (x86-64 only: "pip install pypardiso") or use "superlu".'
            raise InputError(what, f"cannot be loaded ({error})", where, remedy) from error
    if name == "superlu":
        return SuperLU(symmetric)
    return direct(symmetric)
