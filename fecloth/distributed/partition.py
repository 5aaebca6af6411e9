"""Which process owns which nodes, and the part of the cloth that it needs for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.elements import add_midpoints
from fecloth.mesh.flat_mesh import FlatMesh

DRIVING = 0.08  # of the work of a step, as measured: vectors, sums and calls of the first process
MOST_RANGES = 8  # processes; with more, ranges of nodes are long and thin


@dataclass(frozen=True, eq=False)
class Part:
    """The nodes that a process owns, with the triangles around them.

    The forces and the tangent at the nodes that it owns are those of the whole cloth. At the
    others, its ghosts, they are not, as triangles are missing there.
    """

    # (k, 2) coordinates [m], and (m, 3) corners as numbers of the part.
    corners: np.ndarray
    triangles: np.ndarray
    # Numbers of its nodes and triangles in the whole cloth; those of its corners ascend.
    nodes: np.ndarray
    cells: np.ndarray
    is_own: np.ndarray  # whether it owns each of its nodes
    regions: dict[str, np.ndarray]  # named triangles of the part
    element: str  # "P1" or "P2"

    def cloth(self) -> Cloth:
        """The part as a cloth, with regions but without named nodes."""
        return make_cloth(self.corners, self.triangles, self.regions, self.element)

    def counted(self, nodes: np.ndarray) -> np.ndarray:
        """Whether elements with nodes (m, k) of the part count here: if it owns their least node.

        The least is by its number in the whole cloth; −1 is no node.
        """
        numbers = np.where(nodes < 0, np.iinfo(np.int64).max, self.nodes[nodes])
        least = np.take_along_axis(nodes, numbers.argmin(axis=1)[:, None], axis=1)[:, 0]
        counted: np.ndarray = self.is_own[least]
        return counted

    @property
    def own(self) -> slice | np.ndarray:
        """The nodes that it owns, as numbers of the part."""
        return _as_slice(np.flatnonzero(self.is_own))

    @property
    def own_nodes(self) -> slice | np.ndarray:
        """The same as numbers of the whole cloth."""
        return _as_slice(self.nodes[self.is_own])

    def restrict(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of these nodes of the whole cloth are in the part: their places, and numbers."""
        order = np.argsort(self.nodes)
        at = np.searchsorted(self.nodes, nodes, sorter=order)
        found = order[np.minimum(at, len(order) - 1)]
        inside = np.flatnonzero(self.nodes[found] == nodes)
        return inside, found[inside]


def make_cloth(corners: np.ndarray, triangles: np.ndarray, regions: dict, element: str) -> Cloth:
    """A cloth of triangles that were checked as part of a larger mesh."""
    mesh = FlatMesh(corners, triangles, {}, {}, regions)
    mesh = add_midpoints(mesh) if element == "P2" else mesh
    return Cloth(mesh.X, mesh.triangles, element=element, triangle_sets=mesh.triangle_sets)


def find_owners(cloth: Cloth, count: int) -> np.ndarray:
    """(n,) process of each node, of `count`.

    To 8 processes they own equal ranges of the corners, whose numbers follow a narrow band; beyond
    pymetis divides the mesh. The midpoint of an edge belongs to the process of its lesser end.
    """
    corners = int(cloth.triangles.max()) + 1
    if count > corners:
        what, allowed = f"{count} processes", f"must be at most one for each of {corners} nodes"
        raise InputError(what, allowed, "mpiexec", "Ask for fewer by -n.")
    owner = np.empty(len(cloth.X), np.int64)
    ranges = np.searchsorted(_ends(count), np.arange(corners) / corners, side="right")
    owner[:corners] = ranges if count <= MOST_RANGES else _by_metis(cloth, corners, count)
    if cloth.element == "P2":  # the stencil: ascending corners, then the midpoints 01, 12, 02
        for midpoint, end in ((3, 0), (4, 1), (5, 0)):
            owner[cloth.stencil[:, midpoint]] = owner[cloth.stencil[:, end]]
    return owner


def _ends(count: int) -> np.ndarray:
    """Where the ranges end, from 0 to 1; that of the first process is shorter by its own work."""
    first = max((1 + DRIVING) / count - DRIVING, 0.2 / count)
    return first + (1 - first) * np.arange(count) / max(count - 1, 1)


def _by_metis(cloth: Cloth, corners: int, count: int) -> np.ndarray:
    try:
        import pymetis
    except ImportError as error:
        what, allowed = f"{count} processes", f"above {MOST_RANGES} need pymetis"
        raise InputError(what, allowed, "mpiexec", "Run: pip install 'pymetis>=2025.2'") from error
    a, b = cloth.triangles.ravel(), np.roll(cloth.triangles, -1, axis=1).ravel()
    ones = np.ones(2 * len(a), np.int8)
    pairs = np.append(a, b), np.append(b, a)
    graph = sparse.coo_array((ones, pairs), shape=(corners, corners)).tocsr()
    neighbours = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    _, owner = pymetis.part_graph(count, neighbours)
    return np.asarray(owner)


def make_part(cloth: Cloth, owner: np.ndarray, rank: int, rings: int) -> Part:
    """The part of a process, with so many rings of triangles around the nodes that it owns."""
    corners = int(cloth.triangles.max()) + 1
    inside = owner[:corners] == rank
    for _ in range(rings):
        cells = inside[cloth.triangles].any(axis=1)
        inside[cloth.triangles[cells]] = True
    chosen, numbers = np.flatnonzero(cells), np.flatnonzero(inside)
    place = np.full(corners, -1, np.int32)
    place[numbers] = np.arange(len(numbers), dtype=np.int32)
    triangle = np.full(len(cloth.triangles), -1)
    triangle[chosen] = np.arange(len(chosen))
    regions = {name: triangle[which] for name, which in cloth.triangle_sets.items()}
    regions = {name: which[which >= 0] for name, which in regions.items() if (which >= 0).any()}
    part = Part(
        cloth.X[numbers],
        place[cloth.triangles[chosen]],
        numbers,
        chosen,
        inside,
        regions,
        cloth.element,
    )
    if cloth.element == "P2":
        there = part.cloth()
        numbers = np.empty(len(there.X), np.int64)
        numbers[there.stencil] = cloth.stencil[chosen]
    return replace(part, nodes=numbers, is_own=owner[numbers] == rank)


def _as_slice(numbers: np.ndarray) -> slice | np.ndarray:
    """A slice in place of numbers in a row, which saves copies."""
    if (
        len(numbers)
        and numbers[-1] - numbers[0] == len(numbers) - 1
        and (np.diff(numbers) == 1).all()
    ):
        return slice(int(numbers[0]), int(numbers[-1]) + 1)
    return numbers
