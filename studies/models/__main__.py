"""Finite elements and springs: the limit of each membrane model under refinement, and its cost.

Every model computes the same cloth: a pull between clamps, a picture frame, a square that hangs by
its corners, and a swing. The study also measures the stiffness against the direction of a pull,
the bending rigidity of hinges, and the seconds of a step. A model of a material has the same limit
on all meshes. The reference is StVK's limit.

    python -m studies.models [--quick] [--jobs N] [--out DIR]
    fecloth compare my.toml --variants terms.0.type=StVK,Springs          for a scene of yours
"""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies import harness
from studies.models.cases import FABRIC, PATTERNS, hinge, run
from studies.models.findings import (
    NAMES,
    SCENES,
    Rows,
    conclude,
    describe_result,
    finest,
    select_rows,
)

TITLE = "Finite elements against springs"
TWINS = ("StVK", "Springs biquadratic")  # which --quick lets drape and swing: they must agree


def list_cases(quick: bool) -> Rows:
    """List the settings of all cases."""
    sizes = (0.1, 0.05) if quick else (0.1, 0.05, 0.025, 0.0125)
    steps = {"swing": (0.1,) if quick else sizes[:2], "drape": sizes[:3], "cost": sizes[:1]}
    steps |= {"rose": sizes[1:2] if quick else sizes[:3]}
    if not quick:
        steps["cost"] = sizes[1:3]
    patterns = {"swing": ("right", "unstructured"), "cost": ("unstructured",)}
    if quick:
        patterns["drape"] = patterns["swing"]
    return [
        {"scene": scene, "model": model, "pattern": pattern, "h": h, "bending": bending}
        for scene in (*SCENES, "rose", "cost")
        for model in (TWINS if quick and scene in ("drape", "swing") else NAMES)
        for pattern in patterns.get(scene, PATTERNS)
        for h in steps.get(scene, sizes)
        for bending in ((False, True) if scene in ("drape", "swing") else (False,))
    ]


def limits_table(rows: Rows, scene: str) -> Rows:
    """Return each model's finest value over StVK's limit, and its last change."""
    exact, table = finest(rows, scene, "StVK", "unstructured"), []
    for model in NAMES:
        for pattern in PATTERNS:
            values = [row["value"] for row in select_rows(rows, scene, model, pattern)]
            if not values:
                continue
            line = {"model": model, "pattern": pattern, "over StVK's limit": values[-1] / exact}
            if len(values) > 1:
                line["change in the last halving of h"] = values[-1] / values[-2] - 1
            if len(values) > 2:
                ratio = (values[-3] - values[-2]) / ((values[-2] - values[-1]) or np.nan)
                line["order"] = float(np.log2(ratio)) if ratio > 0 else None
            table.append(line)
    return table


def bending_table(rows: Rows) -> Rows:
    """Return the relative change of the results by hinge bending."""
    table = []
    for scene in ("drape", "swing"):
        for model in dict.fromkeys(row["model"] for row in rows if row["scene"] == scene):
            without, with_ = (finest(rows, scene, model, "right", b) for b in (False, True))
            change = with_ / without - 1
            table.append({"scene": scene, "model": model, "change by bending": change})
    return table


def cost_table(rows: Rows) -> Rows:
    """Return the CPU milliseconds of a step, also relative to StVK."""
    table = []
    for model in NAMES:
        for row in select_rows(rows, "cost", model, "unstructured"):
            unit = next(
                r for r in select_rows(rows, "cost", "StVK", "unstructured") if r["h"] == row["h"]
            )
            line = {"model": model, "h": row["h"], "CPU ms per step": row["value"]}
            line |= {"over StVK": row["value"] / unit["value"], "Newton": row["newton"]}
            table.append(line)
    return table


def direction_table(rows: Rows) -> Rows:
    """Return the highest and lowest stiffness over the directions of a pull."""
    table = []
    for model in NAMES:
        for pattern in PATTERNS:
            for row in select_rows(rows, "rose", model, pattern)[-1:]:
                measured = np.array(row["measured"]) / FABRIC.tensile[0]
                line = {"model": model, "pattern": pattern, "highest / lowest": row["value"]}
                line |= {"lowest / Y": measured.min(), "highest / Y": measured.max()}
                if "derived" in row:
                    exact = np.array(row["derived"]) / FABRIC.tensile[0]
                    line["derived highest / lowest"] = exact.max() / exact.min()
                table.append(line)
    return table


def draw_refinement(out, rows: Rows) -> None:
    """Draw results over StVK's limit against h; curves that soften leave the panel."""
    shown = ("right", "unstructured")
    size = {"panels": (2, 2), "size": (9.0, 7.6), "log": False, "sharex": True}
    with harness.figure(out, "refinement", "edge length h [m]", **size) as (figure, axes):
        for i, scene in enumerate(("stretch", "shear")):
            exact = finest(rows, scene, "StVK", "unstructured")
            for ax, pattern in zip(axes[i], shown, strict=True):
                own = [
                    {**r, "ratio": r.get("value", np.nan) / exact}
                    for r in rows
                    if r["scene"] == scene and r["pattern"] == pattern
                ]
                harness.draw_lines(ax, own, x="h", y="ratio", by="model", legend=False, names=NAMES)
                ax.set(xscale="log", yscale="log", ylim=(0.35, 1.5), title=f"{scene}, {pattern}")
                ax.set_ylabel("value / StVK's limit")
                harness.draw_slope_triangle(ax, 2, at=(0.6, 0.12))
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def main() -> int:
    options = harness.parse_arguments(__doc__)
    running = harness.run_options(options)
    cases = list_cases(options.quick)
    alone = [case for case in cases if case["scene"] == "cost"]  # timed cases run one after another
    rows = study.run_cases(
        [case for case in cases if case not in alone], run, **running, time_limit=120
    )
    rows += study.run_cases(alone, run, **harness.run_options(options, alone=True))
    along = (10, 20) if options.quick else (10, 20, 40, 80)
    strips = [{"pattern": pattern, "along": n} for pattern in PATTERNS for n in along]
    hinges = study.run_cases(strips, hinge, **running, time_limit=120)
    harness.require_results(options, TITLE, rows)
    draw_refinement(options.out, rows)
    tables = {f"{scene}: {what}": limits_table(rows, scene) for scene, what in SCENES.items()}
    tables |= {"Stiffness against the direction of a pull": direction_table(rows)}
    tables |= {
        "Bending": bending_table(rows),
        "Effective bending rigidity of hinges": hinges,
        "Cost": cost_table(rows),
    }
    return harness.write_report(
        options,
        TITLE,
        rows + [{"scene": "hinge", **row} for row in hinges],
        tables=tables,
        figures=("refinement",),
        findings=conclude(rows, hinges),
        conclusion=describe_result(rows),
        settings={"fabric": FABRIC},
    )


if __name__ == "__main__":
    harness.run_main(main)
