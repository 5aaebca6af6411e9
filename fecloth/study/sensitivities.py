"""`sensitivity`: how much quantities depend on each number of a problem."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, amount, brief
from fecloth.scene.scene import Scene
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.quantity import Quantity
from fecloth.study.derived_cases import LARGEST_ERROR, Sought, derive_case, run_twin
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Asked as AskedParameters
from fecloth.study.parameters import choose_parameters
from fecloth.study.problem import Asked, StudyProblem
from fecloth.study.result import read_tolerance
from fecloth.study.runs import Run, Runs, announce, print_doubts, refuse_huge, run_all
from fecloth.study.sensitivity_result import OF_SENTENCE, Sensitivity, make_result
from fecloth.study.status import OK, REFUSED

# The change of a quantity over its value: below it round-off of the runs may be all of it.
LEAST_QUANTITY_CHANGE = 1e-9
PRICE = 0.5  # estimated time of a derivative over the time of the run
# The change of each parameter over its width in a pair of twin runs: the usual one, and the one
# of a second pair, where the quantity may bend too much for the first.
WIDE_CHANGE = 3e-4
NARROW_CHANGE = 1e-5
# A number that counts less than the others is changed by up to so many times as much in twin runs,
# so that they tell of it, too.
MOST_WEIGHT = 30.0
# The sentences hold where twin runs that change a parameter by `OF_SENTENCE` differ from the
# derivative by at most this part.
SENTENCE_ERROR = 0.1
STEPS_OF_RUN = ("sizes", "method")  # of a row: the steps, which its twin runs repeat


def sensitivity(
    problem: Scene | str | Path | Callable | Opened,
    parameters: AskedParameters | None = None,
    quantity: Asked | Sequence[Asked] | None = None,
    *,
    scale: Mapping[str, float] | Sequence[tuple[str, float]] = (),
    tolerance: float | str = 1e-4,
    check: bool = True,
    **shared: Any,
) -> Sensitivity:
    """Find the derivatives of quantities by the numbers of a problem.

    The problem runs once. Beside it the derivative of each state by each parameter p goes from
    step to step by the implicit function theorem: with R(q; p) = 0 the equation of a step,

        ∂R/∂q · dq/dp = −∂R/∂p − ∂R/∂(begin of the step) · d(begin)/dp,

    whose right side is a central difference of R at the solved q, and which the factor or the
    preconditioner of the step solves. An equilibrium is one such step, an explicit step has no
    equation. So a parameter costs a part of a run, and no rounding of two runs that differ
    little.

    A pair of twin runs checks every answer. It changes all parameters at once by 0.03 %, those
    that count less than others by up to 0.9 %, each in the direction that increases the first
    quantity. `checked` is its distance from the sum of the derivatives. Above 1 %
    a second pair follows, changed by 0.001 %. If it differs by more than 1 %, too, the answer is
    "no derivative here": folds that change, contacts that begin, and friction between stick and
    slip have none. A last pair is changed by 1 %, as the sentences say it: if it differs by more
    than 10 %, these hold only up to the smaller change, and say so.

    Parameters
    ----------
    problem
        As for `fecloth.study.of`.
    parameters
        Names: keys of a scene, as "fabric.bending_rigidity" or "terms.1.time", with numbers
        (from 0) for single items of lists; arguments of a function, or {"B": 1e-5}, which
        gives them values. By default all numbers of [fabric] and the terms, or all arguments
        of a function but h and dt, that are not 0.
    quantity
        One, or a list; by default the first of [interest], or the first of the problem.
    scale
        The size of a usual change, for parameters whose value is 0: {"terms.2.velocity.0": 1.0}.
    tolerance
        Relative error of the derivatives that is aimed at. Newton's tolerance is a hundredth of
        it.
    check
        Whether twin runs check the answer.
    shared
        Arguments of `fecloth.study.of`, as h, dt, t_end, probes and cache.

    Returns
    -------
    Sensitivity
        With `value`, `derivative`, `elasticity` = derivative · p / value, `checked` and `holds`.

    Raises
    ------
    InputError
        For a name that is no number of the problem, a number that changes the mesh, the steps or
        the solver, and a value of 0 without a scale.

    Notes
    -----
    Steps that their error chooses stay as they are: the derivative is of the run with these
    steps. A function may move the nodes of its triangles with a parameter.

    Source: the staggered method of Serban and Hindmarsh (2005), CVODES: the Sensitivity-Enabled
    ODE Solver in SUNDIALS.

    Examples
    --------
    The stretch of a hanging strip goes with its density and with one over its stiffness, nearly:

    >>> import fecloth as fc
    >>> def strip(h, stiffness=2000.0, density=0.2):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    ...     terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    ...     system = fc.System(cloth, fc.Fabric(density, stiffness), terms, pins=["left"])
    ...     return cloth, system, None, system.rest()
    >>> tip = fc.Probe("tip", "right")
    >>> def stretch(result):
    ...     return float(result.state.x[:, 0].mean()) - 0.5
    >>> answer = fc.sensitivity(strip, ["stiffness", "density"], stretch, h=0.125, probes=[tip])
    >>> print(answer.elasticity.round(2), answer.checked < 1e-4)
    [-1.  1.] True
    """
    study = open_study(problem, shared)
    opened = study.problem
    runs = study.runs()
    relative = read_tolerance(tolerance)
    if not 1e-9 <= relative <= LARGEST_ERROR:
        allowed = f"must lie between 1e-9 and {LARGEST_ERROR:g}"
        raise InputError(f"tolerance = {tolerance}", allowed, "sensitivity")
    if isinstance(scale, str) or not isinstance(scale, Iterable):
        raise InputError(f"scale = {brief(scale)}", "must be a mapping of names", "sensitivity")
    if isinstance(parameters, Mapping):  # it has their values, too
        opened = opened.at(parameters)
    refuse_huge(opened, runs)
    chosen_parameters = choose_parameters(opened, parameters, dict(scale))
    is_single = quantity is None or isinstance(quantity, str | Quantity) or callable(quantity)
    quantities = _choose_quantities(opened, quantity, is_single)
    if not quantities:
        raise InputError("quantity = []", "must be at least one", "sensitivity")
    doubts = print_doubts(opened)
    sought = Sought(chosen_parameters, quantities, relative)
    return _run_and_check(opened, sought, runs, check=check, is_single=is_single, doubts=doubts)


def _choose_quantities(
    opened: StudyProblem, quantity: Any, is_single: bool
) -> tuple[Quantity, ...]:
    """Return the quantities of a list, or the single one, or the first of the problem."""
    if is_single:
        return (opened.choose_quantity(quantity),)
    return opened.choose_quantities(quantity)


def _run_and_check(
    opened: StudyProblem,
    sought: Sought,
    runs: Runs,
    check: bool,
    is_single: bool = False,
    doubts: tuple[Doubt, ...] = (),
) -> Sensitivity:
    """Run the problem with derivatives, check them by twin runs, and return the result.

    A derivative is NaN if the twin runs differ too much from it, or if the change of its
    quantity is lost in round-off. If the run failed, all are NaN.

    Parameters
    ----------
    sought
        Quantities, parameters and tolerance.
    check
        Whether twin runs check the derivatives.
    is_single
        Whether a single quantity was asked for, not a list.
    doubts
        Doubts about the set-up, for the result.
    """
    row = _run_with_derivatives(opened, sought, runs)
    unknown = np.full((len(sought.quantities), len(sought.parameters)), np.nan)
    slopes = np.array(row.get("slopes", unknown))  # a run that failed has none
    checked = np.full(len(slopes), np.nan)
    holds = np.full(len(slopes), np.nan)
    why = row.get("why", "")
    if check and row["status"] == OK:
        # The quantity may bend too much for the wide change: then the narrow one decides.
        for change in (WIDE_CHANGE, NARROW_CHANGE):
            checked, why = _check_by_twin_runs(opened, sought, slopes, row, runs, change)
            if not (checked > LARGEST_ERROR).any():
                break
        holds = np.full(len(slopes), change)
        if change == WIDE_CHANGE:
            far, _ = _check_by_twin_runs(opened, sought, slopes, row, runs, OF_SENTENCE)
            holds[far <= SENTENCE_ERROR] = OF_SENTENCE
    is_lost = _find_changes_below_round_off(sought, slopes, np.array(row.get("values", [])))
    known_slopes = np.where(is_lost, np.nan, slopes)
    result = make_result(opened, sought, row, known_slopes, checked, holds, is_single)
    remarks = [why] if why else []
    for k, parameter in enumerate(sought.parameters):
        if is_lost[:, k].any():
            words = "a change by its scale is lost in round-off; take a larger one"
            remarks.append(f"{parameter.name}: {words}")
    return replace(result, doubts=doubts, remarks=(*remarks, *result.remarks))


def derive(problem: StudyProblem, sought: Sought) -> Run:
    """Return the run of a problem with its derivatives; the row is the one of `derive_case`."""
    count = len(sought.parameters)
    work = problem.work
    return Run(
        problem,
        f"run and {amount(count, 'derivative')}",
        function=derive_case,
        arguments={"sought": sought.settings()},
        # a derivative takes a part of the time of each step, so it counts as more steps
        own_work=replace(work, steps=round(work.steps * (1 + PRICE * count))),
    )


def _run_with_derivatives(opened: StudyProblem, sought: Sought, runs: Runs) -> dict:
    """Run the problem once with all derivatives, and return the row of `derive_case`.

    Raise `InputError` if the problem is refused, or takes too long.
    """
    run = derive(opened, sought)
    announce([run], runs)
    (row,) = run_all([run], runs)
    if row["status"] == REFUSED:
        raise InputError(row["cause"])
    return row


def _find_changes_below_round_off(
    sought: Sought, slopes: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Return (quantities, parameters) whether a change by a given scale is below round-off.

    `slopes` (quantities, parameters) are the derivatives over the widths of the parameters,
    `values` (quantities,) the values of the quantities, empty if the run failed.
    """
    if not len(values):
        return np.zeros(slopes.shape, bool)
    # without a given scale the width is the size of the value
    has_scale = np.array([p.width != abs(p.value) for p in sought.parameters])
    is_small = np.abs(slopes) < LEAST_QUANTITY_CHANGE * np.abs(values)[:, None]
    return np.asarray(has_scale & (slopes != 0.0) & is_small)


