"""Where the blocks of each stencil lie in the matrix of a system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakValueDictionary

import numpy as np

from fecloth.linalg.block_matrix import BlockPattern


@dataclass(frozen=True, eq=False)
class MatrixLayout:
    """The pattern of a matrix and the blocks of its stencils, found when they are first needed.

    Explicit methods form no matrix, and pay for none.

    Examples
    --------
    >>> layout = MatrixLayout(3, (np.array([[0, 2]], dtype=np.int32),))
    >>> layout.pattern.indices.tolist()
    [0, 2, 1, 0, 2]
    >>> layout.slots(layout.stencils[0]).tolist()
    [[[0, 1], [3, 4]]]
    """

    n: int  # number of nodes
    stencils: Sequence[np.ndarray]  # (m, k) nodes that the terms couple, one array for each term
    _shared: WeakValueDictionary[int, np.ndarray] = field(
        default_factory=WeakValueDictionary, init=False, repr=False
    )

    @cached_property
    def pattern(self) -> BlockPattern:
        """The union of the stencils, and the diagonal."""
        return BlockPattern.union(self.n, self.stencils)

    def slots(self, stencil: np.ndarray) -> np.ndarray:
        """(m, k, k) int32 block of each pair of nodes of a stencil; see `BlockPattern.slots`.

        Terms with one stencil share one array, as long as one of them holds it.
        """
        shared = [number for number, known in enumerate(self.stencils) if known is stencil]
        if not shared:
            return self.pattern.slots(stencil)
        if (slots := self._shared.get(shared[0])) is None:
            self._shared[shared[0]] = slots = self.pattern.slots(stencil)
        return slots
