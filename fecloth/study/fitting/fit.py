"""`fit`: constants of a fabric from several experiments, and what these do not tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from fecloth import validation
from fecloth.errors import FeclothError, InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import relative
from fecloth.study.fitting.discrepancy import read_curve
from fecloth.study.fitting.evaluation import Evaluation, Fitting, check_signs
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.result import Fit, summarise
from fecloth.study.fitting.specimens import open_specimens
from fecloth.study.fitting.statistics import statistics
from fecloth.study.fitting.unknowns import make_unknowns
from fecloth.study.runs import Runs, announce
from fecloth.study.states import describe_several_states

OF_RUNS = ("cache", "jobs", "scheduler", "time_limit", "most_seconds", "fresh")  # how cases run
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


def fit(
    experiments: Sequence[Experiment],
    parameters: Mapping[str, float],
    *,
    fabric: Mapping[str, Any] | Fabric | None = None,
    starts: int = 1,
    refined: bool = True,
    specimens: float | str | None = None,
    loss: str = "linear",
    title: str = "fit",
    **shared: Any,
) -> Fit:
    """Find the constants with which problems meet measurements, by least squares.

    The fit makes the sum of ((computed − measured)/σ)² over all points least. It uses the
    derivatives of `fecloth.sensitivity`, and seeks positive constants by their logarithms. The
    result has for each constant its 95 % interval, whether the data tell it at all, and its
    shift by half of h and dt. The constants are the ones of the finer meshes.

    The intervals hold for new specimens. They need two specimens of one direction, or a spread
    of specimens that the user states; without, there are only the intervals of the data, which
    hold for the specimens that were measured.

    Parameters
    ----------
    experiments
        What was measured, with the problem of each specimen.
    parameters
        Where to begin, by the names of the numbers: keys of scenes, as "fabric.shear_stiffness",
        with .0 (warp) or .1 (weft) for one number of a pair, or arguments of functions.
    fabric
        The rest of the fabric, for scenes; by default each scene has its own.
    starts
        Number of starts: the given one, and others between a third and three times of it.
    refined
        Whether the fit is repeated with half of h and dt.
    specimens
        Relative standard deviation of the curves of single specimens about their mean, as "5 %".
        By default it is taken from the specimens in one direction: those that a column `repeat`
        numbers, and experiments of the same problem.
    loss
        "linear", or "soft_l1": the residuals of points far off their curve count in proportion,
        not by their square, so that a few wrong points hardly move the constants.
    title
        A name for the report.
    shared
        Arguments of `fecloth.study.of`, as h, dt, probes, jobs and cache.

    Returns
    -------
    Fit
        With `values`, `intervals`, `intervals_of_data`, `covariance`, `identified`, `misfit`,
        `numerical`, `law_fails`, `specimens`, `law`, `predictions` and `verdict`.

    Raises
    ------
    InputError
        Before the first run: for a column that is not in the data, a quantity that the run
        does not have, a value that is no number, points beyond what the run reaches, and a
        name that is no number of any problem.
    FitFailed
        If no start runs.

    Notes
    -----
    A constant is not told if its standard uncertainty is above a factor of 1.65, or above 0.25
    for Poisson's ratios; it has no interval then. The law is wrong if scatter alone gives such
    residuals with a probability below 0.5 %, by χ² of the worst curve, or by F where repeats give
    the scatter; a constant has an interval then only if other curves tell how far the law is off,
    see `fecloth/study/fitting/discrepancy.py`.

    Sources: Seber and Wild (1989), Nonlinear Regression; the trust region of Branch, Coleman
    and Li (1999) in `scipy.optimize.least_squares`.

    Examples
    --------
    Three points of the force of a strip with Y = 1000 N/m, which is 0.5 m wide:

    >>> import fecloth as fc
    >>> def strip(h, stiffness, drawn=0.1):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    ...     system = fc.System(cloth, fc.Fabric(0.2, stiffness), [fc.StVK()], ["left", "right"])
    ...     return cloth, system, None, system.state(system.rest().x * [1.0 + drawn, 1.0, 1.0])
    >>> data = {"force [N]": [57.5, 58.0, 57.9]}
    >>> test = fc.Experiment(strip, data, quantity={"force": "reaction.right.x"}, sigma="0.5 %")
    >>> answer = fc.fit([test], {"stiffness": 800.0}, h=0.25)
    >>> print(f"{answer.values['stiffness']:.1f}")
    1000.9
    """
    tests = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    if not all(isinstance(experiment, Experiment) for experiment in tests):
        raise InputError("experiments", "must be a list of Experiment", "fit")
    if not any(experiment.fitted for experiment in tests):
        raise InputError("experiments", "at least one must be fitted", "fit")
    stated = None if specimens is None else relative("specimens", specimens, "fit")
    how = Runs(**{key: shared.pop(key) for key in OF_RUNS if key in shared})
    # `make_unknowns` refuses parameters that are no mapping
    begin = parameters if isinstance(parameters, Mapping) else {}
    opened = open_specimens(tests, begin, fabric, shared)
    validation.one_of("loss", loss, LOSSES, "fit")
    fitting = Fitting(opened, make_unknowns(parameters, opened), how)
    finer_fitting = fitting.finer() if refined else None
    _announce(fitting, finer_fitting, starts)
    end, starts_that_end_there = search(fitting, starts, loss)
    remarks = list[str]()
    if starts > 1:
        remarks.append(f"{starts_that_end_there} of {starts} starts end at these constants")
    coarse_end = None
    if refined:
        why_not = "no problem has h or dt to refine"
        if finer_fitting:
            finer_end = refine(finer_fitting, end, loss)
            why_not = finer_end.cause
        if finer_fitting and not why_not:
            remarks += describe_several_states(end.folds, finer_end.folds)
            coarse_end = end
            fitting = finer_fitting
            end = finer_end
        else:
            remarks.append(f"the part of mesh and step is not known: {why_not}")
    if not all(experiment.fitted for experiment in tests):
        # the search ran the fitted experiments only
        is_converged = end.is_converged
        end = replace(fitting.evaluate(end.u, only_fitted=False), is_converged=is_converged)
        if end.cause:
            remarks.append(f"not compared: {end.cause}")
    return summarise(fitting, end, coarse_end, stated, title, remarks)


def _announce(fitting: Fitting, finer: Fitting | None, starts: int) -> None:
    """Print the size of a fit, and raise `InputError` for one that would take too long."""
    begin = np.zeros(len(fitting.unknowns))
    numbers = range(len(fitting.specimens))
    runs = USUAL_EVALUATIONS * starts * fitting.runs(begin, numbers)
    if finer:
        runs += finer.runs(begin, numbers)
    announce(runs, fitting.how)


# --- the search: Gauss-Newton steps in a trust region, from several starts ----------------------


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
