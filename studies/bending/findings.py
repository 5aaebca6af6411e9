"""What the bending study expects of its errors."""

from __future__ import annotations

import numpy as np

from studies.bending.cases import PROBLEMS
from studies.bending.meshes import PATTERNS
from studies.bending.seams import CROSS, GMSH, LINE, MORLEY, PLATE
from studies.harness import Finding

HINGES = ("HingeBending", "QuadraticBending")
P1, P2 = "PlateBending", "PlateBending P2"
EXACT = "corner_twist"  # which plates solve without error on any mesh
LARGEST = {  # error of plates at n = 16 and 32 on the worst pattern; on graded meshes 1.5 times it
    "supported_square": {P1: (6e-3, 1.5e-3), P2: (1.3e-2, 3.1e-3)},
    "clamped_square": {P1: (5.2e-2, 1.3e-2), P2: (5.2e-2, 1.3e-2)},
    "clamped_disk": {P1: (1.1e-2, 2.7e-3), P2: (6.2e-3, 1.6e-3)},
    "free_square": {P1: (7.2e-3, 1.8e-3), P2: (6e-4, 1.5e-4)},
    "heavy_strip": {P1: (6.5e-3, 1.3e-3), P2: (3.2e-3, 8e-4)},
}
BIASED = {"supported_square": 0.4, "free_square": 0.3, EXACT: 0.6, "heavy_strip": 0.1}  # of hinges
ORDERS = (1.85, 2.2)
UNCLEAR = {  # sums of errors with different signs
    *(("free_square", P2, pattern) for pattern in PATTERNS),
    ("heavy_strip", P1, "cross"),  # bending is too soft, the membrane too stiff
}
Rows = list[dict]


def select(rows: Rows, **key) -> Rows:
    """Return the rows with these settings that have a result, coarse to fine."""
    chosen = [r for r in rows if r["status"] == "ok" and all(r[k] == key[k] for k in key)]
    return sorted(chosen, key=lambda row: row["n"])


def order(rows: Rows, key: str = "error") -> float:
    """Return the order of the two finest rows.

    Examples
    --------
    >>> order([{"h": h, "error": 3 * h**2} for h in (0.4, 0.2, 0.1)])
    2.0
    """
    if len(rows) < 2:
        return float("nan")
    (h0, h1), (e0, e1) = ([row[name] for row in rows[-2:]] for name in ("h", key))
    return round(float(np.log(e0 / e1) / np.log(h0 / h1)), 6)


def patterns_of(rows: Rows, **key) -> list[str]:
    return list(dict.fromkeys(row["pattern"] for row in rows if all(row[k] == key[k] for k in key)))


def conclude(rows: Rows) -> list[Finding]:
    """Return all findings of the six problems."""
    found = conclude_hinges(rows)
    for problem in PROBLEMS:
        if problem == EXACT:
            twists = [r.get("error", np.nan) for m in (P1, P2) for r in select_all(rows, EXACT, m)]
            found.append(Finding("corner_twist, plates: largest error", max(twists), high=1e-8))
            continue
        for model in (P1, P2):
            found += conclude_plate(rows, problem, model)
    return found


def select_all(rows: Rows, problem: str, model: str) -> Rows:
    return [row for row in rows if (row["problem"], row["model"]) == (problem, model)]


def conclude_plate(rows: Rows, problem: str, model: str) -> list[Finding]:
    """Return findings for the errors and the orders of a plate on all patterns."""
    found = []
    for n, high in zip((16, 32), LARGEST[problem][model], strict=True):
        errors = {
            graded: [
                row.get("error", np.nan)
                for row in select_all(rows, problem, model)
                if row["n"] == n and (row["pattern"] == "graded") == graded
            ]
            for graded in (False, True)
        }
        for graded, room in ((False, 1.0), (True, 1.5)):
            if errors[graded]:
                where = "graded" if graded else "worst pattern"
                what = f"{problem}, {model}, n = {n}, {where}: error"
                found.append(Finding(what, max(errors[graded]), high=room * high))
    for pattern in patterns_of(rows, problem=problem, model=model):
        group = select(rows, problem=problem, model=model, pattern=pattern)
        low, high = (1.6, 2.4) if problem == "heavy_strip" else ORDERS
        if group[-1]["n"] >= 32 and (problem, model, pattern) not in UNCLEAR:
            found.append(Finding(f"{problem}, {model}, {pattern}: order", order(group), low, high))
    return found


def conclude_hinges(rows: Rows) -> list[Finding]:
    """Return findings: hinges do not converge, and both models of hinges are one at flat."""
    found = []
    for problem, low in BIASED.items():
        finest = [
            select(rows, problem=problem, model=HINGES[0], pattern=pattern)[-1]["error"]
            for pattern in patterns_of(rows, problem=problem, model=HINGES[0])
        ]
        found.append(Finding(f"{problem}, hinges, worst pattern: error", max(finest), low))
    apart = []
    for row in select_all(rows, "supported_square", HINGES[0]):
        (twin,) = select(rows, problem=row["problem"], model=HINGES[1],
                         pattern=row["pattern"], n=row["n"])  # fmt: skip
        apart.append(abs(row["error"] - twin["error"]))
    what = "supported_square: HingeBending and QuadraticBending apart by"
    return [*found, Finding(what, max(apart), high=1e-9)]


def seam_errors(rows: Rows) -> Rows:
    """Return the errors and orders of the seams.

    The reference of the zigzags is Morley's mean deflection on three meshes, extrapolated
    (Richardson); on two meshes with the order 2.
    """
    means = [row["mean"] for row in select(rows, seam=CROSS, model=MORLEY)][-3:]
    d = np.diff(means)
    ratio = d[-2] / d[-1] if len(d) > 1 else 4.0
    limit = means[-1] + d[-1] / (ratio - 1)
    lines: Rows = []
    for row in [row for row in rows if row["status"] == "ok"]:
        line = {key: row[key] for key in ("seam", "model", "n", "h")}
        line["error"] = row["error"] if row["seam"] == LINE else abs(row["mean"] / limit - 1)
        before = [r for r in lines if (r["seam"], r["model"]) == (row["seam"], row["model"])]
        line["order"] = order([*before, line]) if before else None
        line["from the mean seam"] = row.get("from the mean seam")
        lines.append(line)
    return lines


def conclude_seams(lines: Rows) -> list[Finding]:
    """Return findings: the plate's order at a zigzag, and its error beside Morley's."""
    found = []
    for seam in (CROSS, GMSH):
        plate = [r for r in lines if (r["seam"], r["model"]) == (seam, PLATE)]
        found.append(Finding(f"{seam}: order of the mean deflection", plate[-1]["order"], 1.7, 2.2))
    two = [[r["error"] for r in lines if (r["seam"], r["model"]) == (CROSS, m)][-1]
           for m in (PLATE, MORLEY)]  # fmt: skip
    found.append(Finding(f"{CROSS}: error over Morley's element's", two[0] / two[1], high=1))
    cut = [r for r in lines if r["seam"] == LINE]
    found.append(Finding(f"{LINE}: error over h", max(r["error"] / r["h"] for r in cut), high=1))
    return found
