"""The elimination x = T y of seams: which node follows which, and what the pins hold then."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError, brief
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Pin
from fecloth.system.sewn_nodes import SewnNodes
from fecloth.system.sewn_pairs import SewnPair, find_pairs, place_of, standing_nodes

SAME_WEIGHT = 1e-9  # weights of two seams of one node that are as near are the same


def sew(seams: Sequence, cloth: Cloth, constraints: Constraints) -> Constraints:
    """Return the constraints with the nodes that follow, and with pins on their leaders.

    Nodes that meet whole, with one leader of the weight 1, are one: so corners in several seams,
    and edges in several matching seams, are resolved. Raises `InputError` for a node that
    follows in two other ways, for seams that lead back to themselves, and for a pin on a node
    that follows others that are not pinned alike.
    """
    pairs = find_pairs(seams, cloth)
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
    groups = _pins_on_leaders(constraints, followers.T, cloth, pairs)
    try:
        on_leaders = Constraints.of(groups, cloth)
    except InputError as error:
        remedy = "Sewn nodes are one: pin the edge that leads, and leave the other one out."
        raise InputError(error.what, error.allowed, "Seam", remedy) from None
    return replace(on_leaders, followers=followers)


def _column(seam: Any) -> str:
    """The name of a seam in the column of its gap."""
    return seam.first if isinstance(seam.first, str) else "seam"


def _resolve(pairs: Sequence[SewnPair], X: np.ndarray) -> sparse.csr_matrix:
    """Return T (n, n) of nodes at X (n, 2): their weights by the nodes that follow none."""
    n = len(X)
    stands = standing_nodes(pairs, n)
    rows = dict(enumerate(zip(stands[:, None], np.ones((n, 1)), strict=True)))
    ruled: dict[int, Any] = {}
    for pair in pairs:
        for followed, leaders, weights in pair.rows():
            node = int(stands[followed])
            if len(leaders) == 1:
                continue
            if node in ruled:
                what = f"the node at {place_of(X[followed])} follows in {ruled[node].label}, too"
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


def _pins_on_leaders(
    constraints: Constraints, T: sparse.csr_matrix, cloth: Cloth, pairs: Sequence[SewnPair]
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
            place = place_of(cloth.X[free[0]])
            what = f"pin {name!r} holds the node at {place}, which follows a seam"
            leads = (brief(p.leading.where) for p in pairs if free[0] in p.following.nodes)
            remedy = f"Pin {next(leads, 'the other edge')}, which leads, and leave this edge out: "
            remedy += "the pin holds both edges."
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
