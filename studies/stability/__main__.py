"""Where methods fail: maps over dt, stiffness, mesh size and damping, and what was foretold.

Every method on every scene of the failure catalogue: stable, stable but wrong, Newton failed or
blew up, against the limits that the operators at the start foretell; on linear sheets the limits
to 1 %; the largest usable dt of each method and scene. `--scene` maps a scene of your own.

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
STEPS = (8, 16, 32, 64, 128, 256)  # of a run; dt is its time over that
MORE = (512, 1024, 2048, 4096)  # of explicit methods, down to a dt below their limit
SCALES = (0.1, 1.0, 10.0)  # of the stiffness
MESHES = {"courant": (0.2, 0.1, 0.05), "indefinite": (0.2, 0.1, 0.05)}
MESHES |= {"linearised": (0.2, 0.1), "stiff_swing": (0.2, 0.1, 0.05)}
DAMPINGS = {"courant": (1e-5, 1e-4, 1e-3, 1e-2)}
CLEAN = ("courant", "sliver")  # where an explicit run fails by its limit alone
SWING = 72  # steps of the stiff swing: 9.7 ms, where waves pass in 0.3 ms
MAKES = ("implicit_midpoint", "newmark", "generalized_alpha")  # energy, there
KEEPS = ("energy_momentum", "backward_euler", "bdf2")
AXES = {
    "stiffness": ("Y", "tensile stiffness [N/m]"),
    "h": ("h", "edge length [m]"),
    "damping": ("damping", "time of added strain-rate damping [s]"),
}


# --- maps -----------------------------------------------------------------------------------------


def asked(path: Path, over: str, values: tuple) -> Rows:
    """The scene of a map, once for each value of the axis `over`."""
    base = {"path": str(path.resolve()), "content": cases.digest(path)}
    base |= {"stiffness": 1.0, "h": None, "damping": None}
    return [{**base, over: value} for value in values]


def run_maps(options, wanted: list[tuple], steps: tuple, more: tuple) -> Rows:
    """The cells of maps (path, axis, values), each with what was foretold as `limit` [s] or None.

    A scene whose start gives no operators is a row alone, with its cause.
    """
    running = {**study.run_options(options), "time_limit": 120}
    axes = [over for _, over, values in wanted for _ in values]
    scenes = [scene for each in wanted for scene in asked(*each)]
    told = study.run_cases(scenes, cases.foretold, **running)
    listed, of = [], []
    for scene, over in zip(told, axes, strict=True):
        setting = {name: scene[name] for name in cases.KEYS}
        new = [
            {"method": method, "steps": count, **setting}
            for method in ALL
            for count in (*steps, *further(scene, method, more))
            if scene["status"] == "ok"
        ]
        listed, of = listed + new, of + [(scene, over)] * len(new)
    rows = study.run_cases(listed, cases.cell, **running)
    rows = [labelled(row, *whose) for row, whose in zip(rows, of, strict=True)]
    failed = zip(told, axes, strict=True)
    return rows + [labelled(row, row, over) for row, over in failed if row["status"] != "ok"]


def labelled(row: dict, told: dict, over: str) -> dict:
    """A row with its scene's name, stiffness and limit, without where the file is."""
    named = {"scene": Path(row["path"]).stem, "over": over, **row, "Y": told.get("Y")}
    named["limit"] = told.get(row.get("method"))
    return {name: value for name, value in named.items() if name not in HIDDEN}


HIDDEN = ("path", "content")


def further(scene: dict, method: str, more: tuple) -> list[int]:
    """Numbers of steps of an explicit method until one is below its limit."""
    limit = scene.get(method) if method in EXPLICIT else None
    return [count for count in more if limit and scene["time"] / count > 0.4 * limit]


def usable(rows: Rows, allowed: tuple[str, ...]) -> Rows:
    """For each scene as it is and each method the largest dt at and below which all is allowed."""
    own = [r for r in rows if r["over"] == "stiffness" and r["stiffness"] == 1.0]
    table = []
    for scene in dict.fromkeys(r["scene"] for r in own):
        line = {"scene": scene}
        for method in ALL:
            line[method] = 0.0
            for row in sorted(column(own, scene, method), key=lambda row: row["dt"]):
                if row["outcome"] not in allowed:
                    break
                line[method] = row["dt"]
        table.append(line)
    return table


def column(rows: Rows, scene: str, method: str) -> Rows:
    """The cells of a method on a scene that were run."""
    own = (r for r in rows if (r["scene"], r.get("method")) == (scene, method))
    return [r for r in own if r["status"] == "ok"]


def conclude_maps(rows: Rows) -> list[study.Finding]:
    """How many explicit cells contradict what was foretold, of those 10 % or more from the limit.

    One below has blown up, or one beyond has not.
    """
    own = [r for r in rows if r.get("method") in ("symplectic_euler", "central_difference")]
    own = [r for r in own if r["scene"] in CLEAN and r["status"] == "ok"]
    own = [r for r in own if not 0.9 < r["dt"] / r["limit"] < 1.1]
    wrong = [r for r in own if (r["outcome"] == BLOWN) != (r["dt"] > r["limit"])]
    where = " and ".join(dict.fromkeys(r["scene"] for r in own))
    words = f"of {len(own)} explicit cells on {where}, against what was foretold"
    return [study.Finding(words, len(wrong), high=0)]


# --- linear sheets --------------------------------------------------------------------------------

SHEET = {"h": 0.1, "Y": 1000.0, "damping": 0.0, "drag": 0.0}
DRAG = 1500.0  # 1/s: forward Euler needs some


def sheets(quick: bool) -> Rows:
    """The settings of all linear sheets; forward Euler's have drag, and one has none."""
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


