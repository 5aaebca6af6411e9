"""Flat triangle meshes: simple shapes, files, and a numbering that is kind to caches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from fecloth.errors import InputError
from fecloth.mesh.flat_mesh import FlatMesh, checked, shapes, sorted_pairs
from fecloth.mesh.gmsh_import import check_positive, check_size, gmsh_plane
from fecloth.mesh.read import read
from fecloth.suggest import did_you_mean

__all__ = ["FlatMesh", "checked", "disk", "quality", "read", "rectangle", "renumbered"]


def rectangle(width: float, height: float, h: float, pattern: str = "unstructured") -> FlatMesh:
    """Mesh the rectangle [0, width] × [0, height].

    Parameters
    ----------
    width, height : float
        Sides [m].
    h : float
        Edge length [m], at most the longer side. The structured patterns have
        ``max(1, round(width / h))`` by ``max(1, round(height / h))`` cells.
    pattern : str
        ``"unstructured"``: Gmsh. ``"right"``: each cell cut by the same diagonal, from lower left
        to upper right. ``"cross"``: each cell cut into four by its centre. ``"equilateral"``:
        rows of height near h √3/2 that fill the height, every other one shifted by half an edge,
        with half triangles at straight left and right borders; the edge along x is the one nearest
        to the rows' own that divides the width, so only fitting sides give exact 60° angles.

    Returns
    -------
    FlatMesh
        Node sets ``left right bottom top corners boundary``, edge sets
        ``left right bottom top boundary``.

    Raises
    ------
    InputError
        Sides or h that are not positive and finite, h out of range, an unknown pattern.

    Examples
    --------
    >>> mesh = rectangle(2.0, 1.0, 0.5, "right")
    >>> mesh.X.shape, mesh.triangles.shape, mesh.node_sets["left"].tolist()
    ((15, 2), (16, 3), [0, 5, 10])
    """
    check_positive("width", width, "rectangle")
    check_positive("height", height, "rectangle")
    check_size(h, max(width, height), width * height, "rectangle")
    if pattern not in _PATTERNS:
        allowed = f"must be one of {', '.join(_PATTERNS)}"
        remedy = did_you_mean(pattern, _PATTERNS, cutoff=0.0)
        raise InputError(f"pattern = {pattern!r}", allowed, "rectangle", remedy)
    X, triangles = _PATTERNS[pattern](float(width), float(height), float(h))
    return _with_sides(checked(X, triangles, where="rectangle"), width, height)


def disk(radius: float, h: float) -> FlatMesh:
    """Mesh a disk about the origin by Gmsh, its rim nodes on the circle.

    Parameters
    ----------
    radius : float
        Radius [m].
    h : float
        Edge length [m], at most the radius.

    Returns
    -------
    FlatMesh
        With the node and edge set ``boundary``.

    Raises
    ------
    InputError
        A radius or h that is not positive and finite, or h out of range.

    Examples
    --------
    >>> mesh = disk(0.5, 0.25)
    >>> bool(np.allclose(np.hypot(*mesh.X[mesh.node_sets["boundary"]].T), 0.5))
    True
    """
    check_positive("radius", radius, "disk")
    check_size(h, radius, np.pi * radius**2, "disk")

    def draw(geo):
        centre = geo.addPoint(0, 0, 0, h)
        rim = [(radius, 0), (0, radius), (-radius, 0), (0, -radius)]
        points = [geo.addPoint(x, y, 0, h) for x, y in rim]
        arcs = [geo.addCircleArc(points[i], centre, points[(i + 1) % 4]) for i in range(4)]
        geo.addPlaneSurface([geo.addCurveLoop(arcs)])

    return checked(*gmsh_plane(draw, "disk"), where="disk")


def quality(X: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Shape of each triangle, 4 √3 A / (l₁² + l₂² + l₃²).

    Parameters
    ----------
    X : (n, 2) array
        Node coordinates [m].
    triangles : (m, 3) integer array

    Returns
    -------
    (m,) array
        1 for an equilateral triangle, 0 for a degenerate one, negative for a clockwise one.

    Examples
    --------
    >>> X = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.75**0.5]])
    >>> quality(X, np.array([[0, 1, 2]])).round(12).tolist()
    [1.0]
    """
    area, lengths2 = shapes(X, triangles)
    return 4 * np.sqrt(3.0) * area / lengths2.sum(axis=0)


