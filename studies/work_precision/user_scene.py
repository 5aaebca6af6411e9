"""Errors in time of every method in a user's scene."""

from __future__ import annotations

import hashlib
import math

import numpy as np

from fecloth import study
from fecloth.scene.scene import Scene, load_scene
from studies.work_precision import figures as charts
from studies.work_precision.grid import scene_cases
from studies.work_precision.runs import run_scene
from studies.work_precision.tables import LEVELS, cheapest


def study_scene(options) -> int:
    """Run a user's scene with other methods and steps; compare with its method at fine steps."""
    name, scene = options.scene.stem, load_scene(options.scene)
    digest = hashlib.sha256(options.scene.read_bytes()).hexdigest()[:12]
    shared = {"path": str(options.scene.resolve()), "digest": digest}
    cases = [{**shared, **case} for case in scene_cases(scene, options.quick)]
    sizes = [predict_workload(scene, case) for case in cases]
    study.check_scene(sizes, options)
    running = study.run_options(options, alone=True) | {"time_limit": options.time_limit}
    exact, *rows = study.run_cases(cases, run_scene, **running, costs=[s.seconds for s in sizes])
    title = f"Errors in time of {name}"
    study.require_results(options, title, [exact])
    own = scene.time.method.type
    for row in rows:
        row |= {"scene": name, "element": "P1", "model": "StVK", "h": math.nan}
        row["method"] = row["method"].replace("own", f"{own} (the scene's)")
        if row["status"] == "ok":
            row["total_error"] = rms(row["x"], exact["x"]) / rms(exact["x"], exact["start"])
    study.require_results(options, title, rows)
    charts.draw_all(options.out, rows, "distance of the end [% of the displacement]")
    lines = []
    for level in LEVELS:
        row, line = cheapest(rows, name, level), {"error at most": f"{100 * level:g} %"}
        if row:
            line |= {"method": row["method"], "dt [s] or rtol [1/s]": row["step"]}
            line |= {"CPU seconds": row["seconds"], "error [%]": 100 * row["total_error"]}
        lines.append(line)
    return study.write_report(
        options,
        title,
        rows,
        tables={"Cheapest, by the rms error of the end over the rms displacement": lines},
        figures=("speed_accuracy",),
        conclusion=EXPLAINED.format(method=exact["method"].replace("own", own), step=exact["step"]),
        results=("failed", "refused", "time limit"),
    )


EXPLAINED = (
    "Only the method and its step vary: the errors are errors in time, on the mesh and with the "
    "model of the scene. The error is the rms distance of the end from that of {method} with the "
    "step {step:g} s, in percent of the rms displacement of that run's end."
)


def predict_workload(scene: Scene, case: dict) -> study.Workload:
    """Predict the size of a run of the scene with another method."""
    if case["method"] == "CentralDifference":
        return study.Workload.explicit(scene)
    is_fixed = case["step"] and not case["method"].startswith(("Adaptive", "Auto"))
    return study.Workload.of(scene, dt=case["step"] if is_fixed else None)


def rms(a, b) -> float:
    """Return the root mean square of a − b."""
    return float(np.sqrt(np.mean(np.square(np.subtract(a, b)))))
