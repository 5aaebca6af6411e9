"""The search of a fit: Gauss-Newton steps in a trust region, from several starts."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from fecloth import validation
from fecloth.errors import FeclothError
from fecloth.study.fitting.amplitude import read_curve
from fecloth.study.fitting.evaluation import Evaluation, Fitting, check_signs
from fecloth.study.fitting.statistics import statistics

# Evaluations that a start usually takes. On finer meshes, where it begins near the end, no more
# are made.
USUAL_EVALUATIONS = 8
MOST_EVALUATIONS = 60  # of a start, which then ends where it is
# Residual per unit of u, beside the residuals of the points in their uncertainties: it pulls
# towards the start, and holds what the data do not tell. It is small beside the residual 2 of a
# constant that is just told, see `LARGEST_UNCERTAINTY`.
PULL = 0.3
# The same for combinations that are known not to be told: these stay where they are.
PULL_OF_UNTOLD = 10.0
LOSSES = ("linear", "soft_l1")
EXACT = {"xtol": 1e-4, "ftol": 1e-4, "gtol": 1e-9}  # far below the uncertainty of constants
LARGEST_START = np.log(3.0)  # |u| of other starts: between a third and three times the first
# |change of u| from which amplitudes of curves, in place of residuals, give the first step: where
# the start is off by more than a factor 3, residuals hardly depend on the constants.
FAR = np.log(3.0)
SAME_PLACE = 0.02  # distance of two ends in u that are the same place: 2 % of a constant


class FitFailed(FeclothError):
    """No start of a fit ran."""


@dataclass(eq=False)
class Search:
    """The search from one start; it keeps what it has evaluated.

    Attributes
    ----------
    fitting
        What is evaluated.
    center
        (m,) place in u to which the pull is.
    pull
        (k, m) rows: the residuals `pull` @ (u − `center`) stand beside the ones of the points.
    most
        Largest number of evaluations.
    phase
        A word for the lines of progress.
    loss
        As for `fit`.
    known
        What was evaluated, by the bytes of u.
    """

    fitting: Fitting
    center: np.ndarray
    pull: np.ndarray
    most: int = MOST_EVALUATIONS
    phase: str = ""
    loss: str = "linear"
    known: dict[bytes, Evaluation] = field(default_factory=dict)

    def at(self, u: np.ndarray) -> Evaluation:
        """Return the evaluation at u, and report it if it is new."""
        key = u.tobytes()
        if key not in self.known:
            self.known[key] = self.fitting.evaluate(u)
            self.fitting.report(len(self.known), self.known[key], self.phase)
        return self.known[key]

    def residual(self, u: np.ndarray) -> np.ndarray:
        """Return the residuals of the points, then those of the pull."""
        pulled = self.pull @ (u - self.center)
        return np.append(self.at(u).residual, pulled)

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals by u."""
        return np.concatenate([self.at(u).jacobian, self.pull])

    def run(self, begin: np.ndarray) -> Evaluation:
        """Return the evaluation with the least residuals near `begin`, a place u (m,).

        If a run fails at `begin`, return the evaluation there, whose `cause` says why. Raise
        `InputError` if a measured column has the opposite sign of the computed one.
        """
        first = self.at(begin)
        if first.cause:
            return first
        check_signs(first)
        begin = self.nearer(first)
        solved = least_squares(
            self.residual,
            begin,
            self.jacobian,
            bounds=np.array([unknown.bounds for unknown in self.fitting.unknowns]).T,
            x_scale=1.0,
            max_nfev=self.most,
            loss=self.loss,
            **EXACT,
        )
        # status 0: the number of evaluations was reached
        return replace(self.at(solved.x), is_converged=solved.status > 0)

    def nearer(self, first: Evaluation) -> np.ndarray:
        """Return where the search begins: `first.u`, or nearer if the curves are far off.

        The amplitudes of all curves tell how far each constant is off: a = A Δu, by least
        squares. Where a run fails with these constants, the search begins at `first.u`.
        """
        curves = list(filter(None, map(read_curve, first.fitted)))
        if not curves:
            return first.u
        slopes = np.array([curve.slopes for curve in curves])
        amplitudes = np.array([curve.amplitude for curve in curves])
        step = np.linalg.lstsq(slopes, amplitudes, rcond=0.01)[0]
        low, high = np.array([unknown.bounds for unknown in self.fitting.unknowns]).T
        moved = np.clip(first.u + step, low, high)
        if np.abs(step).max() < FAR or self.at(moved).cause:
            return first.u
        return moved


def search(fitting: Fitting, starts: int, loss: str = "linear") -> tuple[Evaluation, int]:
    """Search from the given start and from others.

    Return the end with the least misfit, and the number of starts that end at the same place.

    Raises
    ------
    FitFailed
        If no start runs.
    InputError
        For a number of starts outside 1 to 100.
    """
    validation.whole("starts", starts, 1, "fit", most=100)
    ends = []
    for begin in choose_starts(len(fitting.unknowns), starts):
        pull = PULL * np.eye(len(begin))
        ends.append(Search(fitting, begin, pull, loss=loss).run(begin))
    ends_that_ran = [end for end in ends if not end.cause]
    if not ends_that_ran:
        remedy = "Begin elsewhere, or give starts = 5."
        raise FitFailed(f"no start of the fit runs: {ends[0].cause}. {remedy}")
    best = min(ends_that_ran, key=lambda end: float((end.residual**2).sum()))
    at_same_place = [end for end in ends_that_ran if np.abs(end.u - best.u).max() < SAME_PLACE]
    return best, len(at_same_place)


def refine(fitting: Fitting, end: Evaluation, loss: str) -> Evaluation:
    """Search again from the `end` of a search, with the finer meshes and steps of `fitting`.

    Return where this search ends. A strong pull keeps combinations of the unknowns that the data
    do not tell at their place.
    """
    pull_of_untold = PULL_OF_UNTOLD * statistics(end).untold
    finer_search = Search(
        fitting=fitting,
        center=end.u,
        pull=np.concatenate([PULL * np.eye(len(end.u)), pull_of_untold]),
        most=USUAL_EVALUATIONS,
        phase="finer mesh, ",
        loss=loss,
    )
    return replace(finer_search.run(end.u), is_converged=end.is_converged)


def choose_starts(unknowns: int, starts: int) -> list[np.ndarray]:
    """Return the places where the search begins, (m,) each in u: first the given one, u = 0.

    The others lie in a Latin hypercube, on both sides of it.
    """
    if starts == 1:
        return [np.zeros(unknowns)]
    from scipy.stats import qmc  # takes most of a second, which few commands need

    hypercube = qmc.LatinHypercube(unknowns, seed=0).random(starts - 1)  # from 0 to 1
    others = LARGEST_START * (2 * hypercube - 1)
    return [np.zeros(unknowns), *others]
