"""Bending along a seam: a hinge between the two edges that are sewn."""

from dataclasses import dataclass

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.mortar import common_pieces
from fecloth.mesh.selection import Where
from fecloth.mesh.sewn_edge import SewnEdge
from fecloth.quantities.arguments import checks_arguments
from fecloth.terms.bending.hinge import KERNELS, BoundHinges
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.traits import BOTH, TermTraits


@checks_arguments
@dataclass(frozen=True)
class SeamBending:
    """½ k ∫ (θ − θ₀)² ds along a seam, with the angle θ between the triangles on both sides.

    It is a sum over the common pieces of both edges, each with one triangle on either side. θ is
    the dihedral angle (`dihedral_angle`) about the edge that leads, of the two corners opposite
    to it; s is measured on that edge, where the cloth is flat. On P2 the triangles are the parts
    between neighbouring nodes. `Seam(stiffness=k)` adds this term to its system.

    Source: a rotational spring along a line. Where the edges match, it is the hinge of
    `HingeBending` with k l in place of its stiffness.

    Valid for angles within ±π: seams that are folded flat have no sign. Where the edges do not
    match, the line between them and the edge that leads is taken as straight, with an error of
    the order of the element size.

    Cost: proportional to the number of pieces; each costs as much as a hinge.

    Parameters
    ----------
    leading, following
        The edges, as of `Seam`.
    stiffness
        k, the moment per length of the seam and angle [N m/rad per m].
    angle
        θ₀ [rad].
    reverse
        Whether the edge that follows begins at its other end.
    """

    leading: Where
    following: Where
    stiffness: float
    angle: float = 0.0
    reverse: bool = False

    traits = TermTraits(elements=BOTH)

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """(p, 4) the nodes of the hinge of each piece."""
        return self._hinges(cloth)[0]

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the term on a panel."""
        nodes, lengths = self._hinges(panel.cloth)
        return BoundSeam.bind(
            "SeamBending",
            KERNELS,
            convex=(False,),  # ∂²θ is indefinite
            panel=panel,
            slots=slots,
            nodes=nodes,
            constants=np.full((len(nodes), 1), self.angle),
            stiffness=self.stiffness * lengths,
        )

    def _hinges(self, cloth: Cloth) -> tuple[np.ndarray, np.ndarray]:
        """The nodes (p, 4) of the hinge of each piece of the seam, and its length (p,) [m]."""
        leading = SewnEdge.find(cloth, self.leading)
        following = SewnEdge.find(cloth, self.following)
        following = following.reversed() if self.reverse else following
        places, own_places = leading.node_places(), following.node_places()
        cuts = common_pieces(places, own_places)
        middle = (cuts[1:] + cuts[:-1]) / 2
        edge = np.searchsorted(places, middle) - 1
        other = np.searchsorted(own_places, middle) - 1
        first, last, apex = _oriented(cloth, leading.nodes[edge], leading.nodes[edge + 1])
        *_, opposite = _oriented(cloth, following.nodes[other], following.nodes[other + 1])
        nodes = np.column_stack([first, last, apex, opposite]).astype(np.int32)
        return nodes, np.diff(cuts) * leading.length


class BoundSeam(BoundHinges):
    """`SeamBending` on a cloth: a sum over pieces of a line."""

    # a spring, and no strain of the cloth: what is wrong beside it is in strain and curvature
    stores_strain = False


def _oriented(
    cloth: Cloth, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The ends (p,) of border edges a b, turned so that their triangle lies left, and its apex."""
    n = len(cloth.X)
    start, end, apex = (np.roll(cloth.parts, -shift, axis=1).ravel() for shift in range(3))
    keys = start.astype(np.int64) * n + end
    order = np.argsort(keys)
    place = order[np.minimum(np.searchsorted(keys[order], a * n + b), len(keys) - 1)]
    is_forward = keys[place] == a * n + b
    first, last = np.where(is_forward, a, b), np.where(is_forward, b, a)
    place = order[np.searchsorted(keys[order], first * n + last)]
    return first, last, apex[place]