def power(rows: Rows, method: str, over: str, **fixed: float) -> float:
    """The p of the measured limit ∝ (h or Y)^p over the last step."""
    drag = DRAG if method == "forward_euler" else 0.0
    key = {**SHEET, "method": method, "drag": drag, **fixed}
    own = [r for r in rows if all(r[k] == v for k, v in key.items() if k != over)]
    first, last = sorted((r for r in own if "measured" in r), key=lambda r: r[over])[-2:]
    if over == "h":
        first, last = sorted(own, key=lambda r: r[over])[:2]
    return math.log(last["measured"] / first["measured"]) / math.log(last[over] / first[over])


def conclude_sheets(rows: Rows, free: Rows) -> list[study.Finding]:
    F, found = study.Finding, []
    for method in EXPLICIT:
        own = [r for r in rows if r["method"] == method and "measured" in r]
        off = max(abs(r["measured"] / r["foretold"] - 1) for r in own)
        found.append(F(f"{method}: measured limit from that foretold, relative", off, high=0.1))
        p = 2.0 if method == "forward_euler" else 1.0
        found.append(
            F(f"{method}: goes with h to the power", power(rows, method, "h"), p - 0.15, p + 0.15)
        )
        value = power(rows, method, "Y")
        found.append(F(f"{method}: with Y to the power", value, -p / 2 - 0.05, -p / 2 + 0.05))
        if method != "forward_euler":
            value = power(rows, method, "h", damping=0.02)
            words = f"{method}: with h to the power, where strain-rate damping governs"
            found.append(F(words, value, 1.85, 2.15))
    (bare,) = [r for r in rows if r["method"] == "forward_euler" and r["drag"] == 0.0]
    found.append(F("forward_euler undamped: limit foretold [s]", bare["foretold"], 0.0, 0.0))
    words = "forward_euler undamped at a fifth of the others' limit: log of growth"
    found.append(F(words, bare["growth"], GROWTH))
    for method in METHODS:
        growth = max(r["growth"] for r in free if r["method"] == method)
        words = f"{method}: log of growth at 1 to 100 times the explicit limit, linear"
        found.append(F(words, growth, high=GROWTH))
    return found


def conclude_swing(rows: Rows) -> list[study.Finding]:
    """Which A-stable methods make energy on the nonlinear swing."""
    F, found = study.Finding, []
    for row in rows:
        limits = (-math.inf, math.inf)  # the linearised step makes none at this dt, or a lot
        if row["method"] in (*MAKES, *KEEPS):
            limits = (ENERGY, math.inf) if row["method"] in MAKES else (-math.inf, ENERGY)
        words = f"{row['method']} on the stiff swing at {1e3 * row['dt']:.2g} ms: energy made"
        found.append(F(f"{words} of what moved", row["made"], *limits))
    return found


# --- the study ------------------------------------------------------------------------------------


def maps(options) -> Rows:
    """The cells of all maps, each drawn."""
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
        draw_map(options.out, name_of(path.stem, over), cells, *AXES[over])
    return rows


def name_of(scene: str, over: str) -> str:
    return f"{scene}_over_{over}"


def tables_of(rows: Rows) -> dict[str, Rows]:
    return {
        "Largest dt [s] that is stable and right, with all smaller ones": usable(rows, (STABLE,)),
        "Largest dt [s] that does not fail, with all smaller ones": usable(rows, (STABLE, WRONG)),
    }


SETTINGS = {
    STABLE: f"makes at most {ENERGY:.0%} of the energy that moves, off by at most {ERROR:.0%}",
    WRONG: "beyond one of these, at the quarters of the time",
    NEWTON: "a step was not solved",
    BLOWN: "not finite, a stretch beyond 20, or 4 times the kinetic energy that there can be",
}


def conclusion_of(rows: Rows) -> str:
    """A sentence for each scene: whose largest steps are right."""
    words = "{}: the largest steps that are right, as all smaller ones, are {}'s, {:.3g} s."
    lines = [dict(line) for line in usable(rows, (STABLE,))]
    best = [(line.pop("scene"), max(line, key=line.get), max(line.values())) for line in lines]
    return "\n".join("- " + words.format(*one) for one in best if one[2] > 0)


def figures_of(rows: Rows) -> list[str]:
    return list(dict.fromkeys(name_of(row["scene"], row["over"]) for row in rows))


def main() -> int:
    options = study.parse_arguments(__doc__)
    running = study.run_options(options)
    rows = maps(options)
    shared = {"tables": tables_of(rows), "settings": SETTINGS, "figures": figures_of(rows)}
    shared["conclusion"] = conclusion_of(rows)
    if options.scene:
        return study.write_report(options, f"Where methods fail in {options.scene}", rows, **shared)
    limits = study.run_cases(sheets(options.quick), cases.boundary, **running)
    listed = [{"method": m, "times": t} for m in METHODS for t in (1.0, 10.0, 100.0)]
    free = study.run_cases(listed, cases.unbounded, **running)
    (swing,) = [path for path in cases.catalogue() if path.stem == "stiff_swing"]
    (scene,) = asked(swing, "stiffness", (1.0,))
    listed = [{"method": method, "steps": SWING, **scene} for method in METHODS]
    swings = study.run_cases(listed, cases.cell, **running)
    draw_limits(options.out, limits)
    shared["figures"] = ["limits", *shared["figures"]]
    shared["tables"]["Limits of linear sheets [s]"] = limits
    findings = conclude_sheets(limits, free) + conclude_swing(swings) + conclude_maps(rows)
    return study.write_report(options, "Where methods fail", rows, findings=findings, **shared)


if __name__ == "__main__":
    raise SystemExit(main())
