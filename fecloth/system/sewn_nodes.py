"""Nodes that follow others along seams: the elimination x = T y."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Call
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.linalg.block_matrix import BlockPattern
from fecloth.system.followers import Followers

Closing = Callable[[float], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class SewnNodes(Followers):
    """x_F = W x_L + g; the unknowns are the positions of all nodes that do not follow.

    So forces are Tᵀ f, matrices Tᵀ A T, and the mass Tᵀ M T, or its row sums where it is lumped:
    then the mass of a node that follows goes to its leaders by its weights.

    Attributes
    ----------
    T
        (n, n) the weights of each node by the nodes that do not follow.
    left
        left(t) → (k, 1) is the part of the gap g that is left at the time t [s], of that at the
        time 0, and its rate [1/s]; None where g = 0.
    closing
        By the name of a seam that closes, the rows of its nodes among `nodes`.
    """

    T: sparse.csr_matrix
    left: Closing | None = None
    closing: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def nodes(self) -> np.ndarray:  # type: ignore[override]  # a constant of the base class
        return np.flatnonzero(self.T.diagonal() == 0).astype(np.int64)

    @property
    def closes(self) -> bool:  # type: ignore[override]  # a constant of the base class
        return self.left is not None

    @cached_property
    def rows(self) -> tuple[np.ndarray, ...]:
        """The arguments of `gather_rows` and `follow_rows`, but for the last."""
        W = self.T[self.nodes]
        return self.nodes, W.indptr.astype(np.int64), W.indices.astype(np.int64), W.data

    @cached_property
    def of_components(self) -> sparse.csr_matrix:
        """(3n, 3n) T for each of three components."""
        return sparse.kron(self.T, sparse.identity(3), format="csr")

    def gather(self, f: np.ndarray) -> np.ndarray:
        gather_rows(*self.rows, f)
        return f

    def gather_calls(self, f: np.ndarray) -> Sequence[Call]:
        return [(gather_rows, (*self.rows, f))]

    def follow(self, y: np.ndarray) -> np.ndarray:
        follow_rows(*self.rows, y)
        return y

    def place(self, y: np.ndarray, target: np.ndarray) -> None:
        self.follow(y)
        if self.left:
            y[self.nodes] += self.gap(target)

    def gap(self, y: np.ndarray) -> np.ndarray:
        closed = self.follow(y.copy())
        gap: np.ndarray = (y - closed)[self.nodes]
        return gap

    def gaps(self, x: np.ndarray) -> dict[str, float]:
        sizes = np.linalg.norm(self.gap(x), axis=1)
        return {f"gap:{name}": float(sizes[rows].max()) for name, rows in self.closing.items()}

    def close(self, t: float, later: float, old: np.ndarray, x: np.ndarray, v: np.ndarray) -> None:
        self.follow(x)
        self.follow(v)
        if self.left:
            before, _ = self.left(t)
            after, rate = self.left(later)
            whole = self.gap(old) / np.where(before > 0, before, np.inf)
            x[self.nodes] += after * whole
            v[self.nodes] += rate * whole

    def gathered(self, mass: Any) -> Any:
        if not sparse.issparse(mass):
            return self.T.T @ mass
        if mass.nnz == mass.shape[0]:
            return sparse.diags(self.T.T @ mass.diagonal(), format="csr")
        return (self.T.T @ mass @ self.T).tocsr()

    def condense(self, A: sparse.spmatrix) -> sparse.spmatrix:
        return self.of_components.T @ A @ self.of_components

    def extend(self, Z: sparse.csc_matrix) -> sparse.csc_matrix:
        return (self.of_components @ Z).tocsc()

    def stencils(self, stencils: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        _, rows, columns, _ = self.spread(BlockPattern.union(self.T.shape[0], stencils))
        return (*stencils, np.column_stack([rows, columns]))

    def spread(self, pattern: BlockPattern) -> tuple[np.ndarray, ...]:
        """(Tᵀ A T)_ij gets T_ai T_bj A_ab, where a or b follows; `source` are blocks of A."""
        T = self.T
        a, b = pattern.rows, pattern.indices
        blocks = np.flatnonzero(np.isin(a, self.nodes) | np.isin(b, self.nodes))
        widths = np.diff(T.indptr)
        of_b = widths[b[blocks]]
        pairs = widths[a[blocks]] * of_b
        source = np.repeat(blocks, pairs)
        number = np.arange(len(source)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
        first, second = np.divmod(number, np.repeat(of_b, pairs))
        p = T.indptr[a[source]] + first
        q = T.indptr[b[source]] + second
        return source, T.indices[p], T.indices[q], T.data[p] * T.data[q]


@rounded_kernel
def follow_rows(nodes: Array, starts: Array, leaders: Array, weights: Array, y: Array) -> None:
    """y_F = W y_L of the nodes F (k,) that follow, in place; W as compressed rows."""
    for r in range(len(nodes)):
        for c in range(3):
            total = 0.0
            for p in range(starts[r], starts[r + 1]):
                total += weights[p] * y[leaders[p], c]
            y[nodes[r], c] = total


@rounded_kernel
def gather_rows(nodes: Array, starts: Array, leaders: Array, weights: Array, f: Array) -> None:
    """f_L += Wᵀ f_F, f_F = 0, in place; W as compressed rows."""
    for r in range(len(nodes)):
        i = nodes[r]
        for c in range(3):
            for p in range(starts[r], starts[r + 1]):
                f[leaders[p], c] += weights[p] * f[i, c]
            f[i, c] = 0.0
