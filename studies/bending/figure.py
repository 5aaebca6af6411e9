"""The figure of the bending study: error against edge length, a panel for each problem."""

from __future__ import annotations

import numpy as np

from fecloth import study
from studies import harness
from studies.bending.findings import EXACT, HINGES, P1, P2, Rows

TITLES = {
    "supported_square": "Supported square, uniform load",
    "clamped_square": "Clamped square, uniform load",
    "clamped_disk": "Clamped disk, uniform load",
    "free_square": "Free square, first frequency",
    "corner_twist": "Square twisted at a corner",
    "heavy_strip": "Heavy strip, rotated by 60°",
}
SERIES = {"hinges": (HINGES, 1), P1: ((P1,), 0), P2: ((P2,), 2)}  # models, colour
WORDS = {"hinges": "hinges, quadratic", P1: "plate on P1", P2: "plate on P2"}


def bounds(rows: Rows, models: tuple[str, ...], graded: bool) -> np.ndarray:
    """Return h, the least and the largest error over the patterns (k, 3)."""
    errors: dict[float, list[float]] = {}
    for row in rows:
        is_graded = row["pattern"] == "graded"
        if row["status"] == "ok" and row["model"] in models and is_graded == graded:
            errors.setdefault(row["h"], []).append(row["error"])
    return np.array([(h, min(e), max(e)) for h, e in sorted(errors.items())])


def draw_series(ax, rows: Rows, name: str) -> None:
    """Draw a band over the patterns with a line for the worst, and the graded mesh dotted."""
    models, colour = SERIES[name]
    look = {"color": study.COLOURS[colour]}
    band, graded = (bounds(rows, models, choice) for choice in (False, True))
    if len(band):
        ax.fill_between(*band.T, alpha=0.18, lw=0, **look)
        ax.plot(band[:, 0], band[:, 2], marker=study.MARKERS[colour], label=WORDS[name], **look)
    if len(graded):
        ax.plot(graded[:, 0], graded[:, 2], ls=":", **look)


def draw(out, rows: Rows) -> None:
    """Write bending.png and bending.svg into the folder `out`."""
    labels = "distance of nodes h [m]", "relative error"
    shared = {"panels": (2, 3), "size": (13.0, 8.2)}
    with harness.figure(out, "bending", *labels, **shared) as (figure, axes):
        for ax, (problem, title) in zip(axes.ravel(), TITLES.items(), strict=True):
            group = [row for row in rows if row["problem"] == problem]
            for name in SERIES:
                draw_series(ax, group, name)
            ax.set_title(title)
            ax.set_ylim(top=2)
            if problem == EXACT:
                ax.text(0.022, 1e-7, "plates on P1 and P2:\nround-off", fontsize=11)
            else:
                harness.draw_slope_triangle(ax, 2, at=(0.93, 0.05), width=0.18)
        axes.flat[0].legend()
        words = "Lines: the worst of five patterns. Bands: all five. Dotted: meshes graded 20 : 1."
        figure.supxlabel(words, fontsize=12)
