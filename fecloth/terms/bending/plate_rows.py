"""Where the products of a plate's stiffness lie in the system matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import FindSlots
from fecloth.terms.bending import plate_loops


@dataclass(frozen=True, eq=False)
class CoupledRows:
    """The blocks of each row e of Q: of the four nodes of e with all nodes of its row.

    Attributes
    ----------
    place
        (entries of Q, 4) which of the row's nodes are those of the entry's hinge.
    start, width
        (h,) first slot of each row, and the number of its nodes u.
    slots
        The blocks, 4 u for each row; −1 where the node of e is held in space.
    own
        (h,) the entry of Q on the diagonal of each row.
    """

    place: np.ndarray
    start: np.ndarray
    width: np.ndarray
    slots: np.ndarray
    own: np.ndarray

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        arrays = self.place, self.start, self.width, self.slots, self.own
        return sum(array.nbytes for array in arrays)

    @classmethod
    def make(
        cls, nodes: np.ndarray, Q: sparse.csr_matrix, slots: FindSlots, pairs: np.ndarray, n: int
    ) -> CoupledRows:
        """Find the blocks of hinges with `nodes` (h, 4) among those of the `pairs` (p, 2)."""
        both, alone = slots(pairs), slots(np.arange(n, dtype=np.int32)[:, None])
        i = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(n)])
        j = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(n)])
        blocks = np.concatenate([both[:, 0, 1], both[:, 1, 0], alone.ravel()])
        order = np.argsort(i * n + j)
        first = np.searchsorted(i[order], np.arange(n + 1))
        width = np.empty(len(nodes), np.int64)
        plate_loops.count_row_nodes(nodes, Q.indptr, Q.indices, n, width)
        start = np.concatenate([[0], np.cumsum(4 * width)])
        place, found = np.empty((Q.nnz, 4), np.int16), np.empty(start[-1], np.int32)
        data = first, j[order], blocks[order], start, width
        missing = plate_loops.fill_rows(nodes, Q.indptr, Q.indices, *data, place, found)
        if missing >= 0:
            what = f"the nodes around hinge {missing}"
            remedy = "Name the regions of both fabrics in the cloth: materials may change there."
            raise InputError(what, "are not all coupled in the matrix", "PlateBending", remedy)
        row = np.repeat(np.arange(len(nodes)), np.diff(Q.indptr))
        return cls(place, start[:-1], width, found, np.flatnonzero(Q.indices == row))
