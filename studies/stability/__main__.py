"""Stability: where each method fails over the step, the stiffness, the mesh size and damping.

`fc.study.stability` maps every method on every scene of the failure catalogue, except for forward
Euler, which needs up to millions of steps; and backward Euler and BDF2 on a sheet on a ball, over
its stiffness and the height of its fall. The runs of explicit methods must fail above the limits
that `critical_dt` predicts at the start, and only there; the map of the stiff swing must tell which
A-stable methods make energy. `fc.study.sweep` measures their errors there against short steps. On
linear sheets, also with forward Euler, a bisection measures the limits to 1 %. stability.png is the
map of the stiff swing.

    python -m studies.stability [--quick] [--jobs N] [--out DIR]
    fecloth stability my.toml --over fabric.tensile_stiffness=1e2:1e4:log:3    a scene of yours
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.scene.scene import Scene, load_scene
from studies import harness
from studies.stability import sheets
from studies.stability.swing import conclude_errors, measure_errors

SCENES = Path(__file__).parents[1] / "scenes"
FAILURES = SCENES / "failures"
CONTACT = ("crossing_start", "skid", "wide_gap")  # no question of stability
TITLE = "Stability of methods"
OF_SPRINGS = {"springs": "terms.0.stiffness"}  # the stiffness of a scene that its fabric has not
MESHES = {"courant": (0.2, 0.1, 0.05), "indefinite": (0.2, 0.1, 0.05)}
MESHES |= {"linearised": (0.2, 0.1), "stiff_swing": (0.2, 0.1, 0.05)}
DAMPED = 'terms=[{type="StVK"}, {type="Gravity"}, {type="StrainRateDamping", time=1e-3}]'
DAMPINGS = [1e-5, 1e-4, 1e-3, 1e-2]  # s
CLEAN = ("courant", "sliver")  # scenes in which explicit runs fail only beyond the limit
LEAPFROG = ("symplectic_euler", "central_difference")
# The figure of a map shows the first eight methods, all but Newmark's.
ALL = sorted([*METHODS, *LEAPFROG], key="newmark".__eq__)
MAKES = ("implicit_midpoint", "newmark", "generalized_alpha")  # make energy in the stiff swing
KEEPS = ("energy_momentum", "backward_euler", "bdf2")
OF_CONTACT = {"drop": ["backward_euler", "bdf2"]}  # no other method has contact
QUICK = {"courant": LEAPFROG, "stiff_swing": ("implicit_midpoint", "bdf2")}  # short form
SWING = 64  # steps of the stiff swing: of 10.9 ms; waves cross an element in 0.3 ms
ENERGY = 0.05  # energy made, over the energy that moved, above which a run is wrong
JUDGED = ("ok", "wrong", "failed")  # what a run says of its step; any other status is a failed case
Rows = list[dict]


def list_maps(quick: bool) -> Iterator[tuple[str, Scene, dict[str, list[float]]]]:
    """Yield name, scene and varied key of each map."""
    for path in sorted(FAILURES.glob("*.toml")):
        name = path.stem
        if name in CONTACT or (quick and name not in QUICK):
            continue
        scene = load_scene(path)
        key = OF_SPRINGS.get(name, "fabric.tensile_stiffness")
        term = scene.terms[0] if name in OF_SPRINGS else scene.fabric
        Y = getattr(term, key.rpartition(".")[2])
        factors = (1.0,) if quick else (0.1, 1.0, 10.0)
        yield f"{name}, stiffness", scene, {key: [factor * Y for factor in factors]}
    if not quick:
        for name, sizes in MESHES.items():
            yield f"{name}, h", load_scene(FAILURES / f"{name}.toml"), {"cloth.h": list(sizes)}
        damped = load_scene(FAILURES / "courant.toml", [DAMPED])
        yield "courant, damping", damped, {"terms.2.time": DAMPINGS}
        drop = load_scene(SCENES / "drop.toml")
        yield "drop, stiffness", drop, {"fabric.tensile_stiffness": [100.0, 1e3, 1e4]}
        yield "drop, height", drop, {"start.shift.2": [0.001, 0.05, 0.2]}  # 0, 1 and 2 m/s


def run_maps(options) -> dict[str, study.StabilityMap]:
    """Run all maps, and write the report of each into a folder of its own."""
    how = harness.run_options(options)
    cache, maps = how.pop("out"), {}
    if options.quick:  # without the thousands of steps that a motion needs whose errors grow
        how["time_limit"] = 3.0
    for name, scene, over in list_maps(options.quick):
        methods = QUICK[scene_of(name)] if options.quick else OF_CONTACT.get(scene_of(name), ALL)
        maps[name] = study.stability(scene, over, methods, cache=cache, **how)
        maps[name].report(options.out / folder_of(name))
    return maps


def scene_of(name: str) -> str:
    return name.partition(", ")[0]


def folder_of(name: str) -> str:
    return name.replace(", ", "_over_")


def cells_of(maps: dict[str, study.StabilityMap], is_quick: bool) -> Rows:
    """Return all runs; runs that say nothing of their step keep their status.

    The short form leaves out the runs that take too long.
    """
    rows = []
    for name, found in maps.items():
        for cell in found.cells:
            if is_quick and cell["status"] == "time limit":
                continue
            judged = cell["status"] in JUDGED
            outcome = {"outcome": cell["status"], "status": "ok" if judged else cell["status"]}
            rows.append({"map": name, **cell, **outcome})
    return rows


def conclude_maps(cells: Rows) -> list[harness.Finding]:
    """Return the number of explicit runs, 10 % or more from the limit, that contradict it.

    Such a run failed below the limit, or did not fail above it.
    """
    own = [r for r in cells if scene_of(r["map"]) in CLEAN and r["method"] in LEAPFROG]
    own = [r for r in own if r["status"] == "ok" and not 0.9 < r["dt"] / r["predicted"] < 1.1]
    wrong = [r for r in own if (r["outcome"] == "failed") != (r["dt"] > r["predicted"])]
    where = " and ".join(dict.fromkeys(scene_of(r["map"]) for r in own))
    words = f"of {len(own)} explicit runs on {where}: contradictions to the predicted limit"
    return [harness.Finding(words, len(wrong), high=0)]


def conclude_swing(cells: Rows) -> list[harness.Finding]:
    """Return the findings on which A-stable methods make energy on the nonlinear swing.

    There is no expectation of the linearised step: it makes none or much.
    """
    findings = []
    own = [r for r in cells if r["map"] == "stiff_swing, stiffness" and r["steps"] == SWING]
    words = f"methods that were run in {SWING} steps on the stiff swing"
    findings.append(harness.Finding(words, len({r["method"] for r in own}), low=2))
    for row in own:
        if row["fabric.tensile_stiffness"] != 1e4 or row["method"] in EXPLICIT:
            continue
        limits = {"low": ENERGY} if row["method"] in MAKES else {}
        limits = {"high": ENERGY} if row["method"] in KEEPS else limits
        words = f"{row['method']} on the stiff swing at {1e3 * row['dt']:.3g} ms: energy made"
        what = f"{words}, relative to the energy that moved"
        findings.append(harness.Finding(what, energy_made(row), **limits))
    return findings


def energy_made(row: dict) -> float:
    """Return the energy made, infinite for a run that was stopped for it, NaN for another one."""
    if row["energy made"] is not None:
        return row["energy made"]
    return math.inf if "the method has made the rest" in row["cause"] else math.nan


def main() -> int:
    options = harness.parse_arguments(__doc__)
    running = harness.run_options(options)
    limits = study.run_cases(sheets.sheet_cases(options.quick), sheets.measure_limit, **running)
    listed = [{"method": m, "times": t} for m in METHODS for t in (1.0, 10.0, 100.0)]
    free = study.run_cases(listed, sheets.measure_growth, **running)
    for part in (limits, free):
        harness.require_results(options, TITLE, part)
    maps = run_maps(options)
    cells = cells_of(maps, options.quick)
    errors = [] if options.quick else measure_errors(running)
    sheets.draw_limits(options.out, limits)
    findings = sheets.conclude_sheets(limits, free) + conclude_swing(cells) + conclude_maps(cells)
    findings += conclude_errors(errors)
    tables: dict = {name: found.table for name, found in maps.items()}
    if errors:
        tables["Errors on the stiff swing against short steps"] = errors
    tables["Stability limits of linear sheets [s]"] = limits
    parts = {"linear sheet": limits, "growth": free, "errors": errors}
    rows = cells + [{"map": name, **row} for name, part in parts.items() for row in part]
    return harness.write_report(
        options,
        TITLE,
        rows,
        tables=tables,
        figures=["limits", *(f"{folder_of(name)}/figure" for name in maps)],
        findings=findings,
        conclusion="\n\n".join(f"{name}: {found.verdict}" for name, found in maps.items()),
    )


if __name__ == "__main__":
    harness.run_main(main)
