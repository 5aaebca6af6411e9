"""Seams: edges of a cloth that are sewn to others, exactly, by the elimination x = T y."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np

from fecloth.errors import InputError, brief, errors_of, flag, is_number
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.selection import Where
from fecloth.mesh.sewn_edge import SewnEdge
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import ANGLE, HYSTERESIS, TIME
from fecloth.system.constraints import Constraints
from fecloth.system.elimination import sew
from fecloth.system.sewn_pairs import SewnPair, place_of, sewn_cloth
from fecloth.terms.bending.friction import BendingFriction
from fecloth.terms.bending.seam import SeamBending
from fecloth.terms.traits import has_kind

MOST_EASING = 0.2  # of the longer edge: the most by which two sewn edges may differ in length
MOST_GAP = 0.2  # of the shortest edge: a seam with less is closed at the start


@checks_arguments
@dataclass(frozen=True)
class Seam:
    """Two edges of a cloth, or of its pieces, that are sewn together.

    The edge with the longer triangles leads, and the other one follows: its nodes are no
    unknowns, but x = W x_L with the weights of `fecloth.mesh.mortar`. So a seam has no stiffness
    and no slack, the nodes of both edges need not match, and a constant stress passes exactly.
    The mass of a node that follows is with its leaders, by the same weights, and a pin on it
    holds its leader.

    Edges of different lengths are eased: points at the same part of each length meet.

    Parameters
    ----------
    first
        An edge: the name of an edge set or a node set, as "left", or "front.left" of a piece; in
        Python also node indices, or a predicate on X. It must be one path along the border. It
        begins at its end of the lower X, or of the lower Y at the same X; a closed border begins
        at its node of the largest X, and goes around counter-clockwise.
    second
        The edge that is sewn to it, likewise.
    reverse
        Whether the second edge begins at its other end.
    stiffness
        0.0: both sides turn freely, as on a hinge. A number: the moment per length and angle
        [N] (N m per m and rad), see `SeamBending`. "cloth": the cloth's own bending goes on, as
        inside a piece. Then the nodes of the edges must match, and one edge must be the other
        one, moved without a turn, with the cloth on its other side.
    angle
        The angle of a seam with a stiffness at which it has no moment [rad].
    close
        Time [s] at which a seam is closed that is open at the start: the gap closes by
        1 − s³ (10 − 15 s + 6 s²), s = t/close. In load steps it is the part of the loads. Its
        work is ``work:seams`` in the energy ledger, and the largest gap along the first edge is
        recorded as ``gap:NAME``. None: it is closed at the start.

    Examples
    --------
    >>> import fecloth as fc
    >>> strip = fc.Cloth.rectangle(1.0, 0.2, h=0.1, pattern="right")
    >>> cloth = fc.Cloth.join([strip, strip], names=["front", "back"])
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> seams = [fc.Seam("front.left", "back.left"), fc.Seam("front.right", "back.right")]
    >>> system = fc.System(cloth, fabric, [fc.StVK()], seams=seams)
    >>> len(cloth.X), len(system.free) // 3, round(system.total_mass, 12)
    (66, 60, 0.08)
    """

    first: Where
    second: Where
    reverse: bool = False
    stiffness: Annotated[float | Literal["cloth"], HYSTERESIS] = 0.0
    angle: Annotated[float, ANGLE] = 0.0
    close: Annotated[float | None, TIME] = None

    def __post_init__(self):
        """Raise `InputError` for wrong values."""
        flag("reverse", self.reverse, "Seam")
        k = self.stiffness
        if k != "cloth" and not (is_number(k) and k >= 0):
            allowed = 'must be >= 0 N, or "cloth"'
            raise InputError(f"stiffness = {k!r}", allowed, self.label)
        if not (is_number(self.angle) and abs(self.angle) < np.pi):
            raise InputError(f"angle = {self.angle!r}", "must be between -π and π", self.label)
        if self.angle and (k == "cloth" or not k):
            remedy = "Give the moment per length and angle, as stiffness = 0.001 [N]."
            what = f"angle = {self.angle:.6g} with stiffness = {k!r}"
            raise InputError(what, "needs a number > 0 as its stiffness", self.label, remedy)
        if self.close is not None and not (is_number(self.close) and self.close > 0):
            raise InputError(f"close = {self.close!r}", "must be > 0 s, or None", self.label)

    @property
    def label(self) -> str:
        """What errors call it."""
        return f"Seam({brief(self.first)}, {brief(self.second)})"

    def complete(self, seams: "Sequence[Seam]", cloth: Cloth, terms: tuple) -> tuple[Cloth, tuple]:
        """Return the cloth and the terms of a system with these seams, of which this is one.

        Raises `InputError` for a seam whose bending goes on where no term bends.
        """
        bends = has_kind(terms, "bending") or any(isinstance(t, BendingFriction) for t in terms)
        for seam in seams:
            if seam.stiffness == "cloth" and not bends:
                remedy = "Add PlateBending, or leave the stiffness out: the seam is a hinge then."
                allowed = "needs a term of bending, which goes on"
                raise InputError('stiffness = "cloth"', allowed, seam.label, remedy)
            bending = seam.bending(cloth)
            if bending and bending not in terms:
                terms = (*terms, bending)
        return sewn_cloth(seams, cloth), terms

    def sew(self, seams: "Sequence[Seam]", cloth: Cloth, constraints: Constraints) -> Constraints:
        """Return the constraints of a cloth with all its seams, of which this is one."""
        return sew(seams, cloth, constraints)

    def edges(self, cloth: Cloth) -> tuple[SewnEdge, SewnEdge]:
        """Return the edge that leads and the one that follows; raise `InputError` for others."""
        with errors_of(self.label, f"first = {brief(self.first)}: "):
            first = SewnEdge.find(cloth, self.first)
        with errors_of(self.label, f"second = {brief(self.second)}: "):
            second = SewnEdge.find(cloth, self.second)
        second = second.reversed() if self.reverse else second
        if np.intersect1d(first.nodes[1:-1], second.nodes[1:-1]).size:
            raise InputError("an edge sewn to itself", "must be sewn to another", self.label)
        _check_corners(first, second, cloth, self.label)
        for i, j in ((0, -1), (-1, 0)):
            if first.nodes[i] == second.nodes[j] and first.nodes[i] != first.nodes[j]:
                what = f"edges that meet at {place_of(cloth.X[first.nodes[i]])} by different ends"
                remedy = f"Write reverse = {str(not self.reverse).lower()}."
                raise InputError(what, "must both begin there, or both end", self.label, remedy)
        lengths = first.length, second.length
        if max(lengths) * (1 - MOST_EASING) > min(lengths):
            what = f"edges of {lengths[0]:.4g} m and {lengths[1]:.4g} m"
            allowed = f"must not differ by more than {MOST_EASING:.0%}"
            remedy = "Is one of them a part of what you mean? A name may stand for a longer edge."
            raise InputError(what, allowed, self.label, remedy)
        if len(second.half_edges) < len(first.half_edges):
            return second, first
        return first, second

    def bending(self, cloth: Cloth) -> SeamBending | None:
        """Return the term of a seam with a number as its stiffness; None for others."""
        k = self.stiffness
        if isinstance(k, str) or not k:
            return None
        leading, _ = self.edges(cloth)
        # the first edge is never turned: the other one is, from where it begins
        first, second = self.first, self.second
        if leading.where is not first:
            first, second = second, first
        return SeamBending(first, second, float(k), self.angle, self.reverse)

    def check_start(self, system: Any, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for a seam that is open at the positions x (n, 3) of a start.

        A gap up to a fifth of the shortest edge is closed at once, as between circles of chords.
        """
        if self.close is not None and t < self.close:
            return
        cloth = system.cloth
        gap, shortest = self.gap(cloth, x)
        if gap <= MOST_GAP * shortest:
            return
        turned, _ = replace(self, reverse=not self.reverse).gap(cloth, x)
        what = f"{self.label} is open by {gap:.4g} m"
        remedy = 'Give the time to close it, as close = "0.2 s".'
        if turned <= MOST_GAP * shortest:
            remedy = f"It is closed with reverse = {str(not self.reverse).lower()}."
        raise InputError(what, "must be closed at the start", where or "Seam", remedy)

    def gap(self, cloth: Cloth, x: np.ndarray) -> tuple[float, float]:
        """Return the largest gap at x (n, 3), and the shortest edge along the seam [m]."""
        pair = SewnPair.of(self, cloth)
        gaps = x[pair.following.nodes] - pair.weights @ x[pair.leading.nodes]
        both = pair.leading, pair.following
        shortest = min(float(np.diff(edge.places).min()) * edge.length for edge in both)
        return float(np.linalg.norm(gaps, axis=1).max()), shortest


def _check_corners(first: SewnEdge, second: SewnEdge, cloth: Cloth, label: str) -> None:
    """Raise `InputError` for edges that meet at a node with one triangle or two.

    Sewn, one triangle would have no area, and two would lie on each other.
    """
    for end in (0, -1):
        node = first.nodes[end]
        count = np.count_nonzero(cloth.triangles == node)
        if node == second.nodes[end] and count <= 2:
            what = f"edges around the corner {place_of(cloth.X[node])}, which has {count} triangles"
            allowed = "must have at least 3 there, as sewn ones collapse"
            remedy = "Cut the corner off the mesh, or leave the last nodes of both edges out."
            raise InputError(what, allowed, label, remedy)
