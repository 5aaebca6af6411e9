"""Finite elements against springs: what each membrane model converges to, and what it costs.

The same cloth through every model: a pull between clamps, a picture frame, a square that hangs by
its corners, one that swings; the stiffness against the direction of a pull; the bending that
hinges carry; the seconds of a step. A model of a material comes to one answer on all meshes. The
cloth that was asked for is StVK's limit. `--scene` asks a scene of your own.

    python -m studies.models [--quick] [--jobs N] [--out DIR] [--scene my.toml]
"""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies.models.cases import ANGLES, FABRIC, PATTERNS, hinge, own, run
from studies.models.findings import NAMES, SCENES, Rows, conclude, finest, path, sentence


def asked_of(options) -> Rows:
    """The rows of a user's scene: where each model ends, held against StVK."""
    shared = {
        "path": str(options.scene.resolve()),
        "text": options.scene.read_text(encoding="utf-8"),
    }
    given = [name for name in NAMES if name != "BaraffWitkin p = 1"]  # matched to one h alone
    rows = study.run_cases(
        [{**shared, "model": model} for model in given], own, **study.run_options(options)
    )
    ends = {row["model"]: np.reshape(row["x"], (-1, 3)) for row in rows if row["status"] == "ok"}
    table = []
    for row in rows:
        line = {key: row[key] for key in ("model", "status", "cause")}
        if row["status"] == "ok" and "StVK" in ends:
            apart = np.linalg.norm(ends[row["model"]] - ends["StVK"], axis=1)
            line |= {"rms distance [m]": np.sqrt(np.mean(apart**2)), "largest [m]": apart.max()}
            line |= {"CPU seconds, with loading": row["cpu_seconds"]}
        table.append(line)
    return table


def asked(quick: bool) -> Rows:
    """The settings of all cases of the scenes."""
    sizes = (0.1, 0.05) if quick else (0.1, 0.05, 0.025, 0.0125)
    steps = {"swing": (0.1,) if quick else sizes[:2], "drape": sizes[:3], "cost": sizes[:1]}
    steps |= {"rose": sizes[1:2] if quick else sizes[:3]}
    if not quick:
        steps["cost"] = sizes[1:3]
    some = {"swing": ("right", "unstructured"), "cost": ("unstructured",)}
    if quick:
        some["drape"] = some["swing"]
    return [
        {"scene": scene, "model": model, "pattern": pattern, "h": h, "bending": bending}
        for scene in (*SCENES, "rose", "cost")
        for model in NAMES
        for pattern in some.get(scene, PATTERNS)
        for h in steps.get(scene, sizes)
        for bending in ((False, True) if scene in ("drape", "swing") else (False,))
    ]


def settling(rows: Rows, scene: str) -> Rows:
    """Where each model goes: the finest answer over that asked for, and its last change."""
    exact, table = finest(rows, scene, "StVK", "unstructured"), []
    for model in NAMES:
        for pattern in PATTERNS:
            values = [row["value"] for row in path(rows, scene, model, pattern)]
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


def bent(rows: Rows) -> Rows:
    """What hinges change of the answers."""
    table = []
    for scene in ("drape", "swing"):
        for model in NAMES:
            without, with_ = (finest(rows, scene, model, "right", b) for b in (False, True))
            change = with_ / without - 1
            table.append({"scene": scene, "model": model, "change by bending": change})
    return table


def costs(rows: Rows) -> Rows:
    """Milliseconds of a step on one core, over StVK's."""
    table = []
    for model in NAMES:
        for row in path(rows, "cost", model, "unstructured"):
            unit = next(r for r in path(rows, "cost", "StVK", "unstructured") if r["h"] == row["h"])
            line = {"model": model, "h": row["h"], "CPU ms a step": row["value"]}
            line |= {"over StVK": row["value"] / unit["value"], "Newton": row["newton"]}
            table.append(line | {"compiling and loading [s]": row["compile_seconds"]})
    return table


def roses(rows: Rows) -> Rows:
    """Highest over lowest stiffness of the directions, and the mean of what was asked for."""
    table = []
    for model in NAMES:
        for pattern in PATTERNS:
            for row in path(rows, "rose", model, pattern)[-1:]:
                measured = np.array(row["measured"]) / FABRIC.tensile[0]
                line = {"model": model, "pattern": pattern, "highest / lowest": row["value"]}
                line |= {"lowest / asked": measured.min(), "highest / asked": measured.max()}
                if "derived" in row:
                    exact = np.array(row["derived"]) / FABRIC.tensile[0]
                    line["derived highest / lowest"] = exact.max() / exact.min()
                table.append(line)
    return table


