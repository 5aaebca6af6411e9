"""What a contact touches at the end of a step: there impulses decide with what speed it opens."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sparse


@dataclass(frozen=True, eq=False)
class Touches:
    """The m places of contacts at the end of a step: all points that touch.

    A place opens with the speed u = rows v − surface [m/s]; it closes where u < 0. A place between
    nodes stays a place of its own. If each node of it were stopped instead, a cloth could not
    turn about the edge of a body, nor could free nodes follow what pushes beside held nodes.

    Attributes
    ----------
    rows
        Gradients (m, 3n) of the distances.
    surface
        Speeds (m,) of what is touched, along these [m/s].
    before
        Speeds (m,) with which the places opened at the begin of the step [m/s].
    pushed
        Impulses (m,) of the barrier over the step [N s].
    restitution
        Part e (m,) of its speed that an impact leaves.
    """

    rows: sparse.csr_matrix
    surface: np.ndarray
    before: np.ndarray
    pushed: np.ndarray
    restitution: np.ndarray

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """All places of several contacts, in their order."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            rows=sparse.vstack([part.rows for part in parts], format="csr"),
            surface=np.concatenate([part.surface for part in parts]),
            before=np.concatenate([part.before for part in parts]),
            pushed=np.concatenate([part.pushed for part in parts]),
            restitution=np.concatenate([part.restitution for part in parts]),
        )


def gradients(weights: sparse.csr_matrix, n: np.ndarray) -> sparse.csr_matrix:
    """Return the matrix (m, 3 nodes) of v ↦ n_a · Σ_i w_ai v_i, of places with normals n (m, 3).

    `weights` (m, nodes) are the parts w_ai that the nodes have in the motion of the places.
    """
    parts = weights.tocoo()
    along_normals = parts.data[:, None] * n[parts.row]
    rows = np.repeat(parts.row, 3)
    columns = 3 * parts.col[:, None] + np.arange(3)
    entries = along_normals.ravel(), (rows, columns.ravel())
    return sparse.csr_matrix(entries, shape=(len(n), 3 * weights.shape[1]))