def describe_weak_terms(
    opened: StudyProblem, quantities: Sequence[Quantity], tolerance: float, runs: Runs
) -> str:
    """Return a sentence that names the numbers of terms on which the quantities hardly depend.

    Hardly means: a number that doubles, or falls to zero, would change no quantity by more than
    the tolerance, by its derivative. The sentence is "" if there is no such number, and for a
    function. If the derivatives are not found, the sentence says why. Nothing is raised then,
    because this is only a remark of another study, `simplify`.
    """
    numbers = opened.source.numbers()
    names = [name for name, value in numbers if value and name.startswith("terms.")]
    if not names:
        return ""
    parameters = choose_parameters(opened, names, scale={})
    unknown = "whether numbers of terms count is not known"
    sought = Sought(parameters, tuple(quantities), LARGEST_ERROR)
    try:
        result = _run_and_check(opened, sought, runs, check=False)
    except InputError as error:  # as for a number at an end of its range
        return f"{unknown}: {error}"
    if not np.isfinite(result.value).all():
        return f"{unknown}: {result.verdict}"
    is_weak = (np.abs(result.elasticity) < tolerance).all(axis=0)  # for all quantities
    weak_numbers = []
    for parameter, weak in zip(parameters, is_weak, strict=True):
        if weak:
            term = int(parameter.name.split(".")[1])  # of terms.TERM.KEY
            weak_numbers.append(f"{parameter.name} of {opened.tables['terms'][term]['type']}")
    if weak_numbers:
        return f"the quantities hardly depend on {', '.join(weak_numbers)}"
    return ""


