"""Figure of the study of bending: Pareto fronts of the models, a panel for each scene."""

from __future__ import annotations

from fecloth import study
from studies import harness
from studies.evidence.work_precision.bending_scenes import MODELS
from studies.work_precision.figures import front, points

Rows = list[dict]
PANELS = {  # title: scene and method
    "swing, explicit": ("swing", "CentralDifference"),
    "swing, implicit": ("swing", "ImplicitMidpoint"),
    "cantilever at rest": ("cantilever", "equilibrium"),
    "tablecloth at rest": ("table", "equilibrium"),
}
NAMES = {  # model: number of the point that has the name, its place beside it [pt], alignment
    "hinges": (-1, (7, 8), "left"),
    "quadratic": (-1, (7, -8), "left"),
    "plate": (-1, (8, 0), "left"),
    "plate, P2": (-1, (8, 0), "left"),
}
ELSEWHERE = {  # where a name would lie on another line
    ("swing, explicit", "plate"): (-1, (-8, -6), "right"),
    ("tablecloth at rest", "plate"): (-1, (-8, -6), "right"),
    ("tablecloth at rest", "hinges"): (0, (-8, -6), "right"),
    ("tablecloth at rest", "quadratic"): (0, (-8, 2), "right"),
}


def draw(out, rows: Rows) -> None:
    """Draw all runs as faint points, and the front of each model with its name."""
    words = "CPU time [s]", "error [%]"
    with harness.figure(out, "bending_fronts", *words, panels=(2, 2), size=(9.0, 8.0)) as (_, axes):
        for ax, (title, (scene, method)) in zip(axes.flat, PANELS.items(), strict=True):
            ax.set_title(title)
            for i, model in enumerate(MODELS):
                of = {"scene": scene, "method": method, "model": model, "status": "ok"}
                place = ELSEWHERE.get((title, model), NAMES[model])
                draw_front(ax, [row for row in rows if of.items() <= row.items()], model, i, place)
            ax.margins(x=0.45, y=0.1)


def draw_front(ax, rows: Rows, model: str, i: int, place: tuple) -> None:
    """Draw the runs of a model, and its front with the name at one of its points."""
    if not rows:
        return
    look, (k, offset, side) = study.line_style(i), place
    ax.plot(*points(rows), **look | {"ls": "", "ms": 3}, alpha=0.3, mew=0)
    seconds, errors = points(front(rows))
    ax.plot(seconds, errors, **look | {"ms": 5})
    text = {"color": look["color"], "fontsize": 11, "ha": side, "va": "center"}
    ax.annotate(model, (seconds[k], errors[k]), offset, textcoords="offset points", **text)
