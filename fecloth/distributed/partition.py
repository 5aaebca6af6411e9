"""The parts of a cloth that its processes have: their meshes, and the systems on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.elements import add_midpoints
from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.system.clamps import find_clamps
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Motion, Pin
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.loads.edge_force import KnownEdges
from fecloth.terms.springs.springs import KnownSprings

# Part of the work of a step that only the first process has: vectors, sums and calls. Measured.
FIRST_PROCESS_WORK = 0.08
MOST_RANGES = 8  # processes; with more, ranges of nodes are long and thin


@dataclass(frozen=True, eq=False)
class Part:
    """The nodes that a process owns, with the triangles around them.

    The forces and the tangent at the nodes that it owns are the same as of the whole cloth. At
    the others, its ghosts, they are not, as triangles are missing there.

    Attributes
    ----------
    corners
        (k, 2) coordinates of its corners [m].
    triangles
        (m, 3) their corners, as numbers of the part.
    nodes
        Numbers of its nodes in the whole cloth; those of its corners ascend.
    cells
        Numbers of its triangles in the whole cloth.
    is_own
        Whether it owns each of its nodes.
    regions
        Named triangles of the part.
    element
        "P1" or "P2".
    """

    corners: np.ndarray
    triangles: np.ndarray
    nodes: np.ndarray
    cells: np.ndarray
    is_own: np.ndarray
    regions: dict[str, np.ndarray]
    element: str

    def cloth(self) -> Cloth:
        """The part as a cloth, with regions but without named nodes.

        Its triangles were checked as part of a larger mesh.
        """
        mesh = FlatMesh(self.corners, self.triangles, {}, {}, self.regions)
        if self.element == "P2":
            mesh = add_midpoints(mesh)
        return Cloth(mesh.X, mesh.triangles, element=self.element, triangle_sets=mesh.triangle_sets)

    def counted(self, nodes: np.ndarray) -> np.ndarray:
        """Whether elements with nodes (m, k) of the part count here: it owns the least node.

        The least node is by its number in the whole cloth; −1 is no node.
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
        ranks = np.searchsorted(self.nodes, nodes, sorter=order)
        places = order[np.minimum(ranks, len(order) - 1)]
        inside = np.flatnonzero(self.nodes[places] == nodes)
        return inside, places[inside]


def find_owners(cloth: Cloth, count: int) -> np.ndarray:
    """(n,) the number of the process that owns each node, of `count` processes.

    Up to 8 processes own ranges of the corners, whose numbers follow a narrow band; only the
    range of the first is shorter. More processes get the parts into which pymetis divides the
    mesh. The midpoint of an edge belongs to the process of its end with the lesser number.

    Raise `InputError` for more processes than corners, and where pymetis is missing.
    """
    corners = int(cloth.triangles.max()) + 1
    if count > corners:
        what = f"{count} processes"
        allowed = f"must be at most one for each of {corners} nodes"
        raise InputError(what, allowed, "mpiexec", "Ask for fewer by -n.")
    owner = np.empty(len(cloth.X), np.int64)
    # Where the ranges end, from 0 to 1. The first process has work of its own. So it gets a
    # shorter range, with which all have the same work; but at least a fifth of 1/count.
    first_end = max((1 + FIRST_PROCESS_WORK) / count - FIRST_PROCESS_WORK, 0.2 / count)
    ends = first_end + (1 - first_end) * np.arange(count) / max(count - 1, 1)
    ranges = np.searchsorted(ends, np.arange(corners) / corners, side="right")
    if count <= MOST_RANGES:
        owner[:corners] = ranges
    else:
        owner[:corners] = _by_metis(cloth, corners, count)
    if cloth.element == "P2":  # the stencil: ascending corners, then the midpoints 01, 12, 02
        for midpoint, end in ((3, 0), (4, 1), (5, 0)):
            owner[cloth.stencil[:, midpoint]] = owner[cloth.stencil[:, end]]
    return owner


def _by_metis(cloth: Cloth, corners: int, count: int) -> np.ndarray:
    """(corners,) the process of each corner, by METIS, which cuts as few edges as it can.

    Raise `InputError` where pymetis is missing.
    """
    try:
        import pymetis
    except ImportError as error:
        what = f"{count} processes"
        allowed = f"above {MOST_RANGES} need pymetis"
        remedy = "Run: pip install 'pymetis>=2025.2'"
        raise InputError(what, allowed, "mpiexec", remedy) from error
    # The graph of the edges, each in both directions; an inner edge is once in either triangle.
    begins = cloth.triangles.ravel()
    ends = np.roll(cloth.triangles, -1, axis=1).ravel()
    ones = np.ones(2 * len(begins), np.int8)
    pairs = np.append(begins, ends), np.append(ends, begins)
    graph = sparse.coo_array((ones, pairs), shape=(corners, corners)).tocsr()
    _, owner = pymetis.part_graph(count, pymetis.CSRAdjacency(graph.indptr, graph.indices))
    return np.asarray(owner)


