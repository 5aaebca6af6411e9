"""What a contact touches at the end of a step: there impulses decide with what speed it opens."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sparse


@dataclass(frozen=True, eq=False)
class Touches:
    """The m places of contacts at the end of a step.

    A place opens with the speed u = rows v − surface [m/s]; it closes where u < 0.

    Attributes
    ----------
    rows
        Gradients (m, 3n) of the distances, of unit length in space.
    surface
        Speeds (m,) of what is touched, along these [m/s].
    before
        Speeds (m,) with which the places opened at the begin of the step [m/s].
    pushed
        Impulses (m,) of the barrier over the step [N s].
    restitution
        Part e (m,) of its speed that an impact leaves.
    shares
        (p, m) the parts of the impulses that act at the p points for which friction needs them.
    """

    rows: sparse.csr_matrix
    surface: np.ndarray
    before: np.ndarray
    pushed: np.ndarray
    restitution: np.ndarray
    shares: sparse.csr_matrix

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """All places of several contacts."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            rows=sparse.vstack([part.rows for part in parts], format="csr"),
            surface=np.concatenate([part.surface for part in parts]),
            before=np.concatenate([part.before for part in parts]),
            pushed=np.concatenate([part.pushed for part in parts]),
            restitution=np.concatenate([part.restitution for part in parts]),
            shares=sparse.block_diag([part.shares for part in parts], format="csr"),
        )


@dataclass(frozen=True, eq=False)
class TouchingPoints:
    """The p points of one kind that touch an obstacle, in nodes and between them.

    Attributes
    ----------
    nodes, weights
        The nodes (p, k) of each point, and their parts in the values there.
    n, n_at_begin
        Normals (p, 3) at the end and at the begin of the step, of unit length.
    surface, surface_at_begin
        Speeds (p,) of what is touched along these normals [m/s].
    pushed
        Impulses (p,) of the barrier over the step [N s].
    """

    nodes: np.ndarray
    weights: np.ndarray
    n: np.ndarray
    n_at_begin: np.ndarray
    surface: np.ndarray
    surface_at_begin: np.ndarray
    pushed: np.ndarray


def touches_at_nodes(
    kinds: Sequence[TouchingPoints], v_at_begin: np.ndarray, restitution: float
) -> Touches:
    """Return the touches of the m nodes that the points of all `kinds` push together.

    A point a with the weights w_ia pushes the node i with w_ia Λ₀_a n_a. So the barrier gives the
    node the impulse P_i = Σ_a w_ia Λ₀_a n_a: its normal is P_i/|P_i|, its Λ₀ is |P_i|, and its
    surface has the speed of the points, weighted alike. `v_at_begin` (n, 3) are the velocities of
    the nodes at the begin [m/s].
    """
    all_nodes = np.concatenate([kind.nodes.ravel() for kind in kinds])
    impulses = [kind.weights * kind.pushed[:, None] for kind in kinds]  # w_ia Λ₀_a

    def collect(name: str) -> np.ndarray:
        """Σ_a w_ia Λ₀_a times the values (p, …) of this name at the points, at all nodes."""
        values = [
            impulse[..., None] * getattr(kind, name).reshape(len(impulse), 1, -1)
            for kind, impulse in zip(kinds, impulses, strict=True)
        ]
        flat = np.concatenate([value.reshape(-1, value.shape[-1]) for value in values])
        n = len(v_at_begin)
        return np.stack([np.bincount(all_nodes, each, n) for each in flat.T], axis=1)

    P = collect("n")
    size = np.linalg.norm(P, axis=1)
    nodes = np.flatnonzero(size)
    P_at_begin = collect("n_at_begin")[nodes]
    along_begin = np.einsum("mi,mi->m", P_at_begin, v_at_begin[nodes])
    along_begin -= collect("surface_at_begin")[nodes, 0]
    m = len(nodes)
    columns = 3 * nodes[:, None] + np.arange(3)
    normals = P[nodes] / size[nodes, None]
    rows = (normals.ravel(), columns.ravel(), np.arange(0, 3 * m + 1, 3))
    place = np.cumsum(size > 0.0) - 1  # number of a pushed node among the pushed nodes
    parts = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    counts = np.concatenate([np.full(*kind.nodes.shape) for kind in kinds])
    shares = (
        np.concatenate([impulse.ravel() for impulse in impulses]) * parts[all_nodes],
        np.maximum(place, 0)[all_nodes],
        np.concatenate([[0], np.cumsum(counts)]),
    )
    return Touches(
        rows=sparse.csr_matrix(rows, shape=(m, v_at_begin.size)),
        surface=collect("surface")[nodes, 0] / size[nodes],
        before=along_begin / np.linalg.norm(P_at_begin, axis=1),
        pushed=size[nodes],
        restitution=np.full(m, restitution),
        shares=sparse.csr_matrix(shares, shape=(len(counts), m)),
    )


def collect_at_nodes(
    normals: sparse.csr_matrix, pushed: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, sparse.csr_matrix]:
    """Return the rows (k, 3n), impulses Λ₀ (k,) and `shares` (m, k) of k places of m pairs.

    The `normals` (m, 3n) are the gradients of the distances from what is fixed, and `pushed` (m,)
    the impulses of the barrier. All pairs that touch one node of the cloth alone are one place:
    its impulse is Σ Λ₀_a n_a, as in `touches_at_nodes`. A pair that touches between nodes stays a
    place of its own: where some of its nodes are held, the free nodes must move faster than what
    pushes them.
    """
    is_at_node = np.diff(normals.indptr) == 3
    first = normals.indices[normals.indptr[:-1][is_at_node]] // 3
    nodes, place_of_node = np.unique(first, return_inverse=True)
    m = len(pushed)
    places = len(nodes) + np.cumsum(~is_at_node) - 1
    places[is_at_node] = place_of_node
    k = len(nodes) + (~is_at_node).sum()
    parts = sparse.csr_matrix((pushed, (places, np.arange(m))), shape=(k, m))
    P = (parts @ normals).tocsr()
    size = np.array(P.power(2).sum(axis=1)).ravel() ** 0.5
    size[len(nodes) :] = pushed[~is_at_node]  # such a row keeps the weights of its nodes
    acts = size > 0.0
    per_size = sparse.diags(1 / size[acts])
    return (per_size @ P[acts]).tocsr(), size[acts], (parts[acts].T @ per_size).tocsr()
