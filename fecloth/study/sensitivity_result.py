"""The result of `sensitivity`: derivatives in words, as a table and as a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.errors import FAILED
from fecloth.simulation.quantity import Quantity
from fecloth.study.derived_cases import LARGEST_ERROR, Sought
from fecloth.study.figures import Figure, new_figure
from fecloth.study.parameters import Parameter
from fecloth.study.problem import StudyProblem
from fecloth.study.result import StudyResult, Table, in_percent
from fecloth.study.status import OK
from fecloth.terms.traits import parameters_of

OF_SENTENCE = 1e-2  # relative change of a parameter that the sentences describe


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(StudyResult):
    """The result of `sensitivity`.

    For a single quantity `value` and `checked` are numbers, and `derivative` and `elasticity`
    have the shape (parameters,). For a list of quantities the shapes are (quantities,) and
    (quantities, parameters).

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
        Names of the parameters.
    quantities
        Texts of the quantities.
    value
        Values of the quantities, in their units.
    derivative
        Derivatives, in the unit of the quantity over the unit of the parameter; NaN for none.
    elasticity
        Change of the quantity in per cent if the parameter changes by 1 %.
    checked
        Distance of the derivatives from a pair of twin runs, relative to the sum of all
        changes.
    holds
        Largest relative change of all parameters for which twin runs agree: 0.01 if the sentences
        on 1 % are right, else the smaller one of the check.
    """

    parameters: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    value: Any = np.nan
    derivative: Any = np.nan
    elasticity: Any = np.nan
    checked: Any = np.nan
    holds: Any = np.nan

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a quantity has no derivative, else 0."""
        if np.isfinite(self.derivative).all():
            return 0
        return FAILED

    def figure(self) -> Figure:
        """Return a panel of bars for each quantity, the largest elasticity first.

        The length of a bar is the size of the change; it is red if the quantity falls when the
        parameter changes by 1 %.
        """
        elasticity = np.atleast_2d(self.elasticity)
        signs = np.sign(np.atleast_1d(self.value))
        height = 1.2 + 0.3 * len(self.parameters)
        drawing, axes = new_figure(len(self.quantities), 1, (8.0, height * len(self.quantities)))
        rows = zip(np.ravel(axes), self.quantities, elasticity, signs, strict=True)
        for ax, name, values, sign in rows:
            largest_first = np.argsort(np.nan_to_num(-np.abs(values)), kind="stable")
            upwards = largest_first[::-1]  # the first bar is the lowest one
            names = [self.parameters[i] for i in upwards]
            colors = np.where(sign * values[upwards] >= 0, "C0", "C3")
            ax.barh(names, np.abs(values[upwards]), color=colors.tolist())
            ax.set(xlabel=f"change of {name} for 1 % [%]; red: it falls", ylabel="")
        return drawing


def make_result(
    opened: StudyProblem,
    sought: Sought,
    row: Mapping,
    slopes: np.ndarray,
    checked: np.ndarray,
    holds: np.ndarray,
    is_single: bool,
) -> Sensitivity:
    """Return the result of a run with derivatives, with verdict, table and remarks.

    All derivatives of a quantity are NaN if the twin runs differ by more than `LARGEST_ERROR`
    from them.

    Parameters
    ----------
    row
        The row of the run, with the `values` of the quantities if it was "ok".
    slopes
        (quantities, parameters) derivatives by the parameters over their widths.
    checked
        (quantities,) relative distance of the twin runs; NaN where they did not run.
    holds
        (quantities,) relative change up to which the derivatives hold; NaN where it is not known.
    is_single
        Whether a single quantity was asked for, not a list: then the result has numbers in place
        of arrays with one quantity.
    """
    parameters = sought.parameters
    quantities = sought.quantities
    values = np.array(row.get("values", np.full(len(quantities), np.nan)))
    is_wrong = checked > LARGEST_ERROR
    slopes = np.where(is_wrong[:, None], np.nan, slopes)
    derivative = slopes / np.array([p.width for p in parameters])
    # the elasticity is NaN at a parameter of 0: 1 % of it is no change
    parameter_values = np.array([p.value or np.nan for p in parameters])
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = derivative * parameter_values / values[:, None]
    if row["status"] != OK:
        sentences = [row["cause"]]
    else:
        units = [quantity.unit(opened.first.energies) for quantity in quantities]
        sentences = [
            _describe_quantity(
                quantity, units[i], values[i], slopes[i], parameters, checked[i], holds[i]
            )
            for i, quantity in enumerate(quantities)
        ]
    remarks: tuple[str, ...] = ()
    if is_wrong.any():
        remarks = (_guess_reason(opened),)
    quantity_index = 0 if is_single else slice(None)
    return Sensitivity(
        title=opened.name,
        verdict="\n".join(dict.fromkeys(sentences)),  # each sentence once
        table=Table(tuple(_table_rows(sought, derivative, elasticity, is_single))),
        parameters=tuple(p.name for p in parameters),
        quantities=tuple(quantity.text for quantity in quantities),
        value=values[quantity_index],
        derivative=derivative[quantity_index],
        elasticity=elasticity[quantity_index],
        checked=checked[quantity_index],
        holds=holds[quantity_index],
        remarks=remarks,
    )


