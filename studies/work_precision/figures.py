"""Figures of the work-precision study."""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies import harness

Rows = list[dict]
NAMES = {"many_steps": "CentralDifference, fused"}
BORDER = 0.985  # height of the crosses as a fraction of the axes
FAMILIES = {  # line style: names; all others are dotted
    "-": (
        "BackwardEuler",
        "LinearlyImplicitEuler",
        "BDF2",
        "ImplicitMidpoint",
        "GeneralizedAlpha",
        "Newmark",
        "EnergyMomentum",
    ),
    "--": ("SymplecticEuler", "CentralDifference", "CentralDifference, fused"),
    "-.": ("Auto", "Adaptive CentralDifference", "Adaptive GeneralizedAlpha"),
}


def draw_all(out, rows: Rows, label: str = "error of the mean [%]") -> None:
    """Draw a panel for each scene: runs as points, Pareto fronts of all and of each method."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    looks = line_looks(rows)
    grid = (2, 2) if len(scenes) > 2 else (1, len(scenes))
    size = (8.0, 8.2 if len(scenes) > 2 else 5.2)
    labels = ("CPU time [s]", label)
    with harness.figure(out, "speed_accuracy", *labels, panels=grid, size=size) as (figure, axes):
        for ax, scene in zip(np.ravel(axes), scenes, strict=False):
            draw_panel(ax, [row for row in rows if row["scene"] == scene], looks)
            ax.set_title(scene)
        handles = {}
        for ax in np.ravel(axes):
            lines, names = ax.get_legend_handles_labels()
            handles |= dict(zip(names, lines, strict=True))
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, fontsize=9)


def line_looks(rows: Rows) -> dict[str, dict]:
    """Return colour, marker and dashes by name: the same for a method in all figures."""
    known = [name for names in FAMILIES.values() for name in names]
    names_in_use = list(dict.fromkeys(map(group, rows)))
    families = FAMILIES | {":": tuple(name for name in names_in_use if name not in known)}
    looks = {}
    for dash, names in families.items():
        for i, name in enumerate(names):
            marker = study.MARKERS[len(looks) % len(study.MARKERS)]
            looks[name] = {"color": study.COLOURS[i % 7], "marker": marker, "ls": dash}
    return {name: look for name, look in looks.items() if name in names_in_use}


def draw_panel(ax, rows: Rows, looks: dict[str, dict]) -> None:
    """Draw one scene."""
    good = [row for row in rows if row["status"] == "ok" and "total_error" in row]
    for name, look in looks.items():
        own = [row for row in good if group(row) == name]
        if not own:
            continue
        faint = {"color": look["color"], "marker": look["marker"], "ls": "", "ms": 2}
        ax.plot(*points(own), **faint, alpha=0.3, mew=0)
        ax.plot(*points(front(own)), **{**look, "ms": 4, "lw": 1.0}, label=name)
    ax.plot(*points(front(good)), color="0.25", lw=6, alpha=0.25, zorder=0, label="Pareto front")
    draw_failures(ax, [row for row in rows if row["status"] != "ok"], looks)


def draw_failures(ax, failed: Rows, looks: dict[str, dict]) -> None:
    """Draw a cross at the upper border at the seconds of each failed run, or at the left."""
    low = ax.get_xlim()[0]
    for row in failed:
        x, colour = row.get("seconds") or low, looks[group(row)]["color"]
        at = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot([x], [BORDER], "x", color=colour, ms=7, mew=2, **at)
    causes = dict.fromkeys(describe_failure(row) for row in failed)
    if causes:
        ax.set_ylim(top=4 * ax.get_ylim()[1])  # room for the causes
        text = "\n".join(f"× {text}" for text in causes)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1}
        place = {"ha": "right", "va": "top", "fontsize": 8, "bbox": box}
        ax.text(0.995, 0.94, text, transform=ax.transAxes, **place)


def describe_failure(row: dict) -> str:
    """Describe a failure in a few words."""
    kinds = {"definite": "indefinite", "finite": "blew up", "stretched": "blew up"}
    kinds |= {"kinetic": "blew up", "more than": "late"}
    text = str(row["cause"])
    kind = next((word for part, word in kinds.items() if part in text), row["status"])
    return f"{kind}: {group(row)}"


def group(row: dict) -> str:
    """Return the name of a row's line: its method, or a group of other models or elements."""
    name = NAMES.get(row["method"], row["method"])
    if row.get("element") == "P2":
        return "P2, implicit" if row["method"] != "equilibrium" else "P2, equilibrium"
    if row["model"] not in ("StVK", "StVK + hinges"):
        return "other models"
    return name


def front(rows: Rows) -> Rows:
    """Return the Pareto front: rows that no other row beats in both seconds and error.

    Examples
    --------
    >>> rows = [{"seconds": s, "total_error": e} for s, e in ((1, 3), (2, 1), (3, 2))]
    >>> [row["seconds"] for row in front(rows)]
    [1, 2]
    """
    best = []
    for row in sorted(rows, key=lambda r: (r["seconds"], r["total_error"])):
        if not best or row["total_error"] < best[-1]["total_error"]:
            best.append(row)
    return best


def points(rows: Rows) -> tuple[list, list]:
    """Return the seconds, and the errors in percent."""
    return [row["seconds"] for row in rows], [100 * row["total_error"] for row in rows]
