"""Cusick's drape test of published fabrics: python -m studies.drape [DIR ...]

A round specimen of 0.3 m lies between two disks of 0.18 m and hangs over their edge. The drape
coefficient is the fraction of the hanging ring that the shadow of the draped cloth covers (Cusick
1965, The dependence of fabric drape on bending and shear stiffness, J. Text. Inst. 56,
doi.org/10.1080/19447026508662319): 1 for a board, small for a cloth in deep folds. The study
prints it with the number of folds, for the runs of studies/scenes/drape.toml in the given folders.
Without folders it runs three fabrics and draws them into out/drape.png; --picture names another
file.

With --meshes it drapes all published fabrics that have a bending rigidity on four meshes, with
`PlateBending` and with `HingeBending`, and writes meshes.csv and meshes.md into the folder --out.
`between_meshes` says what is compared.

With --methods it drapes the tablecloth with `HingeBending` and each of `METHODS` and `STEPS`, and
prints their cost and their result.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from itertools import product
from pathlib import Path

import fecloth as fc
from fecloth import study
from fecloth.errors import FeclothError, FeclothWarning, InputError
from fecloth.output.frame_reader import Frame, Series
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.study.result import markdown_table, write_csv
from fecloth.view.checker_pattern import material_coordinates
from studies import harness
from studies.drape.between_meshes import COLUMNS, compare_meshes, summarise
from studies.drape.measures import count_folds, drape_coefficient
from studies.drape.meshes import mesh_specimen

SCENE = Path(__file__).parents[1] / "scenes" / "drape.toml"
FABRICS = ("interlock", "polyester-tablecloth", "trousers")
BENT = [name for name in fc.Fabric.presets() if fc.Fabric.preset(name).bending]
METHODS = (fc.BackwardEuler, fc.LinearlyImplicitEuler, fc.BDF2, fc.ImplicitMidpoint)
STEPS = (0.02, 0.01, 0.005)  # s
MESHES_HEAD = """# The drape coefficient on four meshes

`python -m studies.drape --meshes`, each case in `meshes.csv`. Coefficients in %; folds and CPU
seconds are of the four meshes. Disturbed starts have random heights of 0.1 mm.

"""


def drape_fabric(fabric: str, h: float, folder: Path) -> Frame:
    """Run the drape test of a fabric in a folder; return its last frame."""
    scene = load_scene(SCENE, [f"fabric={fabric}", f"cloth.h={h}"])
    run_scene(scene, folder)
    return read_last_frame(folder)


def draw_fabrics(folders: dict[str, Path], words: dict[str, str], target: Path) -> None:
    """Draw the cloths side by side, each with its result below."""
    import imageio.v2 as imageio
    from matplotlib.figure import Figure

    from fecloth.view.render import render

    figure = Figure(figsize=(12, 2.95), dpi=100)
    axes = figure.subplots(1, len(folders))
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


def describe_drape(X, x, triangles) -> str:
    """Return the drape coefficient and the number of folds in words."""
    coefficient = 100 * drape_coefficient(X, x, triangles)
    return f"drape coefficient {coefficient:.0f} %, {count_folds(X, x)} folds"


def describe_frame(frame: Frame) -> str:
    return describe_drape(material_coordinates(frame), frame.points, frame.cells)


def read_last_frame(folder: Path) -> Frame:
    series = Series.open(folder)
    return series.read(len(series.times) - 1)


def compare_fabrics(h: float, picture: Path | None) -> None:
    """Drape `FABRICS`, print their results, and draw them if there is a file to draw to."""
    with tempfile.TemporaryDirectory() as folder:
        folders = {fabric: Path(folder) / fabric for fabric in FABRICS}
        words = {
            fabric: describe_frame(drape_fabric(fabric, h, run)) for fabric, run in folders.items()
        }
        for fabric in FABRICS:
            print(f"{fabric:22s} {words[fabric]}")
        if picture:
            draw_fabrics(folders, words, picture)
            print(f"wrote {picture}")


def tabulate_meshes(fabrics: list[str], disturbed: tuple[str, ...], h: float, out: Path) -> None:
    """Write the tables of fabrics and meshes into a folder; print each row when it is done."""
    rows: list[dict] = []
    for row in compare_meshes(fabrics, disturbed, h):
        rows.append(row)
        write_csv(rows, out / "meshes.csv")
        values = (row[name] for name in COLUMNS)
        print(*(v if isinstance(v, str) else f"{v:.4g}" for v in values), sep="  ")
    (out / "meshes.md").write_text(
        f"{MESHES_HEAD}{markdown_table(summarise(rows))}\n", encoding="utf-8"
    )
    print(f"wrote {out / 'meshes.md'}")


def compare_methods(h: float) -> None:
    """Print for each method and step the cost of the tablecloth's fall, and where it ends."""
    cloth, fabric = mesh_specimen("Gmsh", h), fc.Fabric.preset("polyester-tablecloth")
    terms = [fc.StVK(), fc.HingeBending(), fc.MassDamping(8.0), fc.Gravity((0, 0, -9.81))]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("support")])
    for method, dt in product(METHODS, STEPS):
        begin = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FeclothWarning)
            try:
                x = fc.run(system, method(), system.rest(), dt=dt, t_end=1.0).state.x
                end = describe_drape(cloth.X, x, cloth.triangles)
            except FeclothError:
                end = "failed"
        seconds = time.process_time() - begin
        if any("energy balance" in str(warning.message) for warning in caught):
            end += ", its energy balance off"
        print(f"{method.__name__:24s} {1000 * dt:3.0f} ms  {seconds:5.1f} CPU s  {end}")


def choose_picture(target: Path | None, is_quick: bool) -> Path | None:
    """Return the file of the figure, or None; a missing package is an error only with --picture."""
    try:
        study.require_packages("pyvista", "imageio")
    except InputError as missing:
        if target:
            raise
        print(f"no picture: {missing}")
        return None
    return target or (None if is_quick else Path("out/drape.png"))


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", type=Path, metavar="DIR", help="folder of a drape test")
    parser.add_argument("--meshes", action="store_true", help="all fabrics on four meshes instead")
    parser.add_argument("--fabric", choices=BENT, help="with --meshes only this fabric")
    parser.add_argument("--methods", action="store_true", help="compare methods and steps instead")
    parser.add_argument("--quick", action="store_true", help="coarse, without a picture")
    parser.add_argument("--h", type=float, default=0.006, help="edge length [m]")
    parser.add_argument("--picture", type=Path, help="file of the picture (out/drape.png)")
    parser.add_argument("--out", type=Path, default=Path("out/drape"), help="folder of the tables")
    options = parser.parse_args()
    for folder in options.runs:
        print(f"{folder!s:22s} {describe_frame(read_last_frame(folder))}")
    h = 0.02 if options.quick else options.h
    if options.meshes:
        one = options.fabric or (FABRICS[0] if options.quick else None)
        tabulate_meshes([one] if one else BENT, () if one else FABRICS, h, options.out)
    elif options.methods:
        compare_methods(h)
    elif not options.runs:
        compare_fabrics(h, choose_picture(options.picture, options.quick))
    return 0


if __name__ == "__main__":
    harness.run_main(main)
