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
    """

    rows: sparse.csr_matrix
    surface: np.ndarray
    before: np.ndarray
    pushed: np.ndarray
    restitution: np.ndarray

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """All places of several contacts."""
        return cls(
            rows=sparse.vstack([part.rows for part in parts], format="csr"),
            surface=np.concatenate([part.surface for part in parts]),
            before=np.concatenate([part.before for part in parts]),
            pushed=np.concatenate([part.pushed for part in parts]),
            restitution=np.concatenate([part.restitution for part in parts]),
        )


def rows_of(weights: sparse.csr_matrix, normals: np.ndarray) -> sparse.csr_matrix:
    """Return the rows (m, 3n) of points with the shape functions (m, n) and normals (m, 3)."""
    entries = weights.tocoo()
    columns = 3 * entries.col[:, None] + np.arange(3)
    values = entries.data[:, None] * normals[entries.row]
    places = (np.repeat(entries.row, 3), columns.ravel())
    shape = (weights.shape[0], 3 * weights.shape[1])
    return sparse.csr_matrix((values.ravel(), places), shape=shape)
