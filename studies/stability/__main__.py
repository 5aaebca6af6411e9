"""Stability: maps of where methods fail over dt, stiffness, mesh size and damping.

The study runs every method on every scene of the failure catalogue. A run is stable, stable but
wrong, blew up, or its Newton iteration failed; the maps compare this with the limits predicted
from the operators at the start. On linear sheets it measures the limits to 1 %. A table has the
largest usable dt of each method and scene. `--scene` maps your own scene.

    python -m studies.stability [--quick] [--jobs N] [--out DIR] [--scene my.toml]
"""

from __future__ import annotations

from pathlib import Path

from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.scene.scene import load_scene
from studies.stability import cases
from studies.stability.cases import ALL, BLOWN, ENERGY, ERROR, NEWTON, STABLE, WRONG
from studies.stability.figures import draw_limits, draw_map
from studies.stability.findings import (
    DRAG,
    SHEET,
    conclude_maps,
    conclude_sheets,
    conclude_swing,
)
from studies.stability.tables import describe_result, tables_of

Rows = list[dict]
TITLE = "Stability of methods"
STEPS = (8, 16, 32, 64, 128, 256)  # number of steps of a run
QUICK_STEPS = STEPS[1::2]
MORE = (512, 1024, 2048, 4096)  # more steps of explicit methods, until dt is below their limit
SCALES = (0.1, 1.0, 10.0)  # of the stiffness
MESHES = {"courant": (0.2, 0.1, 0.05), "indefinite": (0.2, 0.1, 0.05)}
MESHES |= {"linearised": (0.2, 0.1), "stiff_swing": (0.2, 0.1, 0.05)}
DAMPINGS = {"courant": (1e-5, 1e-4, 1e-3, 1e-2)}
SWING = 72  # steps of the stiff swing: of 9.7 ms; waves cross an element in 0.3 ms
AXES = {
    "stiffness": ("Y", "tensile stiffness [N/m]"),
    "h": ("h", "edge length [m]"),
    "damping": ("damping", "time of added strain-rate damping [s]"),
}


# --- maps -----------------------------------------------------------------------------------------


def scenes_along_axis(path: Path, over: str, values: tuple) -> Rows:
    """List the scene of a map for each value of the axis `over`."""
    base = {"path": str(path.resolve()), "content": cases.file_hash(path)}
    base |= {"stiffness": 1.0, "h": None, "damping": None}
    return [{**base, over: value} for value in values]


def run_maps(options, wanted: list[tuple], steps: tuple, more: tuple) -> Rows:
    """Run the cells of maps (path, axis, values); `limit` is the predicted dt [s] or None.

    A scene that cannot be assembled at its start is a single row with the cause.
    """
    limit = options.time_limit if options.scene else 120
    running = {**study.run_options(options), "time_limit": limit}
    axes = [over for _, over, values in wanted for _ in values]
    scenes = [scene for each in wanted for scene in scenes_along_axis(*each)]
    limits = study.run_cases(scenes, cases.predict_limits, **running)
    study.require_results(options, TITLE, [{**row, "scene": row["path"]} for row in limits])
    listed, of = [], []
    for scene, over in zip(limits, axes, strict=True):
        setting = {name: scene[name] for name in cases.KEYS}
        new = [
            {"method": method, "steps": count, **setting}
            for method in ALL
            for count in (*steps, *more_steps(scene, method, more))
            if scene["status"] == "ok"
        ]
        listed, of = listed + new, of + [(scene, over)] * len(new)
    rows = study.run_cases(listed, cases.run_cell, **running, label=describe_cell)
    study.require_results(options, TITLE, rows)
    rows = [label_row(row, *whose) for row, whose in zip(rows, of, strict=True)]
    failed = zip(limits, axes, strict=True)
    return rows + [label_row(row, row, over) for row, over in failed if row["status"] != "ok"]


def check_size(options) -> None:
    """Print the size of the map of a user's scene; refuse it if it is too long."""
    size = study.Workload.of(load_scene(options.scene))
    steps, more = (QUICK_STEPS, ()) if options.quick else (STEPS, MORE)
    cells = [(m, count) for m in ALL for count in (*steps, *(more if m in EXPLICIT else ()))]
    sizes = [study.Workload(size.triangles, count, m in EXPLICIT) for m, count in cells]
    study.check_scene(len(SCALES) * sizes, options)


def describe_cell(case: dict) -> str:
    """Return the words of a cell in the progress lines."""
    scales = {name: case[name] for name in ("stiffness", "h", "damping")}
    words = study.describe_settings(scales)
    return f"{Path(case['path']).stem}, {case['method']}, {case['steps']} steps, {words}"


