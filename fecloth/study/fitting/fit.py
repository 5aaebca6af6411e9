"""`fit`: constants of a fabric from several experiments, and what these do not tell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import relative
from fecloth.study.fitting.evaluation import Fitting
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.result import Fit, summarise
from fecloth.study.fitting.search import LOSSES, USUAL_EVALUATIONS, refine, search
from fecloth.study.fitting.specimens import open_specimens
from fecloth.study.fitting.unknowns import make_unknowns
from fecloth.study.runs import Runs, announce
from fecloth.study.states import describe_several_states

OF_RUNS = ("cache", "jobs", "scheduler", "time_limit", "most_seconds", "fresh")  # how cases run


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
        The known constants of the fabric, which replace those of all scenes; by default each
        scene keeps its own.
    starts
        Number of starts: the given one, and others between a third and three times of it.
    refined
        Whether the fit is repeated with half of h and dt.
    specimens
        By how much single specimens differ, as "5 %": the relative standard deviation of their
        curves. By default it is taken from the specimens of one direction, which a column `repeat`
        numbers, or which are experiments of the same problem.
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
