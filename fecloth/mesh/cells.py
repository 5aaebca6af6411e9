"""The triangles of a file's cells: quadrilaterals are split, nodes between corners left out.

It needs NumPy only, for a quick start of the process that reads files.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fecloth.errors import MeshError, amount
from fecloth.mesh.planes import rounding


class Cells(NamedTuple):
    """Cells of one kind.

    Attributes
    ----------
    kind
        The name of the kind, for messages.
    corners
        Number of corners: 3 and 4 are triangles and quadrilaterals; 2 and 1 are lines and
        points. 0 is another kind of cell, which a cloth has not.
    nodes
        (k, p) node indices: the corners, then the nodes between them.
    """

    kind: str
    corners: int
    nodes: np.ndarray


@dataclass(frozen=True)
class Triangles:
    """The triangles of a file, and what was done to its cells.

    Attributes
    ----------
    nodes
        (m, 3) corners of the triangles.
    cell
        (m,) the cell of each triangle: its number among all triangles and quadrilaterals.
    between
        (n,) bool: nodes that lie between the corners of cells, and are no corners themselves.
    element
        "P2" if all cells are quadratic triangles with straight edges, else "P1".
    notes
        What was done to the cells, a sentence each.
    """

    nodes: np.ndarray
    cell: np.ndarray
    between: np.ndarray
    element: str
    notes: list[str]


def triangles_of(
    xyz: np.ndarray, blocks: Sequence[Cells], where: str, remedy: str = ""
) -> Triangles:
    """Return the triangles of cells between nodes xyz (n, 2 or 3) [m].

    Raises `MeshError` for cells that are no triangles, quadrilaterals, lines or points, for
    wrong node indices, and, with the `remedy`, if there are no triangles.
    """
    _check_kinds(blocks, where, remedy)
    n = len(xyz)
    flat_blocks = [block for block in blocks if block.corners > 2]
    parts, cells = [np.empty((0, 3), int)], [np.empty(0, int)]
    notes = []
    first = 0
    for block in flat_blocks:
        corners = block.nodes[:, : block.corners]
        number = first + np.arange(len(corners))
        first += len(corners)
        if block.corners == 4:
            _check_nodes(block, n, where)
            corners = split_quadrilaterals(xyz, corners)
            cells_of_kind = f"{amount(len(number), 'cell')} of type {block.kind}"
            notes.append(f"{cells_of_kind} split along the better diagonal")
            number = np.repeat(number, 2)
        parts.append(corners)
        cells.append(number)
    is_corner = np.zeros(n, bool)
    between = np.zeros(n, bool)
    for block in blocks:
        if block.nodes.shape[1] > block.corners:
            _check_nodes(block, n, where)
            is_corner[block.nodes[:, : block.corners]] = True
            between[block.nodes[:, block.corners :]] = True
    element = "P1"
    if between.any():
        element, note = _choose_element(xyz, flat_blocks)
        notes.append(note)
    nodes = np.concatenate(parts)
    return Triangles(nodes, np.concatenate(cells), between & ~is_corner, element, notes)


def _check_kinds(blocks: Sequence[Cells], where: str, remedy: str) -> None:
    """Raise `MeshError` for a file with other cells than a cloth has, or without triangles."""
    counts = {block.kind: 0 for block in blocks}
    for block in blocks:
        counts[block.kind] += len(block.nodes)
    others = [block.kind for block in blocks if not block.corners]
    if others:
        listed = ", ".join(f"{counts[kind]} {kind}" for kind in dict.fromkeys(others))
        allowed = "must be triangles or quadrilaterals"
        how = "Export the flat sheet alone, as triangles."
        raise MeshError(f"cells of type {listed}", allowed, where, how)
    if not any(block.corners > 2 for block in blocks):
        listed = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "no cells"
        raise MeshError(f"no triangles, but {listed}", "at least one is needed", where, remedy)


def _check_nodes(block: Cells, n: int, where: str) -> None:
    """Raise `MeshError` for node indices that are not in 0 … n − 1."""
    if block.nodes.min() < 0 or block.nodes.max() >= n:
        what = f"{block.kind} cells with a node out of range"
        raise MeshError(what, f"nodes must be 0 to {n - 1}", where)


def split_quadrilaterals(xyz: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the triangles (2 k, 3) of quadrilaterals (k, 4), two for each.

    Of the two diagonals that one is taken whose worse triangle has the better shape, which is
    4√3 A/Σ l². The area A has the sign of the quadrilateral's, so that a quadrilateral with a
    reentrant corner is split there.
    """
    splits = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    triangles = corners[:, splits]  # (k, 2 diagonals, 2 triangles, 3)
    points = np.zeros((*corners.shape, 3))
    points[..., : xyz.shape[1]] = xyz[corners]
    normal = np.cross(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1])
    a, b, c = np.moveaxis(points[:, splits], 3, 0)
    area = np.einsum("kijx,kx->kij", np.cross(b - a, c - a), normal)
    quality = area / sum(((p - q) ** 2).sum(axis=-1) for p, q in ((a, b), (b, c), (c, a)))
    better = quality.min(axis=2).argmax(axis=1)
    return triangles[np.arange(len(corners)), better].reshape(-1, 3)


def _choose_element(xyz: np.ndarray, blocks: Sequence[Cells]) -> tuple[str, str]:
    """Return "P2" if all cells are quadratic triangles with straight edges, else "P1"; and why."""
    kinds = ", ".join(sorted({block.kind for block in blocks}))
    default = "the element is P1 unless another is asked for"
    if any(block.corners == 4 or block.nodes.shape[1] not in (6, 7) for block in blocks):
        return "P1", f"only the corners of {kinds} used: {default}"
    distance = 0.0
    for block in blocks:
        ends, middle = xyz[block.nodes[:, :3]], xyz[block.nodes[:, 3:6]]
        chord = (ends + np.roll(ends, -1, axis=1)) / 2
        distance = max(distance, float(np.linalg.norm(middle - chord, axis=2).max()))
    if distance <= rounding(xyz):
        return "P2", f"{kinds} with straight edges: the element is P2 unless another is asked for"
    curved = f"edges of {kinds} are curved, by up to {distance:.2g} m: straight ones used"
    return "P1", f"{curved}, and {default}"
