"""The table of `tune`: what each run was for, its setting, its seconds and its error."""

from __future__ import annotations

import math
from typing import Any

from fecloth.study.problems import SceneProblem
from fecloth.study.tables import Table
from fecloth.study.tuning.proof import Proof
from fecloth.study.tuning.result import OTHER_TERMS
from fecloth.study.tuning.trials import Bench, Trial, each_once

COLUMNS = {  # of a setting: names in `Choice` and in the table
    "element": "element",
    "pattern": "pattern",
    "h": "h [m]",
    "method": "method",
    "rtol": "rtol [1/s]",
    "linear": "solver",
}


def table_of_runs(bench: Bench, found: Proof) -> Table:
    """Return a row for each run, with the largest error that it may have.

    This is its distance to the verifying run plus the error that is left in that one; for the
    tuned run it is the estimated error.
    """
    best = found.finer
    left = found.error - float(bench.distance(best, found.trial).max()) if best else math.nan
    rows = []
    for one in each_once([*found.search, found.trial, *([best] if best else [])]):
        line: dict[str, Any] = {"run": _purpose(bench, one, found)}
        line |= {title: getattr(one.choice, name) or None for name, title in COLUMNS.items()}
        line["graded"] = "yes" if one.choice.grading else None
        line["status"] = one.row["status"]
        if one.is_ok:
            line |= {name: one.row[name] for name in ("triangles", "steps")}
            line["CPU s"] = one.seconds
            if one is found.trial:
                line["error %"] = 100 * found.error
            elif best and one.records:  # not of runs that only measure seconds
                apart = 0.0 if one is best else float(bench.distance(best, one).max())
                line["error %"] = 100 * (apart + max(left, 0.0))
        rows.append(line)
    used = {name for row in rows for name, value in row.items() if value is not None}
    return Table(tuple({name: row[name] for name in row if name in used} for row in rows))


def _purpose(bench: Bench, one: Trial, found: Proof) -> str:
    """Return in words what a run was for."""
    if one is found.trial:
        return "tuned"
    if one is found.finer:
        return "verifying"
    if one.is_ok and not one.records:
        return "timing"
    if isinstance(bench.opened, SceneProblem) and "point" in one.row:
        terms = one.row["point"].problem.scene.terms
        if terms != bench.opened.scene.terms:
            return OTHER_TERMS
    return "sharper solver" if one.choice.sharper else "search"
