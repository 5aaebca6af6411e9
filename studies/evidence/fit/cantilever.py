"""Does a strip that hangs give its bending rigidity? Data without noise.

The data are the drop of the end, from the fit's own mesh, where only the search can be wrong, and
from closed forms, where the mesh is: w L⁴/(8 B) of a strip that hardly bends, and the heavy
elastica (`studies.references.elastica`) of one that drops by half of its length. Expected: B to
0.1 % from starts that are off by 3 and 10; against the closed forms an error that falls with h².

    python -m studies.evidence.fit.cantilever [--quick]
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness
from studies.fit.specimens import DENSITY, SAG, TIP, hang
from studies.fit.twins import fit_quietly
from studies.references.elastica import heavy_elastica

B = 1e-5  # N m
WEIGHT = DENSITY * 9.81  # N/m²
SMALL = 0.02  # ρ g L³/B of the strip that hardly bends
EXACT = 1e-3
MESHES = 8, 16, 32  # triangles along the strip


def fit_drop(drop: float, gamma: float, cells: int, start: float, element: str, refined=False):
    """Fit B to the drop of the end [m] of a strip with ρ g L³/B = `gamma`."""
    length = (gamma * B / WEIGHT) ** (1 / 3)
    data = {"drop [m]": [-drop]}
    problem = partial(hang, length=length, element=element)
    test = fc.Experiment(
        problem, data, {"drop": "tip.z"}, sigma=1e-4 * drop, h=1 / cells, probes=TIP, name="drop"
    )
    return fit_quietly([test], {"bending": start}, refined=refined).values["bending"]


def drop_on_mesh(gamma: float, cells: int, element: str) -> float:
    length = (gamma * B / WEIGHT) ** (1 / 3)
    cloth, system, _, start = hang(1 / cells, B, length=length, element=element)
    return -float(fc.equilibrium(system, start).x[cloth.nodes("right"), 2].mean())


def closed_form(gamma: float) -> float:
    """The drop [m] of the end: w L⁴/(8 B) of a small one, else of the heavy elastica."""
    length = (gamma * B / WEIGHT) ** (1 / 3)
    if gamma == SMALL:
        return WEIGHT * length**4 / (8 * B)
    _, _, drop = heavy_elastica(gamma)
    return float(drop[-1]) * length


def main() -> int:
    options = harness.parse_arguments(__doc__ or "")
    meshes = MESHES[:2] if options.quick else MESHES
    rows, same, orders = [], [], {}
    for element in ("P2",) if options.quick else ("P1", "P2"):
        for gamma in (SMALL, SAG):
            own = drop_on_mesh(gamma, meshes[0], element)
            for factor in (3.0,) if options.quick else (10.0, 3.0, 1 / 3, 0.1):
                value = fit_drop(own, gamma, meshes[0], factor * B, element)
                same.append(abs(value / B - 1))
                words = f"from {factor:.3g} times the truth"
                rows.append(row(element, gamma, "its own mesh", meshes[0], words, value))
            exact, errors = closed_form(gamma), []
            for cells in meshes:
                value = fit_drop(exact, gamma, cells, B, element)
                errors.append(value / B - 1)
                rows.append(row(element, gamma, "closed form", cells, "from the truth", value))
            orders[element, gamma] = float(np.log2(errors[-2] / errors[-1]))
    finest = [abs(each["error of B %"]) for each in rows if each["cells"] == meshes[-1]]
    findings = [
        harness.Finding("largest error of B, data of the same mesh, %", 100 * max(same), high=0.1),
        harness.Finding(f"largest error of B at {meshes[-1]} cells, closed forms, %", max(finest)),
        *(
            harness.Finding(f"order of the error of B, {element}, ρ g L³/B = {gamma:g}", order, 1.6)
            for (element, gamma), order in orders.items()
        ),
    ]
    title, what = harness.about(__doc__)
    page = Path(__file__).with_suffix("")
    return harness.write_report(options, title, rows, conclusion=what, findings=findings, page=page)


def row(element: str, gamma: float, data: str, cells: int, start: str, value: float) -> dict:
    return {
        "element": element, "ρ g L³/B": gamma, "data": data, "cells": cells, "start": start,
        "B [N m]": value, "error of B %": 100 * (value / B - 1),
    }  # fmt: skip


if __name__ == "__main__":
    harness.run_main(main)
