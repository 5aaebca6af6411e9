"""Pairs of the IPC Toolkit: their nodes, and how long they stay all that can touch."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, kernel
from fecloth.linalg.block_matrix import BlockMatrix

# Two pairs, one before a step and one after it, are of the same material points if the cosine of
# the angle between their coefficients exceeds this.
LEAST_LIKENESS = 0.5


@dataclass(frozen=True, eq=False)
class PairPlaces:
    """The vectors Σ c_a x_a of m pairs; see `friction.Places`.

    Attributes
    ----------
    weights
        Their coefficients c (m, n) for the nodes of the cloth.
    """

    weights: sparse.csr_matrix

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        values: np.ndarray = self.weights @ of_nodes
        return values

    def add_force(self, F: np.ndarray, f: np.ndarray) -> None:
        f += self.weights.T @ F

    def add_tangent(self, K: np.ndarray, J: BlockMatrix) -> None:
        """Pairs change from step to step: all of their tangent is a `coupling`."""

    def coupling(self, K: np.ndarray) -> sparse.bsr_matrix | None:
        """Σ c_a c_b K of each pair, in the block of its nodes a and b."""
        if not len(K):
            return None
        indptr, indices, coefficients = self.blocks
        n = 3 * self.weights.shape[1]
        values = (coefficients @ K.reshape(-1, 9)).reshape(-1, 3, 3)
        return sparse.bsr_matrix((values, indices, indptr), shape=(n, n))

    @cached_property
    def blocks(self) -> tuple[np.ndarray, np.ndarray, sparse.csr_matrix]:
        """The rows and columns of k blocks, as in `BlockPattern`, and c_a c_b (k, m) there."""
        m, n = self.weights.shape
        number = np.arange(self.weights.nnz)  # of each coefficient
        pair = np.repeat(np.arange(m), np.diff(self.weights.indptr))
        ones = np.ones(len(number))
        of_pair = sparse.csr_matrix((ones, (number, pair)), shape=(len(number), m))
        both = (of_pair @ of_pair.T).tocoo()  # all a, b of the same pair
        c, nodes = self.weights.data, self.weights.indices
        places = nodes[both.row].astype(np.int64) * n + nodes[both.col]
        numbers, block = np.unique(places, return_inverse=True)
        entries = (c[both.row] * c[both.col], (block, pair[both.row]))
        coefficients = sparse.csr_matrix(entries, shape=(len(numbers), m))
        indptr = np.searchsorted(numbers, n * np.arange(n + 1, dtype=np.int64))
        return indptr.astype(np.int32), (numbers % n).astype(np.int32), coefficients

    @cached_property
    def directions(self) -> sparse.csr_matrix:
        """The coefficients over their length √(Σ c_a²)."""
        length = np.sqrt(self.weights.power(2).sum(axis=1).A1)
        return sparse.diags(1 / length) @ self.weights

    def hand_on(self, before: "PairPlaces", e: np.ndarray) -> np.ndarray:
        """Return e (m, 3), of each pair from the pair `before` whose coefficients are most alike.

        A pair that has the same node on an edge as before on the triangle beside it has nearly
        the same coefficients, so that e goes with the material points. Where the order of the
        two parts has changed, e has the other sign.
        """
        handed = np.zeros((self.weights.shape[0], 3))
        if not len(e) or not len(handed):
            return handed
        likeness = (self.directions @ before.directions.T).tocsr()
        most = np.asarray(abs(likeness).argmax(axis=1)).ravel()
        cosines = np.asarray(likeness[np.arange(len(most)), most]).ravel()
        is_same = np.abs(cosines) > LEAST_LIKENESS
        handed[is_same] = np.sign(cosines[is_same])[:, None] * e[most[is_same]]
        return handed


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
