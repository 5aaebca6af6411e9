"""Work and precision of bending: hinges, their quadratic form, plates on P1 and on P2.

    python -m studies.evidence.work_precision.bending_fronts [--quick] [--out DIR]

Three scenes: a strip of paper that swings down from a hinged edge, a sheet of it clamped along an
edge, and a square cloth on a round table, both at rest under their weight. The error is the larger
one of two: of the mean depth and of the depth of a point. The swing is compared with a fine chain
of links: the largest distance at 40 times over the largest depth, which includes the error in time.
The cloths at rest are compared with the limit of plates, a + b h² fitted to the values on four fine
meshes of P2; the same fit to P1 says how sure the limit is.

Seconds are CPU seconds on one thread after a warm-up, without the set-up: the least of three
runs, or of one run that takes more than 1 s.
"""

from __future__ import annotations

import time

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.evidence.work_precision.bending_figure import draw
from studies.evidence.work_precision.bending_scenes import MODELS, REST, swing
from studies.references.continuum import continuum
from studies.work_precision.__main__ import distance, mark_failed
from studies.work_precision.runs import LONG, make_runner, measure_run
from studies.work_precision.tables import cheapest

Rows = list[dict]
TITLE = "Bending: seconds and accuracy"
EXPLICIT, IMPLICIT = "CentralDifference", "ImplicitMidpoint"
SWINGS = (0.03, 0.02, 0.01, 0.005)  # m, edges of P1; of P2 they are twice as long
STEPS = (0.01, 0.005, 0.0025, 0.00125)  # s, of the implicit method
MESHES = {
    "cantilever": (0.04, 0.02, 0.01, 0.005, 0.003),
    "table": (0.016, 0.012, 0.008, 0.006, 0.004, 0.003),
}
FINE = {"cantilever": (0.012, 0.01, 0.008, 0.006), "table": (0.0075, 0.006, 0.005, 0.004)}
COARSE = {"cantilever": 0.05, "table": 0.03}  # m, of the warm-up
LEVELS = (0.05, 0.01, 0.003, 0.001)
COLUMNS = ("scene", "model", "method", "h", "step", "triangles", "nodes", "status", "seconds")
COLUMNS += ("total_error", "mean_error", "point_error")


def run_swing(model: str, h: float, method: str, step: float | None, repeats: int = 3) -> dict:
    """Run the swing; without a step the explicit method takes its largest stable one."""
    problem = swing(model, h, method == EXPLICIT)
    return measure_run(problem, make_runner(problem, method, step, "auto"), repeats)


def run_rest(scene: str, model: str, h: float) -> dict:
    """Solve for the equilibrium; return mean and point depth [m] and the seconds."""
    warm = REST[scene](model, COARSE[scene])
    fc.equilibrium(warm.system, warm.state)
    problem, spent = REST[scene](model, h), []
    while len(spent) < 3 and (not spent or min(spent) < LONG):
        begin = time.process_time()
        found = fc.equilibrium(problem.system, problem.state)
        spent.append(time.process_time() - begin)
    cloth, values = problem.system.cloth, problem.values_of(found.x)
    row = {"nodes": len(cloth.X), "triangles": len(cloth.triangles), "newton": found.iterations}
    return row | {"seconds": min(spent), "mean": float(values[0]), "point": float(values[1])}


def list_swings(quick: bool) -> Rows:
    """List runs of the swing: the explicit one and implicit ones with several steps."""
    sizes, steps = (SWINGS[:1], STEPS[2:3]) if quick else (SWINGS, STEPS)
    more = {"repeats": 1} if quick else {}
    return [
        {"model": model, "h": h * (2 if MODELS[model] == "P2" else 1), "method": m, "step": dt}
        | more
        for model in MODELS
        for h in sizes
        for m, dt in [(EXPLICIT, None), *((IMPLICIT, dt) for dt in steps)]
    ]


def of_scenes(sizes: dict, quick: bool) -> dict:
    """Return the edge lengths by scene; the quick form has the cantilever only."""
    return {"cantilever": sizes["cantilever"]} if quick else sizes


def list_rests(quick: bool) -> Rows:
    """List the equilibria whose seconds count; edges of P2 are 1.5 times as long."""
    return [
        {"scene": scene, "model": model, "h": h * (1.5 if MODELS[model] == "P2" else 1)}
        for scene, sizes in of_scenes(MESHES, quick).items()
        for model in MODELS
        for h in (sizes[1:3] if quick else sizes)
    ]


