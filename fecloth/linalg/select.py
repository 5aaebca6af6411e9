"""Selection of a solver of A x = b for a `BlockMatrix`, by name or by the work of each.

`linalg.protocol.LinearSolver` says what they offer. For every x that is returned, the residual
was computed with A and is small enough.

The solver "auto" is conjugate gradients, multigrid or a factorisation: each matrix goes to the
solver whose solves have taken the least work on average. Conjugate gradients begin. The other
averages begin with estimates, and their first set-up, such as the analysis of the pattern, is
spread over as many solves as the run has had. So a solver that may be the best is tried early, and
one that is dear to set up later or never. The averages of the solvers that are not in use fall
slowly, so that each solver is tried again at times; the more work it took, the later. If a solve
takes several times the work of the cheapest other solver, it is given up. Then this work counts as
the average of the first solver, and the other one continues at once. If the step size changes by
more than a factor of 2, all averages begin anew. Where the pattern of the matrices changes, as
with contact, the work of its analysis is added, in proportion to how often it changed lately.

Work is counted: iterations, cycles, coarse matrices, factors and their entries, tangents. Each has
its price in `prices`. The seconds of the run do not matter, so that a run repeats bit for bit.
`studies.evidence.benchmarks.auto_solver` compares whole runs with those of the best solver.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec

import numpy as np

from fecloth.errors import IndefiniteMatrix, InputError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.direct import Direct, Pardiso, Rslab, SuperLU
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.linalg.prices import FactorPrices, Prices
from fecloth.linalg.protocol import SolveInfo, check_arguments
from fecloth.validation import known

# Cycles of a solve with multigrid, as an estimate.
CYCLES = 10
# New factors for each solve with a direct solver, as an estimate.
FACTORS_PER_SOLVE = 0.45
# The first set-up of a solver is spread over so many solves at least.
FEWEST_SOLVES = 20
# An estimate counts as so many solves in the average.
ESTIMATE = 6
# Weight of a new solve in the average, after larger ones for the first solves.
WEIGHT = 1 / 20
# Factor on the averages of the other solvers for each solve: they fall by half in 350 solves.
DECAY = 0.998
# Another solver is taken if its average is less than this share of the average in use.
RATIO_FOR_CHANGE = 0.95
# A solve is given up if it takes more than this factor times the average of another solver.
PATIENCE = 2.0


class AutoSolver:
    """The solver "auto" for symmetric matrices: `PCG`, `Multigrid` or a direct solver.

    `direct` makes the direct solver; None: there is none. The `name` is the name of the solver
    in use, and `work` what all solves have taken so far, in block products.
    """

    symmetric = True
    keeps_state = True
    _A: BlockMatrix | None

    def __init__(self, pattern: BlockPattern, direct: Callable[[], Direct] | None):
        """Begin with conjugate gradients, for matrices of about this pattern."""
        self.prepared = 0
        self.work = 0.0
        self._prices = Prices.of(pattern)
        self._make: dict[str, Callable[[], PCG | Direct]]
        self._make = {"pcg": PCG, "multigrid": Multigrid}
        if direct:
            self._make["direct"] = direct
        self._expected = expected() if direct else "pardiso"
        self.drop()

    def drop(self) -> None:
        """Reset to the initial state: remove all averages and solvers."""
        self._solvers: dict[str, PCG | Direct] = {}
        self._step_begun: tuple[float, float, np.ndarray] | None = None
        self._reset_averages()

    def _reset_averages(self) -> None:
        """Begin anew with conjugate gradients and estimated averages; keep the solvers."""
        self._first_size: float | None = None  # wx/wa of the first step
        self._pattern: BlockPattern | None = None  # of the last matrix
        self._new_patterns = 0.0  # share of recent matrices whose pattern was new
        self._work = 0.0  # since the last solve
        self._solves = 0  # since these averages began
        # no estimate of conjugate gradients: they begin
        self._average = {"pcg": 0.0} | {mode: self.estimate(mode) for mode in self._others}
        self._use("pcg")

    def _use(self, mode: str) -> None:
        """Take the solver of a mode ("pcg", "direct" or "multigrid"); make it if necessary.

        It has no matrix then: `prepare` must follow. It is told of the step that has begun.
        """
        if mode not in self._solvers:
            self._solvers[mode] = self._make[mode]()
            if mode != "pcg":  # only now it is known which direct solver there is
                self._average[mode] = self.estimate(mode)
        self._mode = mode
        self._solver = self._solvers[mode]
        self._solves_in_use = 0
        self.prepared = self.prepared + 1
        self._A = None
        if self._step_begun:
            self._solver.begin(*self._step_begun)

    @property
    def name(self) -> str:
        """Name of the solver in use."""
        return self._solver.name

    @property
    def _factor_prices(self) -> FactorPrices:
        """The prices of the direct solver: of the one to expect until it is made.

        Without a direct solver they are the prices of PARDISO.
        """
        solver = self._solvers.get("direct")
        if solver is not None:
            return self._prices.factors[solver.name]
        return self._prices.factors[self._expected]

    @property
    def _entries(self) -> float:
        """Entries of the factor of the direct solver; an estimate if there is none yet."""
        solver = self._solvers.get("direct")
        return getattr(solver, "entries", 0) or self._factor_prices.entries

    def estimate(self, mode: str) -> float:
        """The work for a matrix and a solve with "direct" or "multigrid", as an estimate."""
        if mode == "multigrid":
            return self._prepare_work(mode) + self._solve_work(mode, CYCLES)
        factors = FACTORS_PER_SOLVE * self._prepare_work(mode)
        return factors + self._solve_work(mode, 0)

    def _set_up_work(self, mode: str) -> float:
        """The work of the first matrix of a pattern beyond the work of the next ones."""
        if mode == "multigrid":
            return self._prices.grids + self._prices.coarse
        return self._factor_prices.analysis if mode == "direct" else 0.0

    def _cost(self, mode: str) -> float:
        """The average work of a solve, with its share of set-ups past and to come."""
        set_up = self._set_up_work(mode)
        cost = self._average[mode] + self._new_patterns * set_up
        if mode not in self._solvers:
            load = self._factor_prices.load if mode == "direct" else 0.0
            cost += (set_up + load) / max(FEWEST_SOLVES, self._solves)
        return cost

    def _prepare_work(self, mode: str) -> float:
        """The work of a tangent and of what the solver makes of it."""
        work = self._prices.tangent
        if mode == "direct":
            work += self._factor_prices.factor * self._entries
        if mode == "multigrid":
            work += self._prices.refill
        return work

    def _solve_work(self, mode: str, iterations: int) -> float:
        """The work of a solve and of the residual that it is for.

        `iterations` is the number of iterations of the solver. For a direct solver it is the
        number of refinements; each costs a solve with the factor.
        """
        work = self._prices.residual
        if mode == "direct":
            return work + (1 + iterations) * self._factor_prices.solve * self._entries
        return work + iterations * (self._prices.cycle if mode == "multigrid" else 1.0)

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
        while self._solves and self._cost(self._cheapest) < (
            RATIO_FOR_CHANGE * self._cost(self._mode)
        ):
            self._use(self._cheapest)
        self._prepare(A)

    @property
    def _others(self) -> list[str]:
        """The modes besides conjugate gradients, which begin."""
        return [mode for mode in self._make if mode != "pcg"]

    @property
    def _cheapest(self) -> str:
        """The mode whose solves cost the least."""
        return min(self._make, key=self._cost)

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

        If it fails or takes more than `PATIENCE` times the work of the cheapest other solver, that
        one takes over and solves at once. The work goes into the averages. Raises
        `IndefiniteMatrix` if A is not positive definite, and `SolveFailed` if the direct solver
        fails.
        """
        A, _, _ = check_arguments(self._A, b, rtol)
        others = [mode for mode in self._others if mode != self._mode]
        limit = PATIENCE * min(map(self._cost, others), default=math.inf)
        if isinstance(self._solver, PCG) and others:
            price = self._solve_work(self._mode, 1) - self._solve_work(self._mode, 0)
            self._solver.max_iterations = max(10, int(limit / price))
        wear = self._wear
        try:
            x, info = self._solver.solve(b, rtol, guess)
        except SolveFailed as failure:
            # no other solver helps where A is indefinite, or where a factor fails
            if isinstance(failure, IndefiniteMatrix) or self._mode == "direct" or not others:
                raise
            self._average[self._mode] = limit
            self._solves += 1
            self._use(min(others, key=self._cost))
            self._prepare(A)
            return self.solve(b, rtol, guess)
        self._work += self._solve_work(self._mode, info.iterations)
        self._work += (self._wear - wear) * self._prices.coarse
        self._take_note_of(self._work)
        self.work += self._work
        self._work = 0.0
        return x, info

    @property
    def _wear(self) -> float:
        """The part of its coarse matrices that the solver in use has worn out."""
        return self._solver.wear if isinstance(self._solver, Multigrid) else 0.0

    def _take_note_of(self, work: float) -> None:
        """Put the work of a solve into the average of the solver in use; let the others fall."""
        old = self._average[self._mode]
        self._average = {mode: DECAY * average for mode, average in self._average.items()}
        self._solves += 1
        self._solves_in_use += 1
        estimated = 0 if self._mode == "pcg" else ESTIMATE
        weight = max(WEIGHT, 1 / (estimated + self._solves_in_use))
        self._average[self._mode] = old + weight * (work - old)