def draw_refinement(out, rows: Rows) -> None:
    """Answers over StVK's limit against h by scene and pattern; what softens leaves the panel."""
    shown = ("right", "unstructured")
    size = {"panels": (2, 2), "size": (9.0, 7.6), "log": False, "sharex": True}
    with study.figure(out, "refinement", "edge length h [m]", **size) as (figure, axes):
        for i, scene in enumerate(("stretch", "shear")):
            exact = finest(rows, scene, "StVK", "unstructured")
            for ax, pattern in zip(axes[i], shown, strict=True):
                own = [
                    {**r, "ratio": r.get("value", np.nan) / exact}
                    for r in rows
                    if r["scene"] == scene and r["pattern"] == pattern
                ]
                study.draw_lines(ax, own, x="h", y="ratio", by="model", legend=False, names=NAMES)
                ax.set(xscale="log", yscale="log", ylim=(0.35, 1.5), title=f"{scene}, {pattern}")
                ax.set_ylabel("answer / StVK's limit")
                study.draw_slope_triangle(ax, 2, at=(0.6, 0.12))
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_roses(out, rows: Rows) -> None:
    """Stiffness against the direction of the pull, a panel for each pattern."""
    polar = {"subplot_kw": {"projection": "polar"}, "panels": (2, 2), "size": (9.0, 6.0)}
    with study.figure(out, "roses", log=False, **polar) as (figure, axes):
        for ax, pattern in zip(axes.ravel(), PATTERNS, strict=True):
            for i, model in enumerate(NAMES):
                for row in path(rows, "rose", model, pattern)[-1:]:
                    radius = np.array(row["measured"]) / FABRIC.tensile[0]
                    look = {**study.line_style(i), "markevery": (i % 6, 6), "label": model}
                    ax.plot(np.radians(ANGLES), radius, **look)
            title = f"{pattern}: stiffness / Y asked"
            ax.set(thetamin=0, thetamax=180, ylim=(0, 1.4), title=title)
            ax.set_rgrids((0.5, 1.0), fontsize=9)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_hinges(out, hinges: Rows) -> None:
    """B_eff/B of a cantilever strip against its resolution, the derived values as lines."""
    labels = ("edges along the strip [-]", "bending rigidity carried / asked [-]")
    with study.figure(out, "hinges", *labels, log=False) as (figure, ax):
        study.draw_lines(ax, hinges, x="along", y="value", by="pattern", legend=False)
        for i, pattern in enumerate(PATTERNS):
            for row in [r for r in hinges if r["pattern"] == pattern and "narrow" in r][:1]:
                for limit, dashes in ((row["narrow"], ":"), (row["wide"], "--")):
                    ax.axhline(limit, color=study.COLOURS[i], lw=1, ls=dashes)
        ax.axhline(1.0, color="black", lw=1)
        title = "derived for endless patterns: narrow strips dotted, wide ones dashed"
        ax.set(xscale="log", title=title)
        figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def main() -> int:
    options = study.parse_arguments(__doc__)
    if options.scene:
        table = asked_of(options)
        tables = {"The end of the scene, against StVK's": table}
        return study.write_report(options, f"The models in {options.scene}", table, tables=tables)
    running = study.run_options(options)
    cases = asked(options.quick)
    alone = [case for case in cases if case["scene"] == "cost"]  # seconds are taken one at a time
    rows = study.run_cases(
        [case for case in cases if case not in alone], run, **running, time_limit=120
    )
    rows += study.run_cases(alone, run, **{**running, "jobs": 1})
    along = (10, 20) if options.quick else (10, 20, 40, 80)
    strips = [{"pattern": pattern, "along": n} for pattern in PATTERNS for n in along]
    hinges = study.run_cases(strips, hinge, **running, time_limit=120)
    draw_refinement(options.out, rows)
    draw_roses(options.out, rows)
    draw_hinges(options.out, hinges)
    tables = {f"{scene}: {what}": settling(rows, scene) for scene, what in SCENES.items()}
    tables |= {"Stiffness against the direction of a pull": roses(rows)}
    tables |= {"Bending": bent(rows), "Bending carried by hinges": hinges, "Cost": costs(rows)}
    return study.write_report(
        options,
        "Finite elements against springs",
        rows + [{"scene": "hinge", **row} for row in hinges],
        tables=tables,
        figures=("refinement", "roses", "hinges"),
        findings=conclude(rows, hinges),
        conclusion=sentence(rows),
        settings={"fabric": FABRIC},
    )


if __name__ == "__main__":
    raise SystemExit(main())
