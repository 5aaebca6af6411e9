"""The result of `budget`: parts of an uncertainty, in words, as a table and as a figure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np

from fecloth.simulation.quantity import Quantity
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.problem import StudyProblem
from fecloth.study.result import Cell, StudyResult, Table
from fecloth.study.status import FAILED
from fecloth.study.uncertainty import COVERS

# A part of the uncertainty that is at most this part of the total is not named, and not drawn.
NEGLIGIBLE_PART = 0.01
WORDS = {"space": "mesh", "time": "time step", "solver": "solver", "input": "fabric"}
WORDS |= {"specimen": "specimen", "law": "law", "start": "start", "data": "measurement"}


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
    specimen
        Standard uncertainty by the specimen: how much single specimens differ from their mean.
    law
        Standard uncertainty by the law, as a fit has found it.
    start
        Standard uncertainty by the start; 0 where no starts were disturbed and an equilibrium has
        no other states.
    data
        Standard uncertainty of the measured value; 0 where nothing was measured.
    total
        Root of the sum of the squares of the eight parts, as far as they are known.
    difference
        Computed − measured value; NaN where nothing was measured.
    agrees
        Whether |difference| ≤ 2 total; None where nothing was measured, and where a part is not
        known: then there is no verdict on the model.
    shares
        (quantities, parameters) parts of input² by the first order; empty where samples gave
        input.
    unknown
        Names of the constants that the terms read, but whose uncertainty is not known.
    exact
        Names of the other numbers that count as exact.
    """

    quantities: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    value: Any = np.nan
    time: Any = np.nan
    space: Any = np.nan
    solver: Any = np.nan
    input: Any = np.nan
    specimen: Any = np.nan
    law: Any = np.nan
    start: Any = np.nan
    data: Any = np.nan
    total: Any = np.nan
    difference: Any = np.nan
    agrees: Any = None
    shares: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    unknown: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()

    def notes(self) -> list[str]:
        """Return the remarks, and what counts as exact."""
        exact = ", ".join([*self.exact, "the sizes of the cloth"])
        return [*super().notes(), f"Counted as exact: {exact}."]

    def figure(self) -> Figure:
        """Return a stacked bar for each quantity: the parts of its variance, in per cent.

        The part of the uncertain numbers is divided among them, if their shares are known.
        Negligible parts are left out.
        """
        labels = list[str]()
        variances = list[np.ndarray]()  # (quantities,) for each label
        for name, words in WORDS.items():
            if name == "input" and self.shares.size:
                labels += self.parameters
                variances += list(self.shares.T)
            else:
                labels.append(words)
                variances.append(np.atleast_1d(getattr(self, name)) ** 2)
        # correlated inputs may have negative parts, and a part is NaN where its runs failed
        parts = np.maximum(np.nan_to_num(variances), 0.0)
        parts /= np.maximum(parts.sum(axis=0), np.finfo(float).tiny)  # no division by 0
        shown = np.flatnonzero((parts > NEGLIGIBLE_PART**2).any(axis=1))
        left = np.zeros(parts.shape[1])
        drawing, ax = new_figure(1, 1, (8.0, 1.6 + 0.7 * len(left) + 0.15 * len(shown)))
        for i, k in enumerate(shown):
            rounds, color = divmod(i, len(COLOURS))  # colours that come again are hatched
            width = 100 * parts[k]
            ax.barh(
                self.quantities,
                width,
                left=left,
                label=labels[k],
                color=COLOURS[color],
                hatch="//" * rounds,
                ec="white",
            )
            left = left + width
        ax.set(xlabel="part of the variance [%]", xlim=(0, 100))
        ax.invert_yaxis()
        drawing.legend(loc="outside lower center", ncols=2)
        return drawing


