"""Stability: maps of where methods fail over dt, stiffness, mesh size and damping.

The study runs every method on every scene of the failure catalogue. A run is stable, stable but
wrong, blew up, or its Newton iteration failed; the maps compare this with the limits predicted
from the operators at the start. On linear sheets it measures the limits to 1 %. A table has the
largest usable dt of each method and scene. `--scene` maps your own scene.

    python -m studies.stability [--quick] [--jobs N] [--out DIR] [--scene my.toml]
"""

from __future__ import annotations

import math
from pathlib import Path

from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from studies.stability import cases
from studies.stability.cases import ALL, BLOWN, ENERGY, ERROR, GROWTH, NEWTON, STABLE, WRONG
from studies.stability.figures import draw_limits, draw_map

Rows = list[dict]
STEPS = (8, 16, 32, 64, 128, 256)  # number of steps of a run
MORE = (512, 1024, 2048, 4096)  # more steps of explicit methods, until dt is below their limit
SCALES = (0.1, 1.0, 10.0)  # of the stiffness
MESHES = {"courant": (0.2, 0.1, 0.05), "indefinite": (0.2, 0.1, 0.05)}
MESHES |= {"linearised": (0.2, 0.1), "stiff_swing": (0.2, 0.1, 0.05)}
DAMPINGS = {"courant": (1e-5, 1e-4, 1e-3, 1e-2)}
CLEAN = ("courant", "sliver")  # scenes in which explicit runs fail only beyond the limit
SWING = 72  # steps of the stiff swing: of 9.7 ms; waves cross an element in 0.3 ms
MAKES = ("implicit_midpoint", "newmark", "generalized_alpha")  # make energy in the stiff swing
KEEPS = ("energy_momentum", "backward_euler", "bdf2")
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
    running = {**study.run_options(options), "time_limit": 120}
    axes = [over for _, over, values in wanted for _ in values]
    scenes = [scene for each in wanted for scene in scenes_along_axis(*each)]
    limits = study.run_cases(scenes, cases.predict_limits, **running)
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
    rows = study.run_cases(listed, cases.run_cell, **running)
    rows = [label_row(row, *whose) for row, whose in zip(rows, of, strict=True)]
    failed = zip(limits, axes, strict=True)
    return rows + [label_row(row, row, over) for row, over in failed if row["status"] != "ok"]


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


def largest_steps(rows: Rows, allowed: tuple[str, ...]) -> Rows:
    """Return the largest dt of each scene and method at and below which all runs are allowed."""
    own = [r for r in rows if r["over"] == "stiffness" and r["stiffness"] == 1.0]
    table = []
    for scene in dict.fromkeys(r["scene"] for r in own):
        line = {"scene": scene}
        for method in ALL:
            line[method] = 0.0
            for row in sorted(successful_cells(own, scene, method), key=lambda row: row["dt"]):
                if row["outcome"] not in allowed:
                    break
                line[method] = row["dt"]
        table.append(line)
    return table


def successful_cells(rows: Rows, scene: str, method: str) -> Rows:
    """Return the cells of a method on a scene that were run."""
    own = (r for r in rows if (r["scene"], r.get("method")) == (scene, method))
    return [r for r in own if r["status"] == "ok"]


def conclude_maps(rows: Rows) -> list[study.Finding]:
    """Return the number of explicit cells, 10 % or more from the limit, that contradict it.

    Such a cell blew up below the limit, or did not blow up above it.
    """
    own = [r for r in rows if r.get("method") in ("symplectic_euler", "central_difference")]
    own = [r for r in own if r["scene"] in CLEAN and r["status"] == "ok"]
    own = [r for r in own if not 0.9 < r["dt"] / r["limit"] < 1.1]
    wrong = [r for r in own if (r["outcome"] == BLOWN) != (r["dt"] > r["limit"])]
    where = " and ".join(dict.fromkeys(r["scene"] for r in own))
    words = f"of {len(own)} explicit cells on {where}: contradictions to the predicted limit"
    return [study.Finding(words, len(wrong), high=0)]


# --- linear sheets --------------------------------------------------------------------------------

SHEET = {"h": 0.1, "Y": 1000.0, "damping": 0.0, "drag": 0.0}
DRAG = 1500.0  # [1/s]; forward Euler is unstable without


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


def exponent_of(rows: Rows, method: str, over: str, **fixed: float) -> float:
    """Return the p of the measured limit ∝ (h or Y)^p over the last two values."""
    drag = DRAG if method == "forward_euler" else 0.0
    key = {**SHEET, "method": method, "drag": drag, **fixed}
    own = [r for r in rows if all(r[k] == v for k, v in key.items() if k != over)]
    first, last = sorted((r for r in own if "measured" in r), key=lambda r: r[over])[-2:]
    if over == "h":
        first, last = sorted(own, key=lambda r: r[over])[:2]
    return math.log(last["measured"] / first["measured"]) / math.log(last[over] / first[over])


