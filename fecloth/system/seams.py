"""Seams: edges of a cloth that are sewn to others, exactly, by the elimination x = T y."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.errors import InputError, brief, errors_of, flag, is_number
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.mortar import mortar_weights
from fecloth.mesh.selection import Where
from fecloth.mesh.sewn_cloth import SewnCloth
from fecloth.mesh.sewn_edge import SewnEdge
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import ANGLE, HYSTERESIS, TIME
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Pin
from fecloth.system.sewn_nodes import SewnNodes
from fecloth.terms.bending.friction import BendingFriction
from fecloth.terms.bending.seam import SeamBending
from fecloth.terms.traits import has_kind

MOST_EASING = 0.2  # of the longer edge: the most by which two sewn edges may differ in length
SAME_PLACE = 1e-6  # of the length of an edge: so near, two edges are the same but for a shift
PLATE_REMEDY = "Give a number [N m/rad per m], or lay the pieces side by side on the flat cloth."
MOST_GAP = 0.2  # of the shortest edge: a seam with less is closed at the start
SAME_WEIGHT = 1e-9  # weights of two seams of one node that are as near are the same


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
            allowed = 'must be >= 0 N m/rad per m, or "cloth"'
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


@dataclass(frozen=True, eq=False)
class SewnPair:
    """Two edges of a seam on a cloth: nodes (k,) follow nodes (l,) by weights W (k, l)."""

    seam: Seam
    leading: SewnEdge
    following: SewnEdge
    weights: sparse.csr_matrix

    @classmethod
    def of(cls, seam: Seam, cloth: Cloth) -> Self:
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


def _find_pairs(seams: Sequence[Seam], cloth: Cloth) -> list[SewnPair]:
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


def sew(seams: Sequence[Seam], cloth: Cloth, constraints: Constraints) -> Constraints:
    """Return the constraints with the nodes that follow, and with pins on their leaders.

    Nodes that meet whole, with one leader of the weight 1, are one: so corners in several seams,
    and edges in several matching seams, are resolved. Raises `InputError` for a node that
    follows in two other ways, for seams that lead back to themselves, and for a pin on a node
    that follows others that are not pinned alike.
    """
    pairs = _find_pairs(seams, cloth)
    followers = SewnNodes(_resolve(pairs, cloth.X))
    close = np.zeros(len(cloth.X))
    for pair in pairs:
        if pair.seam.close is not None:  # of nodes that are one, any may follow
            nodes = np.append(pair.following.nodes, pair.leading.nodes)
            close[nodes] = np.maximum(close[nodes], pair.seam.close)
    if close.any():
        rows = {
            _column(pair.seam): np.flatnonzero(np.isin(followers.nodes, pair.following.nodes))
            for pair in pairs
            if pair.seam.close
        }
        left = _Closing(close[followers.nodes, None])
        followers = replace(followers, left=left, closing=rows)
    return replace(
        Constraints.of(_pins_on_leaders(constraints, followers.T, cloth), cloth),
        followers=followers,
    )


def sewn_cloth(seams: Sequence[Seam], cloth: Cloth) -> SewnCloth:
    """Return the cloth as bending and contact see it: with the plates that go on across seams.

    Raises `InputError` for a seam with stiffness = "cloth" whose edges do not allow that.
    """
    pairs = _find_pairs(seams, cloth)
    meeting = [
        (node, int(leader))
        for pair in pairs
        for node, leaders, _ in pair.rows()
        for leader in leaders
    ]
    plates = [pair for pair in pairs if pair.seam.stiffness == "cloth"]
    for pair in plates:
        _check_plate(pair, cloth)
    sewn = SewnCloth.sew(cloth, _standing(plates, len(cloth.X)), np.array(meeting))
    joints = len(sewn.hinges.nodes) - len(cloth.hinges.nodes)
    if joints != sum(len(pair.leading.half_edges) for pair in plates):
        what = 'stiffness = "cloth" with the cloth on the same side of both edges'
        raise InputError(what, "needs it on both sides", plates[0].seam.label, PLATE_REMEDY)
    return sewn


def _check_corners(first: SewnEdge, second: SewnEdge, cloth: Cloth, label: str) -> None:
    """Raise `InputError` for edges that meet at a node with one triangle or two.

    Sewn, one triangle would have no area, and two would lie on each other.
    """
    for end in (0, -1):
        node = first.nodes[end]
        count = np.count_nonzero(cloth.triangles == node)
        if node == second.nodes[end] and count <= 2:
            what = f"edges around the corner {_place(cloth.X[node])}, which has {count} triangles"
            allowed = "must have at least 3 there, as sewn ones collapse"
            remedy = "Cut the corner off the mesh, or leave the last nodes of both edges out."
            raise InputError(what, allowed, label, remedy)


def _place(X: np.ndarray) -> str:
    """Where a node is on the flat cloth, in words."""
    return f"({X[0]:.6g}, {X[1]:.6g}) m"


def _check_plate(pair: SewnPair, cloth: Cloth) -> None:
    """Raise `InputError` unless the second edge is the first one, moved without a turn."""
    allowed = "needs edges whose nodes match, and that are parallel"
    matches = len(pair.leading.nodes) == len(pair.following.nodes) == pair.weights.nnz
    if matches:
        shift = cloth.X[pair.following.nodes] - cloth.X[pair.leading.nodes]
        matches = bool(np.ptp(shift, axis=0).max() <= SAME_PLACE * pair.leading.length)
    if not matches:
        raise InputError('stiffness = "cloth"', allowed, pair.seam.label, PLATE_REMEDY)


def _column(seam: Seam) -> str:
    """The name of a seam in the column of its gap."""
    return seam.first if isinstance(seam.first, str) else "seam"


def _resolve(pairs: Sequence[SewnPair], X: np.ndarray) -> sparse.csr_matrix:
    """Return T (n, n) of nodes at X (n, 2): their weights by the nodes that follow none."""
    n = len(X)
    stands = _standing(pairs, n)
    rows = dict(enumerate(zip(stands[:, None], np.ones((n, 1)), strict=True)))
    ruled: dict[int, Seam] = {}
    for pair in pairs:
        for followed, leaders, weights in pair.rows():
            node = int(stands[followed])
            if len(leaders) == 1:
                continue
            if node in ruled:
                what = f"the node at {_place(X[followed])} follows in {ruled[node].label}, too"
                allowed = "must follow in one seam, but at ends and on matching edges"
                remedy = "Make the edges of one of them match, node by node."
                raise InputError(what, allowed, pair.seam.label, remedy)
            ruled[node] = pair.seam
            rows[node] = stands[leaders], weights
    columns, data = (np.concatenate(parts) for parts in zip(*rows.values(), strict=True))
    starts = np.cumsum([0, *(len(leaders) for leaders, _ in rows.values())])
    S = sparse.csr_matrix((data, columns, starts), shape=(n, n))
    S.sum_duplicates()
    T = S
    for _ in range(len(pairs) + 2):  # leaders may follow in other seams
        before, T = T, T @ S
        if abs(T - before).max() <= SAME_WEIGHT:
            T.eliminate_zeros()
            return T
    raise InputError(
        f"the seams {', '.join(sorted({seam.label for seam in ruled.values()}))}",
        "must not lead around in a circle: each edge would follow itself",
        "System(seams=...)",
        "Make the edges of one of them match, node by node.",
    )


def _standing(pairs: Sequence[SewnPair], n: int) -> np.ndarray:
    """The node (n,) that stands for each node: nodes that meet whole are one.

    It is the lowest of those that follow none whole; the lowest of all if there is none.
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


