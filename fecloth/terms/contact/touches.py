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
    weights
        (p, n) the parts of the nodes in the values at the points.
    n, n_at_begin
        Normals (p, 3) at the end and at the begin of the step, of unit length.
    surface, surface_at_begin
        Speeds (p,) of what is touched along these normals [m/s].
    pushed
        Impulses (p,) of the barrier over the step [N s].
    """

    weights: sparse.csr_matrix
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
    weights = sparse.vstack([kind.weights for kind in kinds], format="csr")
    pushed = np.concatenate([kind.pushed for kind in kinds])
    impulses = (weights.T @ sparse.diags(pushed)).tocsr()  # (n, p) w_ia Λ₀_a
    P = impulses @ np.concatenate([kind.n for kind in kinds])
    size = np.linalg.norm(P, axis=1)
    nodes = np.flatnonzero(size)
    size = size[nodes]
    impulses = impulses[nodes]
    P_at_begin = impulses @ np.concatenate([kind.n_at_begin for kind in kinds])
    along_begin = np.einsum("mi,mi->m", P_at_begin, v_at_begin[nodes])
    along_begin -= impulses @ np.concatenate([kind.surface_at_begin for kind in kinds])
    node_weights = sparse.identity(len(v_at_begin), format="csr")[nodes]
    return Touches(
        rows=rows_of(node_weights, P[nodes] / size[:, None]),
        surface=impulses @ np.concatenate([kind.surface for kind in kinds]) / size,
        before=along_begin / np.linalg.norm(P_at_begin, axis=1),
        pushed=size,
        restitution=np.full(len(nodes), restitution),
        shares=(sparse.diags(1 / size) @ impulses).T.tocsr(),
    )


def rows_of(weights: sparse.csr_matrix, normals: np.ndarray) -> sparse.csr_matrix:
    """Return the rows (m, 3n) of points with the shape functions (m, n) and normals (m, 3)."""
    entries = weights.tocoo()
    columns = 3 * entries.col[:, None] + np.arange(3)
    values = entries.data[:, None] * normals[entries.row]
    places = (np.repeat(entries.row, 3), columns.ravel())
    shape = (weights.shape[0], 3 * weights.shape[1])
    return sparse.csr_matrix((values.ravel(), places), shape=shape)