def _table_rows(
    sought: Sought, derivative: np.ndarray, elasticity: np.ndarray, is_single: bool
) -> list[dict[str, Any]]:
    """Return a row of the table for each quantity and parameter.

    The rows of a single quantity do not name it; they are sorted, the largest elasticity first.
    `derivative` and `elasticity` are (quantities, parameters).
    """
    rows = []
    for i, quantity in enumerate(sought.quantities):
        for k, parameter in enumerate(sought.parameters):
            row: dict[str, Any] = {} if is_single else {"quantity": quantity.text}
            row |= {"parameter": parameter.name, "value": parameter.value}
            row |= {"derivative": derivative[i, k], "% for 1 %": elasticity[i, k]}
            rows.append(row)
    if is_single:
        rows.sort(key=lambda row: -abs(np.nan_to_num(row["% for 1 %"])))
    return rows


def _describe_quantity(
    quantity: Quantity,
    unit: str,
    value: float,
    slopes: np.ndarray,
    parameters: Sequence[Parameter],
    checked: float,
    holds: float,
) -> str:
    """Return a sentence on the largest three changes of a quantity, and how they were checked.

    If the twin runs do not agree with the derivatives, the sentence says only this.

    Parameters
    ----------
    unit
        SI unit of the quantity.
    slopes
        (parameters,) derivatives over the widths of the parameters.
    checked
        Relative distance of the twin runs; NaN if they did not run.
    holds
        Relative change up to which the derivatives hold.
    """
    begin = f"{quantity.text} = {value:.6g} {unit}".strip()
    if checked > LARGEST_ERROR:
        distance = "more than 100 %"
        if checked < 1:
            distance = in_percent(checked)
        doubt = f"twin runs differ by {distance} from the derivatives"
        return f"{begin}: no derivative here: {doubt}"
    largest = np.argsort(-np.nan_to_num(np.abs(slopes)), kind="stable")[:3]
    changes = [
        _describe_change(parameters[k], slopes[k], value, unit)
        for k in largest
        if abs(slopes[k]) > 0
    ]
    words = "depends on none of them"
    if changes:
        words = f"it changes for {', '.join(changes)}"
    proof = "not checked"
    if not np.isnan(checked):
        proof = f"checked by twin runs: {checked:.0e}"
        if changes and holds < OF_SENTENCE:
            proof += f"; holds up to ± {in_percent(holds)}, not for 1 %"
    return f"{begin}; {words}; {proof}"


def _describe_change(p: Parameter, slope: float, value: float, unit: str) -> str:
    """Return by how much the quantity rises for 1 % more of a parameter, or by its scale."""
    if p.value and value:
        rise = slope / p.width * p.value / abs(value)
        return f"1 % more of {p.name} by {rise:+.2g} %"
    return f"{p.width:+g} of {p.name} by {slope:+.2g} {unit}".rstrip()


def _guess_reason(opened: StudyProblem) -> str:
    """Return a sentence with the likely reason why there is no derivative.

    The first that the problem has counts: friction, contact, else folds or chaos.
    """
    system = opened.first.system
    if any(parameters_of(term).get("friction") for term in system.terms):
        return "friction: a node that changes between rest and sliding leaves no derivative"
    if opened.has_contact:
        return "contact: where it begins or ends in a run, the motion after it has none"
    return (
        "folds that change, a start that chooses between two equilibria, or a motion that "
        "doubles small differences many times have no derivative; larger damping or a shorter "
        "run may help"
    )
