"""Cusick's drape test of published fabrics: python -m studies.drape [DIR ...]

A round specimen of 0.3 m lies between two disks of 0.18 m and hangs over their edge. The drape
coefficient is the fraction of the hanging ring that the shadow of the draped cloth covers (Cusick
1965, The dependence of fabric drape on bending and shear stiffness, J. Text. Inst. 56,
doi.org/10.1080/19447026508662319): 1 for a board, small for a cloth in deep folds. The study
prints it with the number of folds, for the runs of studies/scenes/drape.toml in the given folders.
Without folders it runs three fabrics and draws them into out/drape.png; --picture names another
file.

With --methods it drapes the tablecloth with each of `METHODS` and `STEPS`, and prints their cost
and their result.

This does not replace a measurement: the folds are one of many states at rest. With --h 0.0045 the
coefficients change by 0.01 and the folds by one.
"""

from __future__ import annotations

import math
import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np

from fecloth import study
from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame, Series
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.view.checker_pattern import material_coordinates

HERE = Path(__file__).parent
FABRICS = ("interlock", "polyester-tablecloth", "trousers")
METHODS = ("backward_euler", "linearly_implicit_euler", "bdf2", "implicit_midpoint")
STEPS = (0.02, 0.01, 0.005)  # s
SPECIMEN, SUPPORT = 0.15, 0.09  # radii in meshes/drape.geo [m]
CELL = 5e-4  # size of the cells in which the area of the shadow is counted [m]


def shadow_area(x: np.ndarray, triangles: np.ndarray) -> float:
    """Return the area that triangles cover, seen from above; overlaps count once [m²]."""
    corners = x[triangles, :2]
    count = math.ceil(2 * np.ptp(corners, axis=1).max() / CELL)
    i, j = np.nonzero(np.tri(count + 1)[::-1])  # points of each triangle, closer than the cells
    weights = np.stack([i, j, count - i - j], axis=1) / count
    cells = np.floor(weights @ corners / CELL).astype(int).reshape(-1, 2)
    cells -= cells.min(axis=0)
    covered = np.zeros(cells.max(axis=0) + 1, bool)
    covered[*cells.T] = True
    return np.count_nonzero(covered) * CELL**2


def drape_coefficient(frame: Frame) -> float:
    """Return (shadow − support)/(specimen − support), all areas; the specimen is the flat mesh."""
    flat, support = shadow_area(material_coordinates(frame), frame.cells), math.pi * SUPPORT**2
    return (shadow_area(frame.points, frame.cells) - support) / (flat - support)


def count_folds(frame: Frame) -> int:
    """Count the crests of the rim: its arcs above the mean height."""
    X = material_coordinates(frame)
    rim = np.flatnonzero(np.hypot(*X.T) > SPECIMEN - 1e-6)
    z = frame.points[rim[np.argsort(np.arctan2(*X[rim].T))], 2]
    return int(np.sum((z > z.mean()) & (np.roll(z, 1) <= z.mean())))


def drape_fabric(fabric: str, h: float, folder: Path) -> Frame:
    """Run the drape test of a fabric in a folder; return its last frame."""
    scene = load_scene(HERE.parent / "scenes" / "drape.toml", [f"fabric={fabric}", f"cloth.h={h}"])
    run_scene(scene, folder)
    return read_last_frame(folder)


def draw_fabrics(folders: dict[str, Path], words: dict[str, str], target: Path) -> None:
    """Draw the cloths side by side, each with its result below."""
    import imageio.v2 as imageio

    from fecloth.study.figures import pyplot
    from fecloth.view.render import render

    plt = pyplot()
    figure, axes = plt.subplots(1, len(folders), figsize=(12, 2.95), dpi=100)
    for ax, (fabric, folder) in zip(axes, folders.items(), strict=True):
        picture = render(folder, folder / "end.png", field="checks", size=(800, 600))
        ax.imshow(imageio.imread(picture)[90:570])
        ax.set_title(fabric, fontsize=14)
        ax.set_xlabel(words[fabric], fontsize=12)
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
    figure.subplots_adjust(0.005, 0.085, 0.995, 0.915, 0.02)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target)


def describe_drape(frame: Frame) -> str:
    """Return the drape coefficient and the number of folds in words."""
    coefficient = 100 * drape_coefficient(frame)
    return f"drape coefficient {coefficient:.0f} %, {count_folds(frame)} folds"


def read_last_frame(folder: Path) -> Frame:
    series = Series.open(folder)
    return series.read(len(series.times) - 1)


def compare_fabrics(h: float, picture: Path | None) -> None:
    """Drape `FABRICS`, print their results, and draw them if there is a file to draw to."""
    with tempfile.TemporaryDirectory() as folder:
        folders = {fabric: Path(folder) / fabric for fabric in FABRICS}
        words = {
            fabric: describe_drape(drape_fabric(fabric, h, run)) for fabric, run in folders.items()
        }
        for fabric in FABRICS:
            print(f"{fabric:22s} {words[fabric]}")
        if picture:
            draw_fabrics(folders, words, picture)
            print(f"wrote {picture}")


def compare_methods(h: float) -> None:
    """Print for each method and step the cost of the tablecloth's fall, and where it ends."""
    for method, dt in product(METHODS, STEPS):
        overrides = [f"cloth.h={h}", f"time.method={method}", f"time.dt={dt}"]
        with tempfile.TemporaryDirectory() as folder:
            begin = time.process_time()
            outcome = run_scene(
                load_scene(HERE.parent / "scenes" / "drape.toml", overrides), Path(folder) / "run"
            )
            seconds = time.process_time() - begin
            end = outcome.status
            if end == "done":
                off = any("energy balance" in words for words in outcome.warnings)
                warned = ", its energy balance off on the way" if off else ""
                end = describe_drape(read_last_frame(outcome.folder)) + warned
        print(f"{method:24s} {1000 * dt:3.0f} ms  {seconds:5.1f} CPU s  {end}")


def choose_picture(target: Path | None, is_quick: bool) -> Path | None:
    """Return the file of the figure, or None; a missing package is an error only with --picture."""
    try:
        study.require_packages("pyvista", "imageio", "matplotlib")
    except InputError as missing:
        if target:
            raise
        print(f"no picture: {missing}")
        return None
    return target or (None if is_quick else Path("out/drape.png"))


def main() -> int:
    parser = study.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", type=Path, metavar="DIR", help="folder of a drape test")
    parser.add_argument("--methods", action="store_true", help="compare methods and steps instead")
    parser.add_argument("--quick", action="store_true", help="coarse, without a picture")
    parser.add_argument("--h", type=float, default=0.006, help="edge length [m]")
    parser.add_argument("--picture", type=Path, help="file of the picture (out/drape.png)")
    options = parser.parse_args()
    for folder in options.runs:
        print(f"{folder!s:22s} {describe_drape(read_last_frame(folder))}")
    h = 0.015 if options.quick else options.h
    if options.methods:
        compare_methods(h)
    elif not options.runs:
        compare_fabrics(h, choose_picture(options.picture, options.quick))
    return 0


if __name__ == "__main__":
    study.run_main(main)