def conclude_sheets(rows: Rows, free: Rows) -> list[study.Finding]:
    F, findings = study.Finding, []
    for method in EXPLICIT:
        own = [r for r in rows if r["method"] == method and "measured" in r]
        off = max(abs(r["measured"] / r["predicted"] - 1) for r in own)
        findings.append(
            F(f"{method}: measured limit, relative distance from the predicted one", off, high=0.1)
        )
        p = 2.0 if method == "forward_euler" else 1.0
        findings.append(
            F(f"{method}: exponent of h", exponent_of(rows, method, "h"), p - 0.15, p + 0.15)
        )
        value = exponent_of(rows, method, "Y")
        findings.append(F(f"{method}: exponent of Y", value, -p / 2 - 0.05, -p / 2 + 0.05))
        if method != "forward_euler":
            value = exponent_of(rows, method, "h", damping=0.02)
            words = f"{method}: exponent of h where strain-rate damping governs"
            findings.append(F(words, value, 1.85, 2.15))
    (bare,) = [r for r in rows if r["method"] == "forward_euler" and r["drag"] == 0.0]
    findings.append(F("forward_euler undamped: predicted limit [s]", bare["predicted"], 0.0, 0.0))
    words = "forward_euler undamped at a fifth of the others' limit: log of growth"
    findings.append(F(words, bare["growth"], GROWTH))
    for method in METHODS:
        growth = max(r["growth"] for r in free if r["method"] == method)
        words = f"{method}: log of growth at 1 to 100 times the explicit limit, linear"
        findings.append(F(words, growth, high=GROWTH))
    return findings


def conclude_swing(rows: Rows) -> list[study.Finding]:
    """Return the findings on which A-stable methods make energy on the nonlinear swing."""
    F, findings = study.Finding, []
    for row in rows:
        limits = (-math.inf, math.inf)  # no expectation: the linearised step makes none or much
        if row["method"] in (*MAKES, *KEEPS):
            limits = (ENERGY, math.inf) if row["method"] in MAKES else (-math.inf, ENERGY)
        words = f"{row['method']} on the stiff swing at {1e3 * row['dt']:.2g} ms: energy made"
        findings.append(F(f"{words}, relative to the energy that moved", row["made"], *limits))
    return findings


# --- the study ------------------------------------------------------------------------------------


def draw_maps(options) -> Rows:
    """Run and draw all maps; return their cells."""
    own = {path.stem: path for path in cases.catalogue()}
    steps, more = STEPS, MORE
    if options.quick:
        wanted, steps, more = [("courant", "stiffness", SCALES)], STEPS[1::2], ()
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


def tables_of(rows: Rows) -> dict[str, Rows]:
    return {
        "Largest dt [s] up to which all runs are stable and right": largest_steps(rows, (STABLE,)),
        "Largest dt [s] up to which no run fails": largest_steps(rows, (STABLE, WRONG)),
    }


SETTINGS = {
    STABLE: f"makes at most {ENERGY:.0%} of the energy that moves; error at most {ERROR:.0%}",
    WRONG: "exceeds one of these limits",
    NEWTON: "Newton's method did not converge",
    BLOWN: "not finite, a stretch above 20, or 4 times the available kinetic energy",
}


def describe_result(rows: Rows) -> str:
    """Return a sentence for each scene: the method with the largest right steps."""
    words = "{}: {} takes the largest steps that are right, {:.3g} s."
    lines = [dict(line) for line in largest_steps(rows, (STABLE,))]
    best = [(line.pop("scene"), max(line, key=line.get), max(line.values())) for line in lines]
    return "\n".join("- " + words.format(*one) for one in best if one[2] > 0)


def figures_of(rows: Rows) -> list[str]:
    return list(dict.fromkeys(map_name(row["scene"], row["over"]) for row in rows))


def main() -> int:
    options = study.parse_arguments(__doc__)
    running = study.run_options(options)
    rows = draw_maps(options)
    shared = {"tables": tables_of(rows), "settings": SETTINGS, "figures": figures_of(rows)}
    shared["conclusion"] = describe_result(rows)
    if options.scene:
        return study.write_report(
            options, f"Stability of methods in {options.scene}", rows, **shared
        )
    limits = study.run_cases(sheet_cases(options.quick), cases.measure_limit, **running)
    listed = [{"method": m, "times": t} for m in METHODS for t in (1.0, 10.0, 100.0)]
    free = study.run_cases(listed, cases.measure_growth, **running)
    (swing,) = [path for path in cases.catalogue() if path.stem == "stiff_swing"]
    (scene,) = scenes_along_axis(swing, "stiffness", (1.0,))
    listed = [{"method": method, "steps": SWING, **scene} for method in METHODS]
    swings = study.run_cases(listed, cases.run_cell, **running)
    draw_limits(options.out, limits)
    shared["figures"] = ["limits", *shared["figures"]]
    shared["tables"]["Stability limits of linear sheets [s]"] = limits
    findings = conclude_sheets(limits, free) + conclude_swing(swings) + conclude_maps(rows)
    return study.write_report(options, "Stability of methods", rows, findings=findings, **shared)


if __name__ == "__main__":
    raise SystemExit(main())
