"""Does Newton's iteration fail where a fabric has friction inside?

Sheets of 1,000 triangles fall for 2 s, as in `studies.evidence.newton_catalogue`: three fabrics
hang down from two corners, with and without 3 ms of strain-rate damping. They have `PlateBending`,
and beside it `BendingFriction`. Sheets with four or two corners held, and a drape test, come to
equilibrium in 20 load steps, laid and shaken.

The presets have no 2HB. So HB/B is a measured ratio of another fabric: 18.8/m of a polyester and
24.6/m of a wool tropical (2HB/(2B) of M. Matsudaira et al. 2015, Journal of Textile Engineering
61(6), 69), and 53/m of a cotton, the largest that we know of, for which we have no citation.

    python -m studies.evidence.bending.friction_grid [--quick] [--jobs N] [--out DIR]
"""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.drape.meshes import cut_ring, mesh_specimen
from studies.evidence.newton_catalogue.__main__ import COTTON, DAMPING, FABRICS, SAFE, STEPS

# HB/B [1/m] of KES
RATIOS = {"none": 0.0, "polyester": 18.8, "wool": 24.6, "cotton": 53.0}
H = 0.0485  # m, of the sheet of 1 m: 1,000 triangles
SHEETS = ("four corners", "two corners", "drape")
ENDS = ("laid", "shaken")


def material(fabric: str, ratio: float) -> fc.Fabric:
    """The fabric with a hysteresis of bending 2HB of `ratio` = HB/B [1/m], along warp and weft."""
    chosen = COTTON if fabric == "cotton" else fc.Fabric.preset(fabric)
    B1, B2 = chosen.bending or (0.0, 0.0)
    return replace(chosen, bending_hysteresis=(2 * ratio * B1, 2 * ratio * B2))


def terms(ratio: float) -> list:
    friction = [fc.BendingFriction()] if ratio else []
    return [fc.StVK(), fc.PlateBending(), *friction, fc.Gravity()]


def corners(X: np.ndarray, both: bool = False) -> np.ndarray:
    """(n,) whether a node is one of the two corners at Y = 1, or one of all four."""
    end = (X[:, 1] > 1 - 1e-9) | both & (X[:, 1] < 1e-9)
    return end & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9)


def fall(
    fabric: str, damping: float, method: str, dt: float, solver: str, friction: str, t_end: float
) -> dict:
    """Run one sheet; a failed step is a result, with its time."""
    cloth, ratio = fc.Cloth.rectangle(1.0, 1.0, h=H), RATIOS[friction]
    given = terms(ratio) + ([fc.StrainRateDamping(damping)] if damping else [])
    system = fc.System(cloth, material(fabric, ratio), given, [fc.Pin(corners)])
    chosen, start, newton, failure = getattr(fc, method)(), system.rest(), [], ""
    next(fc.march(system, chosen, start, dt, dt, solver=solver))  # compiles
    begin = time.process_time()
    try:
        for _, info in fc.march(system, chosen, start, dt, t_end, solver=solver):
            study.check_time_limit()
            newton.append(info.counts.newton)
    except fc.StepFailed as stopped:
        failure = f"{stopped.reason} at t = {stopped.t:.3f} s"
    return {
        "failure": failure,
        "iterations": sum(newton) / max(len(newton), 1),
        "most": max(newton, default=0),
        "seconds": time.process_time() - begin,
    }


def falls(quick: bool) -> list[dict]:
    """The settings of all falls; a quick one falls for 0.1 s."""
    names = ("solver", "friction", "fabric", "damping", "method", "dt")
    undamped = (FABRICS, (0.0,), SAFE, STEPS[:2])
    axes = [
        (("pcg",), ("none", "cotton"), FABRICS, (0.0, DAMPING), SAFE, STEPS),
        (("direct",), ("cotton",), *undamped),
        (("pcg",), ("wool",), *undamped),
    ]
    if quick:
        axes = [(("pcg",), ("none", "cotton"), FABRICS[:1], (0.0,), SAFE[1:], STEPS[1:2])]
    every = [dict(zip(names, v, strict=True)) for each in axes for v in product(*each)]
    return [case | {"t_end": 0.1 if quick else 2.0} for case in every]


