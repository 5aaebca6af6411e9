"""What `info` and `mesh` print of scenes, cloths, fabrics and terms."""

import os
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import amount
from fecloth.fabric import presets, strips
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import CONSTANTS, Uncertainty, numbers_of
from fecloth.linalg import select
from fecloth.mesh.cloth import Cloth
from fecloth.runs.environment import versions
from fecloth.scene.plan import memory_of_each, plan
from fecloth.scene.scene import Scene
from fecloth.scene.tables import TERM_TABLES
from fecloth.scene.type_words import fields, meaning, phrase

ROWS = f"""The constants were taken at zero strain and zero curvature. The tables have the force
of a strip with free sides by all rows of the source, and by how much the force of the constants
differs from it; and the same of bending. Rows are at strains of 0 and {100 * strips.END:.1f} %;
beyond, they are held constant."""


def describe_installation() -> list[str]:
    """Return lines on the versions, the processors, the direct solver and the pages."""
    lines = [f"{name}: {number}" for name, number in versions().items()]
    lines += [f"processors: {os.cpu_count()}", f"direct solver: {select.direct().name}"]
    return [*lines, f"pages: {Path(validation.__file__).with_name('README.md')} leads to all"]


def describe_scene(scene: Scene, ranks: int | None) -> list[str]:
    """Return lines on the plan of a scene, its cloth, its fabrics and the doubts about it.

    With `ranks` also the memory on that number of processes.
    """
    problem, (_, why) = scene.build().choose()
    _, *mesh = describe_cloth(problem.cloth)  # the plan has the sizes
    lines = [*plan(problem, why), *mesh]
    if ranks is not None:
        validation.number("ranks", ranks, 0.0, "info")
        memory = memory_of_each(problem.system, ranks)
        lines.append(f"on {ranks} processes (mpiexec): about {memory:.0f} MB each")
    return lines + [doubt.line for doubt in problem.doubts()]