def make_budget(
    opened: StudyProblem,
    quantities: Sequence[Quantity],
    values_and_parts: Mapping[str, Any],
    measured: Mapping[str, tuple[float, float]],
    parameters: Sequence[str],
    shares: np.ndarray,
    is_single: bool,
    unknown: tuple[str, ...] = (),
    exact: tuple[str, ...] = (),
) -> Budget:
    """Return the result of `budget`, with its total, its verdict and its table.

    `values_and_parts` are arrays (quantities,) or numbers by name: "value", and the standard
    uncertainties of `WORDS` without "data"; a part that is left out is 0. `measured` has a
    measured value and its uncertainty by the text of a quantity. `parameters` are the names of
    the uncertain numbers, and `shares` (quantities, parameters) their parts of input²; empty if
    they are not known. If `is_single`, the result has numbers in place of arrays. `unknown` and
    `exact` are as in `Budget`.
    """
    D, data = np.array([measured.get(q.text, (np.nan, 0.0)) for q in quantities]).T
    columns: dict[str, Any] = {}
    zeros = dict.fromkeys(WORDS, 0.0)
    for name, numbers_of_name in {**zeros, **values_and_parts, "data": data}.items():
        columns[name] = np.broadcast_to(numbers_of_name, D.shape)
    columns["total"] = np.sqrt(sum(columns[name] ** 2 for name in WORDS))
    columns["difference"] = columns["value"] - D
    is_told = np.isfinite(columns["difference"] + columns["total"]) & (not unknown)
    agrees = np.abs(columns["difference"]) <= COVERS * columns["total"]
    columns["agrees"] = np.where(is_told, agrees.astype(object), None)
    energies = opened.first.energies
    sentences = []
    rows = []
    for i, quantity in enumerate(quantities):
        numbers = {name: values[i].item() for name, values in columns.items() if name != "agrees"}
        unit = quantity.unit(energies)
        inputs = dict(zip(parameters, shares[i], strict=True)) if shares.size else {}
        verdict = _verdict(numbers, float(D[i]), unit, inputs, parameters, unknown)
        sentences.append(f"{quantity.text} = {verdict}")
        row: dict[str, Cell] = {"quantity": quantity.text, "unit": unit}
        row |= {name: numbers[name] for name in ("value", *WORDS, "total")}
        if np.isfinite(D[i]):
            row |= {"measured": float(D[i]), "difference": numbers["difference"]}
        if not np.isfinite(numbers["total"]):
            row["status"] = FAILED
        rows.append(row)
    selected = 0 if is_single else slice(None)
    return Budget(
        title=opened.name,
        verdict="\n".join(sentences),
        table=Table(tuple(rows)),
        quantities=tuple(quantity.text for quantity in quantities),
        parameters=tuple(parameters),
        shares=shares,
        unknown=unknown,
        exact=exact,
        **{name: values[selected] for name, values in columns.items()},
    )


def _verdict(
    numbers: Mapping[str, float],
    D: float,
    unit: str,
    inputs: Mapping[str, float],
    parameters: Sequence[str],
    unknown: Sequence[str],
) -> str:
    """Return in words a value, its uncertainties, the largest of them, and what was measured.

    `numbers` are the fields of `Budget` for one quantity, by name. `D` is the measured value;
    NaN if there is none. If there is one, the words say whether both agree. `parameters` are the
    names of the uncertain numbers, and `inputs` their parts of input² by name; empty if they are
    not known. If the uncertainties of `unknown` constants are missing, they do not.
    """
    words = dict(WORDS)
    if not all(name.startswith("fabric") for name in parameters):
        words["input"] = "inputs"  # other numbers than constants of fabrics are uncertain, too
    total = numbers["total"]
    text = f"{_shown(numbers['value'], total)} {unit}".strip()
    least = NEGLIGIBLE_PART * total if np.isfinite(total) else 0.0
    for name in WORDS:
        if name != "data" and numbers[name] > least:  # data stands beside the measured value
            text += f" ± {numbers[name]:.2g} ({words[name]})"
    is_measured = not np.isnan(D)
    if is_measured:
        text += f"; measured {_shown(D, numbers['data'])} ± {numbers['data']:.2g}"
    if not np.isfinite(total):
        missing = ", ".join(words[name] for name in WORDS if not np.isfinite(numbers[name]))
        return f"{text}: its uncertainty is not known (missing parts: {missing})"
    squares = {f"the {words[name]}": numbers[name] ** 2 for name in WORDS}
    if inputs:  # each parameter stands for itself
        del squares[f"the {words['input']}"]
        squares |= inputs
    largest, square = max(squares.items(), key=itemgetter(1))
    amount = f"{total:.2g}"
    if square:
        amount += f", of which {square**0.5:.2g} are of {largest}"
    if unknown:
        names = ", ".join(unknown)
        missing = f"the uncertainty of {names} is not known. State it, or fit them"
        if not is_measured:
            return f"{text}: uncertain by at least {amount}; {missing}"
        return f"{text}: no verdict on the model; {missing}"
    if not is_measured:
        return f"{text}: uncertain by {amount}"
    difference = abs(numbers["difference"])
    if difference <= COVERS * total:
        within = "within twice its" if difference > total else "within its"
        return f"{text}: agrees {within} uncertainty of {amount}"
    return f"{text}: the model is wrong by {difference:.2g} ± {total:.2g}"


def _shown(value: float, u: float) -> str:
    """The value with four digits, or as many more as its uncertainty has places."""
    places = math.log10(abs(value) / u) if value and 0 < u < math.inf else 0.0
    return f"{value:.{max(4, math.ceil(places) + 2)}g}"
