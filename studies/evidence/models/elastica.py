"""Membrane locking: a thin strip hangs as the heavy elastica, by element, pattern and thinness.

    python -m studies.evidence.models.elastica [--quick] [--jobs N] [--out DIR]

A strip of length L, half as wide, is clamped level at one end and hangs under its weight with
Γ = ρ g L³/B = 10 and ν = 0. Its drop over its reach is compared with the drop over reach of the
inextensible elastica. The membrane's stiffness is Y = R B/L² with R from 1e5 to 1e8; cotton of 1 m
has some 1e8. All use `PlateBending`. The elements have the same nodes: n spacings along, so P2 has
n/2 edges.

P1 and P2 with the strain at the quadrature points lock: on coarse meshes they are too stiff by up
to tens of percent, the more the larger R, until h is small enough. P2 with the interpolated strain,
the default, does not lock. The table of a full run is in studies/evidence/models/elastica.md.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.bending.meshes import rectangle
from studies.references.elastica import heavy_elastica

GAMMA = 10.0
PATTERNS = ("right", "cross", "equilateral", "unstructured", "jittered")
MODELS = {"P1": "P1", "P2, pointwise strain": "P2", "P2, interpolated strain": "P2"}
RATIOS = (1e5, 1e6, 1e7, 1e8)  # Y L²/B
SPACINGS = (8, 16, 32, 64)
LOCAL = "P2, interpolated strain"  # that does not lock
LIMITS = {16: 3e-3, 32: 8e-4}  # of its |error|, at 1e6 and 1e7

curve = cache(heavy_elastica)


def strip(pattern: str, n: int, element: str, width: float = 0.5) -> fc.Cloth:
    """A strip of length 1 with n nodes along it."""
    return rectangle(1.0, width, 1 / n if element == "P1" else 2 / n, pattern, element)


def hang(model: str, pattern: str, ratio: float, n: int, width: float = 0.5) -> dict:
    """Return the relative error of drop over reach of the free end, and the Newton iterations.

    The iteration starts at the nodes of the exact curve: from flat it does not end at R = 1e7.
    """
    s, reach, drop = curve(GAMMA)
    cloth = strip(pattern, n, MODELS[model], width)
    membrane = fc.StVK(strain="pointwise" if "pointwise" in model else "interpolated")
    terms = [membrane, fc.PlateBending(), fc.Gravity((0, 0, -GAMMA))]
    fabric = fc.Fabric(1.0, ratio, bending_rigidity=1.0)
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    along, z = (np.interp(cloth.X[:, 0], s, of) for of in (reach, -drop))
    start = system.state(np.column_stack([along, cloth.X[:, 1], z]))
    hung = fc.equilibrium(system, start, tolerance=max(1e-8, 1e-15 * ratio))
    tip = hung.x[cloth.nodes("right")].mean(axis=0)
    error = -tip[2] / tip[0] / (drop[-1] / reach[-1]) - 1
    return {"error": error, "iterations": hung.iterations, "residual": hung.residual}


def list_cases(quick: bool) -> list[dict]:
    ratios, spacings = ((1e7,), SPACINGS[:2]) if quick else (RATIOS, SPACINGS)
    names = ("pattern", "ratio", "model", "n")
    return [
        dict(zip(names, values, strict=True))
        for values in product(PATTERNS, ratios, MODELS, spacings)
    ]


def largest(rows: list[dict], **where) -> float:
    """The largest |error| of the rows with these settings; NaN without any."""
    chosen = [row for row in rows if where.items() <= row.items() and row["status"] == "ok"]
    return max((abs(row["error"]) for row in chosen), default=np.nan)


def worst(rows: list[dict]) -> list[dict]:
    """One line for each model and ratio: the largest |error| of all patterns at each n."""
    sizes = dict.fromkeys(row["n"] for row in rows)
    return [
        {"model": model, "Y L²/B": f"{ratio:.0e}"}
        | {f"n = {n}": f"{largest(rows, model=model, ratio=ratio, n=n):.1e}" for n in sizes}
        for model, ratio in dict.fromkeys((row["model"], row["ratio"]) for row in rows)
    ]


def conclude(rows: list[dict]) -> list[harness.Finding]:
    """Return the findings: P2 with the interpolated strain keeps its limits, the others do not."""
    findings = []
    for ratio, n in product((1e6, 1e7), LIMITS):
        of = {"ratio": ratio, "n": n}
        if any(of.items() <= row.items() for row in rows):
            name = f"{LOCAL}, Y L²/B = {ratio:.0e}, n = {n}: largest |error|"
            findings.append(harness.Finding(name, largest(rows, model=LOCAL, **of), high=LIMITS[n]))
    for model in ("P1", "P2, pointwise strain"):
        name = f"{model}, Y L²/B = 1e+07, n = 16: largest |error|"
        error = largest(rows, model=model, ratio=1e7, n=16)
        findings.append(harness.Finding(name, error, 0.1))
    return findings


def draw(rows: list[dict], out: Path, ratio: float = 1e7) -> None:
    """Draw |error| over n, a panel for each model, a line for each pattern."""
    with harness.figure(
        out, "elastica", "node spacings along n", panels=(1, 3), size=(12.0, 4.4), sharey=True
    ) as (_, axes):
        for ax, model in zip(axes, MODELS, strict=True):
            own = [row for row in rows if (row["model"], row["ratio"]) == (model, ratio)]
            own = [{**row, "error": abs(row.get("error", np.nan))} for row in own]
            harness.draw_lines(ax, own, "n", "error", "pattern", legend=False, names=PATTERNS)
            ax.set_title(model)
        axes[1].legend(loc="lower left")
        axes[0].set_ylabel("|error| of drop over reach")
        axes[0].set_ylim(5e-5, 1.0)
        harness.draw_slope_triangle(axes[2], -2)


def main() -> int:
    options = harness.parse_arguments(__doc__)
    rows = study.run_cases(list_cases(options.quick), hang, **harness.run_options(options))
    title = "A thin strip against the heavy elastica"
    harness.require_results(options, title, rows)
    draw(rows, options.out)
    return harness.write_report(
        options,
        title,
        rows,
        tables={"Relative error of drop over reach, worst of all patterns": worst(rows)},
        figures=["elastica"],
        findings=conclude(rows),
        results=["failed"],
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
