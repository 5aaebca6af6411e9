"""A cloth with seams, as bending and contact see it."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Self

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.edge_slopes import EdgeSlopes
from fecloth.mesh.hinges import HalfEdges, Hinges

NO_PAIRS = np.zeros((0, 2), np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class SewnCloth(Cloth):
    """A cloth whose plate goes on across seams, and whose pieces are neighbours there.

    Attributes
    ----------
    stands
        (n,) the node that stands for each node in hinges: that of the other edge, where the
        plate goes on across a seam.
    meeting
        (p, 2) nodes that follow, each with one of its leaders.
    """

    stands: np.ndarray = field(default_factory=lambda: NO_PAIRS[:, 0])
    meeting: np.ndarray = field(default_factory=lambda: NO_PAIRS)

    @classmethod
    def sew(cls, cloth: Cloth, stands: np.ndarray, meeting: np.ndarray) -> Self:
        """Return the cloth with these seams; they replace the seams that it has."""
        own = {name.name: getattr(cloth, name.name) for name in fields(Cloth)}
        return cls(**own, stands=stands, meeting=meeting)

    @cached_property
    def hinges(self) -> Hinges:
        """The interior edges and those of the seams, each with its two triangles."""
        corners = self.X[self.triangles]
        return Hinges.from_triangles(self.X, self.stands[self.triangles], corners)

    @cached_property
    def edge_slopes(self) -> EdgeSlopes:
        """As of `Cloth`, with the seams among the interior edges."""
        parts = self.parts
        corners = self.X[parts]
        sewn = self.stands[parts].astype(np.int32)
        edges = HalfEdges(self.X, sewn, Hinges.from_triangles(self.X, sewn, corners), corners)
        return EdgeSlopes(edges, super().edge_slopes.region)

    @cached_property
    def neighbours(self) -> np.ndarray:
        """(p, 2) pairs i < j of nodes of triangles that meet at a seam."""
        n = len(self.X)
        m, k = self.stencil.shape
        of_triangle = sparse.csr_matrix(
            (np.ones(m * k), self.stencil.ravel(), np.arange(0, m * k + 1, k)), shape=(m, n)
        )
        ring = of_triangle.T @ of_triangle  # nodes of common triangles
        followed, leaders = self.meeting.T
        meeting = sparse.csr_matrix((np.ones(len(followed)), (followed, leaders)), shape=(n, n))
        pairs = ring @ meeting @ ring
        upper = sparse.triu(pairs + pairs.T, k=1, format="coo")
        return np.column_stack([upper.row, upper.col])
