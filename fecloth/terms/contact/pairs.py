"""Pairs of the IPC Toolkit: their nodes, and how far the cloth has moved since they were found."""

from typing import Any

import numpy as np

from fecloth.compiled.jit import Array, kernel


def nodes_of(contacts: Any, mesh: Any) -> np.ndarray:
    """(m, 4) The nodes of the contacts, in their order; −1 where there are fewer than four."""
    edges = np.asarray(mesh.edges)
    faces = np.asarray(mesh.faces)
    vv = [(each.vertex0_id, each.vertex1_id, -1, -1) for each in contacts.vv_collisions]
    ev = np.array([(each.vertex_id, each.edge_id) for each in contacts.ev_collisions], int)
    ee = np.array([(each.edge0_id, each.edge1_id) for each in contacts.ee_collisions], int)
    fv = np.array([(each.face_id, each.vertex_id) for each in contacts.fv_collisions], int)
    ev, ee, fv = (each.reshape(-1, 2) for each in (ev, ee, fv))
    none = np.full((len(ev), 1), -1)
    parts = [
        np.array(vv, int).reshape(-1, 4),
        np.hstack([ev[:, :1], edges[ev[:, 1]], none]),
        np.hstack([edges[ee[:, 0]], edges[ee[:, 1]]]),
        np.hstack([fv[:, 1:], faces[fv[:, 0]]]),
    ]
    return np.vstack(parts)


@kernel
def square_away_from(x: Array, start: Array, way: Array, drifts: bool) -> float:
    """The square of the longest way [m²] of a node at x (n, 3) from the straight way from `start`.

    The point of this way is the nearest one for all nodes together. Where the cloth `drifts`,
    what all nodes move alike does not count.
    """
    mean = np.zeros(3)
    count = len(x)
    if drifts:
        for n in range(count):
            for i in range(3):
                mean[i] += (x[n, i] - start[n, i]) / count
    along = squared = 0.0
    for n in range(count):
        for i in range(3):
            along += (x[n, i] - start[n, i] - mean[i]) * way[n, i]
            squared += way[n, i] ** 2
    part = min(max(along / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    most = 0.0
    for n in range(count):
        far = 0.0
        for i in range(3):
            far += (x[n, i] - start[n, i] - mean[i] - part * way[n, i]) ** 2
        most = max(most, far)
    return most