def describe_cloth(cloth: Cloth) -> list[str]:
    """Return lines on size, edges and quality of the triangles, the sets, and notes on the file.

    The first line has the numbers of nodes and triangles, and the area.
    """
    corners = cloth.X[cloth.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    x0, y0 = cloth.X.min(axis=0)
    x1, y1 = cloth.X.max(axis=0)
    noun = "quadratic triangles" if cloth.element == "P2" else "triangles"
    triangles = f"{len(cloth.triangles)} {noun}"
    return [
        f"{amount(len(cloth.X), 'node')}, {triangles}, area {cloth.area:.6g} m²",
        f"X {x0:g} to {x1:g} m, Y {y0:g} to {y1:g} m",
        f"edges {edges.min():.4g} to {edges.max():.4g} m, mean {edges.mean():.4g} m",
        f"quality {cloth.quality.min():.3f} to {cloth.quality.max():.3f}, "
        f"mean {cloth.quality.mean():.3f} (1 is equilateral)",
        *(f"set {n}: {amount(len(cloth.nodes(n)), 'node')}" for n in sorted(cloth.node_sets)),
        *(f"note: mesh: {note}" for note in cloth.notes),
    ]


def list_fabrics() -> list[str]:
    """Return lines with the constants of each fabric, its kind, and the numbered sources."""
    fabrics = {name: Fabric.preset(name) for name in Fabric.presets()}
    table = [_row(name, fabric) for name, fabric in fabrics.items()]
    number_of_source: dict[str, int] = {}  # fabrics of one paper share its number
    kinds = []
    for name, fabric in fabrics.items():
        kind, _, source = fabric.source.partition(". ")  # the first sentence says what it is
        number = number_of_source.setdefault(source, len(number_of_source) + 1)
        kinds.append(f"{name}: {kind} [{number}]")
    sources = [_wrap(f"[{number}] {source}") for source, number in number_of_source.items()]
    head = f"{'preset':<21}{'g/m²':>5}{'Y [N/m]':>15}{'G [N/m]':>9}{'ν':>6}{'B [µN m]':>12}"
    table.insert(0, f"{head}  (warp / weft; small strain)")
    return [*table, "", *_list_uncertainties(fabrics), "", *kinds, "", *sources]


def describe_fabric(name: str) -> list[str]:
    """Return lines with the constants of a published fabric; for Wang's fabrics with all rows.

    Raises `InputError` for an unknown name.
    """
    validation.known(f"--fabrics {name}", name, Fabric.presets())
    fabric = Fabric.preset(name)
    assert isinstance(fabric.uncertainty, Uncertainty)
    kind, _, source = fabric.source.partition(". ")  # the first sentence says what it is
    lines = [f"{name}: {kind}", "", "constants, ± standard uncertainty (0: warp, 1: weft)"]
    deviations = dict(fabric.uncertainty.deviations)
    for key, value in numbers_of(presets.constants(name)).items():
        dimension = CONSTANTS[key.partition(".")[0]]
        unit = dimension.si if dimension else ""
        deviation = f"± {deviations[key]}" if key in deviations else ""
        lines.append(f"{key:<20}{value:>10.4g} {unit:<7}{deviation}")
    words = f"uncertainty: {fabric.uncertainty.source}", f"source: {source}"
    return [*lines, "", *map(_wrap, words), *_describe_rows(**presets.rows(name))]


def _describe_rows(stretching: strips.Rows = (), bending: strips.Rows = ()) -> list[str]:
    """Return tables of force over strain and rigidity over curvature, beside the constants.

    `stretching` and `bending` are the rows of the source; without rows there are no tables.
    Beside each value stands by how much the value of the constants differs from it.
    """
    if not stretching:
        return []
    head = "".join(f"{along:>11}{'constants':>11}" for along in strips.ALONG)
    lines = ["", ROWS, "", f"force [N/m] at  {head}"]
    for strain in (0.01, 0.02, 0.05, 0.1, 0.15, 0.2):
        pairs = [strips.compare(stretching, strain, along) for along in strips.ALONG]
        lines.append(f"{100 * strain:.0f} %".ljust(16) + _in_columns(pairs))
    lines += ["", f"B [µN m] at     {head}"]
    warp, bias, weft = bending
    # A row has 4 times the rigidity, see `presets`; its first value is the constant.
    for i, curvature in enumerate(strips.CURVATURES):
        pairs = [(row[i] / 4, row[0] / row[i] - 1) for row in (warp, weft, bias)]
        lines.append(f"{curvature:.0f} 1/m".ljust(16) + _in_columns(pairs))
    return lines


def _in_columns(pairs: Iterable[tuple[float, float]]) -> str:
    return "".join(f"{value:>11.4g}{f'{100 * off:+.0f} %':>11}" for value, off in pairs)


def _list_uncertainties(fabrics: Mapping[str, Fabric]) -> list[str]:
    """Return lines with the standard uncertainties of the constants, and their sources.

    Each fabric has a row with a letter, which stands before its source below.
    """
    rows = []
    letters = dict[str, str]()
    for name, fabric in fabrics.items():
        assert isinstance(fabric.uncertainty, Uncertainty)
        letter = letters.setdefault(fabric.uncertainty.source, chr(ord("a") + len(letters)))
        deviations = dict(fabric.uncertainty.deviations)
        nu = f"{deviations.pop('poisson_ratio'):.2f}"  # a number; the others are in per cent
        percentages = [str(deviation).removesuffix(" %") for deviation in deviations.values()]
        # In the order of the constants; a fabric of unknown rigidity has none for bending.
        warp, weft, shear, *bending = percentages
        tensile = f"{warp} / {weft}"
        rigidity = " / ".join(bending[:2])
        rows.append(f"{name:<26}{tensile:>15}{shear:>9}{nu:>6}{rigidity:>12}  ({letter})")
    head = f"{'standard uncertainty':<26}{'Y [%]':>15}{'G [%]':>9}{'ν':>6}{'B [%]':>12}"
    sources = [_wrap(f"({letter}) {words}") for words, letter in letters.items()]
    return [head, *rows, "", *sources]


def _row(name: str, fabric: Fabric) -> str:
    tensile = " / ".join(f"{value:.0f}" for value in fabric.tensile)
    bending = " / ".join(f"{1e6 * value:.1f}" for value in fabric.bending or ()) or "unknown"
    return (
        f"{name:<21}{1000 * fabric.areal_density:>5.0f}{tensile:>15}{fabric.shear:>9.0f}"
        f"{fabric.poisson_ratio:>6.2f}{bending:>12}"
    )


def _wrap(text: str) -> str:
    return textwrap.fill(
        text, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def list_terms() -> list[str]:
    """Return a line for each term, with its keys."""
    width = max(map(len, TERM_TABLES))
    return [
        f"{term:<{width}}  {', '.join(fields(table))}".rstrip()
        for term, table in TERM_TABLES.items()
    ]


def describe_term(name: str) -> list[str]:
    """Return lines about the term of this name; raise `InputError` for an unknown name."""
    validation.known(f"--terms {name}", name, TERM_TABLES)
    table = TERM_TABLES[name]
    lines = ["[[terms]]", f'type = "{name}"', "", *(table.__doc__ or "").split("\n")]
    indent: dict[str, Any] = {"initial_indent": "    ", "subsequent_indent": "    "}
    for key, field in fields(table).items():
        if field.is_required():
            default = "required"
        else:
            default = f"default {field.default!r}"
        words = textwrap.wrap(meaning(field), **indent)
        lines += ["", f"{key}: {phrase(field)}; {default}", *words]
    return lines
