"""What the studies have written, read back for choose.py: tables, findings, printed lines, runs."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from speed_accuracy import EXPLICIT, FIRST, cheapest
from speed_grid import MODEL

Rows = list[dict]
PRINTED = ("auto", "solvers", "costs", "bending_bias")  # on the terminal, without a report


class Missing(Exception):
    """A table is not there; the message tells the command that makes it."""


def command(study: str, tables: Path) -> str:
    """What writes the tables of a study."""
    name, file = study.split("/")[0], tables / study
    if name in PRINTED:
        return f"mkdir -p {tables} && python studies/{name}.py > {file}.txt"
    return f"python studies/{name}.py --out {tables / name}"


@dataclass(frozen=True)
class Tables:
    """What the studies have written into a folder, each into a folder or file of its own name."""

    folder: Path
    quick: bool = False

    def text(self, study: str) -> str:
        path = self.folder / (f"{study}.txt" if study in PRINTED else f"{study}/report.md")
        remedy = f"make it by\n    {command(study, self.folder)}"
        if not path.is_file():
            raise Missing(f"{path} is not there: {remedy}")
        text = path.read_text(encoding="utf-8")
        if not self.quick and "- quick: True" in text:
            raise Missing(f"{path} is of a quick form: {remedy}")
        return text

    def table(self, study: str, heading: str) -> Rows:
        """The rows of a table of the report, numbers as floats."""
        found = parsed(self.text(study)).get(heading)
        if found is None:
            raise Missing(f"{self.folder / study}/report.md has no table “{heading}”")
        return found

    def all_of(self, study: str, heading: str, column: str, **where: object) -> list[float]:
        """A column of the rows that are as `where` says."""
        rows = self.table(study, heading)
        own = [row for row in rows if all(row.get(k) == v for k, v in where.items())]
        return [row.get(column, math.nan) for row in own]

    def one(self, study: str, heading: str, column: str, **where: object) -> float:
        """The last of these, NaN if there is none."""
        return (self.all_of(study, heading, column, **where) or [math.nan])[-1]

    def finding(self, study: str, what: str) -> float:
        """The value of a line of the findings, or of the last line of a study that prints."""
        match = re.search(rf"^(?:- )?{re.escape(what)}: (?:at most )?(\S+)", self.text(study), re.M)
        return number(match[1]) if match else math.nan

    def printed(self, study: str, *name: str) -> list[float]:
        """The numbers in the line that begins with these words, of a study that prints."""
        lines = [tuple(line.split()) for line in self.text(study).splitlines()]
        k = len(name)
        return next(([number(cell) for cell in line[k:]] for line in lines if line[:k] == name), [])

    def run(self, scene: str, level: float, among: Callable = lambda row: True) -> dict:
        """The run of speed_accuracy.py that takes the fewest seconds to that error, or {}."""
        self.text("speed_accuracy")
        own = (r for r in runs(self.folder / "speed_accuracy/results.csv") if r["scene"] == scene)
        own = [r for r in own if r["model"] == MODEL[scene]]
        if not own:
            raise Missing(
                f"{self.folder}/speed_accuracy has no scene “{scene}”, quick forms have few"
            )
        return cheapest(own, scene, level, among) or {}

    def cheapest(self, scene: str, level: float, among: Callable = lambda row: True) -> float:
        return self.run(scene, level, among).get("seconds", math.inf)


def number(text: str) -> float | str:
    """A cell: a number where it is one, NaN where it is empty."""
    try:
        return float(text or "nan")
    except ValueError:
        return text


@cache
def runs(path: Path) -> Rows:
    with path.open(newline="", encoding="utf-8") as stream:
        return [{k: number(v) for k, v in row.items()} for row in csv.DictReader(stream)]


@cache
def parsed(report: str) -> dict[str, Rows]:
    """Heading to rows of all tables of a report.

    Examples
    --------
    >>> parsed("## Cost\\n\\n| model | ms |\\n|---|---|\\n| StVK | 2.5 |\\n")
    {'Cost': [{'model': 'StVK', 'ms': 2.5}]}
    """
    tables = {}
    for part in re.split(r"^## ", report, flags=re.MULTILINE)[1:]:
        lines = [line for line in part.splitlines() if line.startswith("|")]
        cells = [[c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
        if cells:
            columns, _, *rest = cells
            rows = [dict(zip(columns, map(number, row), strict=False)) for row in rest]
            tables[part.splitlines()[0]] = rows
    return tables


# --- kinds of runs --------------------------------------------------------------------------------


def explicit(row: Mapping) -> bool:
    return row["method"] in EXPLICIT


def implicit(row: Mapping) -> bool:
    """Marched by an implicit method of fixed steps on linear triangles."""
    others = ("Auto", "Adaptive", "equilibrium", "MuJoCo")
    return row["element"] == "P1" and not explicit(row) and not row["method"].startswith(others)


def first_order(row: Mapping) -> bool:
    return row["method"] in FIRST[:2]


def second_order(row: Mapping) -> bool:
    return implicit(row) and not first_order(row)


def still(row: Mapping) -> bool:
    return row["method"] == "equilibrium"
