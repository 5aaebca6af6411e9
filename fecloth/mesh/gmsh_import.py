"""Gmsh in: geometry and mesh files as plain arrays."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.mesh.gmsh_session import gmsh_model, set_options

_LARGEST = 20_000_000  # triangles; beyond it h is taken for a slip
_DIMENSIONS = ("point", "curve", "surface")


@dataclass(frozen=True)
class RawMesh:
    """A file's arrays before any check; sets are lists of indices and of pairs, by name."""

    xyz: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, list[np.ndarray]]
    edge_sets: dict[str, list[np.ndarray]]
    node_ids: np.ndarray
    triangle_ids: np.ndarray
    geometric: np.ndarray  # (n,) bool: nodes that may be dropped when no triangle uses them
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)


def check_size(h, extent: float, area: float, where: str) -> None:
    """Refuse an edge length h [m] that a sheet of that extent [m] and area [m²] cannot have."""
    check_positive("h", h, where)
    if h > extent:
        meant = f"; if it was meant in mm, write {h / 1000:g}" if h / 1000 < extent / 2 else ""
        allowed, remedy = f"must be at most {extent:g} m", f"Refine it{meant}."
        raise InputError(f"h = {h:g} m", allowed, where, remedy)
    with np.errstate(divide="ignore"):
        count = np.float64(area) / (np.sqrt(3.0) / 4 * h * h)
    if count > _LARGEST:
        least = np.sqrt(4 / np.sqrt(3.0) * area / _LARGEST)
        what = f"h = {h:g} m would make about {count:.1e} triangles"
        raise InputError(
            what, f"h must be at least {least:.2g} m", where, "A bare number is in metres."
        )


def check_positive(name: str, value, where: str) -> None:
    """Refuse a length that is not a positive, finite number."""
    try:
        good = not isinstance(value, (str, bytes, bool)) and 0 < float(value) < np.inf
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(f"{name} = {value!r}", "must be a finite length > 0, in m", where)


def gmsh_plane(draw: Callable, where: str) -> tuple[np.ndarray, np.ndarray]:
    """X (n, 2) and triangles (m, 3) of the surface that ``draw(gmsh.model.geo)`` builds."""
    with gmsh_model() as gmsh:
        draw(gmsh.model.geo)
        gmsh.model.geo.synchronize()
        with _refusals("Gmsh cannot mesh it", where):
            gmsh.model.mesh.generate(2)
        _, xyz, triangles, _ = _gmsh_arrays(gmsh, where)
    used, triangles = np.unique(triangles, return_inverse=True)  # circles bring their centre
    return xyz[used, :2], triangles.reshape(-1, 3)


def from_geo(path: Path, h: float | None) -> RawMesh:
    """Mesh a geometry file, with edge length h [m] if given."""
    where = str(path)
    text = path.read_text(encoding="utf-8", errors="replace")
    if text.splitlines()[-1:] and not text.endswith("\n") and text.splitlines()[-1].count(";") > 1:
        what = "the last line holds several statements and does not end"
        raise MeshError(what, "Gmsh reads only the first", where, "End the file with a new line.")
    constant = re.search(r"DefineConstant\s*\[[^\]]*\bh\s*=", text)
    with gmsh_model() as gmsh:
        if h is not None:
            check_positive("h", h, where)
            if constant:
                gmsh.parser.setNumber("h", [float(h)])
        with _refusals("Gmsh cannot read it", where):
            gmsh.merge(where)
        if h is not None:
            _limit_size(gmsh, h, where, uniform=not constant)
        with _refusals("Gmsh cannot mesh it", where):
            gmsh.model.mesh.generate(2)
        return _from_gmsh(gmsh, where)


def _limit_size(gmsh, h: float, where: str, uniform: bool) -> None:
    box = gmsh.model.getBoundingBox(-1, -1)
    lengths = np.sort(np.subtract(box[3:], box[:3]))
    if np.isfinite(lengths).all() and lengths[2] > 0:
        check_size(h, lengths[2], lengths[1] * lengths[2], where)
    if uniform:
        set_options(gmsh, {"Mesh.MeshSizeMin": h, "Mesh.MeshSizeMax": h})


def from_msh(path: Path) -> RawMesh:
    """Read a Gmsh mesh file."""
    with path.open("rb") as file:
        start = file.read(64).lstrip()
    if not start.startswith((b"$MeshFormat", b"$Comments", b"$NOD")):
        # Gmsh would take it for a .geo file, and stumble over the next one that is
        raise MeshError(f"begins with {start[:20]!r}", "must begin with $MeshFormat", str(path))
    with gmsh_model() as gmsh:
        remedy = "Look for nan, inf or a number that is missing, or write it anew."
        with _refusals("Gmsh cannot read it", str(path), remedy):
            gmsh.merge(str(path))
        try:
            return _from_gmsh(gmsh, str(path))
        except UnicodeDecodeError as error:
            byte = f"the byte 0x{error.object[error.start]:02x} in a name"
            raise MeshError(byte, "must be UTF-8 text", str(path)) from None


