"""The commands `info` and `mesh`: what they print of scenes, cloths, fabrics and terms."""

import os
import textwrap
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.cli.options import reading
from fecloth.errors import InputError, amount, did_you_mean
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import Uncertainty
from fecloth.linalg import select
from fecloth.mesh.cloth import Cloth
from fecloth.output.frames import write_mesh
from fecloth.runs.environment import versions
from fecloth.runs.run_scene import resolve_scene
from fecloth.scene.json_schema import json_schema
from fecloth.scene.plan import memory_of_each, plan
from fecloth.scene.scene import load_scene
from fecloth.scene.tables import TERM_TABLES
from fecloth.scene.type_words import fields, meaning, phrase

WIDTH = 100


def print_info(options: Namespace) -> int:
    print("\n".join(_info_lines(options)))
    return 0


def _info_lines(options: Namespace) -> list[str]:
    if options.fabrics:
        return list_fabrics()
    if options.schema:
        return [json_schema()]
    if options.terms is not None:
        return describe_terms(options.terms)
    if options.scene:
        return _describe_scene(options)
    lines = [f"{name}: {number}" for name, number in versions().items()]
    return [*lines, f"processors: {os.cpu_count()}", f"direct solver: {select.direct().name}"]


def _describe_scene(options: Namespace) -> list[str]:
    scene = load_scene(options.scene, options.set, **reading(options))
    problem, _, why = resolve_scene(scene.build())
    _, *mesh = describe_cloth(problem.cloth)  # the plan begins with the sizes
    lines = [*plan(problem, why), *mesh, *sources(problem.system.fabric)]
    if options.ranks is not None:
        validation.number("ranks", options.ranks, 0.0, "info")
        each = memory_of_each(problem.system, options.ranks)
        lines.append(f"on {options.ranks} processes (mpiexec): about {each:.0f} MB each")
    return lines + [f"warning: {words}" for words in problem.warnings()]


def print_mesh(options: Namespace) -> int:
    """Mesh a file or a scene, print what the mesh is like, and write it where asked for."""
    is_scene = Path(options.path).suffix == ".toml"
    if is_scene and options.h:
        raise InputError("--h", "is for mesh files", options.path, "Change cloth.h in the scene.")
    if is_scene:
        cloth = load_scene(options.path, **reading(options)).mesh()
    else:
        cloth = Cloth.read(options.path, options.h, "P1", options.trust_geo, options.mesh_time)
    print("\n".join(describe_cloth(cloth)))
    if options.output:
        path = Path(options.output)
        write_mesh(path, cloth)
        print(f"wrote {path}")
    return 0


def describe_cloth(cloth: Cloth) -> list[str]:
    """Return lines on size, edges and quality of the triangles, and one line for each set."""
    corners = cloth.X[cloth.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    (x0, y0), (x1, y1) = cloth.X.min(axis=0), cloth.X.max(axis=0)
    triangles = f"{len(cloth.triangles)} {'quadratic ' * (cloth.element == 'P2')}triangles"
    return [
        f"{amount(len(cloth.X), 'node')}, {triangles}, area {cloth.area:.6g} m²",
        f"X {x0:g} to {x1:g} m, Y {y0:g} to {y1:g} m",
        f"edges {edges.min():.4g} to {edges.max():.4g} m, mean {edges.mean():.4g} m",
        f"quality {cloth.quality.min():.3f} to {cloth.quality.max():.3f}, "
        f"mean {cloth.quality.mean():.3f} (1 is equilateral)",
        *(f"set {n}: {amount(len(cloth.nodes(n)), 'node')}" for n in sorted(cloth.node_sets)),
    ]


def sources(fabric: Fabric | Mapping[str, Fabric]) -> list[str]:
    """Return a line with the source of each fabric that has one."""
    regions = fabric if isinstance(fabric, Mapping) else {"fabric": fabric}
    return [f"{name}: {one.source}" for name, one in regions.items() if one.source]


def list_fabrics() -> list[str]:
    """Return lines with the constants of each fabric, its kind, and the numbered sources."""
    fabrics = {name: Fabric.preset(name) for name in Fabric.presets()}
    table = [_row(name, fabric) for name, fabric in fabrics.items()]
    numbers: dict[str, int] = {}
    what = []
    for name, fabric in fabrics.items():
        kind, _, source = fabric.source.partition(". ")
        number = numbers.setdefault(source, len(numbers) + 1)
        what.append(f"{name}: {kind} [{number}]")
    sources = [_wrap(f"[{number}] {source}") for source, number in numbers.items()]
    head = f"{'preset':<21}{'g/m²':>5}{'Y [N/m]':>15}{'G [N/m]':>9}{'ν':>6}{'B [µN m]':>12}"
    table.insert(0, f"{head}  (warp / weft; small strain)")
    return [*table, "", *_list_uncertainties(fabrics), "", *what, "", *sources]


def _list_uncertainties(fabrics: Mapping[str, Fabric]) -> list[str]:
    """Return lines with the standard uncertainties of the constants, and where they come from."""
    rows, letters = [], dict[str, str]()
    for name, fabric in fabrics.items():
        assert isinstance(fabric.uncertainty, Uncertainty)
        letter = letters.setdefault(fabric.uncertainty.source, chr(ord("a") + len(letters)))
        found, value = dict(fabric.uncertainty.deviations), "{:.2f}".format
        nu = value(found.pop("poisson_ratio"))
        warp, weft, shear, *bending = (str(text).removesuffix(" %") for text in found.values())
        tensile, bent = f"{warp} / {weft}", " / ".join(bending[:2])
        rows.append(f"{name:<26}{tensile:>15}{shear:>9}{nu:>6}{bent:>12}  ({letter})")
    head = f"{'standard uncertainty':<26}{'Y [%]':>15}{'G [%]':>9}{'ν':>6}{'B [%]':>12}"
    return [head, *rows, "", *(_wrap(f"({letter}) {words}") for words, letter in letters.items())]


def _row(name: str, fabric: Fabric) -> str:
    tensile = " / ".join(f"{value:.0f}" for value in fabric.tensile)
    bending = " / ".join(f"{1e6 * value:.1f}" for value in fabric.bending or ()) or "unknown"
    return (
        f"{name:<21}{1000 * fabric.areal_density:>5.0f}{tensile:>15}{fabric.shear:>9.0f}"
        f"{fabric.poisson_ratio:>6.2f}{bending:>12}"
    )


def _wrap(text: str) -> str:
    return textwrap.fill(
        text, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def describe_terms(name: str) -> list[str]:
    """Return lines about the term of this name, or with "" one line for each term."""
    tables = TERM_TABLES
    if not name:
        wide = max(map(len, tables))
        return [f"{key:<{wide}}  {', '.join(fields(tables[key]))}".rstrip() for key in tables]
    if name not in tables:
        allowed = f"must be one of {', '.join(tables)}"
        raise InputError(f"--terms {name}", allowed, "", did_you_mean(name, list(tables)))
    lines = ["[[terms]]", f'type = "{name}"', "", *(tables[name].__doc__ or "").split("\n")]
    indent: dict[str, Any] = {"initial_indent": "    ", "subsequent_indent": "    "}
    for key, field in fields(tables[name]).items():
        usual = "required" if field.is_required() else f"default {field.default!r}"
        words = textwrap.wrap(meaning(field), WIDTH, **indent)
        lines += ["", f"{key}: {phrase(field)}; {usual}", *words]
    return lines
