"""Work and precision: error against seconds of methods, steps, meshes and models on four scenes.

    python -m studies.work_precision [--quick] [--jobs N] [--out DIR] [--peers]
    fecloth chart my.toml          for a scene of yours

The error of a run is the largest distance of a path from the path of the continuum at 40 times,
over the largest value of the path. Paths are the mean over the cloth, and one point. Between the
steps they are Hermite's cubics. The error has three parts: in time, against a run with fine steps
on the same mesh; in space, of that run against the same on the finest mesh; and of the model, of
that run against the continuum, which includes the remaining error of the finest mesh.

Seconds are CPU seconds of the march on one thread, after a warm-up of a fiftieth of the run, which
also compiles: the least of three runs, or of one run if it takes more than 1 s. Timed cases run one
after another, whatever --jobs is.
"""

from __future__ import annotations

import math

import numpy as np

from fecloth import study
from studies import harness
from studies.references.continuum import continuum
from studies.work_precision.figures import draw_all
from studies.work_precision.grid import fine_runs, key, timed_cases
from studies.work_precision.runs import run
from studies.work_precision.scenes import SCENES
from studies.work_precision.tables import (
    cheapest,
    describe_settings,
    seconds,
    table_of_cheapest,
    table_of_parts,
    table_of_solvers,
)

FIRST = ("BackwardEuler", "LinearlyImplicitEuler", "SymplecticEuler")
EXPLICIT = ("many_steps", "CentralDifference", "SymplecticEuler", "Adaptive CentralDifference")
TITLE = "Speed and accuracy"
Rows = list[dict]


def distance(a, b, last_only: bool = False) -> float:
    """Return the largest |a − b| over the largest |b|, or only at the last sample."""
    a, b = np.asarray(a), np.asarray(b)
    if last_only:
        a, b = a[-1:], b[-1:]
    return float(np.abs(a - b).max() / np.abs(b).max())


def exact_paths(fine: Rows, scene: str, coarse: bool) -> dict[str, np.ndarray]:
    """Return the paths of the continuum, or else the limit of quadratic triangles.

    The limit is Aitken's extrapolation of the three finest meshes.
    """
    times = SCENES[scene]("StVK" if scene != "swing" else "StVK + hinges", "P1", 0.1).times
    exact = continuum(scene, times, coarse)
    if exact:
        return exact
    quadratic = [r for r in fine if r["scene"] == scene and r["element"] == "P2"]
    a, b, c = sorted(quadratic, key=lambda row: -row["h"])[-3:]
    limit = {}
    for name in ("mean", "point"):
        p, q, r = (np.array(row[name]) for row in (a, b, c))
        limit[name] = r - (r - q) ** 2 / ((r - q) - (q - p))
    return limit


def add_errors(rows: Rows, fine: Rows, coarse: bool) -> None:
    """Add the errors to the rows: of both paths, and the three parts of the mean's error."""
    references = {key(row): row for row in fine if row["status"] == "ok"}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        exact, still = exact_paths(fine, scene, coarse), scene == "stretch"
        for row in [*rows, *fine]:
            if row["scene"] != scene or row["status"] != "ok":
                continue
            row["total_error"] = distance(row["mean"], exact["mean"], still)
            row["point_error"] = distance(row["point"], exact["point"], still)
            here = references.get(key(row))
            same_model = [r for r in references.values() if key(r)[:3] == key(row)[:3]]
            if here is None or not same_model:
                continue
            best = min(same_model, key=lambda r: r["h"])
            row["time_error"] = distance(row["mean"], here["mean"], still)
            row["space_error"] = distance(here["mean"], best["mean"], still)
            row["model_error"] = distance(best["mean"], exact["mean"], still)


def mark_failed(rows: Rows) -> Rows:
    """Set the status of rows whose run failed after some seconds."""
    return [
        row | {"status": "failed", "cause": row["failure"]} if "failure" in row else row
        for row in rows
    ]


