"""`fit`: constants of a fabric from several experiments, and what these do not tell."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.study.fitting.evaluation import Fitting
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.result import Fit, summarise
from fecloth.study.fitting.search import Place, refine, search
from fecloth.study.fitting.specimens import open_specimens
from fecloth.study.fitting.unknowns import make_unknowns
from fecloth.study.run_problems import Runs
from fecloth.study.workload import check_size

EVALUATIONS = 8  # that a start usually takes
HOW = ("cache", "jobs", "scheduler", "time_limit", "most_seconds", "fresh")  # how cases run


def fit(
    experiments: Sequence[Experiment],
    parameters: Mapping[str, float],
    *,
    fabric: Mapping[str, Any] | Fabric | None = None,
    starts: int = 1,
    refined: bool = True,
    title: str = "fit",
    **shared: Any,
) -> Fit:
    """Find the constants with which problems meet measurements, by least squares.

    The sum of ((computed − measured)/σ)² over all points is least. The derivatives are the
    derivatives of `fecloth.sensitivity`; constants that are positive are sought by their
    logarithms. Beside each constant stands its 95 % interval, whether the data tell it at all, and
    its shift by half of h and dt; the constants are the ones of the finer meshes.

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
    title
        A name for the report.
    shared
        Arguments of `fecloth.study.of`, as h, dt, probes, jobs and cache.

    Returns
    -------
    Fit
        With `values`, `intervals`, `covariance`, `identified`, `misfit`, `numerical`, `law_fails`
        and `verdict`.

    Raises
    ------
    InputError
        Before the first run: for a column that is not in the data, a quantity that the run does not
        have, a value that is no number, points beyond what the run reaches, and a name that is no
        number of any problem.
    FitFailed
        If no start runs.

    Notes
    -----
    A constant is not told if its standard uncertainty is above a factor of 1.65, or above 0.25 for
    Poisson's ratios; it has no interval then. The law is wrong if scatter alone gives such
    residuals with a probability below 0.5 %, by χ², or F where repeats give the scatter; no
    constant has an interval then.

    Sources: Seber and Wild (1989), Nonlinear Regression; the trust region of Branch, Coleman and Li
    (1999) in `scipy.optimize.least_squares`.

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
    listed = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    if not all(isinstance(each, Experiment) for each in listed):
        raise InputError("experiments", "must be a list of Experiment", "fit")
    if not any(each.fitted for each in listed):
        raise InputError("experiments", "at least one must be fitted", "fit")
    runs = Runs(**{key: shared.pop(key) for key in HOW if key in shared})
    sought = parameters if isinstance(parameters, Mapping) else {}
    specimens = open_specimens(listed, sought, fabric, shared)
    fitting = Fitting(specimens, make_unknowns(parameters, specimens), runs)
    _check_cost(fitting, starts, refined)
    place = search(fitting, starts)
    finer = fitting.finer() if refined else None
    end, coarse, remarks = place.best, None, list(_describe_starts(place))
    why = "no problem has h or dt to refine"
    if finer:
        better = refine(finer, end)
        why = better.cause
        if not why:
            fitting, end, coarse = finer, better, end
    if refined and why:
        remarks.append(f"the part of mesh and step is not known: {why}")
    if not all(each.fitted for each in listed):
        end = fitting.evaluate(end.u, only_fitted=False)
        remarks += [f"not compared: {end.cause}"] if end.cause else []
    return summarise(fitting, end, coarse, title, remarks)


def _check_cost(fitting: Fitting, starts: int, refined: bool) -> None:
    """Print the predicted size, and refuse a fit that would take too long."""
    costs = [each.cost for each in fitting.specimens]
    finer = [replace(cost, triangles=4 * cost.triangles) for cost in costs if refined]
    sizes = EVALUATIONS * starts * costs + finer
    check_size(sizes, fitting.runs.jobs, fitting.runs.most_seconds, "fit")


def _describe_starts(place: Place) -> Iterator[str]:
    if place.starts > 1:
        yield f"{place.same} of {place.starts} starts end at these constants"
