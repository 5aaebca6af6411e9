"""Numbers of nodes and triangles: neighbours close together in memory, pieces as one mesh."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from fecloth.errors import InputError, amount
from fecloth.mesh.flat_mesh import FlatMesh, sorted_pairs


def renumber_mesh(mesh: FlatMesh) -> tuple[FlatMesh, np.ndarray, np.ndarray]:
    """Renumber nodes and triangles so that neighbours lie close together in memory.

    Each triangle keeps the order of its vertices. Measured against a Hilbert curve: reverse
    Cuthill–McKee makes gathers 5-10 % faster and the bandwidth 90-180 times smaller.

    Returns
    -------
    tuple
        The new mesh, the old index of each new node (n,), so that
        ``new.X == mesh.X[old_nodes]``, and the old index of each new triangle (m,).
    """
    n = len(mesh.X)
    start = mesh.triangles.ravel()
    end = np.roll(mesh.triangles, -1, axis=1).ravel()
    place = np.append(start, end), np.append(end, start)
    graph = coo_array((np.ones(2 * len(start), dtype=np.int8), place), (n, n)).tocsr()
    old_nodes = reverse_cuthill_mckee(graph, symmetric_mode=True)
    new_nodes = np.empty(n, dtype=np.int32)
    new_nodes[old_nodes] = np.arange(n, dtype=np.int32)
    triangles = new_nodes[mesh.triangles]
    # Triangles are ordered by their lowest node, then by the next one, then by the highest.
    low = np.sort(triangles, axis=1)
    old_triangles = np.lexsort((low[:, 2], low[:, 1], low[:, 0]))
    node_sets = {
        name: np.sort(new_nodes[nodes]).astype(np.intp) for name, nodes in mesh.node_sets.items()
    }
    edge_sets = {name: sorted_pairs(new_nodes[pairs]) for name, pairs in mesh.edge_sets.items()}
    new_triangles = np.empty(len(triangles), dtype=np.intp)
    new_triangles[old_triangles] = np.arange(len(triangles))
    regions = {name: np.sort(new_triangles[old]) for name, old in mesh.triangle_sets.items()}
    renumbered = replace(
        mesh,
        X=mesh.X[old_nodes],
        triangles=triangles[old_triangles],
        node_sets=node_sets,
        edge_sets=edge_sets,
        triangle_sets=regions,
        start=None if mesh.start is None else mesh.start[old_nodes],
    )
    return renumbered, old_nodes.astype(np.intp), old_triangles


LONGEST_NAME = 100  # characters of the name of a piece, as messages list the names of sets


def join_meshes(pieces: Sequence[FlatMesh], names: Sequence[str]) -> FlatMesh:
    """Return one mesh of pieces without common nodes; `Cloth.join` says how sets are named.

    The corners of all pieces come first, then the midpoints of all pieces, as in any mesh of
    P2. Raises `InputError` for fewer than two pieces and for invalid names.
    """
    _check_names(pieces, names)
    # Numbers of corners: in a piece the corners come first, and each belongs to a triangle.
    corners = [int(piece.triangles.max()) + 1 for piece in pieces]
    first_corner = np.cumsum([0, *corners])
    midpoints = [len(piece.X) - count for piece, count in zip(pieces, corners, strict=True)]
    first_midpoint = first_corner[-1] + np.cumsum([0, *midpoints])
    first_triangle = np.cumsum([0, *(len(piece.triangles) for piece in pieces)])
    nodes: dict[str, np.ndarray] = {}
    edges: dict[str, np.ndarray] = {}
    regions: dict[str, np.ndarray] = {}
    triangles = []
    for i, (piece, name) in enumerate(zip(pieces, names, strict=True)):
        own_corners = first_corner[i] + np.arange(corners[i])
        own_midpoints = first_midpoint[i] + np.arange(midpoints[i])
        own_nodes = np.append(own_corners, own_midpoints)
        own_triangles = np.arange(first_triangle[i], first_triangle[i + 1])
        nodes |= {name: own_nodes} | _new_numbers(name, piece.node_sets, own_nodes)
        edges |= _new_numbers(name, piece.edge_sets, own_nodes)
        regions |= {name: own_triangles} | _new_numbers(name, piece.triangle_sets, own_triangles)
        triangles.append(own_nodes[piece.triangles])

    def join(values: list[np.ndarray]) -> np.ndarray:
        """Return the values of all corners, and then those of all midpoints."""
        parts = list(zip(values, corners, strict=True))
        of_corners = [value[:count] for value, count in parts]
        return np.concatenate(of_corners + [value[count:] for value, count in parts])

    start = None
    if any(piece.start is not None for piece in pieces):
        start = join([_start_or_flat(piece) for piece in pieces])
    return FlatMesh(
        join([piece.X for piece in pieces]),
        np.concatenate(triangles).astype(np.int32),
        nodes,
        edges,
        regions,
        start=start,
        notes=tuple(
            f"{name}: {note}"
            for piece, name in zip(pieces, names, strict=True)
            for note in piece.notes
        ),
    )


def _start_or_flat(piece: FlatMesh) -> np.ndarray:
    """Return the positions (n, 3) of a piece [m], which lies in the plane xy without a start."""
    if piece.start is not None:
        return piece.start
    return np.column_stack([piece.X, np.zeros(len(piece.X))])


def _new_numbers(piece: str, sets: dict[str, np.ndarray], new: np.ndarray) -> dict:
    """The sets of a piece by their names in the joined mesh, in the `new` numbers."""
    return {f"{piece}/{name}": new[members] for name, members in sets.items()}


def _check_names(pieces: Sequence[FlatMesh], names: Sequence[str]) -> None:
    """Raise `InputError` for fewer than two pieces, and for names that do not fit.

    There must be a different name for each piece, of at most `LONGEST_NAME` printed characters
    and without "/", which separates the name from the name of a set.
    """
    where = "Cloth.join"
    if len(pieces) < 2:
        raise InputError(amount(len(pieces), "piece"), "must be at least two cloths", where)
    if len(names) != len(pieces) or len(set(names)) != len(names):
        allowed = f"must be {len(pieces)} different names, one for each piece"
        raise InputError(f"names = {list(names)}", allowed, where)
    wrong = [name for name in names if not (isinstance(name, str) and _is_name(name))]
    if wrong:
        allowed = f"must be 1 to {LONGEST_NAME} printed characters without '/'"
        raise InputError(f"name {str(wrong[0])[:LONGEST_NAME]!r}", allowed, where)


def _is_name(name: str) -> bool:
    return 0 < len(name) <= LONGEST_NAME and name.isprintable() and "/" not in name
