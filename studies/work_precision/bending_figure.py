"""Figure of the study of bending: Pareto fronts of the models, a panel for each scene."""

from __future__ import annotations

from fecloth import study
from studies.work_precision.bending_scenes import MODELS
from studies.work_precision.figures import front, points

Rows = list[dict]
PANELS = {  # title: scene and method
    "swing, explicit": ("swing", "CentralDifference"),
    "swing, implicit": ("swing", "ImplicitMidpoint"),
    "cantilever at rest": ("cantilever", "equilibrium"),
    "tablecloth at rest": ("table", "equilibrium"),
}


def draw(out, rows: Rows) -> None:
    """Draw all runs as faint points, and the front of each model with its name at its end."""
    words = "CPU time [s]", "error of the mean depth [%]"
    with study.figure(out, "bending", *words, panels=(2, 2), size=(9.0, 8.0)) as (_, axes):
        for ax, (title, (scene, method)) in zip(axes.flat, PANELS.items(), strict=True):
            ax.set_title(title)
            for i, model in enumerate(MODELS):
                of = {"scene": scene, "method": method, "model": model, "status": "ok"}
                draw_front(ax, [row for row in rows if of.items() <= row.items()], model, i)
            ax.margins(x=0.3, y=0.1)


def draw_front(ax, rows: Rows, model: str, i: int) -> None:
    """Draw the runs of a model, and its front with the name at the right end."""
    if not rows:
        return
    look = study.line_style(i)
    ax.plot(*points(rows), **look | {"ls": "", "ms": 3}, alpha=0.3, mew=0)
    seconds, errors = points(front(rows))
    ax.plot(seconds, errors, **look | {"ms": 5})
    above = {"hinges": 1.0, "quadratic": -1.0}.get(model, 0.0)  # these two lie on each other
    at = {"textcoords": "offset points", "va": "center", "color": look["color"], "fontsize": 11}
    ax.annotate(model, (seconds[-1], errors[-1]), (7, 7 * above), **at)