def renumbered(mesh: FlatMesh) -> tuple[FlatMesh, np.ndarray, np.ndarray]:
    """Number nodes and triangles so that neighbours lie close together in memory.

    Parameters
    ----------
    mesh : FlatMesh

    Returns
    -------
    mesh : FlatMesh
        The same mesh, each triangle with its vertices in the same order.
    old_nodes : (n,) integer array
        For each new node its old index: ``new.X == mesh.X[old_nodes]``.
    old_triangles : (m,) integer array
        For each new triangle its old index.

    Examples
    --------
    >>> mesh = checked([[0, 0], [1, 0], [0, 1], [1, 1]], [[0, 1, 2], [1, 3, 2]])
    >>> new, nodes, triangles = renumbered(mesh)
    >>> bool((nodes[new.triangles] == mesh.triangles[triangles]).all())
    True
    """
    # Reverse Cuthill–McKee, not a Hilbert curve: gathers 5-10 % faster, the band 90-180 times less.
    n = len(mesh.X)
    old_nodes = reverse_cuthill_mckee(_node_graph(mesh.triangles, n), symmetric_mode=True)
    new = np.empty(n, dtype=np.int32)
    new[old_nodes] = np.arange(n, dtype=np.int32)
    triangles = new[mesh.triangles]
    low = np.sort(triangles, axis=1)
    old_triangles = np.lexsort((low[:, 2], low[:, 1], low[:, 0]))
    node_sets = {
        name: np.sort(new[nodes]).astype(np.intp) for name, nodes in mesh.node_sets.items()
    }
    edge_sets = {name: sorted_pairs(new[pairs]) for name, pairs in mesh.edge_sets.items()}
    place = np.empty(len(triangles), dtype=np.intp)
    place[old_triangles] = np.arange(len(triangles))
    regions = {name: np.sort(place[chosen]) for name, chosen in mesh.triangle_sets.items()}
    moved = FlatMesh(mesh.X[old_nodes], triangles[old_triangles], node_sets, edge_sets, regions)
    return moved, old_nodes.astype(np.intp), old_triangles


def _node_graph(triangles, n):
    a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    ones = np.ones(2 * len(a), dtype=np.int8)
    return coo_array((ones, (np.append(a, b), np.append(b, a))), shape=(n, n)).tocsr()


def _unstructured(width, height, h):
    def draw(geo):
        corners = [(0, 0), (width, 0), (width, height), (0, height)]
        points = [geo.addPoint(x, y, 0, h) for x, y in corners]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        geo.addPlaneSurface([geo.addCurveLoop(lines)])

    X, triangles = gmsh_plane(draw, "rectangle")
    for x, side in zip(X.T, (width, height), strict=True):  # sides exact to the last bit
        x[np.abs(x) < 1e-9 * side] = 0.0
        x[np.abs(x - side) < 1e-9 * side] = side
    return X, triangles


def _grid(width, height, h):
    """Nodes row by row, and the four corners of each cell, counter-clockwise from lower left."""
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


def _equilateral(width, height, h):
    ny = max(1, round(height / (h * np.sqrt(0.75))))
    nx = max(1, round(width / (height / ny / np.sqrt(0.75))))
    whole = np.linspace(0, width, nx + 1)
    shifted = np.concatenate(([0.0], 0.5 * (whole[1:] + whole[:-1]), [width]))
    x = [shifted if j % 2 else whole for j in range(ny + 1)]
    lengths = [len(row) for row in x]
    X = np.column_stack((np.concatenate(x), np.repeat(np.linspace(0, height, ny + 1), lengths)))
    j, start = np.arange(ny), np.cumsum([0, *lengths])
    p, q = np.arange(nx + 1), np.arange(nx + 2)  # places in a whole row and in a shifted one
    based_on_whole = np.stack((p[:-1], p[1:], q[1:-1]), axis=1)
    based_on_shifted = np.stack((p, q[1:], q[:-1]), axis=1)  # half triangles at both ends
    place = np.concatenate((based_on_whole, based_on_shifted))
    in_shifted = np.repeat([[False, False, True], [False, True, True]], [nx, nx + 1], axis=0)
    w, s = (start[j + k][:, None, None] for k in (j % 2, 1 - j % 2))
    triangles = place + np.where(in_shifted, s, w)
    triangles[1::2] = triangles[1::2][:, :, [0, 2, 1]]  # there the shifted row is the lower one
    return X, triangles.reshape(-1, 3)


_PATTERNS = {
    "unstructured": _unstructured,
    "right": _right,
    "cross": _cross,
    "equilateral": _equilateral,
}


def _with_sides(mesh: FlatMesh, width: float, height: float) -> FlatMesh:
    x, y = mesh.X.T
    on = {"left": x == 0, "right": x == width, "bottom": y == 0, "top": y == height}
    border = mesh.edge_sets["boundary"]
    edges = {name: border[mask[border].all(axis=1)] for name, mask in on.items()}
    nodes = {name: np.flatnonzero(mask) for name, mask in on.items()}
    nodes["corners"] = np.flatnonzero((on["left"] | on["right"]) & (on["bottom"] | on["top"]))
    return replace(mesh, node_sets=nodes | mesh.node_sets, edge_sets=edges | mesh.edge_sets)
