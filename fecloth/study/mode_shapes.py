"""A picture of modes of vibration."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.study.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS, MOST = 3, 12  # panels side by side, and in all
PANEL = 2.6  # inches


def draw_modes(cloth: Cloth, frequencies: np.ndarray, shapes: np.ndarray) -> Figure:
    """Draw the first twelve shapes on the flat cloth.

    The colour is the displacement along the direction in which the mode moves most, relative to
    the largest one.
    """
    count = min(len(shapes), MOST)
    columns, rows = min(count, COLUMNS), math.ceil(count / COLUMNS)
    width, height = np.ptp(cloth.X, axis=0)
    tall = PANEL * min(max(height / width, 0.3), 2.0) + 0.4  # with the title
    figure, axes = new_figure(rows, columns, (PANEL * columns + 0.6, max(tall * rows, PANEL)))
    axes = np.atleast_1d(axes).ravel()
    for axis, frequency, shape in zip(axes, frequencies, shapes, strict=False):
        along = np.linalg.svd(shape, full_matrices=False)[2][0]
        u = shape @ along
        u = u / u[abs(u).argmax()]
        smooth = {"shading": "gouraud", "rasterized": True}  # SVG has no colours between nodes
        colours = axis.tripcolor(
            *cloth.X.T, cloth.triangles, u, cmap="RdBu_r", vmin=-1, vmax=1, **smooth
        )
        axis.set_title(f"{frequency:.4g} Hz", fontsize=10)
        axis.set_aspect("equal")
    for axis in axes:
        axis.axis("off")
    figure.colorbar(colours, ax=list(axes), label="displacement / largest", shrink=0.8)
    return figure
