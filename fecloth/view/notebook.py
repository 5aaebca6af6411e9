"""A result as figures in a notebook: its energies, and the heights of its probes over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fecloth.view.svg_chart import chart
from fecloth.view.templates import render


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
    return render("notebook.html", {"title": title, "figures": figures})
