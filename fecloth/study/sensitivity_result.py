"""The result of `sensitivity`: derivatives in words, as a table and as a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.errors import FAILED
from fecloth.simulation.quantity import Quantity
from fecloth.study.derived_cases import Sought
from fecloth.study.figures import Figure, new_figure
from fecloth.study.parameters import Parameter
from fecloth.study.problems import Problem
from fecloth.study.result import StudyResult, Table, in_percent
from fecloth.study.status import OK
from fecloth.terms.traits import parameters_of

DOUBTFUL = 1e-2  # distance from the twin runs above which there is no derivative
SHOWN = 20  # bars of the figure


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(StudyResult):
    """What `sensitivity` found.

    Of a single quantity `value` and `checked` are numbers, and the others have the shape
    (parameters,); of a list of quantities they have the shapes (quantities,) and (quantities,
    parameters).

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each run or level; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    parameters
        Their names.
    quantities
        Their texts.
    value
        Of the quantities, in their units.
    derivative
        Unit of the quantity over the unit of the parameter; NaN for none.
    elasticity
        Change of the quantity in per cent if the parameter changes by 1 %.
    checked
        Distance of the derivatives from a pair of twin runs, relative to the sum of all
        changes.
    """

    parameters: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    value: Any = np.nan
    derivative: Any = np.nan
    elasticity: Any = np.nan
    checked: Any = np.nan

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a quantity has no derivative, else 0."""
        if np.isfinite(self.derivative).all():
            return 0
        return FAILED

    def figure(self) -> Figure:
        """Return a panel of bars for each quantity, the largest elasticity first."""
        elasticity = np.atleast_2d(self.elasticity)
        signs = np.sign(np.atleast_1d(self.value))
        count = min(SHOWN, len(self.parameters))
        size = 8.0, (1.2 + 0.3 * count) * len(self.quantities)
        drawing, axes = new_figure(len(self.quantities), 1, size)
        rows = zip(np.ravel(axes), self.quantities, elasticity, signs, strict=True)
        for ax, name, values, sign in rows:
            order = np.argsort(np.nan_to_num(-np.abs(values)), kind="stable")[:count][::-1]
            colors = ["C0" if sign * values[i] >= 0 else "C3" for i in order]
            ax.barh([self.parameters[i] for i in order], np.abs(values[order]), color=colors)
            ax.set(xlabel=f"change of {name} for 1 % [%]; red: it falls", ylabel="")
        return drawing


def make_result(
    opened: Problem,
    sought: Sought,
    row: Mapping,
    slopes: np.ndarray,
    checked: np.ndarray,
    single: bool,
) -> Sensitivity:
    """The result of a run with derivatives, whose `slopes` are by parameters over their widths."""
    parameters = sought.parameters
    quantities = sought.quantities
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
    names = opened.first.energies
    sentences = [
        _verdict(quantity, quantity.unit(names), values[i], slopes[i], parameters, checked[i])
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
        parameters=tuple(p.name for p in parameters),
        quantities=tuple(quantity.text for quantity in quantities),
        value=values[at],
        derivative=derivative[at],
        elasticity=elasticity[at],
        checked=checked[at],
        remarks=(doubts,) if doubts else (),
    )


def _verdict(
    quantity: Quantity,
    unit: str,
    value: float,
    slopes: np.ndarray,
    parameters: Sequence[Parameter],
    checked: float,
) -> str:
    """The largest three changes, and how they were checked."""
    begin = f"{quantity.text} = {value:.6g} {unit}".strip()
    if checked > DOUBTFUL:
        far = in_percent(checked) if checked < 1 else "more than 100 %"
        return f"{begin}: no derivative here: twin runs differ by {far} from the derivatives"
    order = np.argsort(-np.nan_to_num(np.abs(slopes)), kind="stable")[:3]
    parts = [_change(parameters[k], slopes[k], value, unit) for k in order if abs(slopes[k]) > 0]
    if parts:
        words = f"it changes for {', '.join(parts)}"
    else:
        words = "depends on none of them"
    if np.isnan(checked):
        proof = "not checked"
    else:
        proof = f"checked by twin runs: {checked:.0e}"
    return f"{begin}; {words}; {proof}"


def _change(p: Parameter, slope: float, value: float, unit: str) -> str:
    """By how much the quantity rises for 1 % more of a parameter, or for a change by its scale."""
    if p.value and value:
        rise = slope / p.width * p.value / abs(value)
        return f"1 % more of {p.name} by {rise:+.2g} %"
    return f"{p.width:+g} of {p.name} by {slope:+.2g} {unit}".rstrip()


def _doubts(opened: Problem) -> str:
    """The likely reason why there is no derivative."""
    system = opened.first.system
    if any(parameters_of(term).get("friction") for term in system.terms):
        return "friction: a node that changes between rest and sliding leaves no derivative"
    if opened.has_contact:
        return "contact: where it begins or ends in a run, the motion after it has none"
    return (
        "folds that change, a start that chooses between two equilibria, or a motion that doubles "
        "small differences many times have no derivative; larger damping or a shorter run may help"
    )