def rest(fabric: str, sheet: str, friction: str, end: str) -> dict:
    """The equilibrium of one sheet in 20 load steps."""
    ratio = RATIOS[friction]
    if sheet == "drape":
        cloth, clamp = cut_ring(mesh_specimen("Gmsh", 0.01)), True
        where = "support"
    else:
        cloth, clamp = fc.Cloth.rectangle(1.0, 1.0, h=H), False
        where = lambda X: corners(X, sheet == "four corners")  # noqa: E731
    pins = [fc.Pin(where, clamp=clamp)]
    system = fc.System(cloth, material(fabric, ratio), terms(ratio), pins)
    begin, failure, found = time.process_time(), "", None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = fc.equilibrium(system, system.rest(), load_steps=20, friction=end)
        except fc.EquilibriumFailed as stopped:
            failure = str(stopped)
    return {
        "failure": failure,
        "iterations": found.iterations if found else None,
        "sag": -float(found.x[:, 2].mean()) if found else None,
        "seconds": time.process_time() - begin,
    }


def rests(quick: bool) -> list[dict]:
    """The settings of all equilibria."""
    names = ("fabric", "sheet", "friction", "end")
    ends = [("none", "laid"), *product(("polyester", "cotton"), ENDS)]
    axes = (
        product(FABRICS[:1], SHEETS[:1], ends[-2:-1]) if quick else product(FABRICS, SHEETS, ends)
    )
    return [dict(zip(names, (fabric, sheet, *end), strict=True)) for fabric, sheet, end in axes]


def failed(row: dict) -> bool:
    return row["status"] != "ok" or bool(row["failure"])


def falls_table(rows: list[dict]) -> list[dict]:
    """A row for each fabric and method: the most iterations in one step with each friction."""
    table: dict[tuple, dict] = {}
    for row in rows:
        key = row["fabric"], row["method"]
        line = table.setdefault(key, dict(zip(("fabric", "method"), key, strict=True)))
        line[row["friction"]] = max(line.get(row["friction"], 0), row["most"])
    return list(table.values())


def rests_table(rows: list[dict]) -> list[dict]:
    """A row for each fabric and sheet: iterations, and the mean sag [mm], at each end."""
    table: dict[tuple, dict] = {}
    for row in rows:
        key = row["fabric"], row["sheet"]
        line = table.setdefault(key, dict(zip(("fabric", "sheet"), key, strict=True)))
        name = row["friction"] if row["friction"] == "none" else f"{row['friction']}, {row['end']}"
        found = not failed(row)
        line[name] = f"{row['iterations']}, {1e3 * row['sag']:.1f} mm" if found else "failed"
    return list(table.values())


def growth(rows: list[dict], dt: float) -> float:
    """Iterations of steps with a cotton's friction over those without, in equal cases."""
    keys = ("solver", "fabric", "damping", "method", "dt")
    found: dict[tuple, dict] = {}
    for row in rows:
        if row["dt"] == dt and not failed(row):
            found.setdefault(tuple(row[k] for k in keys), {})[row["friction"]] = row["iterations"]
    pairs = [(of["cotton"], of["none"]) for of in found.values() if {"cotton", "none"} <= of.keys()]
    with_friction, without = np.sum(pairs, axis=0)
    return float(with_friction / without)


def report(options, fallen: list[dict], rested: list[dict]) -> int:
    """Write the report of these cases."""
    rubbing = [row for row in fallen + rested if row["friction"] != "none"]
    plain = [row for row in fallen + rested if row["friction"] == "none"]
    steps = sorted({row["dt"] for row in fallen}, reverse=True)
    findings = [
        harness.Finding(f"failures of {len(rows)} cases {which} friction", failures, high=0)
        for rows, which in ((rubbing, "with"), (plain, "without"))
        for failures in [sum(map(failed, rows))]
    ]
    for dt in steps:
        what = f"iterations a step with the cotton's friction over without, 1/{round(1 / dt)} s"
        findings.append(harness.Finding(what, growth(fallen, dt)))
    title, what = harness.about(__doc__)
    return harness.write_report(
        options,
        title,
        fallen + rested,
        conclusion=what,
        tables={
            "Falls: the most iterations in one step": falls_table(fallen),
            "Equilibria: iterations of all load steps, and the mean sag": rests_table(rested),
        },
        findings=findings,
        page=Path(__file__).with_suffix(""),
    )


def main() -> int:
    options = harness.parse_arguments(__doc__)
    settings, ways = falls(options.quick), harness.run_options(options)
    costs = [case["t_end"] / case["dt"] ** 0.5 for case in settings]
    fallen = study.run_cases(settings, fall, costs=costs, **ways)
    return report(options, fallen, study.run_cases(rests(options.quick), rest, **ways))


if __name__ == "__main__":
    harness.run_main(main)
