"""The linear solver "auto": conjugate gradients or a factorisation, whichever is cheaper.

On large cloths multigrid takes the place of block Jacobi in the conjugate gradients as soon as
they need many iterations.

The solver starts with conjugate gradients and counts the work of each step. From time to time it
tries the other solver for a few steps. If conjugate gradients take more work than two
factorisations, it factorises at once. All decisions use counts and not time, so that a run can be
repeated bit for bit. The unit of work is one iteration of `PCG`.

The solver never starts with a factorisation, even if it is predicted to be cheaper. The prediction
is accurate to a factor of 3 in a time step, and useless in a static solution. A trial of conjugate
gradients costs little. The first factorisation costs as much as five later ones, and the time to
load the MKL.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.direct import Pardiso, SuperLU
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import SolveInfo, check_arguments

# Work in iterations of PCG.
ASSEMBLY = 5.0  # to assemble a tangent
OVERHEAD = 3.0  # to evaluate a residual, and the rest of a Newton iteration
SOLVES = {"pardiso": 8.0, "superlu": 30.0}  # (factorisation + solve) / solve
WASTED = 1.4  # ratio of Newton iterations with solves to 0.01 to those with exact solves
FIRST, LONGEST = 8, 256  # steps between two trials: doubled after each failed trial
TRIAL = {"pcg": 2, "direct": 8}  # steps of a trial; a factor must be used for a while to pay off
MARGIN = 0.9  # a trial succeeds if its work is below this share of the other solver's work
LARGE, MANY = 10_000, 100  # nodes, and iterations of `PCG`, from which on multigrid is cheaper
CYCLE = 10.0  # an iteration with multigrid, 50,000 triangles
LOADING = 1e7  # iterations times nodes that take as long as loading the MKL, 0.4 s


class AutoSolver:
    """`PCG`, `Multigrid` or a direct solver for a symmetric matrix; `name` is the current one's.

    Parameters
    ----------
    nodes
        Number of nodes.
    iterations
        Predicted number of iterations of PCG to a relative residual of 0.01.
    price
        Function of the name of a direct solver. It returns the time of a factorisation and a solve
        in iterations of PCG.
    direct
        Function that creates the direct solver. It is called at the first use, because it may load
        the MKL.
    """

    symmetric = keeps_state = True

    _mode: str
    _home: str
    _steps: int
    _work: float
    _size: float | None
    _A: BlockMatrix | None
    _begun: tuple[float, float, np.ndarray] | None

    def __init__(
        self,
        nodes: int,
        iterations: float,
        price: Callable[[str], float],
        direct: Callable[[], Pardiso | SuperLU],
    ):
        self.nodes, self._price, self._make = nodes, price, direct
        self.predicted = iterations
        self.prepared = 0
        self.drop()

    def drop(self) -> None:
        """Reset to the initial state: remove all counts and the direct solver."""
        self._solvers: dict[str, PCG | Pardiso | SuperLU] = {}
        self._A, self._size, self._begun, self._spent = None, None, None, 0
        self._iterations = self.predicted
        self._settle()

    @property
    def name(self) -> str:
        return self._solver.name

    @property
    def price(self) -> float:
        """Work of a factorisation and a solve; PARDISO's before the direct solver is created."""
        return self._price(self._direct_name)

    @property
    def _direct_name(self) -> str:
        return self._solvers["direct"].name if "direct" in self._solvers else "pardiso"

    # --- the work of a step -----------------------------------------------------------------------

    def prepare(self, A: BlockMatrix) -> None:
        """Let the current solver prepare A."""
        self.prepared, self._A = self.prepared + 1, None
        self._work += ASSEMBLY
        if self._mode == "direct":
            self._work += self.price * (1 - 1 / SOLVES[self.name])
        self._solver.prepare(A)
        self._A = A

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b: x (n, 3) and its `SolveInfo`.

        If PCG exceeds its limit of iterations, multigrid follows on a large cloth, and then or
        otherwise a factorisation.

        Raises
        ------
        IndefiniteMatrix
            If PCG or the direct solver finds that A is not positive definite.
        """
        A, _, _ = check_arguments(self._A, b, rtol)
        if not isinstance(self._solver, PCG):
            x, info = self._solver.solve(b, rtol, guess)
            self._work += OVERHEAD + (1 + info.iterations) * self.price / SOLVES[self.name]
            return x, info
        self._solver.max_iterations = limit = self._limit()
        try:
            x, info = self._solver.solve(b, rtol, guess)
        except IndefiniteMatrix:
            raise
        except SolveFailed:
            self._spent += int(limit * self._cost)
            self._fall_over(A)
            return self.solve(b, rtol, guess)
        self._last, work = info.iterations, info.iterations * self._cost
        self._work += OVERHEAD + work
        self._spent += int(work)
        self._iterations += 0.25 * (work - self._iterations)
        return x, info

    @property
    def _cost(self) -> float:
        """Work of an iteration."""
        return CYCLE if isinstance(self._solver, Multigrid) else 1.0

    def _limit(self) -> int:
        """Limit of iterations of one solve: two factorisations, or the rest of a trial's work."""
        limit = 2 * self.price
        if self._mode != self._home:
            limit = min(limit, TRIAL["pcg"] * self._home_work - self._work)
        return max(10, int(limit / self._cost))

    def _fall_over(self, A: BlockMatrix) -> None:
        """Continue with the same matrix, by multigrid on a large cloth or by a factorisation."""
        if self._take_multigrid():
            self.prepare(A)
            return
        lost = self._mode != self._home
        self._patience = self._longer() if lost else FIRST
        self._home = "direct"
        self._use("direct")
        self.prepare(A)

    # --- between two steps ------------------------------------------------------------------------

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Begin a step near x (n, 3) with these weights: evaluate the last one, select the solver.

        If dt has changed by more than a factor of 2 since the counts began, the counts are reset.
        The predicted iterations are then scaled by √(wx/wa): they are proportional to √κ, and κ is
        proportional to wx/wa, that is dt².
        """
        size = wx / wa
        self._size = size if self._size is None else self._size
        if not 0.25 <= size / self._size <= 4:
            self._iterations *= math.sqrt(size / self._size)
            self._size = size
            self._settle()
        elif self._mode == self._home:
            self._after_a_step_at_home()
        else:
            self._after_a_step_of_a_trial()
        self._steps += 1
        self._begun = wx, wa, x
        if self._mode == "pcg" and self._last > MANY:
            self._take_multigrid()
        self._solver.begin(wx, wa, x)

    def _take_multigrid(self) -> bool:
        """Replace block Jacobi by multigrid; False on a small cloth, or if it is in use."""
        if self.nodes < LARGE or isinstance(self._solvers["pcg"], Multigrid):
            return False
        self._solvers["pcg"], self._mode = Multigrid(), ""
        self._use("pcg")
        if self._begun:
            self._solver.begin(*self._begun)
        return True

    def _after_a_step_at_home(self) -> None:
        if self._steps < self._patience:
            return
        self._home_work = self._work / self._steps
        other = "direct" if self._home == "pcg" else "pcg"
        self._use(other if self._worth_trying(other) else self._home)

    def _after_a_step_of_a_trial(self) -> None:
        count = TRIAL[self._mode]
        if self._work > MARGIN * count * self._home_work:
            self._patience = self._longer()
            self._use(self._home)
        elif self._steps >= count:
            unknown = math.isinf(self._home_work)  # the direct solver was predicted to be cheaper
            self._home, self._patience = self._mode, count if unknown else FIRST

    def _worth_trying(self, mode: str) -> bool:
        """Whether a trial of `mode` can pay off.

        A trial of a factorisation can pay off only if a step with PCG takes more work than two
        solves, and all steps up to now more than loading the MKL.
        """
        if mode == "pcg":
            return True
        if "direct" not in self._solvers and self._spent * self.nodes < LOADING:
            return False
        return self._home_work > 2 * self.price / SOLVES[self._direct_name]

    def _settle(self) -> None:
        """Start with PCG; this is a trial if a factorisation is predicted to be cheaper."""
        self._solvers["pcg"], self._last = PCG(), 0
        iterates = WASTED * self._iterations <= self.price
        self._home = "pcg" if iterates else "direct"
        self._home_work, self._patience, self._mode = math.inf, FIRST, ""  # no mode yet
        self._use("pcg")

    def _use(self, mode: str) -> None:
        """Select a mode and reset its counts; after a change of mode A must be prepared again."""
        if mode != self._mode:
            self.prepared, self._A = self.prepared + 1, None
        self._mode, self._solver = mode, self._get(mode)
        self._steps, self._work = 0, 0.0

    def _get(self, mode: str) -> PCG | Pardiso | SuperLU:
        if mode not in self._solvers:
            self._solvers[mode] = self._make()
        return self._solvers[mode]

    def _longer(self) -> int:
        return min(2 * self._patience, LONGEST)
