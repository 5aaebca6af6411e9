"""The figure of what was predicted and measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.study.figures import COLOURS, new_figure
from studies.validation.drape.parts import Prediction
from studies.validation.drape.specimen import SCATTER

NAMES = {
    "tensile_stiffness": "tension", "shear_stiffness": "shear", "bending_rigidity": "B",
    "bending_hysteresis": "2HB", "bias_rigidity": "B along the bias",
}  # fmt: skip


def parts_of(p: Prediction) -> dict[str, float]:
    """All parts of the uncertainty [points], with the scatter of the measurement."""
    constants = {NAMES[key]: abs(change) for key, change in p.constants.items()}
    own = {"mesh": p.space, "load steps": p.steps, "start": p.start, **constants}
    return own | {"mass": p.mass, "support": p.support, "measurement": SCATTER}


def draw_figure(path: Path, predictions: Sequence[Prediction], D: Mapping[str, float]) -> None:
    """Write the coefficients beside the measured ones, and the parts of each variance."""
    drawing, (left, right) = new_figure(1, 2, (12.0, 4.6), width_ratios=(1, 1.15))
    names = [f"{p.fabric.split()[0]}, {p.model}" for p in predictions]
    places = range(len(names))
    for y, p in zip(places, predictions, strict=True):
        own = p.coefficient(D[p.fabric]).own
        first = y == 0
        look: dict[str, Any] = {"color": COLOURS[1], "ms": 7, "capsize": 4}
        left.errorbar(p.value, y, xerr=2 * own, fmt="o", label="predicted ± 2 u" * first, **look)
        starts = np.full(len(p.coefficients), y + 0.2)
        left.plot(p.coefficients, starts, "|", color="0.3", ms=9, label="the five starts" * first)
        measured = D[p.fabric] + 2 * SCATTER * np.array([-1, 1])
        label = "measured ± 2 u" * first
        left.fill_betweenx(
            [y - 0.42, y + 0.42], *measured, color=COLOURS[0], alpha=0.2, label=label
        )
        left.plot([D[p.fabric]] * 2, [y - 0.42, y + 0.42], color=COLOURS[0])
    left.set(yticks=list(places), yticklabels=names, xlabel="drape coefficient [%]")
    _draw_parts(right, [parts_of(p) for p in predictions])
    for ax in (left, right):
        ax.invert_yaxis()
    left.legend(fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.15))
    drawing.savefig(path, dpi=90)


def _draw_parts(ax: Any, parts: Sequence[Mapping[str, float]]) -> None:
    """Stacked bars: the squares of the parts over their sum."""
    keys = dict.fromkeys(key for each in parts for key in each)
    squares = np.nan_to_num([[each.get(key, 0.0) ** 2 for each in parts] for key in keys])
    share = 100 * squares / squares.sum(axis=0)
    begin = np.zeros(len(parts))
    for i, (key, width) in enumerate(zip(keys, share, strict=True)):
        again, colour = divmod(i, len(COLOURS))
        look: dict[str, Any] = {"color": COLOURS[colour], "hatch": "//" * again, "ec": "white"}
        ax.barh(range(len(parts)), width, left=begin, label=key, **look)
        begin = begin + width
    ax.set(xlabel="part of total² [%]", xlim=(0, 100), yticks=[])
    ax.legend(fontsize=8, ncols=6, loc="upper center", bbox_to_anchor=(0.5, -0.15))
