"""The draped cloths of the first start, and the figure of what was predicted and measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, new_figure
from fecloth.view.checker_pattern import weave_texture
from studies.validation.drape.parts import ENDS, Prediction
from studies.validation.drape.specimen import SCATTER, SUPPORT

FINE = 6  # parts of an edge of a triangle in a picture
SQUARE = 0.01  # side of a square of the weave [m]
PAPER, DISK = "#f6f7f9", "#d9d4cb"
EYE = (0.0, -0.62, 0.42)  # of the camera [m]
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


def draw_cloths(
    path: Path, cloth: fc.Cloth, shapes: Mapping[tuple[str, str], np.ndarray], words: Mapping
) -> None:
    """Write a picture of the cloths by fabric and end, each with its words below.

    `shapes` are positions (n, 3) [m] on the `cloth` of P2 triangles. Needs PyVista.
    """
    fabrics = list(dict.fromkeys(fabric for fabric, _ in shapes))
    drawing, axes = new_figure(len(fabrics), len(ENDS), (12.0, 3.1 * len(fabrics)), squeeze=False)
    for (fabric, end), x in shapes.items():
        ax = axes[fabrics.index(fabric), ENDS.index(end)]
        ax.imshow(_photograph(cloth, x))
        ax.set_title(f"{fabric}, {end}", loc="left", fontsize=11)
        ax.set_xlabel(words[fabric, end], fontsize=10)
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
    drawing.savefig(path, dpi=80)


def _photograph(cloth: fc.Cloth, x: np.ndarray) -> np.ndarray:
    """An image (h, w, 3) of a cloth on its support."""
    import pyvista

    points, triangles = subdivide(x[cloth.cells])
    X, _ = subdivide(np.pad(cloth.X, ((0, 0), (0, 1)))[cloth.cells])
    mesh = pyvista.PolyData.from_regular_faces(points, triangles)
    mesh.active_texture_coordinates = X[:, :2] / (2 * SQUARE)
    mesh = mesh.clean()
    mesh.compute_normals(cell_normals=False, consistent_normals=False, inplace=True)
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[640, 420])
    plotter.set_background(PAPER)
    texture = pyvista.Texture(weave_texture())
    texture.repeat = texture.interpolate = texture.mipmap = True
    plotter.add_mesh(mesh, texture=texture, ambient=0.3, diffuse=0.8).prop.interpolation = "phong"
    for centre, height in (((0, 0, -0.061), 0.12), ((0, 0, 0.003), 0.004)):
        size: dict[str, Any] = {"radius": SUPPORT - 1e-3, "height": height, "resolution": 120}
        cylinder = pyvista.Cylinder(center=centre, direction=(0, 0, 1), **size)
        plotter.add_mesh(cylinder, color=DISK, ambient=0.1, diffuse=0.8)
    plotter.camera_position = [EYE, (0.0, 0.0, -0.02), (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = 18
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image


def subdivide(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and flat triangles on P2 triangles with the nodes `corners` (m, 6, 3)."""
    i, j = np.nonzero(np.tri(FINE + 1)[::-1])
    a, b = i / FINE, j / FINE
    c = 1 - a - b
    shapes = [a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c, 4 * c * a]
    points = np.einsum("kp,mkd->mpd", shapes, corners)
    number = {pair: n for n, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    local = [[number[p, q], number[p + 1, q], number[p, q + 1]] for p, q in number if p + q < FINE]
    local += [
        [number[p + 1, q], number[p + 1, q + 1], number[p, q + 1]]
        for p, q in number
        if p + q < FINE - 1
    ]
    offset = len(number) * np.arange(len(corners))[:, None, None]
    return points.reshape(-1, 3), (offset + np.array(local)).reshape(-1, 3)
