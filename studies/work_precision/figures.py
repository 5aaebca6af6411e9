"""The figures of speed_accuracy.py."""

from __future__ import annotations

import numpy as np

from fecloth import study

Rows = list[dict]
NAMES = {"many_steps": "CentralDifference, fused"}
BORDER = 0.985  # of the axes: where the crosses stand
FAMILIES = {  # dashes to the lines that have them; all others are dotted
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
    """A panel for each scene: all runs as points, the Pareto front, each method's as a line."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    looks = looks_of(rows)
    grid = (2, 2) if len(scenes) > 2 else (1, len(scenes))
    size = (8.0, 8.2 if len(scenes) > 2 else 5.2)
    labels = ("CPU time [s]", label)
    with study.figure(out, "speed_accuracy", *labels, panels=grid, size=size) as (figure, axes):
        for ax, scene in zip(np.ravel(axes), scenes, strict=False):
            panel(ax, [row for row in rows if row["scene"] == scene], looks)
            ax.set_title(scene)
        handles = {}
        for ax in np.ravel(axes):
            lines, names = ax.get_legend_handles_labels()
            handles |= dict(zip(names, lines, strict=True))
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, fontsize=9)


def looks_of(rows: Rows) -> dict[str, dict]:
    """Line to colour, marker and dashes: the same for a method in all figures."""
    known = [name for names in FAMILIES.values() for name in names]
    given = list(dict.fromkeys(map(group, rows)))
    families = FAMILIES | {":": tuple(name for name in given if name not in known)}
    looks = {}
    for dash, names in families.items():
        for i, name in enumerate(names):
            marker = study.MARKERS[len(looks) % len(study.MARKERS)]
            looks[name] = {"color": study.COLOURS[i % 7], "marker": marker, "ls": dash}
    return {name: look for name, look in looks.items() if name in given}


def panel(ax, rows: Rows, looks: dict[str, dict]) -> None:
    """One scene."""
    good = [row for row in rows if row["status"] == "ok" and "total_error" in row]
    for name, look in looks.items():
        own = [row for row in good if group(row) == name]
        if not own:
            continue
        faint = {"color": look["color"], "marker": look["marker"], "ls": "", "ms": 2}
        ax.plot(*points(own), **faint, alpha=0.3, mew=0)
        ax.plot(*points(front(own)), **{**look, "ms": 4, "lw": 1.0}, label=name)
    ax.plot(*points(front(good)), color="0.25", lw=6, alpha=0.25, zorder=0, label="Pareto front")
    crosses(ax, [row for row in rows if row["status"] != "ok"], looks)


def crosses(ax, failed: Rows, looks: dict[str, dict]) -> None:
    """A cross at the upper border over the seconds that a failed run took, at the left if none."""
    low = ax.get_xlim()[0]
    for row in failed:
        x, colour = row.get("seconds") or low, looks[group(row)]["color"]
        at = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot([x], [BORDER], "x", color=colour, ms=7, mew=2, **at)
    causes = dict.fromkeys(cause(row) for row in failed)
    if causes:
        ax.set_ylim(top=4 * ax.get_ylim()[1])  # room for them
        text = "\n".join(f"× {text}" for text in causes)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1}
        place = {"ha": "right", "va": "top", "fontsize": 8, "bbox": box}
        ax.text(0.995, 0.94, text, transform=ax.transAxes, **place)


def cause(row: dict) -> str:
    """A failure in a few words."""
    kinds = {"definite": "indefinite", "finite": "blew up", "stretched": "blew up"}
    kinds |= {"kinetic": "blew up", "more than": "late"}
    text = str(row["cause"])
    kind = next((word for part, word in kinds.items() if part in text), row["status"])
    return f"{kind}: {group(row)}"


def group(row: dict) -> str:
    """The name of a line: the method, whatever its linear solver; or what is not the usual."""
    name = NAMES.get(row["method"], row["method"])
    if row.get("element") == "P2":
        return "P2, implicit" if row["method"] != "equilibrium" else "P2, equilibrium"
    if row["model"] not in ("StVK", "StVK + hinges"):
        return "other models"
    return name


def front(rows: Rows) -> Rows:
    """The rows that no other one beats in both seconds and error, cheapest first.

    Examples
    --------
    >>> rows = [{"seconds": s, "total_error": e} for s, e in ((1, 3), (2, 1), (3, 2))]
    >>> [row["seconds"] for row in front(rows)]
    [1, 2]
    """
    kept = []
    for row in sorted(rows, key=lambda r: (r["seconds"], r["total_error"])):
        if not kept or row["total_error"] < kept[-1]["total_error"]:
            kept.append(row)
    return kept


def points(rows: Rows) -> tuple[list, list]:
    """Seconds, and error in percent."""
    return [row["seconds"] for row in rows], [100 * row["total_error"] for row in rows]


def draw_time(out, rows: Rows) -> None:
    """Error in time against the step, on one mesh of each scene."""
    good = [r for r in rows if r["status"] == "ok" and r.get("time_error") and r["step"]]
    good = [r for r in good if r["element"] == "P1" and group(r) != "other models"]
    good = [r for r in good if not r["method"].startswith(("Adaptive", "Auto"))]
    good = [r | {"milliseconds": 1e3 * r["step"]} for r in good]
    looks = looks_of(good)
    each(out, "time_error", good, "milliseconds", "time_error", group, looks, "time step [ms]", 2)


def draw_space(out, fine: Rows) -> None:
    """Error in space against the mesh, the model's as a line."""
    good = [r for r in fine if r["status"] == "ok" and r.get("space_error")]
    name = lambda row: f"{row['element']}, {row['model']}"  # noqa: E731
    looks = {label: study.line_style(i) for i, label in enumerate(dict.fromkeys(map(name, good)))}
    each(out, "space_error", good, "h", "space_error", name, looks, "edge length h [m]", 1)


def each(out, file, rows: Rows, x, y, name, looks, label, mesh: int) -> None:
    """A panel for each scene with a line for each name."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    grid = (2, 2) if len(scenes) > 2 else (1, max(1, len(scenes)))
    size = (8.0, 8.0 if len(scenes) > 2 else 5.0)
    labels = (label, f"{y.split('_')[0]} error of the mean [%]")
    with study.figure(out, file, *labels, panels=grid, size=size) as (figure, axes):
        shown = {}
        for ax, scene in zip(np.ravel(axes), scenes, strict=False):
            own = [row for row in rows if row["scene"] == scene]
            sizes = sorted({row["h"] for row in own}, reverse=True)
            if mesh == 2:
                middle = sizes[min(1, len(sizes) - 1)]
                own = [row for row in own if row["h"] == middle]
            for label_, look in looks.items():
                line = sorted((r[x], 100 * r[y]) for r in own if name(r) == label_)
                if line:
                    (shown[label_],) = ax.plot(*zip(*line, strict=True), **{**look, "lw": 1.2})
            ax.set_title(scene if mesh == 1 else f"{scene}, h = {middle:g} m")
            study.draw_slope_triangle(ax, 2)
        figure.legend(shown.values(), shown, loc="outside lower center", ncols=3, fontsize=9)