def label_row(row: dict, limits: dict, over: str) -> dict:
    """Return a row with the name, stiffness and limit of its scene, and without the path."""
    named = {"scene": Path(row["path"]).stem, "over": over, **row, "Y": limits.get("Y")}
    named["limit"] = limits.get(row.get("method"))
    return {name: value for name, value in named.items() if name not in HIDDEN}


HIDDEN = ("path", "content")


def more_steps(scene: dict, method: str, more: tuple) -> list[int]:
    """List more numbers of steps of an explicit method, until dt is below its limit."""
    limit = scene.get(method) if method in EXPLICIT else None
    return [count for count in more if limit and scene["time"] / count > 0.4 * limit]


# --- linear sheets --------------------------------------------------------------------------------


def sheet_cases(quick: bool) -> Rows:
    """List the settings of all linear sheets; with drag for forward Euler, except for one."""
    sizes = (0.1, 0.05) if quick else (0.1, 0.05, 0.025)
    stiff = (1000.0, 4000.0) if quick else (250.0, 1000.0, 4000.0, 16000.0)
    times = (0.02,) if quick else (1e-4, 1e-3, 1e-2, 0.02)
    listed = [{"method": "forward_euler", **SHEET}]
    for method in EXPLICIT:
        base = {"method": method, **SHEET, "drag": DRAG if method == "forward_euler" else 0.0}
        listed += [{**base, "h": h} for h in sizes] + [{**base, "Y": Y} for Y in stiff]
        if method != "forward_euler":
            listed += [{**base, "h": h, "damping": t} for t in times for h in sizes]
    return [dict(one) for one in dict.fromkeys(tuple(one.items()) for one in listed)]


# --- the study ------------------------------------------------------------------------------------


def draw_maps(options) -> Rows:
    """Run and draw all maps; return their cells."""
    own = {path.stem: path for path in cases.catalogue()}
    steps, more = STEPS, MORE
    if options.quick:
        wanted, steps, more = [("courant", "stiffness", SCALES)], QUICK_STEPS, ()
    else:
        wanted = [(name, "stiffness", SCALES) for name in own]
        wanted += [(name, "h", values) for name, values in MESHES.items()]
        wanted += [(name, "damping", values) for name, values in DAMPINGS.items()]
    wanted = [(own[name], *rest) for name, *rest in wanted]
    if options.scene:
        wanted = [(options.scene, "stiffness", SCALES)]
    rows = run_maps(options, wanted, steps, more)
    for path, over, _ in wanted:
        cells = [row for row in rows if (row["scene"], row["over"]) == (path.stem, over)]
        draw_map(options.out, map_name(path.stem, over), cells, *AXES[over])
    return rows


def map_name(scene: str, over: str) -> str:
    return f"{scene}_over_{over}"


SETTINGS = {
    STABLE: f"makes at most {ENERGY:.0%} of the energy that moves; error at most {ERROR:.0%}",
    WRONG: "exceeds one of these limits",
    NEWTON: "Newton's method did not converge",
    BLOWN: "not finite, a stretch above 20, or 4 times the available kinetic energy",
}


def figures_of(rows: Rows) -> list[str]:
    return list(dict.fromkeys(map_name(row["scene"], row["over"]) for row in rows))


def main() -> int:
    options = study.parse_arguments(__doc__, needs=["matplotlib"])
    running = study.run_options(options)
    if options.scene:
        check_size(options)
    rows = draw_maps(options)
    shared = {"tables": tables_of(rows), "settings": SETTINGS, "figures": figures_of(rows)}
    shared["conclusion"] = describe_result(rows)
    if options.scene:
        return study.write_report(options, f"{TITLE} in {options.scene.stem}", rows, **shared)
    limits = study.run_cases(sheet_cases(options.quick), cases.measure_limit, **running)
    listed = [{"method": m, "times": t} for m in METHODS for t in (1.0, 10.0, 100.0)]
    free = study.run_cases(listed, cases.measure_growth, **running)
    (swing,) = [path for path in cases.catalogue() if path.stem == "stiff_swing"]
    (scene,) = scenes_along_axis(swing, "stiffness", (1.0,))
    listed = [{"method": method, "steps": SWING, **scene} for method in METHODS]
    swings = study.run_cases(listed, cases.run_cell, **running)
    for part in (limits, free, swings):
        study.require_results(options, TITLE, part)
    draw_limits(options.out, limits)
    shared["figures"] = ["limits", *shared["figures"]]
    shared["tables"]["Stability limits of linear sheets [s]"] = limits
    findings = conclude_sheets(limits, free) + conclude_swing(swings) + conclude_maps(rows)
    parts = {"linear sheet": limits, "growth": free, "stiff swing": swings}
    rows += [{"scene": name, **row} for name, part in parts.items() for row in part]
    rows = [{k: v for k, v in row.items() if k not in HIDDEN} for row in rows]
    return study.write_report(options, TITLE, rows, findings=findings, **shared)


if __name__ == "__main__":
    study.run_main(main)
