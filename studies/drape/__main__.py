"""Cusick's drape test of published fabrics: python -m studies.drape [DIR ...]

A round specimen of 0.3 m, held between two disks of 0.18 m, hangs over their edge. The drape
coefficient is the share of the hanging ring that its shadow still covers (Cusick 1965, The
dependence of fabric drape on bending and shear stiffness, J. Text. Inst. 56,
doi.org/10.1080/19447026508662319): 1 for a board, small for what falls in deep folds. Prints it
with the number of folds, of the runs of studies/scenes/drape.toml in the folders that are named,
or else of three fabrics, which it runs and draws into out/drape.png; that at the head of the
README is made by --picture.

With --methods it drapes the tablecloth with every one of `METHODS` and `STEPS`, and prints what
they cost and where they end.

It is no measurement: the folds are one of many states at rest. With --h 0.0045 the coefficients
change by one hundredth, the folds by one.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame, Series
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.view.checker_pattern import material_coordinates

HERE = Path(__file__).parent
FABRICS = ("interlock", "polyester-tablecloth", "trousers")
METHODS = ("backward_euler", "linearly_implicit_euler", "bdf2", "implicit_midpoint")
STEPS = (0.02, 0.01, 0.005)  # s
SPECIMEN, SUPPORT = 0.15, 0.09  # radii [m], those of meshes/drape.geo
CELL = 5e-4  # of the grid on which the shadow is counted [m]


def shadow_area(x: np.ndarray, triangles: np.ndarray) -> float:
    """Area [m²] that a cloth's triangles cover seen from above, each place once."""
    corners = x[triangles, :2]
    count = math.ceil(2 * np.ptp(corners, axis=1).max() / CELL)
    i, j = np.nonzero(np.tri(count + 1)[::-1])  # barycentric points, closer than the cells
    weights = np.stack([i, j, count - i - j], axis=1) / count
    cells = np.floor(weights @ corners / CELL).astype(int).reshape(-1, 2)
    cells -= cells.min(axis=0)
    covered = np.zeros(cells.max(axis=0) + 1, bool)
    covered[*cells.T] = True
    return np.count_nonzero(covered) * CELL**2


def drape_coefficient(frame: Frame) -> float:
    """(shadow − support)/(specimen − support), the specimen as its mesh has it when flat."""
    flat, support = shadow_area(material_coordinates(frame), frame.cells), math.pi * SUPPORT**2
    return (shadow_area(frame.points, frame.cells) - support) / (flat - support)


def folds(frame: Frame) -> int:
    """Crests along the rim, where it is higher than its mean."""
    X = material_coordinates(frame)
    rim = np.flatnonzero(np.hypot(*X.T) > SPECIMEN - 1e-6)
    z = frame.points[rim[np.argsort(np.arctan2(*X[rim].T))], 2]
    return int(np.sum((z > z.mean()) & (np.roll(z, 1) <= z.mean())))


def draped(fabric: str, h: float, folder: Path) -> Frame:
    scene = load_scene(HERE.parent / "scenes" / "drape.toml", [f"fabric={fabric}", f"cloth.h={h}"])
    run_scene(scene, folder)
    return last(folder)


def draw(folders: dict[str, Path], words: dict[str, str], target: Path) -> None:
    """The cloths beside each other, with what was found under them."""
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


def found(frame: Frame) -> str:
    return f"drape coefficient {100 * drape_coefficient(frame):.0f} %, {folds(frame)} folds"


def last(folder: Path) -> Frame:
    series = Series.open(folder)
    return series.read(len(series.times) - 1)


def three(h: float, picture: Path | None) -> None:
    """Drape `FABRICS`, print what they do, and draw them."""
    if picture and not (find_spec("pyvista") and find_spec("matplotlib")):
        print("no picture: it needs the extras [view] and [plot]")
        picture = None
    with tempfile.TemporaryDirectory() as folder:
        folders = {fabric: Path(folder) / fabric for fabric in FABRICS}
        words = {fabric: found(draped(fabric, h, run)) for fabric, run in folders.items()}
        for fabric in FABRICS:
            print(f"{fabric:22s} {words[fabric]}")
        if picture:
            try:
                draw(folders, words, picture)
                print(f"wrote {picture}")
            except (ImportError, InputError) as missing:
                print(f"no picture: {missing}")


def methods(h: float) -> None:
    """What the tablecloth costs until it is at rest, by method and step, and where it ends."""
    for method, dt in product(METHODS, STEPS):
        given = [f"cloth.h={h}", f"time.method={method}", f"time.dt={dt}"]
        with tempfile.TemporaryDirectory() as folder:
            began = time.process_time()
            outcome = run_scene(
                load_scene(HERE.parent / "scenes" / "drape.toml", given), Path(folder) / "run"
            )
            seconds = time.process_time() - began
            end = outcome.status
            if end == "done":
                off = any("energy balance" in words for words in outcome.warnings)
                balance = ", its balance off on the way" if off else ""
                end = found(last(outcome.folder)) + balance
        print(f"{method:24s} {1000 * dt:3.0f} ms  {seconds:5.1f} CPU s  {end}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", type=Path, metavar="DIR", help="folder of a drape test")
    parser.add_argument("--methods", action="store_true", help="by method and step instead")
    parser.add_argument("--quick", action="store_true", help="coarse; a picture if asked for")
    parser.add_argument("--h", type=float, default=0.006, help="edge length [m]")
    parser.add_argument("--picture", type=Path, help="where to (out/drape.png)")
    options = parser.parse_args()
    for folder in options.runs:
        print(f"{folder!s:22s} {found(last(folder))}")
    h = 0.015 if options.quick else options.h
    if options.methods:
        methods(h)
    elif not options.runs:
        three(h, options.picture or (None if options.quick else Path("out/drape.png")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
