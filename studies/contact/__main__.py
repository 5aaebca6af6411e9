"""Does contact give known answers as h, dt and the gap are refined?

A sheet bounces, and one slides to rest (Coulomb); a strip is pulled over a cylinder (the capstan
equation); a heavy strip is lifted (the elastica); a ball is pushed into a stretched drum (a
membrane of revolution). `converge` refines h, and dt where it moves; its ± has all parts of the
error. Rows of the gap, on the first mesh and step, have that of the gap alone.

    python -m studies.contact [--quick]
"""

from __future__ import annotations

import warnings
from pathlib import Path

import fecloth as fc
from fecloth import study
from fecloth.study.uncertainty import estimate_uncertainty
from studies import harness
from studies.contact import references

CLOSE, COARSE = 1.0, 10.0  # % of the exact value, at most; in the quick form
COVERED = 0.8  # part of the exact values within value ± U


def refine(known: references.Known, by: str, levels: int) -> dict:
    """A row: the figure on the finest level, its ±, the order, and the exact value."""
    h = known.h
    if by == "dt" and known.fine is not None:
        h = known.fine
    sizes = {"h": h} | ({"dt": known.dt, "t_end": known.t_end} if known.dt else {})
    if by == "gap":
        gaps = [4 * known.gap, 2 * known.gap, known.gap]
        swept = study.sweep(known.problem, {"gap": gaps}, known.quantity, **sizes)
        values = [row[swept.quantities[0]] for row in swept.table]
        refined = estimate_uncertainty(gaps, values, theory=1.0)
    else:
        refined = study.converge(known.problem, known.quantity, by, levels, **sizes)
    return {
        "figure": known.name,
        "refined": by,
        "value": refined.value,
        "±": refined.uncertainty,
        "order": refined.order,
        "exact": known.exact,
        "error %": 100 * (refined.value / known.exact - 1),
        "error over ±": abs(refined.value - known.exact) / refined.uncertainty,
    }


def of_self_contact(sizes: tuple[float, ...]) -> list[dict]:
    """The drum that touches a sheet: the contact radius on each mesh."""
    rows = []
    for h in sizes:
        computed, exact = references.drum_on_sheet(h, 0.5 * references.GAP)
        rows.append({"h": h, "radius [m]": computed, "error %": 100 * (computed / exact - 1)})
    return rows


def main() -> int:
    """Refine the problems, and write the report."""
    options = harness.parse_arguments(__doc__)
    warnings.simplefilter("ignore", fc.FeclothWarning)
    known = references.known_answers()
    sizes = ("h",) if options.quick else ("h", "dt", "gap")
    ways = [(each, by) for each in known for by in sizes if by != "dt" or each.dt]
    rows = [refine(each, by, 3 if options.quick else 4) for each, by in ways]
    drums = of_self_contact((0.02, 0.01) if options.quick else (0.02, 0.01, 0.005))
    judged = [row for row in rows if row["refined"] != "gap"]
    best = {
        each.name: [abs(row["error %"]) for row in rows if row["figure"] == each.name]
        for each in known
    }
    bound = COARSE if options.quick else CLOSE
    worst = max(map(min, best.values()))
    covered = sum(row["error over ±"] <= 1 for row in judged) / len(judged)
    findings = [
        harness.Finding("largest error of a figure, at its best level, %", worst, high=bound),
        harness.Finding("part of the exact values within ±, h and dt", covered, low=COVERED),
        harness.Finding(
            "a drum on a sheet, finest mesh, |error| %", abs(drums[-1]["error %"]), high=CLOSE
        ),
    ]
    title, what = harness.about(__doc__)
    tables = {"Refined": rows, "A drum that touches a sheet": drums}
    page = Path(__file__).with_name("contact")
    return harness.write_report(
        options, title, rows, conclusion=what, findings=findings, tables=tables, page=page
    )


if __name__ == "__main__":
    harness.run_main(main)
