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
from itertools import pairwise
from typing import Any, Self

import numpy as np

from fecloth.compiled.calls import Call, Calls, SharedCall, ValuedCall
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
        """Make call(part, target) for all elements, on one thread or on all of them.

        `indptr` is None if the rows of `target` are nodes. If they are the blocks of a matrix,
        the blocks of node i are those from indptr[i] to indptr[i + 1].
        """
        parts = self.parts
        kernel_of_all, all_arguments = call(self.whole, target)
        if parts is None:
            kernel_of_all(*all_arguments)
            return

        def run_thread(p: int) -> None:
            for function, arguments in self._calls(p, call, target, indptr):
                function(*arguments)

        # By this name the team compares the times of both ways, if its threads are "auto".
        self.team.do(
            name=(kernel_of_all, id(self)),
            alone=lambda: kernel_of_all(*all_arguments),
            together=lambda: self.team.run(run_thread),
        )

    def _calls(
        self, p: int, call: CallOf, target: np.ndarray, indptr: np.ndarray | None
    ) -> Iterator[Call]:
        """Yield the calls of thread p, in order; the arguments are as for `_share`.

        In a seam the elements also add to nodes of other threads. There the thread copies the
        rows of its own nodes from `target` to an array of its own, adds to that, and copies them
        back.
        """
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

    def shared_add(
        self, call: CallOf, target: np.ndarray, indptr: np.ndarray | None = None
    ) -> SharedCall:
        """What `add` calls, for joined calls; with `indptr` as `_share` explains it."""
        whole = call(self.whole, target)

        def of_thread(p: int) -> list[Call]:
            if self.parts is None:
                return [whole] if p == 0 else []
            return list(self._calls(p, call, target, indptr))

        return SharedCall(*whole, of_thread)

    def shared_add_blocks(self, call: CallOf, J: BlockMatrix) -> SharedCall:
        """What `add_blocks` calls, for joined calls."""
        return self.shared_add(call, J.values, J.pattern.indptr)

    def total_calls(self, call: Callable[[slice], Call], sums: np.ndarray) -> Calls:
        """Calls that write the parts of `total` to `sums` (SUM_BLOCKS,), or its only part."""
        spans = self.spans_of_sums
        return [ValuedCall(*call(span), sums[part : part + 1]) for part, span in enumerate(spans)]

    @property
    def spans_of_sums(self) -> list[slice]:
        """The ranges of elements of the partial sums of `total`: one where they are few."""
        m = len(self.nodes)
        if m < SUM_BLOCKS * SMALLEST_SHARED_LOOP:
            return [self.whole]
        ends = [part * m // SUM_BLOCKS for part in range(SUM_BLOCKS + 1)]
        return [slice(begin, end) for begin, end in pairwise(ends)]

    def shared_each(self, call: Callable[[slice], Call]) -> SharedCall:
        """What `each` calls, for joined calls."""
        return SharedCall(
            *call(self.whole), lambda p: [call(self.team.share_of(p, len(self.nodes)))]
        )

    def _blocks(self, piece: Piece, indptr: np.ndarray) -> np.ndarray:
        """The numbers of the blocks in the rows of a piece's nodes.

        They are kept until another matrix comes, which has another array `indptr`.
        """
        kept_indptr, blocks = self.cache.get(id(piece), (None, None))
        if kept_indptr is not indptr:
            nodes: Iterable[int] = () if piece.nodes is None else piece.nodes
            rows = [np.arange(indptr[i], indptr[i + 1]) for i in nodes]
            blocks = np.concatenate([np.empty(0, np.int64), *rows])  # also of no rows at all
            self.cache[id(piece)] = indptr, blocks
        numbers: np.ndarray = blocks
        return numbers

    def each(self, call: Callable[[slice], Call]) -> None:
        """Make call(part), which writes only what belongs to its elements."""
        self.team.each(len(self.nodes), call, id(self))

    def total(self, call: Callable[[slice], Call]) -> float:
        """Return the sum over the elements that count of what the kernel of call(part) returns.

        From a certain size on it is the sum of `SUM_BLOCKS` partial sums, on one thread and on
        many, so that the bits do not depend on the number of threads.
        """
        if self.counted is not None:  # a part of a cloth, in one of several processes
            calls = [call(run) for run in self.runs]
            return float(sum(function(*arguments) for function, arguments in calls))
        threads = self.team.count
        function, arguments = call(self.whole)
        spans = self.spans_of_sums
        if len(spans) == 1:
            return float(function(*arguments))
        sums = [0.0] * SUM_BLOCKS

        def fill_sums(first: int, step: int) -> None:
            """Compute the partial sums first, first + step, first + 2 step …"""
            for block in range(first, SUM_BLOCKS, step):
                _, arguments_of_block = call(spans[block])
                sums[block] = function(*arguments_of_block)

        self.team.do(
            name=(function, id(self)),
            alone=lambda: fill_sums(0, 1),
            together=lambda: self.team.run(lambda p: fill_sums(p, threads)),
        )
        return float(sum(sums))

    @cached_property
    def runs(self) -> list[slice]:
        """The ranges of elements that count in sums, one for each row of successive elements."""
        if self.counted is None:
            return [self.whole]
        counted = np.concatenate([[False], self.select(np.ones(len(self.nodes))) > 0, [False]])
        ends = np.flatnonzero(counted[1:] != counted[:-1])  # begin, end, begin, end …
        return [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]

    def select(self, values: np.ndarray) -> np.ndarray:
        """Values (m,) of the elements, zero where they do not count in sums."""
        if self.counted is None:
            return values
        return np.where(self.counted, values, 0.0)


def by_part(
    kernel: Callable[..., Any], shape: tuple[Any, ...], arrays: Iterable[np.ndarray], *others: Any
) -> Callable[..., Call]:
    """Return a function ``call(part, *target)`` that returns a call of a kernel.

    The kernel gets the `shape`, the part's rows of the arrays, the others, and the target.
    """
    return lambda part, *target: (kernel, (*shape, *cut(arrays, part), *others, *target))


def cut(arrays: Iterable[np.ndarray], part: slice) -> tuple[np.ndarray, ...]:
    """The rows of a range of the elements."""
    return tuple(array[part] for array in arrays)


def divide(nodes: np.ndarray, count: int) -> list[list[Piece]] | None:
    """Return the pieces of each of `count` threads for elements with these nodes (m, k).

    Each node has one thread as its owner. Two ways are tried: the owner is the thread in whose
    equal share of the elements the node is met first; or, for several kinds of elements one after
    another, where the first shares may touch all nodes, the owners have equal ranges of nodes.
    Returns None if in both ways a thread has to repeat too many elements, see `MOST_REPEATED`.
    """
    m = len(nodes)
    n = int(nodes.max()) + 1
    by_elements = np.full(n, count, np.int16)  # `count` stands for no thread
    for p in reversed(range(count)):  # the first thread comes last, so that it has a node
        by_elements[nodes[p * m // count : (p + 1) * m // count]] = p
    by_nodes = np.arange(n) * count // n
    for owner in (by_elements, by_nodes.astype(np.int16)):
        owner_or_none = np.append(owner, count)  # the last entry is that of node −1, no node
        parts = [_pieces_of_thread(nodes, owner_or_none, p) for p in range(count)]
        sizes = [sum(piece.span.stop - piece.span.start for piece in part) for part in parts]
        if max(sizes) <= (1 + MOST_REPEATED) * m / count:
            return parts
    return None


def _pieces_of_thread(nodes: np.ndarray, owner: np.ndarray, p: int) -> list[Piece]:
    """The pieces of thread p: runs of elements that touch its nodes, each with two seams.

    `owner` (n + 1,) is the thread of each node; its last entry is for the node −1 in `nodes`
    (m, k), which is no node. A seam reaches from the end of a run to the last element there that
    touches a node of another thread.
    """
    owners = owner[nodes.T]  # (k, m): 30 times faster to reduce than along short rows
    touching = np.flatnonzero((owners == p).any(axis=0))
    touches_others = ((owners != p) & (nodes.T >= 0)).any(axis=0)
    pieces: list[Piece] = []
    for run in np.split(touching, 1 + np.flatnonzero(np.diff(touching) > SHORTEST_GAP)):
        if not len(run):  # the thread has no nodes
            continue
        begin = int(run[0])
        end = int(run[-1]) + 1
        # The elements that belong in seams: in the lower half of the run in the seam at its
        # begin, in the upper half in the seam at its end.
        shared = begin + np.flatnonzero(touches_others[begin:end])
        low, high = np.split(shared, [np.searchsorted(shared, (begin + end) // 2)])
        inner_begin = int(low[-1]) + 1 if len(low) else begin
        inner_end = int(high[0]) if len(high) else end
        spans = slice(begin, inner_begin), slice(inner_begin, inner_end), slice(inner_end, end)
        for span, is_seam in zip(spans, (True, False, True), strict=True):
            if span.start == span.stop:
                continue
            touched = np.unique(nodes[span])
            own_nodes = touched[owner[touched] == p]
            pieces.append(Piece(span, nodes=own_nodes if is_seam else None))
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
