"""Finite elements against springs: what each membrane model converges to, and what it costs.

The same cloth through every model: a pull between clamps, a picture frame, a square that hangs by
its corners, one that swings; the stiffness against the direction of a pull; the bending that
hinges carry; the seconds of a step. A model of a material comes to one answer on all meshes. The
cloth that was asked for is StVK's limit. `--scene` asks a scene of your own.

    python studies/models.py [--quick] [--jobs N] [--out DIR] [--scene my.toml]
"""

from __future__ import annotations

import harness
import numpy as np
from model_cases import ANGLES, FABRIC, PATTERNS, hinge, models, own, run

SCENES = {"stretch": "force [N]", "shear": "shear stiffness [N/m]", "drape": "sag [m]"}
SCENES |= {"swing": "mean depth [m]"}
NAMES = tuple(models("right"))
Rows = list[dict]


def asked_of(options) -> Rows:
    """The rows of a user's scene: where each model ends, held against StVK."""
    shared = {"path": str(options.scene.resolve()), "text": options.scene.read_text()}
    given = [name for name in NAMES if name != "BaraffWitkin p = 1"]  # matched to one h alone
    rows = harness.run_cases(
        [{**shared, "model": model} for model in given], own, **harness.running(options)
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


def path(rows: Rows, scene: str, model: str, pattern: str, bending: bool = False) -> Rows:
    """The rows of one model on one pattern, coarse to fine."""
    key = (scene, model, pattern, bending)
    names = ("scene", "model", "pattern", "bending")
    own = [r for r in rows if tuple(r[n] for n in names) == key and r["status"] == "ok"]
    return sorted(own, key=lambda row: -row["h"])


def finest(rows: Rows, *key) -> float:
    """The answer on the finest mesh; NaN where there is none."""
    own = path(rows, *key)
    return own[-1]["value"] if own else float("nan")


def spread(rows: Rows, scene: str, model: str) -> float:
    """By how much the answers of the patterns differ on the finest meshes, of their mean."""
    patterns = {r["pattern"] for r in rows if r["scene"] == scene}
    values = [finest(rows, scene, model, pattern) for pattern in patterns]
    return float((max(values) - min(values)) / np.mean(values))


def power(rows: Rows, scene: str, model: str, pattern: str) -> float:
    """The p of value ∝ h^p over the last halving."""
    *_, coarse, fine = [{"value": np.nan, "h": 1.0}] * 2 + path(rows, scene, model, pattern)
    return float(np.log(coarse["value"] / fine["value"]) / np.log(coarse["h"] / fine["h"]))


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


def conclude(rows: Rows, hinges: Rows) -> list[harness.Finding]:
    """The statements, each a number and its range."""
    F, found = harness.Finding, []
    twins = [
        abs(finest(rows, scene, "Springs biquadratic", p) / finest(rows, scene, "StVK", p) - 1)
        for scene in SCENES
        for p in ("right", "unstructured")
    ]
    found.append(F("biquadratic springs from StVK, all scenes, relative", max(twins), high=1e-6))
    for scene, most in (("stretch", 0.02), ("shear", 1e-6)):
        found.append(
            F(f"StVK, {scene}: spread over patterns", spread(rows, scene, "StVK"), high=most)
        )
    found += conclude_springs(rows)
    soft = power(rows, "shear", "BaraffWitkin p = 1", "right")
    found.append(F("BaraffWitkin as published, shear: goes with h to the power", soft, 1.99, 2.01))
    firm = abs(power(rows, "shear", "BaraffWitkin p = 1/2", "right"))
    found.append(F("BaraffWitkin p = 1/2, shear: goes with h to the power", firm, high=0.05))
    G = finest(rows, "shear", "TensorCondition", "unstructured") / FABRIC.shear
    asked_for = 1 + FABRIC.poisson_ratio  # nu = 0: G = Y/2 for Y/(2 (1 + nu))
    found.append(F("TensorCondition: G over that asked", G, asked_for - 1e-6, asked_for + 1e-6))
    found += [*conclude_roses(rows), *conclude_hinges(hinges)]
    return found


def conclude_springs(rows: Rows) -> list[harness.Finding]:
    """Springs settle under refinement, on another material for each pattern."""
    F, found = harness.Finding, []
    for model, scene in (("Springs structural", "stretch"), ("Springs van_gelder", "shear")):
        off = abs(finest(rows, scene, model, "right") / finest(rows, scene, "StVK", "right") - 1)
        found.append(F(f"{model}, {scene}, right: away from StVK, relative", off, 0.1))
        drift = abs(power(rows, scene, model, "right"))
        found.append(F(f"{model}, {scene}, right: goes with h to the power", drift, high=0.02))
        found.append(F(f"{model}, {scene}: spread over patterns", spread(rows, scene, model), 0.1))
    return found


def conclude_roses(rows: Rows) -> list[harness.Finding]:
    """Elements know no direction, springs have that of their pattern, as the derived moduli say."""
    F, found = harness.Finding, []
    least = {"StVK": (1.0, 1 + 1e-9), "Springs structural": (1.15,), "Springs van_gelder": (3.0,)}
    for model, limits in least.items():
        value = finest(rows, "rose", model, "right")
        found.append(F(f"{model} on right: highest over lowest stiffness", value, *limits))
    own = [row for m in NAMES for p in ("right", "cross") for row in path(rows, "rose", m, p)[-1:]]
    off = max((farthest(row["measured"], row["derived"]) for row in own), default=np.nan)
    found.append(F("roses from the derived ones on right and cross, relative", off, high=0.02))
    return found


def farthest(measured: list[float], derived: list[float]) -> float:
    """The largest relative difference."""
    return float(np.abs(np.array(measured) / derived - 1).max())


def conclude_hinges(hinges: Rows) -> list[harness.Finding]:
    """Every pattern carries another B, as derived, and refinement does not cure it."""
    good = [row for row in hinges if row["status"] == "ok"]
    fine = {row["pattern"]: row for row in sorted(good, key=lambda row: row["along"])}
    values = [row["value"] for row in fine.values()] or [np.nan]
    off = [
        max(row["narrow"] - row["value"], row["value"] - row["wide"], 0.0)
        for row in fine.values()
        if "narrow" in row
    ]
    F, differ = harness.Finding, max(values) - min(values)
    return [
        F("hinges: B_eff/B of the stiffest pattern less the softest", differ, 0.15),
        F("hinges: B_eff/B on right", fine.get("right", {}).get("value", np.nan), 0.75, 0.85),
        F(
            "hinges: B_eff/B outside the derived of narrow and wide strips",
            max(off, default=np.nan),
            high=0.05,
        ),
    ]


def draw_refinement(out, rows: Rows) -> None:
    """Every model's answers over StVK's limit against h, a panel for each scene and pattern."""
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
                harness.lines(ax, own, x="h", y="ratio", by="model", legend=False)
                ax.set(xscale="log", yscale="log", title=f"{scene}, {pattern}")
                ax.set_ylabel("answer / StVK's limit")
                harness.slope_triangle(ax, 2)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_roses(out, rows: Rows) -> None:
    """Stiffness against the direction of the pull, a panel for each pattern."""
    polar = {"subplot_kw": {"projection": "polar"}, "panels": (2, 2), "size": (9.0, 6.0)}
    with harness.figure(out, "roses", log=False, **polar) as (figure, axes):
        for ax, pattern in zip(axes.ravel(), PATTERNS, strict=True):
            for i, model in enumerate(NAMES):
                for row in path(rows, "rose", model, pattern)[-1:]:
                    radius = np.array(row["measured"]) / FABRIC.tensile[0]
                    look = {**harness.style(i), "markevery": (i % 6, 6), "label": model}
                    ax.plot(np.radians(ANGLES), radius, **look)
            title = f"{pattern}: stiffness / Y asked"
            ax.set(thetamin=0, thetamax=180, ylim=(0, 1.4), title=title)
            ax.set_rgrids((0.5, 1.0), fontsize=9)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_hinges(out, hinges: Rows) -> None:
    """B_eff/B of a cantilever strip against its resolution, the derived values at the border."""
    labels = ("edges along the strip [-]", "bending rigidity carried / asked [-]")
    with harness.figure(out, "hinges", *labels, log=False) as (_, ax):
        harness.lines(ax, hinges, x="along", y="value", by="pattern")
        for i, pattern in enumerate(PATTERNS):
            for row in [r for r in hinges if r["pattern"] == pattern and "narrow" in r][:1]:
                for limit, dashes in ((row["narrow"], ":"), (row["wide"], "--")):
                    ax.axhline(limit, color=harness.COLOURS[i], lw=1, ls=dashes)
        ax.axhline(1.0, color="black", lw=1)
        ax.set(
            xscale="log",
            title="derived for endless patterns: narrow strips dotted, wide ones dashed",
        )


def main() -> int:
    options = harness.arguments(__doc__)
    if options.scene:
        table = asked_of(options)
        tables = {"The end of the scene, against StVK's": table}
        return harness.report(options, f"The models in {options.scene}", table, tables=tables)
    running = harness.running(options)
    cases = asked(options.quick)
    alone = [case for case in cases if case["scene"] == "cost"]  # seconds are taken one at a time
    rows = harness.run_cases(
        [case for case in cases if case not in alone], run, **running, time_limit=120
    )
    rows += harness.run_cases(alone, run, **{**running, "jobs": 1})
    along = (10, 20) if options.quick else (10, 20, 40, 80)
    strips = [{"pattern": pattern, "along": n} for pattern in PATTERNS for n in along]
    hinges = harness.run_cases(strips, hinge, **running, time_limit=120)
    draw_refinement(options.out, rows)
    draw_roses(options.out, rows)
    draw_hinges(options.out, hinges)
    tables = {f"{scene}: {what}": settling(rows, scene) for scene, what in SCENES.items()}
    tables |= {"Stiffness against the direction of a pull": roses(rows)}
    tables |= {"Bending": bent(rows), "Bending carried by hinges": hinges, "Cost": costs(rows)}
    return harness.report(
        options,
        "Finite elements against springs",
        rows + [{"scene": "hinge", **row} for row in hinges],
        tables=tables,
        figures=("refinement", "roses", "hinges"),
        findings=conclude(rows, hinges),
        settings={"fabric": FABRIC},
    )


if __name__ == "__main__":
    raise SystemExit(main())
