"""Selection of a solver of A x = b for a `BlockMatrix`, by name or by the work of each.

`linalg.protocol.LinearSolver` says what they offer. For every x that is returned, the residual
was computed with A and is small enough.

The solver "auto" is conjugate gradients, multigrid or a factorisation: each matrix goes to the
solver whose solves have taken the least work on average. Conjugate gradients begin. All
averages begin with guesses. The averages of the solvers that are not in use fall slowly, so
that each solver is tried again at times; the more work it took, the later. If a solve takes
several times the guess of the cheapest other solver, it is given up. Then this work counts as the
average of the first solver, and the other one continues at once. If the step size changes by
more than a factor of 2, all averages begin anew. Where the pattern of the matrices changes, as
with contact, the work of its analysis is added, in proportion to how often it changed lately.

Work is counted in iterations of `PCG` and not in seconds, so that a run repeats bit for bit.
`studies.evidence.benchmarks.auto_solver` compares whole runs with those of the best solver.
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

# All works are in iterations of `PCG` on the same matrix.
# Work of a tangent, for each block in a row.
TANGENT_WORK = 2.0
# Work of an iteration of multigrid.
CYCLE_WORK = 10.0
# Iterations of multigrid that take as long as a solve's share of the coarse matrices.
COARSE_ITERATIONS = 4
# Work of a solve with multigrid, as a first guess.
MULTIGRID_GUESS = 150.0
# New factors for each solve with a direct solver, as a first guess.
FACTORS_PER_SOLVE = 0.8
# Work of SuperLU over the work of PARDISO.
SUPERLU_RATIO = 8.0
# Work of the analysis of a new pattern.
PATTERN = {"pcg": 0.0, "direct": 320.0, "multigrid": 100.0}
# Work times nodes that takes as long as loading the MKL, 0.4 s.
LOADING_WORK = 1e7
# Nodes from which on multigrid is considered.
FEWEST_MULTIGRID_NODES = 2_000
# Weight of a new solve in the average, after 1/2, 1/3, … for the first solves.
WEIGHT = 1 / 12
# Factor on the averages of the other solvers for each solve: they fall by half in 350 solves.
DECAY = 0.998
# Another solver is taken if its average is less than this share of the average in use.
RATIO_FOR_CHANGE = 0.85
# A solve is given up if it takes more than this factor times the guess of another solver: soon
# while nothing is known of the solver in use, later where its average is.
FIRST_PATIENCE = 1.5
PATIENCE = 3.0


class AutoSolver:
    """The solver "auto" for symmetric matrices: `PCG`, `Multigrid` or a direct solver.

    `direct` makes the direct solver. The `name` is the name of the solver in use.
    """

    symmetric = True
    keeps_state = True
    _A: BlockMatrix | None

    def __init__(self, pattern: BlockPattern, direct: Callable[[], Pardiso | SuperLU]):
        """Begin with conjugate gradients, for matrices of about this pattern."""
        self._nodes = len(pattern)
        self.prepared = 0
        self._make: dict[str, Callable[[], PCG | Pardiso | SuperLU]]
        self._make = {"pcg": PCG, "direct": direct}
        if self._nodes >= FEWEST_MULTIGRID_NODES:
            self._make["multigrid"] = Multigrid
        self._blocks_in_row = len(pattern.indices) / self._nodes
        self.drop()

    def drop(self) -> None:
        """Reset to the initial state: remove all averages and solvers."""
        self._solvers: dict[str, PCG | Pardiso | SuperLU] = {}
        self._step_begun: tuple[float, float, np.ndarray] | None = None
        self._reset_averages()

    def _reset_averages(self) -> None:
        """Begin anew with conjugate gradients and guessed averages; keep the solvers."""
        self._first_size: float | None = None  # wx/wa of the first step
        self._pattern: BlockPattern | None = None  # of the last matrix
        self._new_patterns = 0.0  # share of recent matrices whose pattern was new
        self._work = 0.0  # since the last solve
        guesses = {mode: self.guess(mode) for mode in self._make if mode != "pcg"}
        # conjugate gradients begin: no other solver has a smaller average
        self._average = {"pcg": min(guesses.values()), **guesses}
        if "direct" not in self._solvers:
            self._average["direct"] += LOADING_WORK / self._nodes
        self._solves = dict.fromkeys(self._make, 1)  # with each solver; the guess is one
        self._use("pcg")

    def _use(self, mode: str) -> None:
        """Take the solver of a mode ("pcg", "direct" or "multigrid"); make it if necessary.

        It has no matrix then: `prepare` must follow. It is told of the step that has begun.
        """
        if mode not in self._solvers:
            self._solvers[mode] = self._make[mode]()
            if mode != "pcg":  # the MKL is loaded now: a guess without `LOADING_WORK`
                self._average[mode] = min(self._average[mode], self.guess(mode))
        self._mode = mode
        self._solver = self._solvers[mode]
        self.prepared = self.prepared + 1
        self._A = None
        if self._step_begun:
            self._solver.begin(*self._step_begun)

    @property
    def name(self) -> str:
        """Name of the solver in use."""
        return self._solver.name

    def guess(self, mode: str) -> float:
        """The work for a matrix and a solve with "direct" or "multigrid", as a guess."""
        if mode == "multigrid":
            return MULTIGRID_GUESS + TANGENT_WORK * self._blocks_in_row
        return FACTORS_PER_SOLVE * self._prepare_work(mode) + self._solve_work(mode, 0)

    def _average_with_pattern(self, mode: str) -> float:
        """The average work of a solve, with its share of the work of a new pattern."""
        return self._average[mode] + self._new_patterns * PATTERN[mode]

    def _prepare_work(self, mode: str) -> float:
        """Return the work of a tangent, and of its factor, in iterations of `PCG`."""
        tangent = TANGENT_WORK * self._blocks_in_row
        if mode == "direct":
            return tangent + 1.1 * self._blocks_in_row * self._solve_work(mode, 0)
        return tangent

    def _solve_work(self, mode: str, iterations: int) -> float:
        """Return the work of a solve, in iterations of `PCG`.

        `iterations` is the number of iterations of the solver. For a direct solver it is the
        number of refinements; each costs a solve with the factor, about ∛n for n nodes.
        """
        if mode == "direct":
            work = (1 + iterations) * math.cbrt(self._nodes)
            if mode in self._solvers and self._solvers[mode].name == "superlu":
                work *= SUPERLU_RATIO
            return work
        if mode == "multigrid":
            return CYCLE_WORK * (iterations + COARSE_ITERATIONS)
        return float(iterations)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note that a step begins; if wx/wa has changed by more than 4, begin anew.

        wx/wa is about dt², so this is a change of the step size by more than 2.
        """
        self._step_begun = (wx, wa, x)
        size = wx / wa
        if self._first_size and not 0.25 <= size / self._first_size <= 4:
            self._reset_averages()
        self._first_size = self._first_size or size
        self._solver.begin(wx, wa, x)

    def prepare(self, A: BlockMatrix) -> None:
        """Select the solver with the least average work, and let it prepare A.

        The solver in use stays unless another one is clearly cheaper, see `RATIO_FOR_CHANGE`.
        """
        is_new = self._pattern is not None and not A.pattern.same_as(self._pattern)
        self._pattern = A.pattern
        self._new_patterns += WEIGHT * (is_new - self._new_patterns)
        cheapest = min(self._make, key=self._average_with_pattern)
        average_in_use = self._average_with_pattern(self._mode)
        if self._average_with_pattern(cheapest) < RATIO_FOR_CHANGE * average_in_use:
            self._use(cheapest)
        self._prepare(A)

    def _prepare(self, A: BlockMatrix) -> None:
        """Let the solver in use prepare A."""
        self.prepared = self.prepared + 1
        self._A = None
        self._work += self._prepare_work(self._mode)
        self._solver.prepare(A)
        self._A = A

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3) by the solver in use; return x (n, 3) and its `SolveInfo`.

        If it fails or takes more than a factor (`FIRST_PATIENCE`, `PATIENCE`) times the guess of
        the cheapest other solver, that one takes over and solves at once. The work goes into the
        averages. Raises `IndefiniteMatrix` if A is not positive definite, and `SolveFailed` if
        the direct solver fails.
        """
        A, _, _ = check_arguments(self._A, b, rtol)
        others = [mode for mode in self._make if mode not in ("pcg", self._mode)] or ["direct"]
        guesses = [(self.guess(mode) + self._new_patterns * PATTERN[mode], mode) for mode in others]
        cheapest_guess, other = min(guesses)
        is_known = self._solves[self._mode] > 1
        limit = (PATIENCE if is_known else FIRST_PATIENCE) * cheapest_guess
        if isinstance(self._solver, PCG):
            iteration_work = CYCLE_WORK if self._mode == "multigrid" else 1.0
            self._solver.max_iterations = max(10, int(limit / iteration_work))
        try:
            x, info = self._solver.solve(b, rtol, guess)
        except SolveFailed as failure:
            # no other solver helps where A is indefinite, or where a factor fails
            if isinstance(failure, IndefiniteMatrix) or self._mode == "direct":
                raise
            self._average[self._mode] = limit
            self._use(other)
            self._prepare(A)
            return self.solve(b, rtol, guess)
        self._work += self._solve_work(self._mode, info.iterations)
        self._take_note_of(self._work)
        self._work = 0.0
        return x, info

    def _take_note_of(self, work: float) -> None:
        """Put the work of a solve into the average of the solver in use; let the others fall."""
        old = self._average[self._mode]
        self._average = {mode: DECAY * average for mode, average in self._average.items()}
        self._solves[self._mode] += 1
        weight = max(WEIGHT, 1 / self._solves[self._mode])
        self._average[self._mode] = old + weight * (work - old)


NAMES = ("direct", "pardiso", "superlu", "pcg", "multigrid")
"""The names that `create` knows."""


def direct(symmetric: bool = True) -> Pardiso | SuperLU:
    """Create PARDISO if the MKL can be loaded, else SuperLU."""
    try:
        return Pardiso(symmetric)
    except (ImportError, OSError):
        return SuperLU(symmetric)


def choose(pattern: BlockPattern, symmetric: bool) -> tuple[Pardiso | SuperLU | AutoSolver, str]:
    """Create the solver "auto" for matrices of a pattern; also return a text with the reason.

    If the matrices are not symmetric, it is a direct solver.
    """
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    solver = AutoSolver(pattern, direct)
    price = solver.guess("direct")
    return solver, f"at first; a factor and a solve cost about as much as {price:.0f} iterations"


def create(name: str, symmetric: bool = True) -> Pardiso | SuperLU | PCG | Multigrid:
    """Create the solver with one of the `NAMES`.

    "direct" is PARDISO if it is available, else SuperLU. Raises `InputError` for another name,
    for an iterative solver of matrices that are not symmetric, and if PARDISO cannot be loaded.
    """
    what = f"solver {name!r}"
    where = "linalg.select.create"
    known(what, name, NAMES, where)
    if name in ("pcg", "multigrid") and not symmetric:
        remedy = 'Use "auto" or "direct"; or EnergyMomentum with tangent = "symmetric".'
        raise InputError(what, "supports symmetric matrices only", where, remedy)
    if name == "pcg":
        return PCG()
    if name == "multigrid":
        return Multigrid()
    if name == "pardiso":
        try:
            return Pardiso(symmetric)
        except (ImportError, OSError) as error:
            remedy = 'Install pypardiso (x86-64 only: "pip install pypardiso") or use "superlu".'
            raise InputError(what, f"cannot be loaded ({error})", where, remedy) from error
    if name == "superlu":
        return SuperLU(symmetric)
    return direct(symmetric)
