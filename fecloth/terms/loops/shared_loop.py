"""A loop over elements that adds to their nodes, shared among threads to the bits of one thread.

Each thread takes a range of the elements, and owns the nodes that no thread before it has
touched. It also computes the elements of its neighbours that touch its nodes. So no two threads
write to one node, and the contributions to a node are added in the order of the elements.
Elements are numbered along a narrow band. Therefore only a few elements at both ends of a range,
the seams, touch nodes of other threads. They are added to an array of the thread, from which its
own nodes are copied.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np

from fecloth.compiled.calls import Call, SharedCall
from fecloth.compiled.jit import Array, kernel
from fecloth.compiled.team import SMALLEST_SHARED_LOOP, Team
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots

CallOf = Callable[[slice, np.ndarray], Call]
"""A call for a range of the elements, and the array to which it adds."""

MOST_REPEATED = 0.3
"""Largest number of elements that a thread repeats, relative to its equal share.

If one thread has more to repeat, one thread does the whole loop. Only speed depends on it.
"""
SHORTEST_GAP = 100
"""Least number of foreign elements between two runs of a thread.

The thread also computes shorter gaps, which makes fewer calls. Only speed depends on it.
"""
SUM_BLOCKS = 8
"""Number of partial sums of a sum over the elements.

It is the same for every number of threads, and so are the bits of the sum.
"""


@dataclass(frozen=True, eq=False)
class Piece:
    """Elements that a thread does in one call.

    Attributes
    ----------
    span
        The range of the elements.
    nodes
        Of a seam, whose elements touch nodes of other threads too: the thread's own nodes that
        they touch. Else None.
    """

    span: slice
    nodes: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SharedLoop:
    """A loop over elements, shared by the threads of a team.

    The methods take functions that return a `Call`, a kernel and its arguments, for a range of
    the elements.

    Attributes
    ----------
    team
        The threads.
    nodes
        (m, k) The nodes of the elements; −1 stands for no node.
    counted
        (m,) Which elements count in sums, for a part of a cloth; None where all do.
    find_slots
        Finds blocks in the matrix, as `bind` of a term gets it.
    cache
        What is computed once: the parts of the threads, and the blocks of their seams.
    """

    team: Team
    nodes: np.ndarray
    counted: np.ndarray | None = None
    find_slots: FindSlots | None = None
    cache: dict[Any, Any] = field(default_factory=dict)

    @classmethod
    def over_elements(
        cls, panel: Panel, nodes: np.ndarray, find_slots: FindSlots | None = None
    ) -> Self:
        """The loop over elements of a panel."""
        counted = panel.counted(nodes) if panel.counted else None
        return cls(panel.team, nodes, counted, find_slots)

    @cached_property
    def slots(self) -> np.ndarray:
        """(m, k, k) blocks of the elements in the matrix, found at the first tangent."""
        assert self.find_slots is not None
        return self.find_slots(self.nodes)

    @property
    def parts(self) -> list[list[Piece]] | None:
        """The pieces of each thread; None for one thread, and if too much would be repeated."""
        if not self.team.shares(len(self.nodes)):
            return None
        if "parts" not in self.cache:
            self.cache["parts"] = divide(self.nodes, self.team.count)
        parts: list[list[Piece]] | None = self.cache["parts"]
        return parts

    @property
    def whole(self) -> slice:
        """The range of all elements."""
        return slice(0, len(self.nodes))

    def add(self, call: CallOf, target: np.ndarray) -> None:
        """Make call(part, target), which adds to the rows of an array (n, …)."""
        self._share(call, target, None)

    def add_blocks(self, call: CallOf, J: BlockMatrix) -> None:
        """Make call(part, J.values), which adds to blocks in the rows of the nodes."""
        self._share(call, J.values, J.pattern.indptr)

    def _share(self, call: CallOf, target: np.ndarray, indptr: np.ndarray | None) -> None:
        """Make the calls of all threads; `indptr` says where a node's blocks are in a matrix."""
        parts = self.parts
        kernel_of_all, all_arguments = call(self.whole, target)
        if parts is None:
            kernel_of_all(*all_arguments)
            return

        def part(p: int) -> None:
            for function, arguments in self._calls(p, call, target, indptr):
                function(*arguments)

        name = kernel_of_all, id(self)
        self.team.do(name, lambda: kernel_of_all(*all_arguments), lambda: self.team.run(part))

    def _calls(
        self, p: int, call: CallOf, target: np.ndarray, indptr: np.ndarray | None
    ) -> Iterator[Call]:
        """The calls of thread p; the calls of a seam work on an array of the thread."""
        for piece in self.parts[p] if self.parts else []:
            if piece.nodes is None:
                yield call(piece.span, target)
                continue
            work = self.team.work(p, target.shape)
            if indptr is None:
                rows = piece.nodes
            else:
                rows = self._blocks(piece, indptr)
            yield copy_rows, (rows, target, work)
            yield call(piece.span, work)
            yield copy_rows, (rows, work, target)

    def shared_add(self, call: CallOf, target: np.ndarray) -> SharedCall:
        """What `add` calls, for `fused_steps`."""
        whole = call(self.whole, target)

        def of_thread(p: int) -> list[Call]:
            if self.parts is None:
                return [whole] if p == 0 else []
            return list(self._calls(p, call, target, None))

        return SharedCall(*whole, of_thread)

    def shared_each(self, call: Callable[[slice], Call]) -> SharedCall:
        """What `each` calls, for `fused_steps`."""
        return SharedCall(
            *call(self.whole), lambda p: [call(self.team.share_of(p, len(self.nodes)))]
        )

    def _blocks(self, piece: Piece, indptr: np.ndarray) -> np.ndarray:
        """The blocks in the rows of a piece's nodes, kept for one pattern."""
        known, blocks = self.cache.get(id(piece), (None, None))
        if known is not indptr:
            nodes: Iterable[int] = () if piece.nodes is None else piece.nodes
            rows = [np.arange(indptr[i], indptr[i + 1]) for i in nodes]
            blocks = np.concatenate([np.empty(0, np.int64), *rows])
            self.cache[id(piece)] = indptr, blocks
        kept: np.ndarray = blocks
        return kept

    def each(self, call: Callable[[slice], Call]) -> None:
        """Make call(part), which writes only what belongs to its elements."""
        self.team.each(len(self.nodes), call, id(self))

    def total(self, call: Callable[[slice], Call]) -> float:
        """Σ over the elements of what call(part) returns, in fixed blocks."""
        if self.counted is not None:
            calls = [call(run) for run in self.runs]
            return float(sum(function(*arguments) for function, arguments in calls))
        m = len(self.nodes)
        count = self.team.count
        function, arguments = call(self.whole)
        if m < SUM_BLOCKS * SMALLEST_SHARED_LOOP:
            return float(function(*arguments))
        sums = [0.0] * SUM_BLOCKS

        def fill(first: int, step: int) -> None:
            for block in range(first, SUM_BLOCKS, step):
                span = slice(block * m // SUM_BLOCKS, (block + 1) * m // SUM_BLOCKS)
                sums[block] = function(*call(span)[1])

        run = self.team.run
        self.team.do(
            (function, id(self)), lambda: fill(0, 1), lambda: run(lambda p: fill(p, count))
        )
        return float(sum(sums))

    @cached_property
    def runs(self) -> list[slice]:
        """The ranges of elements that count."""
        if self.counted is None:
            return [self.whole]
        counted = np.concatenate([[False], self.select(np.ones(len(self.nodes))) > 0, [False]])
        ends = np.flatnonzero(counted[1:] != counted[:-1])
        return [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]

    def select(self, values: np.ndarray) -> np.ndarray:
        """Values (m,) of the elements, zero where they do not count in sums."""
        if self.counted is None:
            return values
        return np.where(self.counted, values, 0.0)


def by_part(
    kernel: Callable[..., Any], shape: tuple[Any, ...], arrays: Iterable[np.ndarray], *others: Any
) -> Callable[..., Call]:
    """Make a function ``call(part, …)`` of a kernel.

    The kernel gets the `shape`, the part's rows of the arrays, and the others.
    """
    return lambda part, *target: (kernel, (*shape, *cut(arrays, part), *others, *target))


def cut(arrays: Iterable[np.ndarray], part: slice) -> tuple[np.ndarray, ...]:
    """The rows of a range of the elements."""
    return tuple(array[part] for array in arrays)


def divide(nodes: np.ndarray, count: int) -> list[list[Piece]] | None:
    """Divide elements with these nodes (m, k) among `count` threads, or return None.

    The nodes belong to the thread that touches them first; or, for several kinds of elements one
    after another, to threads by equal ranges of nodes.
    """
    m = len(nodes)
    n = int(nodes.max()) + 1
    by_elements = np.full(n, count, np.int16)
    by_nodes = np.arange(n) * count // n
    for p in reversed(range(count)):
        by_elements[nodes[p * m // count : (p + 1) * m // count]] = p
    for owner in (by_elements, by_nodes.astype(np.int16)):
        parts = [_runs(nodes, np.append(owner, count), p) for p in range(count)]  # −1: nobody's
        work = [sum(piece.span.stop - piece.span.start for piece in part) for part in parts]
        if max(work) <= (1 + MOST_REPEATED) * m / count:
            return parts
    return None


def _runs(nodes: np.ndarray, owner: np.ndarray, p: int) -> list[Piece]:
    """The pieces of thread p: runs of elements that touch its nodes, each with two seams."""
    of_nodes = owner[nodes.T]  # (k, m): 30 times faster to reduce than along short rows
    touching = np.flatnonzero((of_nodes == p).any(axis=0))
    others = ((of_nodes != p) & (nodes.T >= 0)).any(axis=0)
    pieces: list[Piece] = []
    for run in np.split(touching, 1 + np.flatnonzero(np.diff(touching) > SHORTEST_GAP)):
        if not len(run):
            continue
        begin = int(run[0])
        end = int(run[-1]) + 1
        seams = begin + np.flatnonzero(others[begin:end])
        low, high = np.split(seams, [np.searchsorted(seams, (begin + end) // 2)])
        inner_begin = int(low[-1]) + 1 if len(low) else begin
        inner_end = int(high[0]) if len(high) else end
        spans = slice(begin, inner_begin), slice(inner_begin, inner_end), slice(inner_end, end)
        for span, is_seam in zip(spans, (True, False, True), strict=True):
            if span.start == span.stop:
                continue
            touched = np.unique(nodes[span])
            own_nodes = touched[owner[touched] == p]
            pieces.append(Piece(span, own_nodes if is_seam else None))
    return pieces


@kernel
def copy_rows(at: Array, a: Array, b: Array) -> None:
    """b[i] = a[i] for the rows i of `at`."""
    width = a.size // len(a)
    a = a.reshape(len(a), width)
    b = b.reshape(len(b), width)
    for n in range(len(at)):
        i = at[n]
        for c in range(width):
            b[i, c] = a[i, c]
