"""How much of the forces on pinned nodes can come from the cloth that moves."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints


@dataclass(frozen=True, eq=False)
class ReactionLimits:
    """Limits for the nodes of triangles that the pins hold whole.

    Such triangles push on each other as hard as their stiffness and strain have it. A steel
    grip that is held at a strain of 1 % would hide every force of the cloth in it. The force
    of the cloth on a node is at most about Σ ‖K_ij‖ l_ij over the nodes j that move, at a
    distance l_ij: its stiffness at rest times a strain of 1.

    Attributes
    ----------
    nodes
        (k,) nodes of triangles that are held whole; none in most systems.
    largest
        (k,) the largest force on each of them [N].
    """

    nodes: np.ndarray
    largest: np.ndarray

    @classmethod
    def find(
        cls, cloth: Cloth, constraints: Constraints, stiffness: Callable[[], BlockMatrix]
    ) -> Self:
        """Find the nodes of triangles that are held whole, and the largest force on each.

        `stiffness` makes K of the flat cloth at rest. It is called only if there are such
        triangles.
        """
        is_pinned = np.zeros(len(cloth.X), bool)
        is_pinned[constraints.nodes] = ~constraints.projectors.any(axis=(1, 2))
        nodes = np.unique(cloth.stencil[is_pinned[cloth.stencil].all(axis=1)])
        if not len(nodes):
            return cls(nodes, np.zeros(0))
        K = stiffness()
        pattern = K.pattern
        way = np.linalg.norm(cloth.X[pattern.rows] - cloth.X[pattern.indices], axis=1)
        force = np.linalg.norm(K.values, axis=(1, 2)) * way
        force[is_pinned[pattern.indices]] = 0.0  # only nodes that move count
        largest = np.bincount(pattern.rows, force, len(cloth.X))[nodes]
        # where K is not finite, as that of a gas at rest, there is no limit
        return cls(nodes, np.where(np.isfinite(largest), largest, np.inf))

    def apply(self, f: np.ndarray) -> np.ndarray:
        """Return the forces (n, 3) with none above its limit; f itself if there are no limits."""
        if not len(self.nodes):
            return f
        f = f.copy()
        sizes = np.linalg.norm(f[self.nodes], axis=1)
        f[self.nodes] *= np.minimum(1.0, self.largest / np.maximum(sizes, 1e-300))[:, None]
        return f
