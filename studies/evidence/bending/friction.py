"""Does friction inside a fabric give the loops, rests and cantilevers that are known?

Loops: a strip on every pattern is bent to ±κ, κL = 1e-3, and the derivative of its energy gives B
and 2HB. Release: a strip that was bent by κL = 1 and is slowly let go rests at κ = HB/B.
Cantilever: a strip that is laid down under its weight w has the deflection w/(8B) (L² − 2HB/w)² for
m → ∞, and an integral for m = 20; HB/B is a quarter of the curvature at its clamp. Cost: on 3,200
and 12,800 triangles of rows and about as many of Gmsh, on one thread.

    python -m studies.evidence.bending.friction [--quick] [--out DIR]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from studies import harness
from studies.bending.meshes import PATTERNS
from studies.evidence.benchmarks.measure import fastest
from studies.evidence.bending import friction_cases as cases
from studies.evidence.bending import friction_figure

MESHES = (8, 16, 32)  # distances of nodes along the strip
SHARES = (0.02, 0.1, 0.25, 0.5)
EVEN = PATTERNS[:-1]  # graded meshes of 32 edges would take minutes
FEW = ("right", "cross", "unstructured")  # of the strip that is let go
ELEMENTS = ("P1", "P2")


def refined(case: Callable, patterns, meshes) -> list[dict]:
    """Errors of a case on each mesh, by pattern and element."""
    rows = []
    for pattern in patterns:
        for element in ELEMENTS:
            edges = {n: n // 2 if element == "P2" else n for n in meshes}
            errors = {f"n = {n}": case(pattern, element, e)["error"] for n, e in edges.items()}
            rows.append({"pattern": pattern, "element": element, **errors})
    return rows


def order(rows: list[dict], meshes) -> float:
    """The order of the largest error over the patterns, from the coarsest to the finest mesh."""
    coarse, fine = (largest(rows, f"n = {n}") for n in (meshes[0], meshes[-1]))
    return float(np.log(coarse / fine) / np.log(meshes[-1] / meshes[0]))


def loops(patterns) -> list[dict]:
    pairs = [(pattern, element) for pattern in patterns for element in ELEMENTS]
    return [{"pattern": p, "element": e, **cases.loop(p, e)} for p, e in pairs]


def shares(of: tuple[float, ...], n: int) -> list[dict]:
    """Deflections of cantilevers over the elastic one, by HB/B over the curvature at the clamp."""
    elastic, rows = cases.end(*cases.cantilever(n=n, share=0.0)), []
    for r in of:
        row = {"r": r}
        for friction in ("laid", "shaken"):
            found = cases.cantilever(n=n, share=r, friction=friction)
            row[friction] = cases.end(*found) / elastic
        row["closed form"] = cases.closed_form(r) / cases.closed_form(0.0)
        rows.append(row)
    return rows


def wavy_state(system: fc.System) -> fc.State:
    """Return a state with waves along both directions that bends every hinge."""
    X, Y = system.cloth.X.T
    z = 0.03 * np.sin(9 * X + 1) * np.cos(7 * Y) + 0.02 * np.sin(5 * Y)
    return system.state(np.column_stack([1.01 * X, 1.005 * Y, z]))


def costs(n: int, count: int) -> list[dict]:
    """Least CPU time of force and tangents over those of `PlateBending` [ns per triangle]."""
    calls: dict[str, Callable[[], object]] = {}
    for pattern in ("right", "unstructured"):
        cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, pattern)
        terms = [fc.PlateBending(), fc.BendingFriction()]
        system = fc.System(cloth, cases.fabric(1e-5), terms)
        system = system.with_history(system.start_history(system.rest()))
        state = wavy_state(system)
        f, J = np.zeros_like(state.x), BlockMatrix.zeros(system.pattern)
        for term in system.bound:
            at = (state.x, state.v, state.t)
            calls[f"{pattern} force {term.name}"] = lambda t=term, at=at, f=f: t.add_force(*at, f)
            calls[f"{pattern} tangent {term.name}"] = lambda t=term, at=at, J=J: t.add_tangent(
                *at, 1.0, 0.0, J, False
            )
    seconds = {name: fastest(call, count, time.process_time) for name, call in calls.items()}
    rows = []
    for name in calls:
        if name.endswith("PlateBending"):
            what = name.rsplit(" ", 1)[0]
            triangles = 2 * n**2 if "right" in what else len(cloth.triangles)
            rows.append(
                {
                    "what": what,
                    "triangles": triangles,
                    "plate [ms]": 1e3 * seconds[name],
                    "friction [ms]": 1e3 * seconds[f"{what} BendingFriction"],
                    "ratio": seconds[f"{what} BendingFriction"] / seconds[name],
                }
            )
    return rows


def largest(rows: list[dict], *names: str) -> float:
    return max(abs(row[name]) for row in rows for name in names)


def conclude(loop, release, laid, cost, meshes) -> list[harness.Finding]:
    """The findings; one mesh has no order, and short measurements of time no limit."""
    finest, quick = f"n = {meshes[-1]}", len(meshes) == 1
    fine = [row for row in cost if row["triangles"] >= 12_800 or quick]
    force, tangent = (
        max(row["ratio"] for row in fine if word in row["what"]) for word in ("force", "tangent")
    )
    limits = {"release": (release, 5e-3), "cantilever": (laid, 0.03 if quick else 5e-3)}
    findings = [
        harness.Finding("loops, largest relative error of B", largest(loop, "B"), high=1e-6),
        harness.Finding("loops, largest relative error of 2HB", largest(loop, "2HB"), high=1e-6),
        harness.Finding("force over PlateBending's", force, high=np.inf if quick else 1.5),
        harness.Finding("tangent over PlateBending's", tangent),
    ]
    for name, (rows, limit) in limits.items():
        error = largest(rows, finest)
        findings.append(harness.Finding(f"{name}, largest error, {finest}", error, high=limit))
        for element in ELEMENTS if not quick else ():
            of = [row for row in rows if row["element"] == element]
            what = f"{name}, order of the largest error, {element}"
            findings.append(harness.Finding(what, order(of, meshes), 1.7))
    return findings


def main() -> int:
    options = harness.parse_arguments(__doc__)
    quick = options.quick
    patterns, meshes = (EVEN[:1], MESHES[:1]) if quick else (EVEN, MESHES)
    loop = loops(patterns if quick else PATTERNS)
    release = refined(cases.release, FEW[:1] if quick else FEW, meshes)
    laid = refined(cases.laid, patterns, meshes)
    share = shares(SHARES[3:4] if quick else SHARES, meshes[-1] if quick else 16)
    cost = [row for n in ((20,) if quick else (40, 80)) for row in costs(n, 3 if quick else 40)]
    friction_figure.draw(options.out, share, 8 if quick else 16)
    title, what = harness.about(__doc__)
    parts = {"loop": loop, "release": release, "cantilever": laid, "share": share, "cost": cost}
    return harness.write_report(
        options,
        title,
        [{"part": part} | row for part, rows in parts.items() for row in rows],
        conclusion=what,
        tables={
            "Cantilever: deflection over the elastic one; r = HB/B over w L²/(2B)": share,
            "Cost: least CPU time": cost,
        },
        figures=("friction",),
        findings=conclude(loop, release, laid, cost, meshes),
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
