"""The result of `budget`: parts of an uncertainty, in words, as a table and as a figure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np

from fecloth.simulation.quantity import Quantity
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.problems import Problem
from fecloth.study.result import Cell, StudyResult, Table
from fecloth.study.status import FAILED

# Two values agree within this multiple of the standard uncertainty of their difference: 95 % of
# a normal distribution.
COVERS = 2.0
# A part of the uncertainty that is at most this part of the total is not named, and not drawn.
NEGLIGIBLE_PART = 0.01
WORDS = {"space": "mesh", "time": "time step", "solver": "solver", "input": "fabric"}
WORDS |= {"start": "start", "data": "measurement"}


@dataclass(frozen=True, eq=False, repr=False)
class Budget(StudyResult):
    """What `budget` found: standard uncertainties, in the unit of each quantity.

    Of a single quantity the fields are numbers, else arrays (quantities,).

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        A row for each quantity; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    quantities
        Texts of the quantities.
    parameters
        Names of the uncertain numbers.
    value
        Value on the finest mesh.
    time
        Standard uncertainty by the time step.
    space
        Standard uncertainty by the mesh.
    solver
        Standard uncertainty by the tolerance of the solver.
    input
        Standard uncertainty by the uncertain numbers.
    start
        Standard uncertainty by the start; 0 where no starts were disturbed.
    data
        Standard uncertainty of the measured value; 0 where nothing was measured.
    total
        Root of the sum of the squares of the six parts.
    difference
        Computed − measured value; NaN where nothing was measured.
    agrees
        Whether |difference| ≤ 2 total.
    shares
        (quantities, parameters) parts of input² by the first order; empty where samples gave
        input.
    """

    quantities: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    value: Any = np.nan
    time: Any = np.nan
    space: Any = np.nan
    solver: Any = np.nan
    input: Any = np.nan
    start: Any = np.nan
    data: Any = np.nan
    total: Any = np.nan
    difference: Any = np.nan
    agrees: Any = False
    shares: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def figure(self) -> Figure:
        """Return stacked bars: the parts of each variance, input by parameter."""
        rows: list[tuple[str, np.ndarray]] = []
        for name, words in WORDS.items():
            if name == "input" and self.shares.size:
                rows += zip(self.parameters, self.shares.T, strict=True)
            else:
                rows.append((words, np.atleast_1d(getattr(self, name)) ** 2))
        # Correlated inputs may have negative parts.
        parts = np.maximum(np.nan_to_num([variance for _, variance in rows]), 0.0)
        parts /= np.maximum(parts.sum(axis=0), np.finfo(float).tiny)
        shown = np.flatnonzero((parts > NEGLIGIBLE_PART**2).any(axis=1))
        left = np.zeros(parts.shape[1])
        drawing, ax = new_figure(1, 1, (8.0, 1.6 + 0.7 * len(left) + 0.15 * len(shown)))
        for i, k in enumerate(shown):
            again, color = divmod(i, len(COLOURS))
            width = 100 * parts[k]
            ax.barh(
                self.quantities,
                width,
                left=left,
                label=rows[k][0],
                color=COLOURS[color],
                hatch="//" * again,
                ec="white",
            )
            left = left + width
        ax.set(xlabel="part of the variance [%]", xlim=(0, 100))
        ax.invert_yaxis()
        drawing.legend(loc="outside lower center", ncols=2)
        return drawing


def make_budget(
    opened: Problem,
    quantities: Sequence[Quantity],
    known: Mapping[str, Any],
    measured: Mapping[str, tuple[float, float]],
    names: Sequence[str],
    shares: np.ndarray,
    single: bool,
) -> Budget:
    """The result, from values and uncertainties (quantities,), and what was measured.

    `known` are the values and the parts but data, `measured` are values with their uncertainties
    by quantity. `names` are the uncertain numbers, and `shares` their parts of input², which are
    empty if they are not known. A `single` quantity has numbers in place of arrays.
    """
    D, data = np.array([measured.get(q.text, (np.nan, 0.0)) for q in quantities]).T
    given: dict[str, Any] = {**known, "data": data}
    columns: dict[str, Any] = {name: np.broadcast_to(u, D.shape) for name, u in given.items()}
    columns["total"] = np.sqrt(sum(columns[name] ** 2 for name in WORDS))
    columns["difference"] = columns["value"] - D
    columns["agrees"] = np.abs(columns["difference"]) <= COVERS * columns["total"]
    energies = opened.first.energies
    sentences = []
    rows = []
    for i, quantity in enumerate(quantities):
        numbers = {name: values[i].item() for name, values in columns.items()}
        unit = quantity.unit(energies)
        inputs = dict(zip(names, shares[i], strict=True)) if shares.size else {}
        verdict = _verdict(numbers, float(D[i]), unit, inputs, names)
        sentences.append(f"{quantity.text} = {verdict}")
        row: dict[str, Cell] = {"quantity": quantity.text, "unit": unit}
        row |= {name: numbers[name] for name in ("value", *WORDS, "total")}
        if np.isfinite(D[i]):
            row |= {"measured": float(D[i]), "difference": numbers["difference"]}
        if not np.isfinite(numbers["total"]):
            row["status"] = FAILED
        rows.append(row)
    at = 0 if single else slice(None)
    return Budget(
        title=opened.name,
        verdict="\n".join(sentences),
        table=Table(tuple(rows)),
        quantities=tuple(quantity.text for quantity in quantities),
        parameters=tuple(names),
        shares=shares,
        **{name: values[at] for name, values in columns.items()},
    )


def _verdict(
    numbers: Mapping[str, float],
    D: float,
    unit: str,
    inputs: Mapping[str, float],
    names: Sequence[str],
) -> str:
    """In words a value, its uncertainty, its largest part, and whether it agrees with D.

    `inputs` are the parts of input² by parameter, if they are known.
    """
    words = dict(WORDS)
    if not all(name.startswith("fabric") for name in names):
        words["input"] = "inputs"
    total = numbers["total"]
    text = f"{_shown(numbers['value'], total)} {unit}".strip()
    for name in WORDS:
        is_negligible = numbers[name] <= NEGLIGIBLE_PART * total
        if name != "data" and not is_negligible:
            text += f" ± {numbers[name]:.2g} ({words[name]})"
    is_measured = not np.isnan(D)
    if is_measured:
        text += f"; measured {_shown(D, numbers['data'])} ± {numbers['data']:.2g}"
    if not np.isfinite(total):
        return f"{text}: its uncertainty is not known, as runs for a part of it failed"
    squares = {f"the {words[name]}": numbers[name] ** 2 for name in WORDS}
    if inputs:
        del squares[f"the {words['input']}"]
        squares |= inputs
    largest, square = max(squares.items(), key=itemgetter(1))
    amount = f"{total:.2g}"
    if square:
        amount += f", of which {square**0.5:.2g} are of {largest}"
    if not is_measured:
        return f"{text}: uncertain by {amount}"
    off = abs(numbers["difference"])
    if off <= COVERS * total:
        within = "within twice its" if off > total else "within its"
        return f"{text}: agrees {within} uncertainty of {amount}"
    return f"{text}: the model is wrong by {off:.2g} ± {total:.2g}"


def _shown(value: float, u: float) -> str:
    """The value with four digits, or as many more as its uncertainty has places."""
    places = math.log10(abs(value) / u) if value and 0 < u < math.inf else 0.0
    return f"{value:.{max(4, math.ceil(places) + 2)}g}"