def conclude(rows: Rows, fine: Rows, quick: bool) -> list[harness.Finding]:
    """Return the findings: ratios of seconds, and the error of the finest run."""
    findings = []

    def ratio(what, scene, level, slow, fast, low):
        costs = [seconds(cheapest(rows, scene, level, among)) for among in (slow, fast)]
        value = costs[0] / costs[1] if math.isfinite(costs[1]) else math.nan
        findings.append(harness.Finding(f"{scene}, {100 * level:g} %: {what}", value, low))

    def explicit(row):
        return row["method"] in EXPLICIT

    def implicit(row):
        others = ("Auto", "equilibrium", "MuJoCo")
        return not explicit(row) and not row["method"].startswith(others)

    def first(row):
        return row["method"] in FIRST[:2]

    def second(row):
        return implicit(row) and row["method"] not in FIRST

    ratio("cheapest implicit over explicit", "trampoline", 0.01, implicit, explicit, 1.5)
    for scene in ("trampoline", "wave"):
        ratio("first order over second, implicit", scene, 0.01, first, second, 1.0)
    if quick:
        return findings
    ratio("cheapest explicit over implicit", "swing", 0.01, explicit, implicit, 1.5)
    marching = lambda row: row["method"] != "equilibrium"  # noqa: E731
    still = lambda row: row["method"] == "equilibrium"  # noqa: E731
    ratio("marching over the equilibrium", "stretch", 0.01, marching, still, 1.0)
    best = min(
        (r for r in rows if r["scene"] == "trampoline" and r["status"] == "ok"),
        key=lambda row: (row["h"], row["total_error"]),
    )
    what = f"trampoline, finest ({describe_settings(best)}): error of the mean [%]"
    findings.append(harness.Finding(what, 100 * best["total_error"], high=0.1))
    findings.append(harness.Finding("  and of the centre [%]", 100 * best["point_error"]))
    return findings


def describe_result(rows: Rows) -> str:
    """Return the cheapest settings at 1 % as a sentence."""
    parts = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        row = cheapest(rows, scene, 0.01)
        if row:
            parts.append(
                f"the {scene} takes {describe_settings(row)} and {row['seconds']:.2g} CPU s"
            )
    return "At 1 % of error " + "; ".join(parts) + "." if parts else ""


def main() -> int:
    peers = {"action": "store_true", "help": "add MuJoCo"}
    options = harness.parse_arguments(__doc__, peers=peers)
    if options.peers:
        study.require_packages("mujoco")
    running, one = harness.run_options(options), harness.run_options(options, alone=True)
    words = {"label": lambda case: f"{case['scene']}, {describe_settings(case)}"}
    fine = study.run_cases(fine_runs(options.quick), run, **running, **words, time_limit=300)
    rows = study.run_cases(timed_cases(options.quick), run, **one, **words, time_limit=60)
    if options.peers:
        from studies.work_precision.mujoco import list_mujoco_cases, run_mujoco

        rows += study.run_cases(list_mujoco_cases(options.quick), run_mujoco, **one, time_limit=300)
    rows = mark_failed(rows)
    harness.require_results(options, TITLE, rows)
    add_errors(rows, fine, options.quick)
    draw_all(options.out, rows)
    scenes = dict.fromkeys(row["scene"] for row in rows)
    tables = {f"Cheapest: {scene}": table_of_cheapest(rows, scene) for scene in scenes}
    tables["Errors in space and of the model, with fine steps"] = table_of_parts(fine)
    if not options.quick:
        tables["Linear solvers, CPU seconds"] = table_of_solvers(rows)
    return harness.write_report(
        options,
        TITLE,
        rows,
        tables=tables,
        figures=("speed_accuracy",),
        findings=conclude(rows, fine, options.quick),
        conclusion=describe_result(rows),
        results=("failed", "refused", "time limit"),  # steps that are too large, P2 with hinges
    )


if __name__ == "__main__":
    harness.run_main(main)
