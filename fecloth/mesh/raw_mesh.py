"""The arrays of a mesh file before validation.

It needs NumPy only, for a quick start of the process that reads files.
"""

from dataclasses import dataclass, field

import numpy as np


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
    between
        (n,) bool: nodes between the corners of cells. No triangle uses them, and sets lose them.
    start
        (n, 3) positions in space [m], where xyz are the flat coordinates of a frame; else None.
    vt, vt_triangles
        The texture coordinates (k, 2) of an .obj, and those of each triangle's corners (m, 3);
        None without them.
    element
        "P2" if the cells are quadratic triangles with straight edges, else "P1".
    notes
        What was done to the file, a sentence each.
    """

    xyz: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, list[np.ndarray]]
    edge_sets: dict[str, list[np.ndarray]]
    node_ids: np.ndarray
    triangle_ids: np.ndarray
    geometric: np.ndarray
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)
    between: np.ndarray | None = None
    start: np.ndarray | None = None
    vt: np.ndarray | None = None
    vt_triangles: np.ndarray | None = None
    element: str = "P1"
    notes: list[str] = field(default_factory=list)
