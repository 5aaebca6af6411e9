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
from fecloth.study.result import StudyResult, Table
from fecloth.study.status import FAILED

COVERS = 2.0  # times the standard uncertainty: within it, two values agree
LEAST = 0.1  # per cent of the variance: what the figure shows
LITTLE = 0.01  # of the total: what a verdict does not name
WORDS = {"space": "mesh", "time": "time step", "solver": "solver", "input": "fabric"}
WORDS |= {"start": "start", "data": "measurement"}


@dataclass(frozen=True, eq=False, repr=False)
class Budget(StudyResult):
    """What `budget` found: standard uncertainties, in the unit of each quantity.

    Of a single quantity these are numbers, else arrays (quantities,).

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
    quantities
        Their texts.
    parameters
        Names of the uncertain numbers.
    value
        On the finest mesh.
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
        Of what was measured; 0 for nothing.
    total
        Root of the sum of the squares of the six parts.
    difference
        Value − measured; NaN for nothing measured.
    agrees
        |difference| ≤ 2 total.
    shares
        (quantities, parameters) parts of input² by first order; empty where samples gave
        it.
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
        parts *= 100 / np.maximum(parts.sum(axis=0), np.finfo(float).tiny)
        left = np.zeros(parts.shape[1])
        shown = np.flatnonzero((parts > LEAST).any(axis=1))
        drawing, ax = new_figure(1, 1, (8.0, 1.6 + 0.7 * len(left) + 0.15 * len(shown)))
        for i, k in enumerate(shown):
            again, color = divmod(i, len(COLOURS))
            look: dict[str, Any] = {"color": COLOURS[color], "hatch": "//" * again, "ec": "white"}
            ax.barh(self.quantities, parts[k], left=left, label=rows[k][0], **look)
            left = left + parts[k]
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
    """The result, from values and uncertainties (quantities,), and what was measured."""
    D, data = np.array([measured.get(q.text, (np.nan, 0.0)) for q in quantities]).T
    given: dict[str, Any] = {**known, "data": data}
    columns: dict[str, Any] = {name: np.broadcast_to(u, D.shape) for name, u in given.items()}
    columns["total"] = np.sqrt(sum(columns[name] ** 2 for name in WORDS))
    columns["difference"] = columns["value"] - D
    columns["agrees"] = np.abs(columns["difference"]) <= COVERS * columns["total"]
    at = 0 if single else slice(None)
    energies = opened.first.energies
    sentences = []
    rows = []
    for i, quantity in enumerate(quantities):
        of = {name: values[i].item() for name, values in columns.items()}
        unit = quantity.unit(energies)
        inputs = dict(zip(names, shares[i], strict=True)) if shares.size else {}
        sentences.append(f"{quantity.text} = {_verdict(of, float(D[i]), unit, inputs, names)}")
        shown = {name: of[name] for name in ("value", *WORDS, "total")}
        compared = {"measured": float(D[i]), "difference": of["difference"]}
        rows.append({"quantity": quantity.text, "unit": unit} | shown)
        rows[-1] |= compared if np.isfinite(D[i]) else {}
        rows[-1] |= {} if np.isfinite(of["total"]) else {"status": FAILED}
    return Budget(
        title=opened.name,
        verdict="\n".join(sentences),
        table=Table(tuple(rows)),
        quantities=tuple(q.text for q in quantities),
        parameters=tuple(names),
        shares=shares,
        **{name: values[at] for name, values in columns.items()},
    )


def _verdict(
    of: Mapping[str, float], D: float, unit: str, inputs: Mapping[str, float], names: Sequence[str]
) -> str:
    """In words a value, its uncertainty, its largest part, and whether it agrees with D."""
    # `inputs` are the parts of input² by parameter, if they are known.
    fabric = all(name.startswith("fabric") for name in names)
    words = WORDS | ({} if fabric else {"input": "inputs"})
    total = of["total"]
    counts = [name for name in WORDS if name != "data" and not of[name] <= LITTLE * total]
    text = f"{_shown(of['value'], total)} {unit}".strip() + "".join(
        f" ± {of[name]:.2g} ({words[name]})" for name in counts
    )
    text += "" if np.isnan(D) else f"; measured {_shown(D, of['data'])} ± {of['data']:.2g}"
    if not np.isfinite(total):
        return f"{text}: its uncertainty is not known, as runs for a part of it failed"
    parts = {f"the {words[name]}": of[name] ** 2 for name in WORDS if name != "input" or not inputs}
    largest, square = max((parts | dict(inputs)).items(), key=itemgetter(1))
    amount = f"{total:.2g}" + (f", of which {square**0.5:.2g} are of {largest}" if square else "")
    if np.isnan(D):
        return f"{text}: uncertain by {amount}"
    off = abs(of["difference"])
    if off <= COVERS * total:
        return f"{text}: agrees within {'twice ' if off > total else ''}its uncertainty of {amount}"
    return f"{text}: the model is wrong by {off:.2g} ± {total:.2g}"


def _shown(value: float, u: float) -> str:
    """The value with four digits, or as many more as its uncertainty has places."""
    places = math.log10(abs(value) / u) if value and 0 < u < math.inf else 0.0
    return f"{value:.{max(4, math.ceil(places) + 2)}g}"
