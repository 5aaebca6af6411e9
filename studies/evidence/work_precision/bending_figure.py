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


def draw(out, rows: Rows) -> None:
    """Draw all runs as faint points, and the front of each model."""
    words = "CPU time [s]", "error [%]"
    with harness.figure(out, "bending_fronts", *words, panels=(2, 2), size=(9.0, 8.0)) as (_, axes):
        for ax, (title, (scene, method)) in zip(axes.flat, PANELS.items(), strict=True):
            ax.set_title(title)
            for i, model in enumerate(MODELS):
                of = {"scene": scene, "method": method, "model": model, "status": "ok"}
                own, look = [row for row in rows if of.items() <= row.items()], study.line_style(i)
                ax.plot(*points(own), **look | {"ls": "", "ms": 3}, alpha=0.3, mew=0)
                ax.plot(*points(front(own)), **look | {"ms": 5}, label=model)
        axes.flat[0].legend()
