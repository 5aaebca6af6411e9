"""Contact against known answers, under refinement of mesh, gap and step.

The problems are from references.py: the capstan equation, a heavy elastica that leaves a plane,
and a drum blown against a plate, or against a held sheet with `SelfContact`. Errors are relative.
The full form writes contact.md.
`python -m studies.evidence.contact.drop` lets a sheet fall on a ball.

    python -m studies.contact [--quick]
"""

from __future__ import annotations

import inspect
import math
import warnings
from pathlib import Path

import fecloth as fc
from studies import harness
from studies.contact import references

HERE = Path(__file__).parent
GAPS, FINEST_GAP = (2e-3, 1e-3, 5e-4, 2.5e-4), 1.25e-4


def table(title: str, head: tuple[str, ...], rows: list[tuple]) -> str:
    """A Markdown table below its title."""
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    lines += [" | ".join(map(str, row)) for row in rows]
    return f"## {title}\n\n" + "\n".join(f"| {line} |" for line in lines) + "\n"


def percent(value: float, exact: float) -> str:
    """The relative error in per cent."""
    return f"{100 * (value / exact - 1):+.3f}"


def order(values: list[float]) -> str:
    """The order from the last three values at steps of ratio 2, or nothing."""
    if len(values) < 3:
        return ""
    a, b, c = values[-3:]
    return f"{math.log2(abs((b - a) / (c - b))):.1f}"


def capstans(quick: bool) -> str:
    """T₂/T₁ against e^(μ θ)."""
    grid = [(0.3, 90)] if quick else [(0.0, 90), (0.3, 90), (0.6, 90), (0.3, 180)]
    rows = []
    for mu, degrees in grid:
        exact = math.exp(mu * math.radians(degrees))
        for h, dt in [(0.01, 5e-3)] if quick else [(0.01, 4e-3), (0.005, 4e-3), (0.01, 2e-3)]:
            ratio = references.capstan(mu, math.radians(degrees), h, dt)
            error = percent(ratio, exact)
            rows.append((mu, degrees, 1e3 * h, 1e3 * dt, f"{ratio:.4f}", f"{exact:.4f}", error))
            if dt != 2e-3:
                ratio = references.capstan_at_rest(mu, math.radians(degrees), h)
                shown = f"{ratio:.4f}", f"{exact:.4f}", percent(ratio, exact)
                rows.append((mu, degrees, 1e3 * h, "10 load steps", *shown))
    head = ("μ", "θ [°]", "h [mm]", "dt [ms]", "T₂/T₁", "e^(μθ)", "error [%]")
    return table("A strip that is pulled over a cylinder", head, rows)


def refined(title: str, unit: str, solve, sizes: tuple[float, ...], gaps: tuple) -> str:
    """Tables of a figure under refinement of h, at the smallest gap, and of the gap."""
    rows, values = [], []
    for h in sizes:
        value, exact = solve(h, FINEST_GAP)
        values.append(value)
        shown = f"{value:.6g}", f"{exact:.6g}", percent(value, exact), order(values)
        rows.append((1e3 * h, 1e3 * FINEST_GAP, *shown))
    for gap in gaps:
        value, exact = solve(sizes[-1], gap)
        shown = f"{value:.6g}", f"{exact:.6g}", percent(value, exact), ""
        rows.append((1e3 * sizes[-1], 1e3 * gap, *shown))
    head = ("h [mm]", "gap [mm]", f"computed [{unit}]", "exact", "error [%]", "order in h")
    return table(title, head, rows)


def main() -> None:
    """Print the tables, and write contact.md in the full form."""
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse meshes, few rows")
    quick = parser.parse_args().quick
    warnings.simplefilter("ignore", fc.FeclothWarning)
    sizes = (0.02, 0.01) if quick else (0.02, 0.01, 0.005, 0.0025)
    gaps = GAPS[-1:] if quick else GAPS
    parts = [
        f"# Contact\n\n{inspect.cleandoc(__doc__.split('    python')[0])}\n",
        capstans(quick),
        refined("A lifted heavy strip", "N/m", references.lifted, sizes, gaps),
        refined("A drum against a plate", "m", references.drum, sizes, gaps),
        refined("A drum against a held sheet", "m", references.drum_on_sheet, sizes, gaps[-2:]),
    ]
    text = "\n".join(parts)
    print(text)
    if not quick:
        (HERE / "contact.md").write_text(text, encoding="utf-8")
        print("wrote studies/contact/contact.md")


if __name__ == "__main__":
    harness.run_main(main)
