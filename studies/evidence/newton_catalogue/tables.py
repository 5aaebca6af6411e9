"""Newton's iteration on measured curves: a J-shaped knit and a weave that locks, and their cost.

    python -m studies.evidence.newton_catalogue.tables [--quick] [--jobs N] [--out DIR]

Sheets of 1 m × 1 m with `MembraneTable` and `PlateBending` hang down from two corners or from an
edge for 2 s, with and without 3 ms of strain-rate damping, at the steps of
`studies.evidence.newton_catalogue`, on 1,000 triangles. Backward Euler and BDF2 must not fail, with
either solver: there every step minimises a potential. Generalised-α and energy-momentum, whose
steps do not, run on sheets that hang from two corners, beside `StVK` in place of the curves.

Force and tangent are compared with `StVK` on 20,000 triangles, by the least of many calls that take
turns: in a smooth stretch, where neighbours lie between the same points, and where the strains jump
from triangle to triangle. The file tables.md beside this one is the report of a full run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.linalg.block_matrix import BlockMatrix
from studies import harness
from studies.evidence.newton_catalogue.__main__ import DAMPING, SAFE, SIZES, SOLVERS, STEPS, failed

OTHERS = ("GeneralizedAlpha", "EnergyMomentum")
H, T_END = SIZES[1000]  # m, s
MOST = {"force": 2.0, "tangent": 1.5}  # times the cost of StVK
JUMPS = {"smooth": 0.0, "jumping": 0.1}  # of h: the random part of the positions
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


def hang(
    law: str,
    fabric: str,
    hold: str,
    damping: float,
    method: str,
    solver: str,
    dt: float,
    t_end: float,
) -> dict:
    """Run one sheet; a failed step is a result."""
    membrane = LAWS[fabric] if law == "MembraneTable" else fc.StVK()
    terms: list = [membrane, fc.PlateBending(), fc.Gravity()]
    terms += [fc.StrainRateDamping(damping, law=membrane)] if damping else []
    corners = fc.Pin(lambda X: (X[:, 1] > 1 - 1e-9) & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9))
    pins, cloth = [corners if hold == "corners" else "top"], fc.Cloth.rectangle(1.0, 1.0, h=H)
    system = fc.System(cloth, FABRICS[fabric], terms, pins)
    chosen, newton, failure = getattr(fc, method)(), [], ""
    try:
        for _, info in fc.march(system, chosen, system.rest(), dt, t_end, solver=solver):
            study.check_time_limit()
            newton.append(info.counts.newton)
    except fc.StepFailed as stopped:
        failure = f"{stopped.reason} at t = {stopped.t:.3f} s"
    mean = sum(newton) / max(len(newton), 1)
    return {"failure": failure, "iterations": mean, "most_iterations": max(newton, default=0)}


def costs(triangles: int) -> list[dict]:
    """Rows of the CPU times of force and tangent over the times of `StVK`."""
    h, rng, table = (2.3 / triangles) ** 0.5, np.random.default_rng(1), []
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    for (fabric, law), (strains, jump) in product(LAWS.items(), JUMPS.items()):
        x = np.column_stack([1.02 * cloth.X, 0.02 * np.sin(3 * cloth.X[:, 0])])
        x[:, :2] += jump * h * rng.standard_normal((len(x), 2))
        f, v = np.zeros_like(x), np.zeros_like(x)
        calls: list[Callable[[], None]] = []
        for each in (law, fc.StVK()):
            system = fc.System(cloth, FABRICS[fabric], [each])
            bound, J = system.bound[0], BlockMatrix.zeros(system.pattern)
            calls.append(partial(bound.add_force, x, v, 0.0, f))
            calls.append(partial(bound.add_tangent, x, v, 0.0, 1.0, 0.0, J, False))
        force, tangent, *stvk = fastest(calls)
        row = {"fabric": fabric, "strains": strains}
        table.append(row | {"force": force / stvk[0], "tangent": tangent / stvk[1]})
    return table


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
    names = ("law", "method", "solver", "fabric", "hold", "damping", "dt")
    times = ((0.0, DAMPING), STEPS)
    axes = (
        (("MembraneTable",), SAFE, SOLVERS, LAWS, ("corners", "edge"), *times),
        (("MembraneTable", "StVK"), OTHERS, ("direct",), LAWS, ("corners",), *times),
    )
    every = [dict(zip(names, values, strict=True)) for of in axes for values in product(*of)]
    if quick:
        picked = {"hold": "corners", "damping": 0.0, "dt": STEPS[1], "solver": "direct"}
        every = [case for case in every if case.items() >= picked.items()]
    return [{**case, "t_end": 0.1 if quick else T_END} for case in every]


def summary(rows: list[dict]) -> list[dict]:
    """A row for each fabric, method and law: mean and largest iterations of a step at each dt."""
    keys, table = ("fabric", "method", "law"), []
    for of in dict.fromkeys(tuple(row[key] for key in keys) for row in rows):
        own = [row for row in rows if tuple(row[key] for key in keys) == of]
        line = dict(zip(keys, of, strict=True)) | {"sheets": len(own)}
        line["failed"] = sum(map(failed, own))
        for dt in STEPS:
            ran = [row for row in own if row["dt"] == dt and not failed(row)]
            mean = sum(row["iterations"] for row in ran) / max(len(ran), 1)
            most = max((row["most_iterations"] for row in ran), default=0)
            line[f"1/{round(1 / dt)} s"] = f"{mean:.1f} (≤ {most})" if ran else ""
        table.append(line)
    return table


def main() -> int:
    options = harness.parse_arguments(__doc__)
    settings = cases(options.quick)
    weights = [case["t_end"] / case["dt"] ** 0.7 for case in settings]
    rows = study.run_cases(settings, hang, costs=weights, **harness.run_options(options))
    priced = costs(1_000 if options.quick else 20_000)
    findings = []
    for method, law in dict.fromkeys((row["method"], row["law"]) for row in rows):
        own = [row for row in rows if (row["method"], row["law"]) == (method, law)]
        what = f"failures of {method} with {law}, of {len(own)} sheets"
        limit = 0 if method in SAFE else float("inf")
        findings.append(harness.Finding(what, sum(map(failed, own)), high=limit))
    for name, limit in MOST.items():
        most = max(row[name] for row in priced)
        limit = 10.0 if options.quick else limit  # a quick run measures nothing
        findings.append(harness.Finding(f"{name} over that of StVK, the most", most, high=limit))
    return harness.write_report(
        options,
        "Newton's iteration on measured curves",
        rows,
        tables={"By fabric, method and law": summary(rows), "Cost over StVK's": priced},
        findings=findings,
        conclusion="Each cell: Newton iterations a step, and the most in one step.",
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