def _pins_on_leaders(
    constraints: Constraints, T: sparse.csr_matrix, cloth: Cloth
) -> dict[str, tuple[Pin, np.ndarray]]:
    """Return the pins by name, each with the nodes (k,) that it holds in place of followers.

    Raises `InputError` for a node that follows others, which no pin holds as it.
    """
    groups = {
        name: (pin, _leaders(pin, nodes, T, name))
        for name, (pin, nodes) in constraints.groups.items()
    }
    for name, (pin, nodes) in constraints.groups.items():
        followed = nodes[np.diff(T[nodes].indptr) > 1]
        P = pin.projector
        held = [
            own
            for other, own in groups.values()
            if other is pin
            or (
                not (pin.moves or other.moves) and np.allclose(P @ other.projector, other.projector)
            )
        ]
        is_held = np.isin(np.arange(len(cloth.X)), np.concatenate(held)).astype(float)
        # the weights of all leaders, and those of the leaders that are held
        free = followed[(abs(T[followed]) @ (1.0 - is_held)) > SAME_WEIGHT]
        if len(free):
            place = _place(cloth.X[free[0]])
            what = f"pin {name!r} holds the node at {place}, which follows a seam"
            remedy = "Pin the other edge of the seam, which leads, or leave the node out."
            raise InputError(what, "must hold the nodes that it follows, too", "Seam", remedy)
    return groups


def _leaders(pin: Pin, nodes: np.ndarray, T: sparse.csr_matrix, name: str) -> np.ndarray:
    """Return the nodes (k,) that a pin holds: leaders in place of nodes that are one with them.

    Nodes that follow several others are left out. Raises `InputError` for a motion by node.
    """
    W = T[nodes]
    is_one = np.diff(W.indptr) == 1
    leaders = W.indices[W.indptr[:-1][is_one]].astype(np.int64)
    if is_one.all() and np.array_equal(leaders, nodes):
        return nodes
    if pin.displacement(0.0).ndim == 2:
        what = f"pin {name!r} on a seam, with a motion for each node"
        raise InputError(what, "must move all nodes alike", "Seam", "Pin the edge that leads.")
    return np.unique(leaders)


@dataclass(frozen=True, eq=False)
class _Closing:
    """The part of each gap that is left at a time, and its rate; see `Seam`.

    Attributes
    ----------
    close
        (k, 1) the time at which it is closed [s]; 0 if it is from the start.
    """

    close: np.ndarray

    def __call__(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the part (k, 1) that is left at t [s], and its rate [1/s]."""
        ends = np.where(self.close > 0, self.close, 1.0)
        s = np.where(self.close > 0, np.clip(t / ends, 0.0, 1.0), 1.0)
        left = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return np.where(s < 1.0, left, 0.0), -30.0 * (s * (1.0 - s)) ** 2 / ends
