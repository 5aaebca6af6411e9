"""Pairs of the IPC Toolkit: their nodes, and how long they stay all that can touch."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from fecloth.compiled.jit import Array, kernel


def nodes_of(contacts: Any, mesh: Any) -> np.ndarray:
    """Return the nodes (m, 4) of the toolkit's contacts; −1 where one has fewer than four.

    The toolkit has four kinds of contacts, and numbers them one kind after the other, in the
    order of `rows_of_kinds`. `mesh` is its collision mesh, to which all numbers belong.
    """
    edges = np.asarray(mesh.edges)
    faces = np.asarray(mesh.faces)
    two_nodes = _rows((pair.vertex0_id, pair.vertex1_id) for pair in contacts.vv_collisions)
    node_and_edge = _rows((pair.vertex_id, pair.edge_id) for pair in contacts.ev_collisions)
    two_edges = _rows((pair.edge0_id, pair.edge1_id) for pair in contacts.ee_collisions)
    face_and_node = _rows((pair.face_id, pair.vertex_id) for pair in contacts.fv_collisions)
    rows_of_kinds = [
        np.hstack([two_nodes, np.full_like(two_nodes, -1)]),
        np.hstack(
            [
                node_and_edge[:, :1],
                edges[node_and_edge[:, 1]],
                np.full((len(node_and_edge), 1), -1),
            ]
        ),
        np.hstack([edges[two_edges[:, 0]], edges[two_edges[:, 1]]]),
        np.hstack([face_and_node[:, 1:], faces[face_and_node[:, 0]]]),
    ]
    return np.vstack(rows_of_kinds)


def _rows(pairs: Iterable[tuple[int, int]]) -> np.ndarray:
    """Return pairs of numbers as an array (m, 2), also for m = 0."""
    return np.array(list(pairs), int).reshape(-1, 2)


@kernel
def square_away_from(x: Array, start: Array, way: Array, drifts: bool) -> float:
    """Return the square [m²] of the largest distance of a node from its straight way.

    The nodes are at x (n, 3). The point of each way is `start` + part × `way`, (n, 3) each.
    The part in [0, 1] is one for all nodes: with it, they are nearest to x in the sense of
    least squares. If the cloth `drifts`, the mean motion of its nodes does not count, as it
    changes no distance in the cloth.
    """
    mean = np.zeros(3)  # motion from start to x
    count = len(x)
    if drifts:
        for n in range(count):
            for i in range(3):
                mean[i] += (x[n, i] - start[n, i]) / count
    # Least squares: part = Σ (x − start − mean) · way / Σ |way|².
    along = squared = 0.0
    for n in range(count):
        for i in range(3):
            along += (x[n, i] - start[n, i] - mean[i]) * way[n, i]
            squared += way[n, i] ** 2
    part = 0.0
    if squared > 0.0:
        part = min(max(along / squared, 0.0), 1.0)
    most = 0.0
    for n in range(count):
        far = 0.0
        for i in range(3):
            far += (x[n, i] - start[n, i] - mean[i] - part * way[n, i]) ** 2
        most = max(most, far)
    return most
