"""Import of geometry and mesh files through Gmsh as plain arrays."""

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import MeshError
from fecloth.mesh.cells import Cells, Triangles, triangles_of
from fecloth.mesh.gmsh_session import gmsh_model, set_options
from fecloth.mesh.grading import Grading, set_sizes
from fecloth.mesh.raw_mesh import RawMesh

_DIMENSIONS = ("point", "curve", "surface")
_SAVED_GROUPS = (  # the remedy for a .msh without triangles
    "Where a file has physical groups, Gmsh saves their cells only: add a Physical Surface, or "
    "set Mesh.SaveAll = 1, and save again."
)


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
        _, xyz, cells, *_ = _gmsh_arrays(gmsh, where)
    # Removes the centres of circles.
    used, triangles = np.unique(cells.nodes, return_inverse=True)
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
        # The file may have set them; quadratic nodes are added on request, in `Cloth`.
        set_options(gmsh, {"Mesh.ElementOrder": 1, "Mesh.RecombineAll": 0})
        if h is not None:
            _limit_size(gmsh, h, where, uniform=not defines_h and not grading)
            if grading:
                set_sizes(gmsh, grading, h, where)
        with _as_mesh_error("Gmsh cannot mesh the file", where):
            gmsh.model.mesh.generate(2)
        mesh = _from_gmsh(gmsh, where, remedy="Add a Plane Surface.")
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
            return _from_gmsh(gmsh, where, _SAVED_GROUPS)
        except UnicodeDecodeError as error:
            byte = f"the byte 0x{error.object[error.start]:02x} in a name"
            raise MeshError(byte, "must be UTF-8 text", where) from None


def _gmsh_arrays(
    gmsh, where: str, remedy: str = ""
) -> tuple[np.ndarray, np.ndarray, Triangles, np.ndarray, np.ndarray]:
    """Return the mesh of the current model; refuse other cells by `MeshError`.

    These are the node tags (n,) in ascending order, the coordinates (n, 3) [m] in the same
    order, the triangles, and for each of them the tag of its cell (m,) and of its surface (m,).
    A tag is Gmsh's number of a node, cell or surface.
    """
    mesh = gmsh.model.mesh
    tags, xyz, _ = mesh.getNodes(returnParametricCoord=False)
    order = np.argsort(tags)
    ids = tags[order].astype(np.int64)
    xyz = xyz.reshape(-1, 3)[order]
    blocks = []
    cell_ids = [np.empty(0, np.int64)]
    surfaces = [np.empty(0, np.int64)]
    for dim, tag in gmsh.model.getEntities():
        for kind, cell_tags, nodes in zip(*mesh.getElements(dim, tag), strict=True):
            name, _, _, count, _, corners = mesh.getElementProperties(kind)
            indices = np.searchsorted(ids, nodes.astype(np.int64)).reshape(-1, count)
            blocks.append(Cells(name, corners if dim < 3 else 0, indices))
            if dim == 2:
                cell_ids.append(cell_tags.astype(np.int64))
                surfaces.append(np.full(len(cell_tags), tag))
    triangles = triangles_of(xyz, blocks, where, remedy)
    ids_of_triangles, surfaces_of_triangles = (
        np.concatenate(parts)[triangles.cell] for parts in (cell_ids, surfaces)
    )
    return ids, xyz, triangles, ids_of_triangles, surfaces_of_triangles


def _from_gmsh(gmsh, where: str, remedy: str) -> RawMesh:
    """Return the mesh of the current model with its physical groups as sets.

    Raises `MeshError` for cells that a cloth has not, with the `remedy` for a mesh without
    triangles, and for a physical group that is empty.
    """
    model = gmsh.model
    ids, xyz, triangles, triangle_ids, surfaces = _gmsh_arrays(gmsh, where, remedy)
    nodes = triangles.nodes
    if any(len(model.getPhysicalGroupsForEntity(2, tag)) > 1 for _, tag in model.getEntities(2)):
        # Format 2.2 has a triangle of several groups several times: the first one stays.
        first = np.sort(np.unique(nodes, axis=0, return_index=True)[1])
        nodes, triangle_ids, surfaces = nodes[first], triangle_ids[first], surfaces[first]
    node_sets, edge_sets = _gmsh_sets(gmsh, ids, where)
    return RawMesh(
        xyz=xyz,
        triangles=nodes,
        node_sets=node_sets,
        edge_sets=edge_sets,
        node_ids=ids,
        triangle_ids=triangle_ids,
        geometric=np.ones(len(ids), dtype=bool),
        triangle_sets=_gmsh_regions(model, surfaces),
        between=triangles.between,
        element=triangles.element,
        notes=triangles.notes,
    )


def _gmsh_regions(model, surfaces: np.ndarray) -> dict[str, np.ndarray]:
    """Return the triangle indices of each physical surface, by its name.

    `surfaces` (m,) are the tags of the surfaces of the triangles.
    """
    members: dict[str, list[int]] = {}
    for dim, tag in model.getPhysicalGroups(2):
        name = model.getPhysicalName(dim, tag) or f"surface_{tag}"
        members.setdefault(name, []).extend(model.getEntitiesForPhysicalGroup(dim, tag))
    return {name: np.flatnonzero(np.isin(surfaces, tags)) for name, tags in members.items()}


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
                for kind, _, ends in zip(*gmsh.model.mesh.getElements(dim, curve), strict=True):
                    count = gmsh.model.mesh.getElementProperties(kind)[3]
                    pairs = np.searchsorted(ids, ends.astype(np.int64)).reshape(-1, count)[:, :2]
                    edges.setdefault(name, []).append(pairs)
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


@contextlib.contextmanager
def _as_mesh_error(what: str, where: str, remedy: str = "") -> Iterator[None]:
    """Raise a `MeshError` with these words in place of any error of the block."""
    try:
        yield
    except Exception as error:  # Gmsh raises nothing more specific
        raise MeshError(f"{what} ({error})", where=where, remedy=remedy) from error
