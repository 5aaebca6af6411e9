"""A result as figures in a notebook: its energies, and the heights of its probes over time."""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np

from fecloth.view.svg_chart import chart

STYLE = """<style>
.fecloth { display: flex; flex-wrap: wrap; gap: 1em }
.fecloth figure { margin: 0; width: 460px }
.fecloth svg text { font: 11px sans-serif; fill: currentColor }
.fecloth .grid line { stroke: #8884 }
.fecloth .key i { display: inline-block; width: .8em; height: .8em; margin: 0 .3em 0 .8em }
</style>"""


def result_figures(
    title: str,
    times: np.ndarray,
    energies: Mapping[str, np.ndarray],
    observed: Mapping[str, np.ndarray],
) -> str:
    """Return HTML with a title, the energies [J] and the heights [m] over the times [s].

    Energies that are zero throughout are left out; of `observed` the z of each probe, the mean
    displacement in z and the sag are drawn.
    """
    curves = {name: (times, values) for name, values in energies.items() if np.any(values)}
    heights = {
        name: (times, values)
        for name, values in observed.items()
        if name == "sag" or (name.endswith(".z") and not name.startswith("reaction:"))
    }
    figures = chart("Energies", curves, "t [s]", "energy [J]")
    figures += chart("Probes", heights, "t [s]", "z, sag [m]")
    return f'{STYLE}<p>{html.escape(title)}</p><div class="fecloth">{figures}</div>'
