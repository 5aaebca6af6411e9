"""What a contact touches at the end of a step: there impulses decide with what speed it opens."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
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
    """The p points of a contact that touch, in nodes and between them.

    Attributes
    ----------
    point, node, weight
        For each of e pairs of a point and a node: the part that the node has in the motion of
        the point.
    n, n_at_begin
        Normals (p, 3) at the end and at the begin of the step, of unit length.
    surface, surface_at_begin
        Speeds (p,) of what is touched along these normals [m/s].
    pushed
        Impulses (p,) of the barrier over the step [N s].
    """

    point: np.ndarray
    node: np.ndarray
    weight: np.ndarray
    n: np.ndarray
    n_at_begin: np.ndarray
    surface: np.ndarray
    surface_at_begin: np.ndarray
    pushed: np.ndarray

    @classmethod
    def join(cls, kinds: Sequence[Self]) -> Self:
        """The points of all kinds, in their order."""
        first = np.cumsum([0, *(len(kind.n) for kind in kinds)])  # number of the first of a kind
        numbered = [
            replace(kind, point=kind.point + k) for kind, k in zip(kinds, first, strict=False)
        ]
        return cls(
            *(
                np.concatenate([getattr(kind, each.name) for kind in numbered])
                for each in fields(cls)
            )
        )


def collect(
    points: TouchingPoints, v_at_begin: np.ndarray, held: np.ndarray, restitution: float
) -> Touches | None:
    """Return the m places of the points that push; None if none of them does.

    A point a with the weights w_ia pushes the node i with w_ia Λ₀_a n_a. So the points give the
    node the impulse P_i = Σ_a w_ia Λ₀_a n_a, and all of them are one place: its normal is
    P_i/|P_i|, its Λ₀ is |P_i|, and its surface has the speed of the points, weighted alike. But
    a point stays a place of its own if one of its nodes is `held` (n,): where some nodes cannot
    follow what pushes the point, the others must be faster.

    `v_at_begin` (n, 3) are the velocities of the nodes at the begin [m/s].
    """
    impulse = points.weight * points.pushed[points.point]  # w_ia Λ₀_a
    acts = impulse != 0.0
    if not acts.any():
        return None
    a, i, impulse = points.point[acts], points.node[acts], impulse[acts]
    p, n = len(points.n), len(v_at_begin)
    stays = np.zeros(p, bool)
    stays[a[held[i]]] = True
    # the numbers of nodes, and after them the numbers of points that stay
    numbers, place = np.unique(np.where(stays[a], n + a, i), return_inverse=True)
    m = len(numbers)
    stay = numbers[numbers >= n] - n

    def size_of(normals: np.ndarray) -> np.ndarray:
        """|Σ_a w_ia Λ₀_a n_a| (m,) at nodes, and Λ₀ of points that stay."""
        P = [np.bincount(place, each, m) for each in (impulse[:, None] * normals[a]).T]
        size: np.ndarray = np.linalg.norm(P, axis=0)
        size[numbers >= n] = points.pushed[stay]
        return np.maximum(size, np.finfo(float).tiny)  # impulses may cancel

    size, size_at_begin = size_of(points.n), size_of(points.n_at_begin)
    of_point = np.bincount(a, np.abs(impulse), p)
    parts = np.abs(impulse) / of_point[a] * points.pushed[a] / size[place]
    shares = sparse.csr_matrix((parts, (a, place)), shape=(p, m))
    columns = 3 * i[:, None] + np.arange(3)
    entries = (impulse / size[place])[:, None] * points.n[a]
    rows = sparse.csr_matrix(
        (entries.ravel(), (np.repeat(place, 3), columns.ravel())), shape=(m, 3 * n)
    )
    along = np.einsum("ec,ec->e", points.n_at_begin[a], v_at_begin[i])
    before = np.bincount(place, impulse * along, m) - size * (shares.T @ points.surface_at_begin)
    return Touches(
        rows=rows,
        surface=shares.T @ points.surface,
        before=before / size_at_begin,
        pushed=size,
        restitution=np.full(m, restitution),
        shares=shares,
    )