def list_limits(quick: bool) -> Rows:
    """List the equilibria of plates on fine meshes, to which the limits are fitted."""
    return [
        {"scene": scene, "model": model, "h": h * factor}
        for scene, sizes in of_scenes(FINE, quick).items()
        for model, factor in (("plate", 0.75), ("plate, P2", 1))
        for h in (sizes[:2] if quick else sizes)
    ]


def limit(fine: Rows, scene: str, model: str, name: str) -> float:
    """Return a of a + b h², fitted to the values on the fine meshes."""
    own = [r for r in fine if (r["scene"], r["model"]) == (scene, model) and r["status"] == "ok"]
    h, values = np.array([(row["h"], row[name]) for row in own]).T
    return float(np.polyfit(h**2, values, 1)[1])


def add_errors_of_swings(rows: Rows, quick: bool) -> None:
    """Add the errors of the mean and of the free edge against the chain of links."""
    exact = continuum("swing", swing("plate", 0.03).times, quick)
    for row in rows:
        if row["status"] == "ok":
            row["mean_error"] = distance(row["mean"], exact["mean"])
            row["point_error"] = distance(row["point"], exact["point"])


def add_errors_at_rest(rows: Rows, fine: Rows, quick: bool) -> list[harness.Finding]:
    """Add the errors against the limits; return how far the limits of P1 and P2 differ."""
    findings = []
    for scene in dict.fromkeys(row["scene"] for row in fine):
        for name, error in (("mean", "mean_error"), ("point", "point_error")):
            a, b = (limit(fine, scene, model, name) for model in ("plate, P2", "plate"))
            for row in rows:
                if row["scene"] == scene and row["status"] == "ok":
                    row[error] = abs(row[name] / a - 1)
            what = f"{scene}: {name} {1e3 * a:.5g} mm, by P1 differs by [%]"
            findings.append(harness.Finding(what, 100 * abs(b / a - 1), high=2 if quick else 0.3))
    return findings


def table_of_costs(rows: Rows) -> Rows:
    """Return the CPU seconds of each model to each level of error, and its least error."""
    lines = []
    for scene, model, method in dict.fromkeys((r["scene"], r["model"], r["method"]) for r in rows):
        line = of = {"scene": scene, "model": model, "method": method}
        own = [r for r in rows if of.items() <= r.items()]
        errors = [r["total_error"] for r in own if r["status"] == "ok"]
        for level in LEVELS if errors else ():
            row = cheapest(own, scene, level)
            line = line | {f"{100 * level:g} % [s]": f"{row['seconds']:.2g}" if row else "-"}
        lines.append(line | ({"least error [%]": 100 * min(errors)} if errors else {}))
    return lines


def conclude(rows: Rows, quick: bool) -> list[harness.Finding]:
    """Return the errors that each model comes down to, and what 0.1 % of the swing costs."""
    findings = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        for model in MODELS:
            own = [r for r in rows if (r["scene"], r["model"]) == (scene, model)]
            least = 100 * min(row["total_error"] for row in own if row["status"] == "ok")
            high = 2.0 if quick else {"table": 0.5}.get(scene, 0.05)
            bounds = {"high": high} if model.startswith("plate") else {"low": 0.3}
            findings.append(harness.Finding(f"{scene}, {model}: least error [%]", least, **bounds))
    best = None if quick else cheapest(rows, "swing", 0.001)
    if best:
        what = f"swing, 0.1 %: {best['model']}, {best['method']}, CPU seconds"
        findings.append(harness.Finding(what, best["seconds"], high=2.0))
    return findings


def main() -> int:
    options = harness.parse_arguments(__doc__)
    one = harness.run_options(options, alone=True)
    swings = study.run_cases(list_swings(options.quick), run_swing, **one, time_limit=300)
    swings = mark_failed([{"scene": "swing"} | row for row in swings])
    still, fine = (
        study.run_cases(cases(options.quick), run_rest, **one, time_limit=300)
        for cases in (list_rests, list_limits)
    )
    for rows in (swings, still, fine):
        harness.require_results(options, TITLE, rows)
    add_errors_of_swings(swings, options.quick)
    sure = add_errors_at_rest(still, fine, options.quick)
    rows = swings + [row | {"method": "equilibrium"} for row in still]
    for row in rows:
        if row["status"] == "ok":
            row["total_error"] = max(row["mean_error"], row["point_error"])
    rows = [{name: row.get(name) for name in COLUMNS} for row in rows]
    draw(options.out, rows)
    return harness.write_report(
        options,
        TITLE,
        rows,
        tables={"CPU seconds to an error": table_of_costs(rows)},
        figures=("bending_fronts",),
        findings=[*sure, *conclude(rows, options.quick)],
        results=("refused",),
    )


if __name__ == "__main__":
    harness.run_main(main)
