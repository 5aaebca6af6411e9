"""Aggregates of coupled nodes and their rigid motions: the coarse unknowns of multigrid.

Source: Vaněk, Mandel and Brezina (1996), Algebraic multigrid by smoothed aggregation for second
and fourth order elliptic problems, sections 4.1 (aggregates) and 3 (tentative prolongator).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.compiled.team import Team
from fecloth.linalg.block_matrix import BlockPattern

DEPENDENT = 1e-10  # of a motion's size: where orthogonalisation leaves less, nothing is left


@dataclass(frozen=True)
class Aggregates:
    """Disjoint groups of neighbours that cover all nodes of a pattern."""

    of_node: np.ndarray  # (n,) int32 aggregate of each node
    # Aggregate a has the nodes members[starts[a]] … members[starts[a + 1] − 1], ascending.
    starts: np.ndarray
    members: np.ndarray

    @classmethod
    def from_pattern(cls, pattern: BlockPattern) -> Self:
        """Group the nodes by the pattern alone."""
        of_node = np.full(len(pattern), -1, np.int32)
        count = _aggregate(pattern.indptr, pattern.indices, of_node)
        members = np.argsort(of_node, kind="stable").astype(np.int32)
        starts = np.searchsorted(of_node[members], np.arange(count + 1)).astype(np.int32)
        return cls(of_node, starts, members)

    def __len__(self) -> int:
        return len(self.starts) - 1


@kernel
def _aggregate(indptr: Array, indices: Array, of_node: Array) -> int:
    """Number the aggregates in `of_node`, −1 at first; returns their number."""
    n, count = len(of_node), 0
    for i in range(n):  # a node whose neighbours are all free makes an aggregate with them
        row = indices[indptr[i] : indptr[i + 1]]
        taken = False
        for j in row:
            taken = taken or of_node[j] >= 0
        if not taken:
            for j in row:
                of_node[j] = count
            count += 1
    first = count
    for i in range(n):  # a node left over joins a neighbour's aggregate
        if of_node[i] < 0:
            for j in indices[indptr[i] : indptr[i + 1]]:
                if 0 <= of_node[j] < first:
                    of_node[i] = of_node[j] + n  # marked: it takes no others with it
                    break
    for i in range(n):
        if of_node[i] >= n:
            of_node[i] -= n
    return count


def rigid_motions(x: np.ndarray) -> np.ndarray:
    """(n, 3, 6) displacements of nodes at x (n, 3): three translations, three rotations."""
    # The rotations are e × (x − centre) about the axes e through the mean position.
    motions = np.zeros((len(x), 3, 6))
    motions[:, :, :3] = np.eye(3)
    arm = x - x.mean(axis=0)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    return motions


def orthonormalise(aggregates: Aggregates, motions: np.ndarray, team: Team) -> np.ndarray:
    """(m, 6, 6) R of the motions of each aggregate, B = Q R, by Gram and Schmidt's method, twice.

    The `motions` (n, 3, 6) are B, overwritten with Q. A motion that depends on motions before it
    leaves zeros. The team shares the aggregates.
    """
    m = len(aggregates)
    coarse = np.empty((m, 6, 6))
    data = aggregates.starts, aggregates.members, motions, coarse
    team.each(m, lambda part: (_orthonormalise, (*data, part.start, part.stop)), m)
    return coarse


@kernel
def _orthonormalise(
    starts: Array, members: Array, motions: Array, coarse: Array, begin: int, end: int
) -> None:
    for a in range(begin, end):
        nodes = members[starts[a] : starts[a + 1]]
        coarse[a] = 0.0
        for k in range(6):
            before = 0.0
            for i in nodes:
                for c in range(3):
                    before += motions[i, c, k] ** 2
            for m in range(2 * k):
                overlap = 0.0
                for i in nodes:
                    for c in range(3):
                        overlap += motions[i, c, m % k] * motions[i, c, k]
                coarse[a, m % k, k] += overlap
                for i in nodes:
                    for c in range(3):
                        motions[i, c, k] -= overlap * motions[i, c, m % k]
            after = 0.0
            for i in nodes:
                for c in range(3):
                    after += motions[i, c, k] ** 2
            size = np.sqrt(after) if after > DEPENDENT**2 * before else 0.0
            coarse[a, k, k] = size
            for i in nodes:
                for c in range(3):
                    motions[i, c, k] = motions[i, c, k] / size if size > 0.0 else 0.0
