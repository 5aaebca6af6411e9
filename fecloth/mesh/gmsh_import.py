"""Import of geometry and mesh files through Gmsh as plain arrays."""

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import MeshError
from fecloth.mesh.gmsh_session import gmsh_model, set_options
from fecloth.mesh.grading import Grading, set_sizes

_DIMENSIONS = ("point", "curve", "surface")


@dataclass(frozen=True)
class RawMesh:
    """Arrays of a file before validation.

    Attributes
    ----------
    xyz
        (n, 3) coordinates [m]; some files have two coordinates.
    triangles
        (m, 3) node indices.
    node_sets
        Name of each set to arrays of node indices, which together are the set.
    edge_sets
        Name of each set to arrays (k, 2) of node indices.
    node_ids, triangle_ids
        Numbers of the nodes (n,) and triangles (m,) in the file, for messages.
    geometric
        (n,) bool: nodes that are removed if no triangle uses them.
    triangle_sets
        Name of each region to its triangle indices.
    """

    xyz: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, list[np.ndarray]]
    edge_sets: dict[str, list[np.ndarray]]
    node_ids: np.ndarray
    triangle_ids: np.ndarray
    geometric: np.ndarray
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)


def gmsh_plane(draw: Callable, h: float, where: str, grading: Sequence[Grading] = ()) -> RawMesh:
    """Mesh the surface that ``draw(gmsh.model.geo)`` builds, and return the mesh.

    The function gives the edge lengths; with a `grading`, h [m] is the edge length away from
    its places. Physical groups of the drawing are only places for the `grading`: the mesh has
    no sets. Raises `MeshError`, with the name `where`, if Gmsh fails.
    """
    with gmsh_model() as gmsh:
        draw(gmsh.model.geo)
        gmsh.model.geo.synchronize()
        if grading:
            set_sizes(gmsh, grading, h, where)
        with _as_mesh_error("Gmsh cannot mesh the surface", where):
            gmsh.model.mesh.generate(2)
        _, xyz, triangles, _ = _gmsh_arrays(gmsh, where)
    used, triangles = np.unique(triangles, return_inverse=True)  # removes the centres of circles
    return RawMesh(
        xyz=xyz[used],
        triangles=triangles.reshape(-1, 3),
        node_sets={},
        edge_sets={},
        node_ids=np.arange(len(used)),
        triangle_ids=np.arange(len(triangles) // 3),
        geometric=np.zeros(len(used), dtype=bool),
    )


# Edges longer than this many h are a failure of Gmsh: its longest edges are about 1.6 h.
LONGEST_EDGE_OVER_H = 4.0


def _draw_disk(geo, radius: float, h: float) -> None:
    centre = geo.addPoint(0, 0, 0, h)
    rim = [(radius, 0), (0, radius), (-radius, 0), (0, -radius)]
    points = [geo.addPoint(x, y, 0, h) for x, y in rim]
    arcs = [geo.addCircleArc(points[i], centre, points[(i + 1) % 4]) for i in range(4)]
    geo.addPlaneSurface([geo.addCurveLoop(arcs)])


def _draw_rectangle(geo, width: float, height: float, h: float) -> None:
    corners = [(0, 0), (width, 0), (width, height), (0, height)]
    points = [geo.addPoint(x, y, 0, h) for x, y in corners]
    lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    geo.addPlaneSurface([geo.addCurveLoop(lines)])
    for name, line in zip(("bottom", "right", "top", "left"), lines, strict=True):
        geo.addPhysicalGroup(1, [line], name=name)
    geo.addPhysicalGroup(0, points, name="corners")


DRAWINGS: dict[str, Callable[..., None]] = {"disk": _draw_disk, "rectangle": _draw_rectangle}


def from_geo(path: Path, h: float | None, where: str, grading: Sequence[Grading] = ()) -> RawMesh:
    """Mesh a geometry file, with the edge length h [m] unless h is None.

    In a file with ``DefineConstant[ h = … ]`` the constant gets the value h, and the sizes that
    the file makes of it remain. In another file all edges get the length h, except for a
    `grading`.

    Raises `MeshError`, with the name `where`, if Gmsh cannot read or mesh the file, or makes
    edges far longer than h; and `InputError` for a wrong h.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    # Gmsh would ignore all but the first statement of a last line without a line end.
    last_line = text.rpartition("\n")[2]  # empty if the file ends with a line end
    if last_line.count(";") > 1:
        what = "the last line has several statements and no line end"
        allowed = "Gmsh reads only the first statement of such a line"
        raise MeshError(what, allowed, where, "End the file with a new line.")
    defines_h = re.search(r"DefineConstant\s*\[[^\]]*\bh\s*=", text)
    with gmsh_model() as gmsh:
        if h is not None:
            validation.length("h", h, where)
            if defines_h:
                gmsh.parser.setNumber("h", [float(h)])
        with _as_mesh_error("Gmsh cannot read the file", where):
            gmsh.merge(str(path))
        if h is not None:
            _limit_size(gmsh, h, where, uniform=not defines_h and not grading)
            if grading:
                set_sizes(gmsh, grading, h, where)
        with _as_mesh_error("Gmsh cannot mesh the file", where):
            gmsh.model.mesh.generate(2)
        mesh = _from_gmsh(gmsh, where)
    if h is not None and not defines_h:  # a file with its own h may use larger sizes, too
        refuse_coarse(mesh, h, where)
    return mesh


def refuse_coarse(mesh: RawMesh, h: float, where: str) -> None:
    """Refuse a mesh with edges far longer than h [m], where Gmsh gave up and did not say so."""
    corners = mesh.xyz[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    if longest > LONGEST_EDGE_OVER_H * h:
        what = f"Gmsh made edges of {longest:.3g} m where h = {h:.3g} m"
        remedy = "It fails so for millions of triangles: take a larger h."
        raise MeshError(what, "must be about h", where, remedy)


def _limit_size(gmsh, h: float, where: str, uniform: bool) -> None:
    """Refuse an h [m] that does not fit the geometry; with `uniform`, let all edges have it."""
    box = gmsh.model.getBoundingBox(-1, -1)
    lengths = np.sort(np.subtract(box[3:], box[:3]))
    if np.isfinite(lengths).all() and lengths[2] > 0:
        validation.mesh_size(h, lengths[2], lengths[1] * lengths[2], where)
    if uniform:
        set_options(gmsh, {"Mesh.MeshSizeMin": h, "Mesh.MeshSizeMax": h})


def from_msh(path: Path, where: str) -> RawMesh:
    """Read a Gmsh mesh file; `where` names it in errors.

    Raises `MeshError` for a file with another beginning, for one that Gmsh cannot read, and for
    names that are not UTF-8.
    """
    with path.open("rb") as file:
        start = file.read(64)
    if not start.startswith((b"$MeshFormat", b"$Comments", b"$NOD")):
        # Gmsh would read it as a .geo file, and run its commands.
        raise MeshError(f"begins with {start[:20]!r}", "must begin with $MeshFormat", where)
    with gmsh_model() as gmsh:
        remedy = "Look for nan, inf or a missing number, or write the file again."
        with _as_mesh_error("Gmsh cannot read the file", where, remedy):
            gmsh.merge(str(path))
        try:
            return _from_gmsh(gmsh, where)
        except UnicodeDecodeError as error:
            byte = f"the byte 0x{error.object[error.start]:02x} in a name"
            raise MeshError(byte, "must be UTF-8 text", where) from None


def _gmsh_arrays(gmsh, where: str):
    """Return the mesh of the current model as four arrays; refuse other cells by `MeshError`.

    The arrays are the node tags (n,) in ascending order, the coordinates (n, 3) [m] in the same
    order, the triangles (m, 3) as node indices, and the triangle tags (m,). A tag is Gmsh's
    number of a node or element.
    """
    mesh = gmsh.model.mesh
    other_cells = {}
    for cell_type in mesh.getElementTypes():
        if cell_type not in (1, 2, 15):  # Gmsh's numbers of lines, triangles and points
            type_name = mesh.getElementProperties(cell_type)[0]
            other_cells[type_name] = len(mesh.getElementsByType(cell_type)[0])
    check_cells(other_cells, where)
    tags, xyz, _ = mesh.getNodes(returnParametricCoord=False)
    order = np.argsort(tags)
    ids = tags[order].astype(np.int64)
    xyz = xyz.reshape(-1, 3)[order]
    triangle_ids, vertices = mesh.getElementsByType(2)
    triangles = np.searchsorted(ids, vertices.astype(np.int64)).reshape(-1, 3)
    return ids, xyz, triangles, triangle_ids.astype(np.int64)


def _from_gmsh(gmsh, where: str) -> RawMesh:
    """Return the mesh of the current model with its physical groups as sets.

    Raises `MeshError` for other cells than triangles, lines and points, and for a physical group
    that is empty.
    """
    model = gmsh.model
    ids, xyz, triangles, triangle_ids = _gmsh_arrays(gmsh, where)
    surfaces = model.getEntities(2)
    if any(len(model.getPhysicalGroupsForEntity(dim, tag)) > 1 for dim, tag in surfaces):
        # Format 2.2 has a triangle of several groups several times: the first one stays.
        first = np.sort(np.unique(triangles, axis=0, return_index=True)[1])
        triangles = triangles[first]
        triangle_ids = triangle_ids[first]
    node_sets, edge_sets = _gmsh_sets(gmsh, ids, where)
    return RawMesh(
        xyz=xyz,
        triangles=triangles,
        node_sets=node_sets,
        edge_sets=edge_sets,
        node_ids=ids,
        triangle_ids=triangle_ids,
        geometric=np.ones(len(ids), dtype=bool),
        triangle_sets=_gmsh_regions(gmsh, triangles, ids),
    )


def _gmsh_regions(gmsh, triangles, ids) -> dict[str, np.ndarray]:
    """Return the triangle indices of each physical surface, by its name.

    `triangles` (m, 3) are node indices, and `ids` (n,) the ascending tags of the nodes.
    Triangles are identified by their nodes, because format 2.2 gives a triangle a new number in
    each group.
    """
    # The key of a triangle is one integer for its three nodes; the keys ascend in this order.
    order = np.lexsort(triangles.T[::-1])
    weights = [len(ids) ** 2, len(ids), 1]
    keys = np.ascontiguousarray(triangles[order].astype(np.int64)) @ weights
    regions: dict[str, list[np.ndarray]] = {}
    for dim, tag in gmsh.model.getPhysicalGroups(2):
        name = gmsh.model.getPhysicalName(dim, tag) or f"surface_{tag}"
        for surface in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
            vertices = gmsh.model.mesh.getElementsByType(2, surface)[1].astype(np.int64)
            group_keys = np.searchsorted(ids, vertices).reshape(-1, 3) @ weights
            position = np.minimum(np.searchsorted(keys, group_keys), len(keys) - 1)
            is_found = keys[position] == group_keys
            regions.setdefault(name, []).append(order[position[is_found]])
    return {name: np.unique(np.concatenate(parts)) for name, parts in regions.items()}


def _gmsh_sets(gmsh, ids, where):
    """Return lists of node indices and lists of node pairs of each physical group, by its name.

    Only groups of curves have node pairs. `ids` (n,) are the ascending tags of the nodes. Groups
    with the same name are united. Raises `MeshError` for an empty group.
    """
    nodes = {}
    edges = {}
    # Groups of dimension 3 are volumes, which a cloth has not.
    groups = [group for group in gmsh.model.getPhysicalGroups() if group[0] < 3]
    _check_no_empty_groups(gmsh, groups, where)
    for dim, tag in groups:
        name = gmsh.model.getPhysicalName(dim, tag) or f"{_DIMENSIONS[dim]}_{tag}"
        tags = gmsh.model.mesh.getNodesForPhysicalGroup(dim, tag)[0]
        nodes.setdefault(name, []).append(np.searchsorted(ids, tags.astype(np.int64)))
        if dim == 1:
            for curve in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
                ends = gmsh.model.mesh.getElementsByType(1, curve)[1].astype(np.int64)
                edges.setdefault(name, []).append(np.searchsorted(ids, ends).reshape(-1, 2))
    return nodes, edges


def _check_no_empty_groups(gmsh, groups, where):
    """Raise `MeshError` for a physical group without entities.

    Gmsh does not list such a group, but returns the name for its tag. Therefore all tags up to
    a limit are tried; this takes 1 µs per tag.
    """
    tag_limit = min(10_000, max([1000, *(tag + 100 for _, tag in groups)]))
    for dim, kind in enumerate(_DIMENSIONS):
        for tag in range(1, tag_limit):
            name = gmsh.model.getPhysicalName(dim, tag)
            if name and (dim, tag) not in groups:
                what = f"physical {kind} group {name!r} is empty"
                raise MeshError(what, "must contain an entity", where, "Remove or fill it.")


def check_cells(counts: dict[str, int], where: str) -> None:
    """Raise `MeshError` if a file has other cells than 3-node triangles, lines and points.

    `counts` maps the type of those other cells to their number.
    """
    if counts:
        listed = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        remedy = "Split quadrilaterals, and mesh with order 1."
        raise MeshError(f"cells of type {listed}", "must be 3-node triangles", where, remedy)


@contextlib.contextmanager
def _as_mesh_error(what: str, where: str, remedy: str = "") -> Iterator[None]:
    """Raise a `MeshError` with these words in place of any error of the block."""
    try:
        yield
    except Exception as error:  # Gmsh raises nothing more specific
        raise MeshError(f"{what} ({error})", where=where, remedy=remedy) from error