def _gmsh_arrays(gmsh, where: str):
    """Node tags (sorted), coordinates, triangles by index, triangle tags."""
    mesh = gmsh.model.mesh
    refuse_cells(
        {
            mesh.getElementProperties(kind)[0]: len(mesh.getElementsByType(kind)[0])
            for kind in mesh.getElementTypes()
            if kind not in (1, 2, 15)
        },
        where,
    )
    tags, xyz, _ = mesh.getNodes(returnParametricCoord=False)
    order = np.argsort(tags)
    ids, xyz = tags[order].astype(np.int64), xyz.reshape(-1, 3)[order]
    triangle_ids, vertices = mesh.getElementsByType(2)
    triangles = np.searchsorted(ids, vertices.astype(np.int64)).reshape(-1, 3)
    return ids, xyz, triangles, triangle_ids.astype(np.int64)


def _from_gmsh(gmsh, where: str) -> RawMesh:
    ids, xyz, triangles, triangle_ids = _gmsh_arrays(gmsh, where)
    surfaces = gmsh.model.getEntities(2)
    if any(len(gmsh.model.getPhysicalGroupsForEntity(*s)) > 1 for s in surfaces):
        first = np.sort(np.unique(triangles, axis=0, return_index=True)[1])
        triangles, triangle_ids = triangles[first], triangle_ids[first]
    nodes, edges = _gmsh_sets(gmsh, ids, where)
    regions = _gmsh_regions(gmsh, triangles, ids)
    every = np.ones(len(ids), dtype=bool)
    return RawMesh(xyz, triangles, nodes, edges, ids, triangle_ids, every, regions)


def _gmsh_regions(gmsh, triangles, ids) -> dict[str, np.ndarray]:
    """Triangle indices by the name of their physical surface; by their nodes, as a file of format
    2.2 numbers a triangle anew for each group that it is in."""
    order = np.lexsort(triangles.T[::-1])
    known = np.ascontiguousarray(triangles[order].astype(np.int64)) @ [len(ids) ** 2, len(ids), 1]
    regions: dict[str, list[np.ndarray]] = {}
    for dim, tag in gmsh.model.getPhysicalGroups(2):
        name = gmsh.model.getPhysicalName(dim, tag) or f"surface_{tag}"
        for surface in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
            vertices = gmsh.model.mesh.getElementsByType(2, surface)[1].astype(np.int64)
            own = np.searchsorted(ids, vertices).reshape(-1, 3) @ [len(ids) ** 2, len(ids), 1]
            place = np.minimum(np.searchsorted(known, own), len(known) - 1)
            regions.setdefault(name, []).append(order[place[known[place] == own]])
    return {name: np.unique(np.concatenate(found)) for name, found in regions.items()}


def _gmsh_sets(gmsh, ids, where):
    """Lists of node indices, and of node pairs, by the name of their physical groups."""
    nodes, edges = {}, {}
    groups = [group for group in gmsh.model.getPhysicalGroups() if group[0] < 3]
    _refuse_empty_groups(gmsh, groups, where)
    for dim, tag in groups:
        name = gmsh.model.getPhysicalName(dim, tag) or f"{_DIMENSIONS[dim]}_{tag}"
        tags = gmsh.model.mesh.getNodesForPhysicalGroup(dim, tag)[0]
        nodes.setdefault(name, []).append(np.searchsorted(ids, tags.astype(np.int64)))
        if dim == 1:
            for curve in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
                ends = gmsh.model.mesh.getElementsByType(1, curve)[1].astype(np.int64)
                edges.setdefault(name, []).append(np.searchsorted(ids, ends).reshape(-1, 2))
    return nodes, edges


def _refuse_empty_groups(gmsh, groups, where):
    # Gmsh does not list a group without entities, but still knows its name: look for names.
    last = min(10_000, max([1000, *(tag + 100 for _, tag in groups)]))  # a call a tag: 1 µs each
    for dim, kind in enumerate(_DIMENSIONS):
        for tag in range(1, last):
            name = gmsh.model.getPhysicalName(dim, tag)
            if name and (dim, tag) not in groups:
                what = f"physical {kind} group {name!r} is empty"
                raise MeshError(what, "must hold an entity", where, "Remove or fill it.")


def refuse_cells(counts: dict[str, int], where: str) -> None:
    """Refuse cells, counted by type, that are not 3-node triangles, lines or points."""
    if counts:
        found = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        remedy = "Split quadrilaterals, and mesh with order 1."
        raise MeshError(f"cells of type {found}", "must be 3-node triangles", where, remedy)


@contextlib.contextmanager
def _refusals(what: str, where: str, remedy: str = "") -> Iterator[None]:
    try:
        yield
    except Exception as error:  # Gmsh raises nothing more specific
        raise MeshError(f"{what} ({error})", where=where, remedy=remedy) from error
