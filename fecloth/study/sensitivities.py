"""`sensitivity`: how much quantities depend on each number of a problem."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import FAILED, InputError, amount
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.change import FIRST, Change
from fecloth.study.derived_cases import LOOSE, Sought, Task, run_tasks
from fecloth.study.figures import Figure, new_figure
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Asked as AskedParameters
from fecloth.study.parameters import Parameter, choose_parameters
from fecloth.study.problem import Asked
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.result import StudyResult, Table, in_percent
from fecloth.study.run_problems import Runs, print_warnings, refuse_huge
from fecloth.study.status import OK, REFUSED
from fecloth.study.workload import Workload, check_size

DOUBTFUL = 1e-2  # distance from the twin runs above which there is no derivative
ROUND_OFF = 1e-9  # of a quantity: differences of twin runs below it tell nothing
PRICE = 0.5  # of a derivative, in runs
STEP = 3e-4  # of the twin runs: change of each parameter over its width
OF_STEPS = ("sizes", "method")  # of the run, which its twin runs repeat
SHOWN = 20  # bars of the figure


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(StudyResult):
    """What `sensitivity` found.

    Of a single quantity `value` and `checked` are numbers, and the others have the shape
    (parameters,); of a list of quantities they have the shapes (quantities,) and (quantities,
    parameters).
    """

    parameters: tuple[str, ...] = ()  # their names
    quantities: tuple[str, ...] = ()  # their texts
    value: Any = np.nan  # of the quantities, in their units
    derivative: Any = np.nan  # unit of the quantity over the unit of the parameter; NaN for none
    elasticity: Any = np.nan  # change of the quantity in per cent if the parameter changes by 1 %
    # Distance of the derivatives from a pair of twin runs, relative to the sum of all changes.
    checked: Any = np.nan
    remarks: tuple[str, ...] = field(default=(), kw_only=True)

    def notes(self) -> list[str]:
        return list(self.remarks)

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a quantity has no derivative, else 0."""
        return 0 if np.isfinite(self.derivative).all() else FAILED

    def figure(self) -> Figure:
        """Return a panel of bars for each quantity, the largest elasticity first."""
        elasticity = np.atleast_2d(self.elasticity)
        count = min(SHOWN, len(self.parameters))
        size = 8.0, (1.2 + 0.3 * count) * len(self.quantities)
        drawing, axes = new_figure(len(self.quantities), 1, size)
        for ax, name, values in zip(np.ravel(axes), self.quantities, elasticity, strict=True):
            order = np.argsort(np.nan_to_num(-np.abs(values)), kind="stable")[:count][::-1]
            colors = ["C0" if values[i] >= 0 else "C3" for i in order]
            ax.barh([self.parameters[i] for i in order], np.abs(values[order]), color=colors)
            ax.set(xlabel=f"change of {name} for 1 % [%]; red: it falls", ylabel="")
        return drawing


