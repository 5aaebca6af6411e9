"""Does the stress at a point reach a known value, and at which order in the mesh?

LE1 of NAFEMS (`le1.toml`): a quarter of an elliptic membrane of steel, with 10 MPa outward on its
outer edge. At D, the end of the inner ellipse, σ_yy is 92.7 MPa. `fc.study.converge` refines the
mesh. Expected: within 1 %. D lies on the border, where a recovered stress is at its worst, and the
ellipse is a polygon with a corner at D, also on P2, whose edges are straight; so the order at D, by
the changes from level to level, is below 2 on P1 and below 3 on P2. σ_yy is the stress resultant
over the thickness. Large deformations lower it by 0.07 %: 92.7 MPa is of linear elasticity.

    python -m studies.nafems [--quick]
"""

import math
import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import fecloth as fc
from studies import harness

SCENE = Path(__file__).with_name("le1.toml")
THICKNESS = 0.1  # m
PUBLISHED = 92.7  # MPa
CLOSE = 1.0  # %
# The first edge length [m] and the number of levels, each with half the edge length.
LEVELS = {"P1": (0.075, 4), "P2": (0.15, 4)}
QUICK = {"P1": (0.075, 3), "P2": (0.15, 3)}


def refine(element: str, h: float, levels: int) -> list[dict]:
    """Return a row for each level of a study of the stress at D, with σ_yy [MPa]."""
    scene = fc.load_scene(SCENE, [f"cloth.element={element}", f"cloth.h={h}"])
    study = fc.study.converge(scene, levels=levels)
    return [
        {
            "element": element,
            "h [m]": row["h"],
            "triangles": row["triangles"],
            "σ_yy [MPa]": 1e-6 * row["value"] / THICKNESS,
        }
        for row in study.table
    ]


def compare(rows: Sequence[dict]) -> list[dict]:
    """Return the rows of an element with errors [%], changes from level to level [%] and orders."""
    compared = []
    for row in rows:
        error = 100 * (row["σ_yy [MPa]"] / PUBLISHED - 1)
        compared.append(row | {"error %": error, "change %": "", "order": ""})
    for coarse, fine in pairwise(compared):
        fine["change %"] = fine["error %"] - coarse["error %"]
        if coarse["change %"]:
            drop = math.log(abs(coarse["change %"] / fine["change %"]))
            fine["order"] = drop / math.log(coarse["h [m]"] / fine["h [m]"])
    return compared


def main() -> int:
    """Refine both elements, and write the report."""
    options = harness.parse_arguments(__doc__)
    warnings.simplefilter("ignore", fc.FeclothWarning)
    levels = QUICK if options.quick else LEVELS
    refined = {element: refine(element, *sizes) for element, sizes in levels.items()}
    tables = {element: compare(rows) for element, rows in refined.items()}
    findings = [
        harness.Finding(
            f"{element}: |error| on the finest mesh, %", abs(rows[-1]["error %"]), high=CLOSE
        )
        for element, rows in tables.items()
    ]
    findings += [
        harness.Finding(f"{element}: order at D, by the last three levels", rows[-1]["order"], low)
        for (element, rows), low in zip(tables.items(), (0.7, 1.8), strict=True)
    ]
    title, what = harness.about(__doc__)
    return harness.write_report(
        options,
        title,
        [row for rows in tables.values() for row in rows],
        conclusion=what,
        findings=findings,
        tables={f"σ_yy at D, {element}": rows for element, rows in tables.items()},
        page=Path(__file__).with_name("le1"),
    )


if __name__ == "__main__":
    harness.run_main(main)
