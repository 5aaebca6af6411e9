"""References of the twelve scenes: two fine runs each, and what they leave uncertain.

    python -m studies.tune.references [--names NAME …]

makes them, in 10 CPU minutes all together, and writes them into references.json. The second run has
h and dt divided by the ratio r of the scene. With d for their difference, the uncertainty of the
second is 1.25 d / (r² − 1), the grid convergence index for order 2 (Roache 1994). It must be less
than a tenth of the tolerance.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from fecloth import study
from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, relative_difference, value_of
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Row, Run, Runs, announce, record_at, run_quantities
from fecloth.study.status import OK
from studies import harness
from studies.tune.scenes import TWELVE, Tried

FILE = Path(__file__).with_name("references.json")
SAFETY, ORDER = 1.25, 2
SAMPLES = 500  # of a path; between them it is linear
DIGITS = 6


@dataclass(frozen=True, eq=False)
class Reference:
    """What the runs of a scene are compared with; by the text of the quantity.

    Attributes
    ----------
    values, uncertainties
        Of the second run, in the unit of the quantity, and relative.
    records
        The records of the quantities that are compared as vectors, paths or fields.
    """

    tried: Tried
    values: Mapping[str, float]
    uncertainties: Mapping[str, float]
    records: Mapping[str, RunRecord]

    def errors(self, row: Row) -> dict[str, float]:
        """Return the relative error of each quantity in a run; infinite without a value."""
        if row["status"] != OK:
            return dict.fromkeys(self.values, math.inf)
        return {text: self._error(parse_quantity(text), row) for text in self.values}

    def _error(self, quantity: Quantity, row: Row) -> float:
        record = record_at(row, quantity)
        if quantity.text in self.records:
            return relative_difference(quantity, self.records[quantity.text], record)
        exact = self.values[quantity.text]
        try:
            return abs(value_of(quantity, record) - exact) / abs(exact)
        except InputError:  # as where a signal has no period
            return math.inf


def fine_problems(tried: Tried) -> tuple[StudyProblem, StudyProblem]:
    """Return the problems of the two fine runs."""
    problem = StudyProblem.of(tried.scene(tried.fine)).finer(sharper=1.0)
    return problem, problem.finer(h=tried.ratio, dt=tried.ratio)


def quantities_of(tried: Tried) -> list[Quantity]:
    return [parse_quantity(text) for text in tried.scene().interest.all]


def fingerprint(tried: Tried) -> str:
    """Return a hash of the scene and its reference: another one makes the stored one stale.

    Defaults do not count: a solver's tolerance and the like change no limit.
    """
    text = to_toml(tried.tables(tried.fine)).replace(str(FILE.parents[2]), "")
    return hashlib.sha256(text.encode()).hexdigest()[:12]


# --- making ---------------------------------------------------------------------------------------


def make(tried: Tried, runs: Runs) -> dict:
    """Run both levels; return what is stored."""
    quantities = quantities_of(tried)
    to_run = [Run(problem, f"{tried.name}, h = {problem.h}") for problem in fine_problems(tried)]
    announce(to_run, runs)
    rows = run_quantities(to_run, quantities, runs)
    for row in rows:
        if row["status"] != OK:
            raise study.StudyFailed(f"{tried.name}: {row['cause']}")
    stored = {}
    for quantity in quantities:
        first, second = (record_at(row, quantity) for row in rows)
        stored[quantity.text] = _stored(tried, quantity, first, second)
    seconds = sum(row["cpu_seconds"] for row in rows)
    sizes = {key: rows[-1][key] for key in ("element", "triangles", "steps")}
    more = {"seconds": float(f"{seconds:.3g}"), "quantities": stored}
    return {"scene": fingerprint(tried)} | sizes | more


def _stored(tried: Tried, quantity: Quantity, first: RunRecord, second: RunRecord) -> dict:
    """Return value, difference and uncertainty, and the record where a number is not enough."""
    if is_number(quantity):
        value = value_of(quantity, second)
        apart = abs(value_of(quantity, first) - value) / abs(value)
        more: dict = {}
    else:
        value, apart = value_of(quantity, second), relative_difference(quantity, second, first)
        more = _record(quantity, second)
    uncertainty = SAFETY * apart / (tried.ratio**ORDER - 1)
    numbers = {"value": value, "difference": apart, "uncertainty": uncertainty}
    return {name: _short(number) for name, number in numbers.items()} | more


def is_number(quantity: Quantity) -> bool:
    """Whether two runs are compared by one number of each."""
    return not quantity.is_field and quantity.how not in ("value", "path")


def _record(quantity: Quantity, record: RunRecord) -> dict:
    """Return the columns, of long runs at equally spaced steps, or the field at the end."""
    if quantity.is_field:
        return {"field": _short(record.fields[quantity.name])}
    names = [f"{quantity.column}.{c}" for c in "xyz"] if quantity.column in record.vectors else []
    count = len(record.times)
    at = np.unique(np.linspace(0, count - 1, min(count, SAMPLES + 1)).round().astype(int))
    columns = {name: _short(record.columns[name][at]) for name in names or [quantity.column]}
    return {"times": _short(record.times[at]), "columns": columns}


def _short(values):
    """Return numbers with few digits: relative to the largest, so that round-off takes none."""
    if isinstance(values, float):
        return float(f"{values:.{DIGITS}g}")
    largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    places = DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0
    return np.where(np.isfinite(values), np.round(values, places) + 0.0, 0.0).tolist()


# --- reading --------------------------------------------------------------------------------------


@cache
def _file() -> dict:
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def read(tried: Tried) -> Reference:
    """Return the stored reference of a scene.

    Raises
    ------
    InputError
        If there is none, or it belongs to an earlier form of the scene.
    """
    found = _file().get(tried.name)
    if found is None or found["scene"] != fingerprint(tried):
        what = f"the reference of {tried.name}"
        remedy = f"Run python -m studies.tune.references --names {tried.name}"
        raise InputError(what, "is missing or belongs to another scene", FILE.name, remedy)
    return reference_of(tried, found)


def reference_of(tried: Tried, made: Mapping) -> Reference:
    """Return the reference of what `make` returned."""
    stored = made["quantities"]
    return Reference(
        tried,
        {text: one["value"] for text, one in stored.items()},
        {text: one["uncertainty"] for text, one in stored.items()},
        {text: r for text, one in stored.items() if (r := _read_record(tried, text, one))},
    )


def _read_record(tried: Tried, text: str, stored: Mapping) -> RunRecord | None:
    quantity = parse_quantity(text)
    if is_number(quantity):
        return None
    _, problem = fine_problems(tried)
    if quantity.is_field:
        cloth = problem.cloth_for(quantity)
        fields = {quantity.name: np.array(stored["field"])}
        return RunRecord(np.zeros(1), {}, cloth, fields)
    columns = {name: np.array(values) for name, values in stored["columns"].items()}
    return RunRecord(np.array(stored["times"]), columns, probes=problem.source.probes)


def main() -> int:
    names = {"nargs": "*", "default": [], "metavar": "NAME", "help": "scenes; all by default"}
    options = harness.parse_arguments(__doc__, names=names)
    known = {one.name: one for one in TWELVE if one.has_limit}
    chosen = [known[name] for name in options.names or known]
    stored = dict(_file())
    runs = Runs(
        options.out, options.jobs, options.scheduler, most_seconds=None, fresh=options.fresh
    )
    too_uncertain = []
    for tried in chosen:
        stored[tried.name] = make(tried, runs)
        _write({name: one for name, one in stored.items() if name in known})
        for text, one in stored[tried.name]["quantities"].items():
            print(f"{tried.name}: {text} = {one['value']:.6g} ± {100 * one['uncertainty']:.2g} %")
            if one["uncertainty"] > tried.tolerance / 10:
                too_uncertain.append(f"{tried.name}: {text}")
    print(f"more uncertain than a tenth of the tolerance: {', '.join(too_uncertain) or 'none'}")
    return 1 if too_uncertain else 0


def _write(stored: Mapping) -> None:
    """Write a line for each scene and one for each quantity."""
    parts = []
    for name, one in stored.items():
        rest = {key: value for key, value in one.items() if key != "quantities"}
        lines = [
            f"    {json.dumps(text)}: {json.dumps(q)}" for text, q in one["quantities"].items()
        ]
        body = ",\n".join(lines)
        parts.append(f'"{name}": {json.dumps(rest)[:-1]}, "quantities": {{\n{body}}}}}')
    replace_file(FILE, ("{\n" + ",\n".join(parts) + "\n}\n").encode())


if __name__ == "__main__":
    sys.exit(harness.run_main(main))