def sensitivity(
    problem: Scene | str | Path | Callable | Opened,
    parameters: AskedParameters | None = None,
    quantity: Asked | Sequence[Asked] | None = None,
    *,
    scale: Mapping[str, float] | Sequence[tuple[str, float]] = (),
    tolerance: float = 1e-4,
    check: bool = True,
    **shared: Any,
) -> Sensitivity:
    """Find the derivatives of quantities by the numbers of a problem.

    The problem runs once. Beside it the derivative of each state by each parameter p goes from
    step to step by the implicit function theorem: with R(q; p) = 0 the equation of a step,

        ∂R/∂q · dq/dp = −∂R/∂p − ∂R/∂(begin of the step) · d(begin)/dp,

    whose right side is a central difference of R at the solved q, and which the factor or the
    preconditioner of the step solves. An equilibrium is one such step, an explicit step has no
    equation. So a parameter costs a part of a run, and no rounding of two runs that differ little.

    A pair of twin runs, with all parameters changed by 0.03 % at once, each in the direction that
    increases the first quantity, checks every answer: `checked` is its distance from the sum of
    the derivatives. Above 1 % the answer is "no derivative here": folds that change, contacts that
    begin, friction between stick and slip have none.

    Parameters
    ----------
    problem
        As for `fecloth.study.of`.
    parameters
        Names: keys of a scene, as "fabric.bending_rigidity" or "terms.1.time", with numbers (from
        0) for the items of lists; arguments of a function, or {"B": 1e-5}, which gives them
        values. By default all numbers of [fabric] and the terms, or all arguments of a function
        but h and dt, that are not 0.
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
    A strip that hangs under its own weight stretches by ρ g L²/(2 Y) at its end, nearly:

    >>> import fecloth as fc
    >>> def strip(h, stiffness=2000.0, density=0.2):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    ...     terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    ...     system = fc.System(cloth, fc.Fabric(density, stiffness), terms, pins=["left"])
    ...     return cloth, system, None, system.rest()
    >>> tip = fc.Probe("tip", "right")
    >>> def stretch(result):
    ...     return float(result.state.x[:, 0].max()) - 1.0
    >>> found = fc.sensitivity(strip, ["stiffness", "density"], stretch, h=0.125, probes=[tip])
    >>> print(found.elasticity.round(2), found.checked < 1e-5)
    [-1.  1.] True
    """
    study = open_study(problem, shared)
    opened, runs = study.problem, study.runs()
    if not (isinstance(tolerance, float) and 1e-9 <= tolerance <= LOOSE):
        allowed = f"must lie between 1e-9 and {LOOSE:g}"
        raise InputError(f"tolerance = {tolerance!r}", allowed, "sensitivity")
    if isinstance(parameters, Mapping):
        opened = opened.changed(Change.of(parameters))
    refuse_huge(opened, runs)
    chosen = choose_parameters(opened, parameters, dict(scale))
    single = quantity is None or isinstance(quantity, str | Quantity) or callable(quantity)
    only: Any = quantity
    asked = (opened.choose_quantity(only),) if single else opened.choose_quantities(quantity)
    warned = print_warnings(opened)
    return _answer(opened, Sought(chosen, asked, tolerance), runs, check, single, warned)


def _answer(
    opened: Problem,
    sought: Sought,
    runs: Runs,
    check: bool,
    single: bool = False,
    warned: tuple[str, ...] = (),
) -> Sensitivity:
    size, count = opened.workload(FIRST), len(sought.parameters)
    cost = replace(size, steps=round(size.steps * (1 + PRICE * count)))
    check_size([cost], runs.jobs, runs.most_seconds, opened.source)
    task = Task("derive", f"run and {amount(count, 'derivative')}", cost, {})
    (row,) = run_tasks(opened, sought, [task], runs)
    if row["status"] == REFUSED:
        raise InputError(row["cause"])
    shape = len(sought.quantities), count
    slopes = np.array(row.get("slopes", np.full(shape, np.nan)))
    checked, why = np.full(len(slopes), np.nan), row.get("why", "")
    if row["status"] == OK and check:
        checked, why = _check(opened, sought, slopes, row, size, runs)
    return _found(opened, sought, row, slopes, checked, why, single, warned)


def describe_weak_terms(
    opened: Problem, quantities: Sequence[Quantity], tolerance: float, runs: Runs
) -> str:
    """A sentence: on which terms' numbers the quantities of a scene hardly depend, or "".

    Hardly means: a number that doubles, or falls to zero, would change no quantity by more than the
    tolerance, by its derivative.
    """
    listed = choose_parameters(opened, None, {}) if isinstance(opened, SceneProblem) else ()
    chosen = tuple(p for p in listed if p.name.startswith("terms."))
    if not chosen:
        return ""
    found = _answer(opened, Sought(chosen, tuple(quantities), LOOSE), runs, check=False)
    if not np.isfinite(found.value).all():
        return f"whether numbers of terms count is not known: {found.verdict}"
    weak = (np.abs(found.elasticity) < tolerance).all(axis=0)
    types = [table["type"] for table in opened.tables["terms"]]
    names = [p.name for p, is_weak in zip(chosen, weak, strict=True) if is_weak]
    words = [f"{name} of {types[int(name.split('.')[1])]}" for name in names]
    return f"the quantities hardly depend on {', '.join(words)}" if words else ""