NAMES = ("direct", "pardiso", "rslab", "superlu", "pcg", "multigrid")
"""The names that `create` knows."""
DIRECT = {"pardiso": Pardiso, "rslab": Rslab, "superlu": SuperLU}
"""The direct solvers, the fastest first."""
PACKAGES = {"pardiso": "pypardiso", "rslab": "rslab", "superlu": "scipy"}


def direct(symmetric: bool = True) -> Direct:
    """Create the first of `DIRECT` that can be loaded."""
    for make in (Pardiso, Rslab):
        with suppress(ImportError, OSError):
            return make(symmetric)
    return SuperLU(symmetric)


def expected() -> str:
    """The name of the solver that `direct` makes, if its package loads; it is not loaded here."""
    return next(name for name, package in PACKAGES.items() if find_spec(package))


def choose(pattern: BlockPattern, symmetric: bool) -> tuple[Direct | AutoSolver, str]:
    """Create the solver "auto" for matrices of a pattern; also return a text with the reason.

    If the matrices are not symmetric, it is a direct solver.
    """
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    solver = AutoSolver(pattern, direct)
    price = solver.estimate("direct")
    return solver, f"at first; a factor and a solve cost about as much as {price:.0f} iterations"


def create(name: str, symmetric: bool = True) -> Direct | PCG:
    """Create the solver with one of the `NAMES`.

    "direct" is the first of `DIRECT` that is available. Raises `InputError` for another name, for
    an iterative solver of matrices that are not symmetric, and if a package cannot be loaded.
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
    if name == "direct":
        return direct(symmetric)
    try:
        return DIRECT[name](symmetric)
    except (ImportError, OSError) as error:
        remedy = f'Install it by "pip install {PACKAGES[name]}", or use "direct".'
        raise InputError(what, f"cannot be loaded ({error})", where, remedy) from error
