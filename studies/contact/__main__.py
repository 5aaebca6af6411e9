"""Does contact give known answers, and at which order in the mesh and the gap?

A strip is pulled over a cylinder (the capstan equation), a heavy strip is lifted from a plane (the
elastica), and a drum is blown against a plate, or against a held sheet with `SelfContact`. Errors
are relative; the gap is 0.125 mm, in the file also larger ones.

    python -m studies.contact [--quick]
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import fecloth as fc
from studies import harness
from studies.contact import references

GAPS, FINEST_GAP = (2e-3, 1e-3, 5e-4, 2.5e-4), 1.25e-4
CLOSE = 1.0  # %, on the finest mesh


def line(problem: str, computed: float, exact: float, **settings: object) -> dict:
    """A row of the results."""
    error = 100 * (computed / exact - 1)
    return {"problem": problem, **settings, "computed": computed, "exact": exact, "error %": error}


def capstans(quick: bool) -> list[dict]:
    """T₂/T₁ of a strip over a cylinder, by steps and by the equilibrium of 10 load steps."""
    rows = []
    for mu, degrees in [(0.3, 90)] if quick else [(0.0, 90), (0.3, 90), (0.6, 90), (0.3, 180)]:
        problem = f"strip over a cylinder, μ = {mu}, {degrees}°: T₂/T₁"
        angle = math.radians(degrees)
        exact = math.exp(mu * angle)
        for h, dt in [(0.01, 5e-3)] if quick else [(0.01, 4e-3), (0.005, 4e-3), (0.01, 2e-3)]:
            moved = references.capstan(mu, angle, h, dt)
            rows.append(line(problem, moved, exact, h=h, dt=dt))
            if dt != 2e-3:
                rows.append(line(problem, references.capstan_at_rest(mu, angle, h), exact, h=h))
    return rows


def refined(problem: str, solve: Callable, sizes: tuple[float, ...], gaps: tuple) -> list[dict]:
    """A figure under refinement of h, at the smallest gap, and of the gap, at the smallest h."""
    settings = [*((h, FINEST_GAP) for h in sizes), *((sizes[-1], gap) for gap in gaps)]
    return [line(problem, *solve(h, gap), h=h, gap=gap) for h, gap in settings]


def errors_on_meshes(rows: list[dict]) -> list[dict]:
    """The errors [%] of each problem at each h, at rest and with the smallest gap."""
    rows = [row for row in rows if "dt" not in row and row.get("gap", FINEST_GAP) == FINEST_GAP]
    sizes = sorted({row["h"] for row in rows}, reverse=True)
    return [
        {"problem": problem}
        | {f"h = {1e3 * h:g} mm": "" for h in sizes}
        | {
            f"h = {1e3 * row['h']:g} mm": row["error %"]
            for row in rows
            if row["problem"] == problem
        }
        for problem in dict.fromkeys(row["problem"] for row in rows)
    ]


def main() -> int:
    """Solve the problems, and write the report."""
    options = harness.parse_arguments(__doc__)
    warnings.simplefilter("ignore", fc.FeclothWarning)
    sizes = (0.02, 0.01) if options.quick else (0.02, 0.01, 0.005, 0.0025)
    gaps = GAPS[-1:] if options.quick else GAPS
    rows = [
        *capstans(options.quick),
        *refined("lifted heavy strip", references.lifted, sizes, gaps),
        *refined("drum against a plate", references.drum, sizes, gaps),
        *refined("drum against a held sheet", references.drum_on_sheet, sizes, gaps[-2:]),
    ]
    title, what = harness.about(__doc__)
    table = errors_on_meshes(rows)
    findings = [
        harness.Finding(f"{row['problem']}: |error| on the finest mesh, %", finest, high=CLOSE)
        for row in table
        for finest in [[abs(error) for error in row.values() if isinstance(error, float)][-1]]
    ]
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        findings=findings,
        tables={"Errors in %": table},
        page=Path(__file__).with_name("contact"),
    )


if __name__ == "__main__":
    harness.run_main(main)
