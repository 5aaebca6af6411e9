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
from fecloth.study.change import FIRST, Change
from fecloth.study.derived_cases import LOOSE, Sought, derive_case, run_twin
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Asked as AskedParameters
from fecloth.study.parameters import choose_parameters
from fecloth.study.problem import Asked
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.result import read_tolerance
from fecloth.study.run_problems import Runs, Task, print_warnings, refuse_huge, run_tasks
from fecloth.study.sensitivity_result import DOUBTFUL, Sensitivity, make_result
from fecloth.study.status import OK, REFUSED
from fecloth.study.workload import Workload, check_size

ROUND_OFF = 1e-9  # of a quantity: changes below it tell nothing
PRICE = 0.5  # of a derivative, in runs
STEPS = 3e-4, 1e-5  # of pairs of twin runs: change of each parameter over its width
OF_STEPS = ("sizes", "method")  # of the run, which its twin runs repeat


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

    A pair of twin runs, with all parameters changed by 0.03 % at once, each in the direction
    that increases the first quantity, checks every answer: `checked` is its distance from the
    sum of the derivatives. So it tells little of parameters that count much less than others.
    Above 1 % a second pair follows, changed by 0.001 %, and then the answer is "no derivative
    here": folds that change, contacts that begin, friction between stick and slip have none.

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
        With `value`, `derivative`, `elasticity` = derivative · p / value, and `checked`.

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
    A strip that hangs stretches in proportion to its density and to one over its stiffness, nearly:

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
    if not 1e-9 <= relative <= LOOSE:
        allowed = f"must lie between 1e-9 and {LOOSE:g}"
        raise InputError(f"tolerance = {tolerance}", allowed, "sensitivity")
    pairs = scale.items() if isinstance(scale, Mapping) else scale
    if isinstance(pairs, str) or not isinstance(pairs, Iterable):
        raise InputError(f"scale = {brief(scale)}", "must be a mapping of names", "sensitivity")
    if isinstance(parameters, Mapping):
        opened = opened.changed(Change.of(parameters))
    refuse_huge(opened, runs)
    chosen = choose_parameters(opened, parameters, dict(pairs))
    single = quantity is None or isinstance(quantity, str | Quantity) or callable(quantity)
    only: Any = quantity
    asked = (opened.choose_quantity(only),) if single else opened.choose_quantities(quantity)
    if not asked:
        raise InputError("quantity = []", "must be at least one", "sensitivity")
    doubts = print_warnings(opened)
    return _answer(opened, Sought(chosen, asked, relative), runs, check, single, doubts)


def _answer(
    opened: Problem,
    sought: Sought,
    runs: Runs,
    check: bool,
    single: bool = False,
    doubts: tuple[Doubt, ...] = (),
) -> Sensitivity:
    size = opened.workload(FIRST)
    count = len(sought.parameters)
    cost = replace(size, steps=round(size.steps * (1 + PRICE * count)))
    check_size([cost], runs.jobs, runs.most_seconds, opened.source)
    words = f"run and {amount(count, 'derivative')}"
    settings = {"sought": sought.settings()}
    task = Task(derive_case, opened, settings, words, cost)
    (row,) = run_tasks([task], runs)
    if row["status"] == REFUSED:
        raise InputError(row["cause"])
    shape = len(sought.quantities), count
    slopes = np.array(row.get("slopes", np.full(shape, np.nan)))
    checked = np.full(len(slopes), np.nan)
    why = row.get("why", "")
    for step in STEPS if row["status"] == OK and check else ():
        checked, why = _check(opened, sought, slopes, row, size, runs, step)
        if not (checked > DOUBTFUL).any():
            break
    lost = _lost(sought, slopes, np.array(row.get("values", [])))
    made = make_result(opened, sought, row, np.where(lost, np.nan, slopes), checked, single)
    names = [p.name for k, p in enumerate(sought.parameters) if lost[:, k].any()]
    remarks = [f"{n}: a change by its scale is lost in round-off; take a larger one" for n in names]
    return replace(made, doubts=doubts, remarks=(*filter(None, [why]), *remarks, *made.remarks))


def _lost(sought: Sought, slopes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Whether a change by a scale that was given is below the round-off of a quantity."""
    given = np.array([p.width != abs(p.value) for p in sought.parameters])
    if not len(values):
        return np.zeros(slopes.shape, bool)
    small = np.abs(slopes) < ROUND_OFF * np.abs(values)[:, None]
    return np.asarray(given & (slopes != 0.0) & small)


def describe_weak_terms(
    opened: Problem, quantities: Sequence[Quantity], tolerance: float, runs: Runs
) -> str:
    """A sentence: on which terms' numbers the quantities of a scene hardly depend, or "".

    Hardly means: a number that doubles, or falls to zero, would change no quantity by more than
    the tolerance, by its derivative.
    """
    if isinstance(opened, SceneProblem):
        listed = choose_parameters(opened, None, {})
    else:
        listed = ()
    chosen = tuple(p for p in listed if p.name.startswith("terms."))
    if not chosen:
        return ""
    unknown = "whether numbers of terms count is not known"
    try:
        answer = _answer(opened, Sought(chosen, tuple(quantities), LOOSE), runs, check=False)
    except InputError as error:  # as for a number at its limit: it is no mistake of `simplify`
        return f"{unknown}: {error}"
    if not np.isfinite(answer.value).all():
        return f"{unknown}: {answer.verdict}"
    weak = (np.abs(answer.elasticity) < tolerance).all(axis=0)
    types = [table["type"] for table in opened.tables["terms"]]
    names = [p.name for p, is_weak in zip(chosen, weak, strict=True) if is_weak]
    words = [f"{name} of {types[int(name.split('.')[1])]}" for name in names]
    if words:
        return f"the quantities hardly depend on {', '.join(words)}"
    return ""


def _check(
    opened: Problem,
    sought: Sought,
    slopes: np.ndarray,
    row: Mapping,
    size: Workload,
    runs: Runs,
    step: float,
) -> tuple[np.ndarray, str]:
    """The relative distance of twin runs for each quantity, and why there is none, or a remark."""
    signs = np.where(slopes[0] < 0, -1.0, 1.0)
    same = {"sought": sought.settings(), **{key: row[key] for key in OF_STEPS}}
    tasks = []
    for sign, change in ("+", step * signs), ("-", -step * signs):
        words = f"twin run, numbers {sign} {100 * step:g} %"
        settings = {"changes": change.tolist()}
        tasks.append(Task(run_twin, opened, same | settings, words, size))
    plus, minus = run_tasks(tasks, runs)
    if failed := next((each for each in (plus, minus) if each["status"] != OK), None):
        return np.full(len(slopes), np.inf), f"a twin run failed: {failed['cause']}"
    change = (np.array(plus["values"]) - np.array(minus["values"])) / (2 * step)
    size_of = np.abs(slopes).sum(axis=1)
    least = ROUND_OFF * np.abs(row["values"]) / STEPS[0] + np.finfo(float).tiny
    return np.abs(change - slopes @ signs) / np.maximum(size_of, least), row["why"]
