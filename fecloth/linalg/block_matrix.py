"""A sparse matrix of 3×3 blocks with a fixed pattern, one block per pair of coupled nodes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakValueDictionary

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.team import ALONE, Team
from fecloth.errors import InputError

FindSlots = Callable[[np.ndarray], np.ndarray]
"""A function as `BlockPattern.slots`."""


@dataclass(frozen=True)
class BlockPattern:
    """The pairs of coupled nodes, as compressed rows of 3×3 blocks.

    The pattern always contains the diagonal.

    Attributes
    ----------
    indptr
        (n + 1,) int32: row i has the blocks indptr[i] … indptr[i + 1] − 1.
    indices
        (b,) int32 column of each block, ascending within a row.
    """

    indptr: np.ndarray
    indices: np.ndarray

    @classmethod
    def union(cls, n: int, stencils: Sequence[np.ndarray]) -> "BlockPattern":
        """Return the pattern over `n` nodes that couples the nodes of each row of each stencil.

        A stencil (m, k) has the k nodes of each of m elements. Nodes of no stencil are coupled
        with themselves only.
        """
        distinct = {id(stencil): stencil for stencil in stencils}  # terms may share an array
        diagonal = np.arange(n, dtype=np.int32)[:, None]
        coupled = [diagonal, *distinct.values()]
        nodes = np.concatenate([stencil.ravel() for stencil in coupled])
        nodes = nodes.astype(np.int32, copy=False)
        widths = [np.full(len(stencil), stencil.shape[1]) for stencil in coupled]
        start = np.concatenate([[0], np.cumsum(np.concatenate(widths))])
        # E has a row for each element, with a 1 in the column of each of its nodes. So Eᵀ E has
        # an entry for each pair of nodes with a common element.
        E = sparse.csr_array((np.ones(len(nodes), bool), nodes, start), (len(start) - 1, n))
        product = (E.T @ E).tocsr()
        product.sort_indices()
        return cls(
            product.indptr.astype(np.int32, copy=False),
            product.indices.astype(np.int32, copy=False),
        )

    def __len__(self) -> int:
        return len(self.indptr) - 1

    def same_as(self, other: "BlockPattern | None") -> bool:
        """Whether the blocks are the same.

        Arrays are compared, because contact often repeats an earlier pattern in a new object.
        """
        if other is None or other is self:
            return other is self
        return np.array_equal(self.indptr, other.indptr) and np.array_equal(
            self.indices, other.indices
        )

    def slots(self, stencil: np.ndarray) -> np.ndarray:
        """Return the number of the block of each pair of nodes of a stencil (m, k).

        The result (m, k, k) is int32, with the pair (stencil[e, a], stencil[e, b]) at [e, a, b].
        Raises `InputError` for a pair that the pattern does not contain.
        """
        m, k = stencil.shape
        slots = np.empty((m, k, k), np.int32)
        missing_row = _find_slots(self.indptr, self.indices, stencil, slots)
        if missing_row >= 0:
            what = f"nodes {stencil[missing_row].tolist()}"
            remedy = "Use the same array in `stencil` and `slots`."
            raise InputError(what, "are not all coupled in the matrix", "BlockPattern", remedy)
        return slots

    @cached_property
    def diagonal(self) -> np.ndarray:
        """(n,) int32 numbers of the blocks on the diagonal."""
        return self.slots(np.arange(len(self), dtype=np.int32)[:, None]).ravel()

    @cached_property
    def rows(self) -> np.ndarray:
        """(b,) int32 row of each block."""
        return np.repeat(np.arange(len(self), dtype=np.int32), np.diff(self.indptr))


def find_entries(matrix: sparse.csr_matrix, find_slots: FindSlots) -> np.ndarray:
    """(e,) number of the block of each entry of an (n, n) matrix.

    The matrix acts on each component alike, as the mass does.
    """
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    pairs = np.column_stack([rows, matrix.indices]).astype(np.int32)
    return np.ascontiguousarray(find_slots(pairs)[:, 0, 1])


@dataclass(frozen=True)
class BlockMatrix:
    """A sparse matrix of 3×3 blocks.

    Attributes
    ----------
    pattern
        The pairs of coupled nodes.
    values
        (b, 3, 3) the blocks, to which terms add in place.
    team
        The threads that share the work with the matrix.
    """

    pattern: BlockPattern
    values: np.ndarray
    team: Team = ALONE

    @classmethod
    def zeros(cls, pattern: BlockPattern, team: Team = ALONE) -> "BlockMatrix":
        """The matrix of a pattern with values that are all zero."""
        return cls(pattern, np.zeros((len(pattern.indices), 3, 3)), team)

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """A x for x of shape (n, 3)."""
        product: np.ndarray = self.shared @ np.ravel(x).astype(float, copy=False)
        return product.reshape(-1, 3)

    @property
    def shared(self) -> sparse.bsr_matrix:
        """A SciPy matrix with the arrays of this matrix, which are not copied."""
        n = 3 * len(self.pattern)
        arrays = self.values, self.pattern.indices, self.pattern.indptr
        return sparse.bsr_matrix(arrays, shape=(n, n))

    def plus(self, other: sparse.spmatrix) -> "BlockMatrix":
        """The sum with a SciPy matrix (3n, 3n); its pattern is a new object."""
        total = self.shared + other.tobsr((3, 3))
        total.sort_indices()
        pattern = BlockPattern(
            total.indptr.astype(np.int32, copy=False),
            total.indices.astype(np.int32, copy=False),
        )
        return BlockMatrix(pattern, total.data, self.team)

    def to_scipy(self) -> sparse.bsr_matrix:
        """Copy the matrix to a SciPy matrix, 3n × 3n."""
        return self.shared.copy()


@kernel
def _find_slots(indptr: Array, indices: Array, stencil: Array, slots: Array) -> int:
    """Fill `slots` (m, k, k), see `BlockPattern.slots`.

    Return the first row of the stencil (m, k) with a pair that has no block, or −1.
    """
    m, k = stencil.shape
    for e in range(m):
        for a in range(k):
            i = stencil[e, a]
            for b in range(k):
                s = find_sorted(indices, indptr[i], indptr[i + 1], stencil[e, b])
                if s < 0:
                    return e
                slots[e, a, b] = s
    return -1


@inner
def find_sorted(numbers: Array, begin: int, end: int, number: int) -> int:
    """Return the place of a number in `numbers`, by bisection, or −1 if it is not there.

    Only numbers[begin:end] are searched; they ascend.
    """
    stop = end
    while begin < end:
        middle = (begin + end) // 2
        if numbers[middle] < number:
            begin = middle + 1
        else:
            end = middle
    if begin < stop and numbers[begin] == number:
        return begin
    return -1


@kernel
def add_mass(slots: Array, mass: Array, scale: float, values: Array) -> None:
    """values += scale * mass ⊗ I₃, where `slots` are the blocks of the mass entries."""
    for s in range(len(slots)):
        for c in range(3):
            values[slots[s], c, c] += scale * mass[s]


@dataclass(frozen=True, eq=False)
class MatrixLayout:
    """The pattern of a matrix and the blocks of its stencils, found when they are first needed.

    So they cost nothing in a run of an explicit method, which forms no matrix.

    Attributes
    ----------
    n
        Number of nodes.
    stencils
        (m, k) nodes that each term couples, an array for each term.
    """

    n: int
    stencils: Sequence[np.ndarray]
    _shared: WeakValueDictionary[int, np.ndarray] = field(
        default_factory=WeakValueDictionary, init=False, repr=False
    )

    @cached_property
    def pattern(self) -> BlockPattern:
        """The union of the stencils, and the diagonal."""
        return BlockPattern.union(self.n, self.stencils)

    def slots(self, stencil: np.ndarray) -> np.ndarray:
        """Return the number of the block of each pair of nodes, (m, k, k) int32.

        See `BlockPattern.slots`. Terms with the same stencil, one of `stencils`, get the same
        array.
        """
        numbers = [number for number, own in enumerate(self.stencils) if own is stencil]
        if not numbers:
            return self.pattern.slots(stencil)
        first = numbers[0]
        # its references are weak: an array that no term uses any more is freed
        slots = self._shared.get(first)
        if slots is None:
            slots = self.pattern.slots(stencil)
            self._shared[first] = slots
        return slots
