"""The solver that "auto" is: conjugate gradients or a factorisation, whichever turns out cheaper.

It starts with conjugate gradients, keeps an account of the work of every step, and tries the other
one now and then; at once where the conjugate gradients need more than two factorisations are worth.
All is decided by counts, never by the clock, so that a run repeats bit for bit; the unit of work is
an iteration of `PCG`.

Why not with a factorisation where that is predicted to be cheaper: the prediction is good to a
factor 3 in a step of time and worthless in a static one, a trial of conjugate gradients costs
little, and the first factorisation costs five later ones, and loading the MKL besides.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.direct import Pardiso, SuperLU
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import SolveInfo, checked

ASSEMBLY, OVERHEAD = 5.0, 3.0  # of a tangent; of a residual and what else belongs to an iteration
SOLVES = {"pardiso": 8.0, "superlu": 30.0}  # that cost as much as a factorisation and one of them
WASTED = 1.4  # Newton takes more steps when each is solved to 0.01 only than with exact ones
FIRST, LONGEST = 8, 256  # steps between two trials: doubled after each that was lost
TRIAL = {"pcg": 2, "direct": 8}  # steps; a factor has to last for a while before it pays
MARGIN = 0.9  # of the other's work: a trial that takes less is won
LOADING = 1e7  # iterations times nodes that take as long as loading the MKL, 0.4 s


class Cheapest:
    """`PCG` or a direct solver for a symmetric matrix; `name` is that of the one in use.

    Parameters
    ----------
    nodes
        Number of nodes.
    iterations
        Of PCG to a residual of 0.01, as predicted.
    price
        Name of a direct solver → time of a factorisation and a solve in iterations of PCG.
    direct
        Makes the direct solver; called when one is needed first, as it may load the MKL.
    """

    symmetric = keeps_state = True

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
        """Forget the accounts, and which direct solver there is: start as at first."""
        self._solvers: dict[str, PCG | Pardiso | SuperLU] = {"pcg": PCG()}
        self._A, self._size, self._spent = None, None, 0
        self._iterations = self.predicted
        self._settle()

    @property
    def name(self) -> str:
        return self._solver.name

    @property
    def price(self) -> float:
        """Of a factorisation and a solve; PARDISO's while it is not known which one there is."""
        return self._price(self._solvers["direct"].name if "direct" in self._solvers else "pardiso")

    # --- the work of a step -----------------------------------------------------------------------

    def prepare(self, A: BlockMatrix) -> None:
        """Factorise A, or invert its diagonal blocks."""
        self.prepared, self._A = self.prepared + 1, None
        self._work += ASSEMBLY
        if self._mode == "direct":
            self._work += self.price * (1 - 1 / SOLVES[self.name])
        self._solver.prepare(A)
        self._A = A

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """x (n, 3) and its `SolveInfo`; by factorisation where PCG needs more than that is worth.

        A matrix that PCG finds to be indefinite is indefinite for both.
        """
        checked(self._A, b, rtol)
        if self._mode == "direct":
            x, info = self._solver.solve(b, rtol, guess)
            self._work += OVERHEAD + (1 + info.iterations) * self.price / SOLVES[self.name]
            return x, info
        self._solver.max_iterations = limit = self._limit()
        try:
            x, info = self._solver.solve(b, rtol, guess)
        except IndefiniteMatrix:
            raise
        except SolveFailed:
            self._spent += limit
            self._fall_over()
            return self.solve(b, rtol, guess)
        self._work += OVERHEAD + info.iterations
        self._spent += info.iterations
        self._iterations += 0.25 * (info.iterations - self._iterations)
        return x, info

    def _limit(self) -> int:
        """Iterations worth spending on one solve: two factorisations, or what a trial has left."""
        limit = 2 * self.price
        if self._mode != self._home:
            limit = min(limit, TRIAL["pcg"] * self._home_work - self._work)
        return max(10, int(limit))

    def _fall_over(self) -> None:
        """PCG needs too long: factorise the same matrix, and stay with that."""
        A, lost = self._A, self._mode != self._home
        self._patience = self._longer() if lost else FIRST
        self._home = "direct"
        self._use("direct")
        self.prepare(A)

    # --- between two steps ------------------------------------------------------------------------

    def begin(self, wx: float, wa: float) -> None:
        """A step with these weights begins: account for the last one, and choose for this one.

        Where dt has changed by more than a factor 2 since the accounts were opened, it starts
        anew, with a prediction in proportion: iterations go with √κ, and κ with wx/wa, or dt².
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
            unknown = math.isinf(self._home_work)  # what the prediction had for the cheaper
            self._home, self._patience = self._mode, count if unknown else FIRST

    def _worth_trying(self, mode: str) -> bool:
        """A factorisation only if PCG takes more than two solves, also than loading the MKL."""
        if mode == "pcg":
            return True
        dear = self._home_work > 2 * self.price / SOLVES["pardiso"]
        if not dear or ("direct" not in self._solvers and self._spent * self.nodes < LOADING):
            return False
        return self._home_work > 2 * self.price / SOLVES[self._get("direct").name]

    def _settle(self) -> None:
        """Start with PCG: on trial, if a factorisation is predicted to be cheaper."""
        iterates = WASTED * self._iterations <= self.price
        self._home = "pcg" if iterates else "direct"
        self._home_work, self._patience, self._mode = math.inf, FIRST, None
        self._use("pcg")

    def _use(self, mode: str) -> None:
        """Begin to count the steps of a mode; a change of it gives up what was prepared."""
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
