"""The pairs of edges that seams join: which nodes meet, and the cloth that goes on across them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.mortar import mortar_weights
from fecloth.mesh.sewn_cloth import SewnCloth
from fecloth.mesh.sewn_edge import SewnEdge

SAME_PLACE = 1e-6  # of the length of an edge: so near, two edges are the same but for a shift
PLATE_REMEDY = "Give a number [N], or lay the pieces side by side on the flat cloth."


@dataclass(frozen=True, eq=False)
class SewnPair:
    """Two edges of a seam on a cloth: nodes (k,) follow nodes (l,) by weights W (k, l)."""

    seam: Any
    leading: SewnEdge
    following: SewnEdge
    weights: sparse.csr_matrix

    @classmethod
    def of(cls, seam: Any, cloth: Cloth) -> Self:
        """Find the edges of a seam, and the weights."""
        leading, following = seam.edges(cloth)
        degree = 1 if cloth.element == "P1" else 2
        W = mortar_weights(following.places, leading.places, degree)
        return cls(seam, leading, following, W)

    def rows(self) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Each node that follows, with its leaders and their weights."""
        W = self.weights
        for node, begin, end in zip(self.following.nodes, W.indptr, W.indptr[1:], strict=False):
            yield int(node), self.leading.nodes[W.indices[begin:end]], W.data[begin:end]


def find_pairs(seams: Sequence, cloth: Cloth) -> list[SewnPair]:
    """Find the edges of all seams; raise `InputError` for two seams of the same edges."""
    pairs = [SewnPair.of(seam, cloth) for seam in seams]
    numbers: dict[frozenset, int] = {}
    for number, pair in enumerate(pairs, start=1):
        edges = frozenset(frozenset(e.half_edges.tolist()) for e in (pair.leading, pair.following))
        first = numbers.setdefault(edges, number)
        if first != number:
            what = f"[[seams]] {first} and {number} sew the same edges"
            remedy = "Leave one of them out."
            raise InputError(what, "edges are sewn together once", pair.seam.label, remedy)
    return pairs


def standing_nodes(pairs: Sequence[SewnPair], n: int) -> np.ndarray:
    """The node (n,) that stands for each node: nodes that meet whole are one.

    It is the node with the lowest number that follows no other node whole. If each of them
    follows another one, it is the node with the lowest number of all.
    """
    meeting = [
        (node, int(leaders[0]))
        for pair in pairs
        for node, leaders, _ in pair.rows()
        if len(leaders) == 1
    ]
    followed, leaders = np.array(meeting, np.int64).reshape(-1, 2).T
    graph = sparse.coo_matrix((np.ones(len(meeting)), (followed, leaders)), (n, n))
    count, group = connected_components(graph, directed=False)
    follows = np.isin(np.arange(n), followed)
    order = np.lexsort((np.arange(n), follows))[::-1]
    first = np.zeros(count, np.int64)
    first[group[order]] = order  # the last one written is the first of its group
    standing: np.ndarray = first[group]
    return standing


def sewn_cloth(seams: Sequence, cloth: Cloth) -> SewnCloth:
    """Return the cloth as bending and contact see it: with the plates that go on across seams.

    Raises `InputError` for a seam with stiffness = "cloth" whose edges do not allow that.
    """
    pairs = find_pairs(seams, cloth)
    meeting = [
        (node, int(leader))
        for pair in pairs
        for node, leaders, _ in pair.rows()
        for leader in leaders
    ]
    plates = [pair for pair in pairs if pair.seam.stiffness == "cloth"]
    for pair in plates:
        _check_plate(pair, cloth)
    sewn = SewnCloth.sew(cloth, standing_nodes(plates, len(cloth.X)), np.array(meeting))
    joints = len(sewn.hinges.nodes) - len(cloth.hinges.nodes)
    if joints != sum(len(pair.leading.half_edges) for pair in plates):
        what = 'stiffness = "cloth" with the cloth on the same side of both edges'
        raise InputError(what, "needs it on both sides", plates[0].seam.label, PLATE_REMEDY)
    return sewn


def _check_plate(pair: SewnPair, cloth: Cloth) -> None:
    """Raise `InputError` unless the second edge is the first one, moved without a turn."""
    allowed = "needs edges whose nodes match, and that are parallel"
    matches = len(pair.leading.nodes) == len(pair.following.nodes) == pair.weights.nnz
    if matches:
        shift = cloth.X[pair.following.nodes] - cloth.X[pair.leading.nodes]
        matches = bool(np.ptp(shift, axis=0).max() <= SAME_PLACE * pair.leading.length)
    if not matches:
        raise InputError('stiffness = "cloth"', allowed, pair.seam.label, PLATE_REMEDY)


def place_of(X: np.ndarray) -> str:
    """Where a node is on the flat cloth, in words."""
    return f"({X[0]:.6g}, {X[1]:.6g}) m"
