"""The search for constants: Gauss-Newton steps in a trust region, from several starts."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from fecloth.errors import FeclothError, InputError
from fecloth.study.fitting.evaluation import Evaluation, Fitting
from fecloth.study.fitting.statistics import statistics

PULL = 0.3  # towards the center, per unit of u: it holds what the data do not tell
EXACT = {"xtol": 1e-4, "ftol": 1e-4, "gtol": 1e-9}
HOLD = 10.0  # the same for what is known not to be told
MOST, FEW = 60, 8  # evaluations of a start, and on finer meshes
SPREAD = np.log(3.0)  # of other starts, in u: between a third and three times the first
SAME = 0.02  # of u: ends of two starts that are the same place


class FitFailed(FeclothError):
    """No start of a fit ran."""


@dataclass(eq=False)
class Search:
    """The search from one start; it keeps what it has evaluated."""

    fitting: Fitting
    center: np.ndarray  # (m,) where the pull is to
    pull: np.ndarray  # (k, m) its rows, beside the residuals
    most: int = MOST
    phase: str = ""  # a word for the lines of progress
    known: dict[bytes, Evaluation] = field(default_factory=dict)

    def at(self, u: np.ndarray) -> Evaluation:
        key = u.tobytes()
        if key not in self.known:
            self.known[key] = self.fitting.evaluate(u)
            self.fitting.report(len(self.known), self.known[key], self.phase)
        return self.known[key]

    def residual(self, u: np.ndarray) -> np.ndarray:
        pulled = self.pull @ (u - self.center)
        return np.append(self.at(u).residual(self.fitting.blocks), pulled)

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        rows = self.at(u).jacobian(self.fitting.blocks)
        return np.concatenate([rows, self.pull])

    def run(self, begin: np.ndarray) -> Evaluation:
        """Search from `begin`; a failed run there ends it."""
        first = self.at(begin)
        if first.cause:
            return first
        self.fitting.check_signs(first)
        limits = np.array([each.bounds for each in self.fitting.unknowns]).T
        bounds = (-np.inf, np.inf) if np.isinf(limits).all() else limits
        solved = least_squares(
            self.residual, begin, self.jacobian, bounds, x_scale=1.0, max_nfev=self.most, **EXACT
        )
        return self.at(solved.x)


@dataclass(frozen=True, eq=False)
class Place:
    """Where the searches ended."""

    best: Evaluation
    same: int  # number of the starts that ended there
    starts: int


def search(fitting: Fitting, starts: int) -> Place:
    """Search from the given start, and from others around it; the least misfit counts.

    It raises `FitFailed` if no start runs.
    """
    if not (isinstance(starts, int) and 1 <= starts <= 100):
        raise InputError(f"starts = {starts!r}", "must be an integer from 1 to 100", "fit")
    ends = []
    for begin in _begins(fitting, starts):
        ends.append(Search(fitting, begin, PULL * np.eye(len(begin))).run(begin))
    ran = [end for end in ends if not end.cause]
    if not ran:
        remedy = "Begin elsewhere, or give starts = 5."
        raise FitFailed(f"no start of the fit runs: {ends[0].cause}. {remedy}")
    best = min(ran, key=lambda end: float((end.residual(fitting.blocks) ** 2).sum()))
    same = [end for end in ran if np.abs(end.u - best.u).max() < SAME]
    return Place(best, len(same), starts)


def refine(fitting: Fitting, end: Evaluation) -> Evaluation:
    """Go on from the end of a search, with finer meshes and shorter steps.

    Combinations that the data do not tell stay as they are.
    """
    untold = statistics(fitting, end).untold
    pull = np.concatenate([PULL * np.eye(len(end.u)), HOLD * untold])
    return Search(fitting, end.u, pull, FEW, "finer mesh, ").run(end.u)


def _begins(fitting: Fitting, starts: int) -> list[np.ndarray]:
    count = len(fitting.unknowns)
    others = qmc.LatinHypercube(count, seed=0).random(starts - 1) if starts > 1 else []
    return [np.zeros(count), *(SPREAD * (2 * np.asarray(place) - 1) for place in others)]