def make_part(cloth: Cloth, owner: np.ndarray, rank: int, rings: int) -> Part:
    """The part of the process `rank`: the nodes that it owns, and the triangles around them.

    `owner` (n,) is the process of each node, and `rings` the number of rings of triangles around
    the own nodes, at least 1: each ring adds the triangles that touch the ones before.
    """
    corners = int(cloth.triangles.max()) + 1
    in_part = owner[:corners] == rank  # of each corner
    for _ in range(rings):
        touches_part = in_part[cloth.triangles].any(axis=1)
        in_part[cloth.triangles[touches_part]] = True
    cells = np.flatnonzero(touches_part)
    numbers = np.flatnonzero(in_part)
    # from numbers in the whole cloth to numbers in the part; −1 outside the part
    local_corner = np.full(corners, -1, np.int32)
    local_corner[numbers] = np.arange(len(numbers), dtype=np.int32)
    local_cell = np.full(len(cloth.triangles), -1)
    local_cell[cells] = np.arange(len(cells))
    regions = {}
    for name, cells_of_region in cloth.triangle_sets.items():
        local_cells = local_cell[cells_of_region]
        if (local_cells >= 0).any():
            regions[name] = local_cells[local_cells >= 0]
    part = Part(
        corners=cloth.X[numbers],
        triangles=local_corner[cloth.triangles[cells]],
        nodes=numbers,
        cells=cells,
        is_own=in_part,  # replaced below
        regions=regions,
        element=cloth.element,
    )
    if cloth.element == "P2":  # its nodes are also midpoints, which `cloth` numbers
        part_cloth = part.cloth()
        numbers = np.empty(len(part_cloth.X), np.int64)
        numbers[part_cloth.stencil] = cloth.stencil[cells]
    return replace(part, nodes=numbers, is_own=owner[numbers] == rank)


def _as_slice(numbers: np.ndarray) -> slice | np.ndarray:
    """A slice in place of numbers in a row, which saves copies."""
    if not len(numbers) or (np.diff(numbers) != 1).any():
        return numbers
    return slice(int(numbers[0]), int(numbers[-1]) + 1)


@dataclass(frozen=True, eq=False)
class PartDescription:
    """What a process needs to make the system of its part: the arguments of `System`, cut."""

    part: Part
    fabric: Any
    terms: Sequence
    pins: Sequence[tuple[Pin, np.ndarray]]
    mass: str
    grain: Any
    start: State

    def make(self) -> System:
        """Make the cloth of the part, and return the system on it."""
        cloth = self.part.cloth()
        return PartSystem(
            self.part,
            cloth=cloth,
            fabric=_regions_of(cloth, self.fabric),
            terms=self.terms,
            pins=[_pin_of(pin, nodes, cloth, self.start) for pin, nodes in self.pins],
            mass=self.mass,
            grain=_regions_of(cloth, self.grain),
            start=self.start,
        )


class PartSystem(System):
    """A `System` of a part, in whose sums each element of the cloth counts in one part only."""

    def __init__(self, part: Part, **arguments: Any):
        self.part = part
        super().__init__(**arguments, threads=1)

    @property
    def counted(self) -> Callable[[np.ndarray], np.ndarray]:
        return self.part.counted

    @cached_property
    def constraints(self) -> Constraints:
        """The pins on the part, which agree where they meet: the whole cloth was checked."""
        return Constraints.bind(self.pins, self.cloth, check=False)


def cut_pins(part: Part, groups: Mapping[str, tuple[Pin, np.ndarray]]) -> list:
    """(pin, nodes) of each pin that holds nodes of the part; the nodes as numbers of the part.

    `groups` has each pin of the whole cloth with its nodes. The positions of held nodes come
    from the first process, so a motion is left only where a clamp needs it.
    """
    pins_of_part = []
    for pin, nodes in groups.values():
        places, local_nodes = part.restrict(nodes)
        if not len(local_nodes):
            continue
        if not pin.clamp:
            pin = replace(pin, motion=None, velocity=None, rotate=None)
        elif isinstance(pin.motion, Motion) and pin.motion.X is not None:
            pin = pin.at(pin.motion.X[places])  # a motion by place: of these nodes only
        pins_of_part.append((pin, local_nodes))
    return pins_of_part


def cut_term(part: Part, term: Any) -> Any:
    """The term on the part: what names springs or edges gets those of the part.

    Other terms follow from the part's triangles.
    """
    if isinstance(term, KnownSprings):
        return _cut_springs(part, term)
    if isinstance(term, KnownEdges):
        return term.cut(part.cells)
    return term


def _cut_springs(part: Part, springs: KnownSprings) -> KnownSprings:
    """The springs between two nodes of the part."""
    local = np.full(int(max(part.nodes.max(), springs.nodes.max())) + 1, -1, np.int32)
    local[part.nodes] = np.arange(len(part.nodes), dtype=np.int32)
    nodes = local[springs.nodes]
    inside = (nodes >= 0).all(axis=1)
    return replace(springs, nodes=nodes[inside], length=springs.length[inside], k=springs.k[inside])


def _pin_of(pin: Pin, nodes: np.ndarray, cloth: Cloth, start: State) -> Pin:
    """The pin on nodes of the part; a clamp is left out where no edge of it is in the part."""
    pin = replace(pin, where=nodes, without=None, name=pin.name or "pin")
    if pin.clamp:
        try:
            find_clamps(Constraints.bind([pin], cloth), cloth, start)
        except InputError:
            return replace(pin, clamp=False)
    return pin


def _regions_of(cloth: Cloth, values: Any) -> Any:
    """One value for all, or the values of the regions that the part has."""
    if not isinstance(values, Mapping):
        return values
    return {name: value for name, value in values.items() if name in cloth.triangle_sets}
