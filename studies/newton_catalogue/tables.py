"""Newton's iteration on measured curves: a J-shaped knit and a weave that locks, and their cost.

    python -m studies.newton_catalogue.tables [--quick] [--jobs N] [--out DIR]

Sheets of 1 m × 1 m with `MembraneTable` and `PlateBending` hang down from two corners or from an
edge for 0.8 s, with and without 3 ms of strain-rate damping, by four methods at steps of 2.5 to
20 ms: 128 sheets of 500 triangles. None may fail but those of `EnergyMomentum`, which dissipates
nothing. Force and tangent are compared with
`StVK` on 20,000 triangles, where the strains of neighbours lie between the same points: at most 1.3
times its CPU time, by the least of many calls that take turns. The table of a full run is in
studies/newton_catalogue/tables.md.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.linalg.block_matrix import BlockMatrix
from studies import harness

METHODS = ("BackwardEuler", "BDF2", "GeneralizedAlpha", "EnergyMomentum")
SAFE = METHODS[:3]  # these must not fail
STEPS = (0.0025, 0.005, 0.01, 0.02)  # s
DAMPING, T_END, MOST = 0.003, 0.8, 1.3  # s, s, times the cost of StVK
DRAWN = np.linspace(0.05, 0.4, 8)  # extensions of the knit
CRIMP = np.array([0.002, 0.005, 0.01, 0.02, 0.04])  # of the weave
LAWS = {
    "knit": fc.MembraneTable(
        warp=np.column_stack([1 + DRAWN, 20 * np.expm1(DRAWN / 0.09)]),
        weft=np.column_stack([1 + DRAWN, 8 * np.expm1(DRAWN / 0.10)]),
        shear=[(0.2, 2.0), (0.4, 5.0), (0.6, 10.0), (0.8, 25.0)],
        poisson=0.4,
    ),
    "weave": fc.MembraneTable(
        warp=np.column_stack([1 + CRIMP, [2.0, 8.0, 40.0, 160.0, 500.0]]),
        weft=np.column_stack([1 + 2 * CRIMP, [2.0, 8.0, 40.0, 160.0, 500.0]]),
        shear=[(0.1, 0.6), (0.2, 1.3), (0.3, 2.2), (0.4, 4.0), (0.5, 10.0), (0.6, 40.0)],
        poisson=0.1,
    ),
}
FABRICS = {
    "knit": fc.Fabric(0.18, 100.0, bending_rigidity=2e-6),
    "weave": fc.Fabric(0.12, 8000.0, bending_rigidity=1e-5),
}


def hang(fabric: str, hold: str, damping: float, method: str, dt: float, t_end: float) -> dict:
    """Run one sheet; a failed step is a result."""
    law, cloth = LAWS[fabric], fc.Cloth.rectangle(1.0, 1.0, h=0.07)
    terms = [law, fc.PlateBending(), fc.Gravity()]
    terms += [fc.StrainRateDamping(damping, law=law)] if damping else []
    corners = fc.Pin(lambda X: (X[:, 1] > 1 - 1e-9) & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9))
    system = fc.System(cloth, FABRICS[fabric], terms, [corners if hold == "corners" else "top"])
    newton, failure = [], ""
    try:
        for _, info in fc.march(system, getattr(fc, method)(), system.rest(), dt, t_end):
            study.check_time_limit()
            newton.append(info.counts.newton)
    except fc.StepFailed as stopped:
        failure = f"{stopped.reason} at t = {stopped.t:.3f} s"
    mean = sum(newton) / max(len(newton), 1)
    return {"failure": failure, "iterations": mean, "most_iterations": max(newton, default=0)}


def ratios(triangles: int) -> dict[str, float]:
    """The CPU times of force and tangent of the knit over the CPU times of `StVK`."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=(2.3 / triangles) ** 0.5)
    x = np.column_stack([1.02 * cloth.X, 0.02 * np.sin(3 * cloth.X[:, 0])])
    f, v = np.zeros_like(x), np.zeros_like(x)
    calls = []
    for law in (LAWS["knit"], fc.StVK()):
        system = fc.System(cloth, FABRICS["knit"], [law])
        bound, J = system.bound[0], BlockMatrix.zeros(system.pattern)
        calls.append(lambda b=bound: b.add_force(x, v, 0.0, f))
        calls.append(lambda b=bound, J=J: b.add_tangent(x, v, 0.0, 1.0, 0.0, J, False))
    force, tangent, *stvk = fastest(calls)
    return {"force": force / stvk[0], "tangent": tangent / stvk[1]}


def fastest(calls: list[Callable[[], None]]) -> list[float]:
    """The least seconds of each call, of 200 rounds."""
    seconds = np.full(len(calls), np.inf)
    for _ in range(200):
        for i, call in enumerate(calls):
            begin = time.perf_counter()
            call()
            seconds[i] = min(seconds[i], time.perf_counter() - begin)
    return seconds.tolist()


def cases(quick: bool) -> list[dict]:
    axes = product(LAWS, ("corners", "edge"), (0.0, DAMPING), METHODS, STEPS)
    names = ("fabric", "hold", "damping", "method", "dt")
    every = [dict(zip(names, values, strict=True)) for values in axes]
    if quick:
        picked = {"hold": "corners", "damping": 0.0, "dt": 0.02}
        every = [case for case in every if case.items() >= picked.items()]
    return [{**case, "t_end": 0.1 if quick else T_END} for case in every]


def summary(rows: list[dict]) -> list[dict]:
    """A row for each fabric and method: mean and largest iterations of a step at each dt."""
    table = []
    for fabric, method in product(LAWS, METHODS):
        own = [row for row in rows if (row["fabric"], row["method"]) == (fabric, method)]
        line: dict = {"fabric": fabric, "method": method, "sheets": len(own)}
        line["failed"] = sum(map(failed, own))
        for dt in STEPS:
            ran = [row for row in own if row["dt"] == dt and not failed(row)]
            mean = sum(row["iterations"] for row in ran) / max(len(ran), 1)
            most = max((row["most_iterations"] for row in ran), default=0)
            line[f"{1000 * dt:g} ms"] = f"{mean:.1f} (≤ {most})" if ran else ""
        table.append(line)
    return table


def failed(row: dict) -> bool:
    return row["status"] != "ok" or bool(row["failure"])


def main() -> int:
    options = harness.parse_arguments(__doc__)
    settings = cases(options.quick)
    costs = [case["t_end"] / case["dt"] ** 0.7 for case in settings]
    rows = study.run_cases(settings, hang, costs=costs, **harness.run_options(options))
    found = ratios(1_000 if options.quick else 20_000)
    limit = 10.0 if options.quick else MOST  # a quick run measures nothing
    findings = [
        harness.Finding(f"failures of {method}", sum(map(failed, own)), high=most)
        for method in METHODS
        for own in [[row for row in rows if row["method"] == method]]
        for most in [0 if method in SAFE else float("inf")]
    ]
    findings += [
        harness.Finding(f"{name} over that of StVK", ratio, high=limit)
        for name, ratio in found.items()
    ]
    code = harness.write_report(
        options,
        "Newton's iteration on measured curves",
        rows,
        tables={"By fabric and method": summary(rows)},
        findings=findings,
        conclusion="Each cell: Newton iterations a step, and the most in one step.",
    )
    if not options.quick:
        shutil.copy(options.out / "report.md", Path(__file__).parent / "tables.md")
    return code


if __name__ == "__main__":
    harness.run_main(main)
