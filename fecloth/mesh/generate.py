"""Flat triangle meshes of simple shapes: rectangles and disks."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.mesh import gmsh_session
from fecloth.mesh.child_process import in_child
from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.mesh.gmsh_import import DRAWINGS, gmsh_plane, refuse_coarse
from fecloth.mesh.grading import Grading, check_gradings

# Area over h² below which Gmsh takes less time than the start of a process, about 0.4 s.
SMALL_AREA_OVER_H2 = 10_000
# An h above this many times the edges of one "equilateral" row is refused as a mistake.
MOST_H_OVER_EDGE = 1.5


def rectangle(
    width: float,
    height: float,
    h: float,
    pattern: str = "unstructured",
    grading: Sequence[Grading] = (),
) -> FlatMesh:
    """Mesh the rectangle [0, width] × [0, height].

    The patterns "right" and "cross" have ``max(1, round(width / h))`` by ``max(1, round(height /
    h))`` cells. In the pattern "equilateral" the rows have a height near h √3/2, and the edges
    along x have nearly the length of equilateral triangles, so that both divide the sides. The
    angles are 60° only if the sides fit. Every second row is shifted by half an edge, and has
    half an edge at both ends.

    `Cloth.rectangle` says what the arguments are, and for what `InputError` is raised. The edge
    sets are ``left``, ``right``, ``bottom``, ``top`` and ``boundary``; the node sets are
    these and ``corners``.
    """
    validation.length("width", width, "rectangle")
    validation.length("height", height, "rectangle")
    validation.mesh_size(h, max(width, height), width * height, "rectangle")
    validation.known(f"pattern = {pattern!r}", pattern, _PATTERNS, "rectangle", always=True)
    check_gradings(grading, "rectangle")
    if grading and pattern != "unstructured":
        remedy = 'Take the pattern "unstructured", or leave the grading out.'
        raise InputError(f"pattern = {pattern!r}", "has one edge length", "rectangle", remedy)
    if pattern == "equilateral":
        _refuse_another_size(float(height), float(h))
    if not grading:
        make_mesh = _PATTERNS[pattern]
    else:
        make_mesh = partial(_mesh_unstructured, grading=grading)
    X, triangles = make_mesh(float(width), float(height), float(h))
    return _with_side_sets(FlatMesh.from_arrays(X, triangles, where="rectangle"), width, height)


def disk(radius: float, h: float, grading: Sequence[Grading] = ()) -> FlatMesh:
    """Mesh a disk around the origin by Gmsh; nodes of the set ``boundary`` lie on the circle."""
    validation.length("radius", radius, "disk")
    validation.mesh_size(h, radius, np.pi * radius**2, "disk")
    check_gradings(grading, "disk")
    X, triangles = _mesh_drawing("disk", [radius], np.pi * radius**2, h, grading)
    return FlatMesh.from_arrays(X, triangles, where="disk")


def _mesh_drawing(
    name: str, sizes: Sequence[float], area: float, h: float, grading: Sequence[Grading]
) -> tuple[np.ndarray, np.ndarray]:
    """Mesh a drawing of these sizes by Gmsh: return X (n, 2) [m] and triangles (m, 3).

    `name` is a name of `DRAWINGS`, `sizes` are the lengths [m] that it takes before h, and
    `area` [m²] is its area, for the number of triangles. Raises `MeshError` if Gmsh fails or
    makes edges far longer than h.

    A mesh of many triangles is made in a process of its own, which can be stopped. So is any
    mesh while the user has a session of Gmsh, which must not be changed.
    """
    arguments = [*map(float, sizes), float(h)]
    if area / h**2 < SMALL_AREA_OVER_H2 and not gmsh_session.is_open():
        draw = DRAWINGS[name]
        raw = gmsh_plane(lambda geo: draw(geo, *arguments), float(h), name, grading)
    else:
        places = [asdict(place) for place in grading]
        raw = in_child({"draw": name, "sizes": arguments, "grading": places}, name)
    refuse_coarse(raw, h, name)
    return raw.xyz[:, :2], raw.triangles


def _mesh_unstructured(width, height, h, grading=()):
    X, triangles = _mesh_drawing("rectangle", [width, height], width * height, h, grading)
    for x, side in zip(X.T, (width, height), strict=True):  # put side nodes exactly on the sides
        x[np.abs(x) < 1e-9 * side] = 0.0
        x[np.abs(x - side) < 1e-9 * side] = side
    return X, triangles


def _grid(width, height, h):
    """Nodes row by row, and the four corners of each cell counter-clockwise from lower left."""
    nx, ny = (max(1, round(side / h)) for side in (width, height))
    x, y = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1))
    i = np.arange((nx + 1) * ny).reshape(ny, nx + 1)[:, :-1].ravel()
    return np.column_stack((x.ravel(), y.ravel())), (i, i + 1, i + nx + 2, i + nx + 1)


def _right(width, height, h):
    X, (a, b, c, d) = _grid(width, height, h)
    return X, np.stack((a, b, c, a, c, d), axis=1).reshape(-1, 3)


def _cross(width, height, h):
    X, (a, b, c, d) = _grid(width, height, h)
    o = len(X) + np.arange(len(a))
    triangles = np.stack((a, b, o, b, c, o, c, d, o, d, a, o), axis=1).reshape(-1, 3)
    return np.concatenate((X, 0.5 * (X[a] + X[c]))), triangles


def _refuse_another_size(height: float, h: float) -> None:
    """Raise `InputError` if one row of equilateral triangles has much shorter edges than h."""
    edge = height / np.sqrt(0.75)
    if h > MOST_H_OVER_EDGE * edge:
        allowed = f"must be at most {edge:.4g} m, the edges of one row of height {height:g} m"
        remedy = 'Write that, or use the pattern "right", whose cells may be longer than high.'
        raise InputError(f"h = {h!r}", allowed, "rectangle", remedy)


def _equilateral(width, height, h):
    """Return X (n, 2) and triangles (m, 3) of the pattern "equilateral", see `rectangle`.

    The even rows of nodes have nx edges, and the odd rows nx + 1: half an edge at both ends.
    """
    # √0.75 is the height of an equilateral triangle with edges of length 1.
    ny = max(1, round(height / (h * np.sqrt(0.75))))
    nx = max(1, round(width / (height / ny / np.sqrt(0.75))))
    even = np.linspace(0, width, nx + 1)
    odd = np.concatenate(([0.0], 0.5 * (even[1:] + even[:-1]), [width]))
    rows = [(even, odd)[j % 2] for j in range(ny + 1)]
    lengths = [len(row) for row in rows]
    y = np.repeat(np.linspace(0, height, ny + 1), lengths)
    X = np.column_stack((np.concatenate(rows), y))
    start = np.cumsum([0, *lengths])  # number of the first node of each row
    p = np.arange(nx + 1)  # node numbers within an even row
    q = np.arange(nx + 2)  # and within an odd row
    with_even_base = np.stack((p[:-1], p[1:], q[1:-1]), axis=1)
    with_odd_base = np.stack((p, q[1:], q[:-1]), axis=1)  # half triangles at both ends
    number_in_row = np.concatenate((with_even_base, with_odd_base))
    # Which corners lie in the odd row: the apex of an even base, and the base of an odd one.
    is_odd = np.repeat([[False, False, True], [False, True, True]], [nx, nx + 1], axis=0)
    j = np.arange(ny)  # the row of triangles between the rows of nodes j and j + 1
    even_start, odd_start = (start[j + k][:, None, None] for k in (j % 2, 1 - j % 2))
    triangles = number_in_row + np.where(is_odd, odd_start, even_start)
    # In every second row of triangles the odd row of nodes is the lower row: turn them over.
    triangles[1::2] = triangles[1::2][:, :, [0, 2, 1]]
    return X, triangles.reshape(-1, 3)


_PATTERNS = {
    "unstructured": _mesh_unstructured,
    "right": _right,
    "cross": _cross,
    "equilateral": _equilateral,
}


def _with_side_sets(mesh: FlatMesh, width: float, height: float) -> FlatMesh:
    """The mesh with node and edge sets of the four sides, and a node set of the corners."""
    x, y = mesh.X.T
    on = {"left": x == 0, "right": x == width, "bottom": y == 0, "top": y == height}
    border = mesh.edge_sets["boundary"]
    edges = {name: border[mask[border].all(axis=1)] for name, mask in on.items()}
    nodes = {name: np.flatnonzero(mask) for name, mask in on.items()}
    nodes["corners"] = np.flatnonzero((on["left"] | on["right"]) & (on["bottom"] | on["top"]))
    return replace(mesh, node_sets=nodes | mesh.node_sets, edge_sets=edges | mesh.edge_sets)