def _check_by_twin_runs(
    opened: StudyProblem,
    sought: Sought,
    slopes: np.ndarray,
    row: Mapping,
    runs: Runs,
    change: float,
) -> tuple[np.ndarray, str]:
    """Run a pair of twin runs, and return how far they are from the derivatives, and a remark.

    The first item, (quantities,), is the distance between the change that the twin runs measured
    and the change that the derivatives predict, over the sum of the sizes of all derivatives.
    It is infinite if a twin run failed; then the remark, the second item, says why. Else the
    remark is the one of the run with derivatives. Numbers that count less than others change by
    more, see `weights_of_twins`.

    Parameters
    ----------
    slopes
        (quantities, parameters) derivatives over the widths of the parameters.
    row
        The row of the run with derivatives.
    change
        The change of each parameter over its width.
    """
    # all parameters change in the direction that increases the first quantity
    signs = np.where(slopes[0] < 0, -1.0, 1.0) * weights_of_twins(slopes, change)
    settings = {"sought": sought.settings(), **{key: row[key] for key in STEPS_OF_RUN}}
    twins = []
    for sign, changes in ("+", change * signs), ("-", -change * signs):
        words = f"twin run, numbers {sign} {100 * change:g} %"
        arguments = settings | {"changes": changes.tolist()}
        twins.append(Run(opened, words, function=run_twin, arguments=arguments))
    twin_above, twin_below = run_all(twins, runs)
    for twin in (twin_above, twin_below):
        if twin["status"] != OK:
            return np.full(len(slopes), np.inf), f"a twin run failed: {twin['cause']}"
    measured = (np.array(twin_above["values"]) - np.array(twin_below["values"])) / (2 * change)
    predicted = slopes @ signs
    # Where all derivatives are about 0, the distance is compared with round-off of the runs. The
    # smallest number is added so that nothing is divided by 0.
    least_size = LEAST_QUANTITY_CHANGE * np.abs(row["values"]) / WIDE_CHANGE
    least_size *= np.abs(signs).max()
    least_size = least_size + np.finfo(float).tiny
    size_of_all = np.maximum(np.abs(slopes) @ np.abs(signs), least_size)
    return np.abs(measured - predicted) / size_of_all, row["why"]


def weights_of_twins(slopes: np.ndarray, change: float) -> np.ndarray:
    """Return the change of each parameter in twin runs over `change`, (parameters,) ≥ 1.

    A parameter whose largest part of a quantity's changes is below 1/k, of k parameters, changes
    by more: so that it counts as an equal one does, but at most `MOST_WEIGHT` times as much, and
    by no more than `OF_SENTENCE` of its width. `slopes` (quantities, parameters) are over widths.
    """
    sizes = np.abs(slopes)
    sums = sizes.sum(axis=1, keepdims=True)
    parts = np.max(np.divide(sizes, sums, out=np.zeros_like(sizes), where=sums > 0), axis=0)
    most = max(min(MOST_WEIGHT, OF_SENTENCE / change), 1.0)
    return np.clip(1 / np.maximum(len(parts) * parts, 1 / most), 1.0, most)
