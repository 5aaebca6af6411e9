"""Newton's iteration on hanging cloth: which fabric, method, step and solver it fails on.

    python -m studies.evidence.newton_catalogue [--quick] [--jobs N] [--out DIR] [--triangles 1000]

Three fabrics, with and without 3 ms of strain-rate damping, hang down from two corners of a sheet
of 1 m × 1 m: a knit, a denim and a cotton whose shear is fifty times softer than its warp. They
fall, crumple and swing, from rest in the plane: 2 s with 1,000 triangles, 0.7 s with 6,000. Each
is stepped by `METHODS` at `STEPS` with a direct solver and with conjugate gradients.

The report has a row for each fabric and method: failures of Newton's iteration, the mean and the
largest number of iterations a step, and CPU seconds for each second of motion. Backward Euler and
BDF2 must not fail: there every step minimises a potential. The table of a full run is in
studies/evidence/newton_catalogue/catalogue.md.
"""

from __future__ import annotations

import time
from itertools import product
from pathlib import Path

import fecloth as fc
from fecloth import study
from studies import harness

FABRICS = ("interlock", "denim-wang", "cotton")
METHODS = ("BackwardEuler", "BDF2", "GeneralizedAlpha")
SAFE = METHODS[:2]  # every step of these minimises a potential
STEPS = (1 / 30, 1 / 60, 1 / 240)  # s
SOLVERS = ("direct", "pcg")
SIZES = {1000: (0.0485, 2.0), 6000: (0.0198, 0.7)}  # triangles: edge [m] and time [s]
DAMPING = 0.003  # s
COTTON = fc.Fabric(
    areal_density=0.15,
    tensile_stiffness=(3000.0, 1500.0),
    poisson_ratio=0.2,
    shear_stiffness=60.0,
    bending_rigidity=1e-5,
)


def hanging(fabric: str, damping: float, h: float) -> fc.System:
    """A sheet of 1 m × 1 m, held at the two corners of one edge, under gravity."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity()]
    terms += [fc.StrainRateDamping(damping)] if damping else []
    chosen = COTTON if fabric == "cotton" else fc.Fabric.preset(fabric)
    corners = fc.Pin(lambda X: (X[:, 1] > 1 - 1e-9) & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9))
    return fc.System(cloth, chosen, terms, [corners])


def hang(
    fabric: str, damping: float, method: str, dt: float, solver: str, triangles: int, t_end: float
) -> dict:
    """Run one case; a failed step is a result, with its time."""
    system = hanging(fabric, damping, SIZES[triangles][0])
    chosen, start = getattr(fc, method)(), system.rest()
    next(fc.march(system, chosen, start, dt, dt, solver=solver))  # compiles
    t, newton, most, factors, failure, begin = 0.0, [], 0, 0, "", time.process_time()
    try:
        for state, info in fc.march(system, chosen, start, dt, t_end, solver=solver):
            study.check_time_limit()
            t, counts = state.t, info.counts
            newton.append(counts.newton)
            factors += counts.factorisations
    except fc.StepFailed as stopped:
        failure = f"{stopped.reason} at t = {stopped.t:.3f} s"
    cpu, most = time.process_time() - begin, max(newton, default=0)
    return {
        "nodes": len(system.cloth.X),
        "failure": failure,
        "steps_done": len(newton),
        "iterations": sum(newton) / max(len(newton), 1),
        "most_iterations": most,
        "factorisations": factors / max(len(newton), 1),
        "cpu_per_second": cpu / t if t else None,
    }


def cases(quick: bool, sizes: list[int]) -> list[dict]:
    """The settings of all cases; the quick ones fall for 0.3 s, one for each fabric and method."""
    axes = product(sizes, STEPS, FABRICS, (0.0, DAMPING), METHODS, SOLVERS)
    names = ("triangles", "dt", "fabric", "damping", "method", "solver")
    every = [dict(zip(names, values, strict=True)) for values in axes]
    if quick:
        picked = {"triangles": 1000, "dt": 1 / 60, "solver": "pcg"}
        every = [case for case in every if case.items() >= picked.items()]
    return [{**case, "t_end": 0.3 if quick else SIZES[case["triangles"]][1]} for case in every]


def summary(rows: list[dict]) -> list[dict]:
    """One row for each size, fabric and method: over the steps, the damping and the solvers."""
    keys = ("triangles", "fabric", "method")
    table = []
    for of in dict.fromkeys(tuple(row[key] for key in keys) for row in rows):
        group = [row for row in rows if tuple(row[key] for key in keys) == of]
        line = dict(zip(keys, of, strict=True)) | {"cases": len(group)}
        line["failed"] = sum(failed(row) for row in group)
        for dt in STEPS:
            own = [row for row in group if row["dt"] == dt and not failed(row)]
            line[f"1/{round(1 / dt)} s"] = describe(own) if own else ""
        table.append(line)
    return table


def failed(row: dict) -> bool:
    return row["status"] != "ok" or bool(row["failure"])


def describe(rows: list[dict]) -> str:
    """Mean and largest iterations of a step, and the mean of CPU seconds a second of motion."""
    iterations, seconds = (
        sum(row[name] for row in rows) / len(rows) for name in ("iterations", "cpu_per_second")
    )
    return f"{iterations:.1f} (≤ {max(row['most_iterations'] for row in rows)}), {seconds:.2g} s"


def main() -> int:
    sizes = {"type": int, "nargs": "+", "choices": list(SIZES), "default": list(SIZES)}
    options = harness.parse_arguments(__doc__, triangles=sizes)
    settings = cases(options.quick, options.triangles)
    costs = [1e-4 * case["triangles"] * case["t_end"] / case["dt"] ** 0.5 for case in settings]
    rows = study.run_cases(settings, hang, costs=costs, **harness.run_options(options))
    findings = [
        harness.Finding(f"failures of {method}", sum(map(failed, own)), high=limit)
        for method in METHODS
        for own in [[row for row in rows if row["method"] == method]]
        for limit in [0 if method in SAFE else float("inf")]
    ]
    text = "Each cell: Newton iterations a step, the most in one, CPU seconds a second of motion."
    return harness.write_report(
        options,
        "Newton's iteration on hanging cloth",
        rows,
        tables={"By fabric and method": summary(rows)},
        findings=findings,
        conclusion=text,
        page=Path(__file__).with_name("catalogue"),
    )


if __name__ == "__main__":
    harness.run_main(main)