def _check(
    opened: Problem, sought: Sought, slopes: np.ndarray, row: Mapping, size: Workload, runs: Runs
) -> tuple[np.ndarray, str]:
    """The relative distance of twin runs for each quantity, and why there is none, or a remark."""
    signs = np.where(slopes[0] < 0, -1.0, 1.0)
    tasks = [
        Task(
            "twin",
            f"twin run, numbers {'+' if way > 0 else '-'} {100 * STEP:g} %",
            size,
            {"changes": (way * STEP * signs).tolist(), **{key: row[key] for key in OF_STEPS}},
        )
        for way in (1.0, -1.0)
    ]
    plus, minus = run_tasks(opened, sought, tasks, runs)
    if failed := next((each for each in (plus, minus) if each["status"] != OK), None):
        return np.full(len(slopes), np.inf), f"a twin run failed: {failed['cause']}"
    change = (np.array(plus["values"]) - np.array(minus["values"])) / (2 * STEP)
    size_of = np.abs(slopes).sum(axis=1)
    least = ROUND_OFF * np.abs(row["values"]) / STEP + np.finfo(float).tiny
    return np.abs(change - slopes @ signs) / np.maximum(size_of, least), row["why"]


def _found(
    opened: Problem,
    sought: Sought,
    row: Mapping,
    slopes: np.ndarray,
    checked: np.ndarray,
    why: str,
    single: bool,
    warned: tuple[str, ...],
) -> Sensitivity:
    parameters, quantities = sought.parameters, sought.quantities
    values = np.array(row.get("values", np.full(len(quantities), np.nan)))
    slopes = np.where((checked > DOUBTFUL)[:, None], np.nan, slopes)
    derivative = slopes / np.array([p.width for p in parameters])
    of_values = np.array([p.value or np.nan for p in parameters])
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = derivative * of_values / values[:, None]
    rows = [
        {
            "quantity": quantity.text,
            "parameter": p.name,
            "value": p.value,
            "derivative": derivative[i, k],
            "% for 1 %": elasticity[i, k],
        }
        for i, quantity in enumerate(quantities)
        for k, p in enumerate(parameters)
    ]
    names = sorted(row.get("energies", ()))
    sentences = [
        _verdict(quantity, quantity.unit(names), values[i], elasticity[i], parameters, checked[i])
        if row["status"] == OK
        else row["cause"]
        for i, quantity in enumerate(quantities)
    ]
    table = [{k: v for k, v in each.items() if not (single and k == "quantity")} for each in rows]
    shown = sorted(table, key=lambda each: -abs(np.nan_to_num(each["% for 1 %"])))
    at = 0 if single else slice(None)
    doubts = _doubts(opened) if (checked > DOUBTFUL).any() else ""
    return Sensitivity(
        title=opened.name,
        verdict="\n".join(dict.fromkeys(sentences)),
        table=Table(tuple(shown if single else table)),
        warnings=warned,
        parameters=tuple(p.name for p in parameters),
        quantities=tuple(quantity.text for quantity in quantities),
        value=values[at],
        derivative=derivative[at],
        elasticity=elasticity[at],
        checked=checked[at],
        remarks=tuple(words for words in (why, doubts) if words),
    )


def _verdict(
    quantity: Quantity,
    unit: str,
    value: float,
    elasticity: np.ndarray,
    parameters: Sequence[Parameter],
    checked: float,
) -> str:
    """The largest three elasticities, and how they were checked."""
    begin = f"{quantity.text} = {value:.6g} {unit}".strip()
    if checked > DOUBTFUL:
        return (
            f"{begin}: no derivative here: twin runs differ by "
            f"{in_percent(checked)} from the sum of the derivatives"
        )
    order = np.argsort(-np.nan_to_num(np.abs(elasticity)), kind="stable")[:3]
    parts = [
        f"{parameters[k].name} {elasticity[k]:+.2g} %" for k in order if abs(elasticity[k]) > 0
    ]
    words = f"for 1 % more of {', '.join(parts)}" if parts else "depends on none of them"
    proof = "not checked" if np.isnan(checked) else f"checked by twin runs: {checked:.0e}"
    return f"{begin}; {words}; {proof}"


def _doubts(opened: Problem) -> str:
    """The likely reason why there is no derivative."""
    system = opened.first.system
    if any(getattr(term, "friction", 0.0) for term in system.terms):
        return "friction: a node that changes between rest and sliding leaves no derivative"
    if opened.has_contact:
        return "contact: where it begins or ends in a run, the motion after it has none"
    return (
        "folds that change, a start that chooses between two equilibria, or a motion that doubles "
        "small differences many times have no derivative; larger damping or a shorter run may help"
    )
