"""Several pieces of cloth that share no node, as one mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fecloth.errors import InputError

if TYPE_CHECKING:
    from fecloth.mesh.cloth import Cloth


def join(pieces: Sequence[Cloth], names: Sequence[str]) -> dict[str, Any]:
    """Return the attributes of a cloth of several pieces; see `Cloth.join`.

    All corners come first, then, for P2, all midpoints, both in the order of the pieces.
    """
    _check(pieces, names)
    corners = [_number_of_corners(piece) for piece in pieces]
    first_corner = np.cumsum([0, *corners])
    midpoints = [len(p.X) - c for p, c in zip(pieces, corners, strict=True)]
    first_midpoint = first_corner[-1] + np.cumsum([0, *midpoints])
    first_triangle = np.cumsum([0, *(len(piece.triangles) for piece in pieces)])
    nodes: dict[str, np.ndarray] = {}
    edges: dict[str, np.ndarray] = {}
    regions: dict[str, np.ndarray] = {}
    triangles = []
    for i, (piece, name) in enumerate(zip(pieces, names, strict=True)):
        own = np.append(
            first_corner[i] + np.arange(corners[i]), first_midpoint[i] + np.arange(midpoints[i])
        )
        nodes |= {name: own} | {f"{name}/{k}": own[v] for k, v in piece.node_sets.items()}
        edges |= {f"{name}/{k}": own[v] for k, v in piece.edge_sets.items()}
        all_own = np.arange(first_triangle[i], first_triangle[i + 1])
        regions |= {name: all_own}
        regions |= {f"{name}/{k}": all_own[v] for k, v in piece.triangle_sets.items()}
        triangles.append(own[piece.triangles])
    ends = [(p.X[:c], p.X[c:]) for p, c in zip(pieces, corners, strict=True)]
    total = sum(len(piece.X) for piece in pieces)
    return {
        "X": np.concatenate([part for place in (0, 1) for part in (end[place] for end in ends)]),
        "triangles": np.concatenate(triangles).astype(np.int32),
        "node_sets": nodes,
        "edge_sets": edges,
        "source_nodes": np.arange(total),
        "source_triangles": np.arange(first_triangle[-1]),
        "element": pieces[0].element,
        "triangle_sets": regions,
    }


def _number_of_corners(piece: Cloth) -> int:
    return len(piece.X) if piece.element == "P1" else int(piece.triangles.max()) + 1


def _check(pieces: Sequence[Cloth], names: Sequence[str]) -> None:
    where = "Cloth.join"
    if len(pieces) < 2:
        raise InputError(f"{len(pieces)} pieces", "must be at least two cloths", where)
    if len(names) != len(pieces) or len(set(names)) != len(names):
        allowed = f"must be {len(pieces)} different names, one for each piece"
        raise InputError(f"names = {list(names)}", allowed, where)
    wrong = [name for name in names if not (isinstance(name, str) and name and "/" not in name)]
    if wrong:
        raise InputError(f"name {wrong[0]!r}", "must be a text without '/'", where)
    elements = {piece.element for piece in pieces}
    if len(elements) > 1:
        remedy = "Make all pieces with one element."
        raise InputError("pieces of P1 and of P2", "must have one element", where, remedy)
