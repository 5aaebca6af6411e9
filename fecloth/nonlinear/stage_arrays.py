"""The arrays of a stage of an implicit step, and the kernels that work on them between terms.

Each operation is rounded by itself, as NumPy and SciPy round it.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.compiled.calls import AnyCall, Present
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.terms.loops.shared_loop import SUM_BLOCKS


@dataclass(frozen=True, eq=False)
class StageArrays:
    """The arrays on which the joined calls of a stage work.

    Attributes
    ----------
    t
        (1,) time at which the forces balance [s].
    wx, wv, wa
        (1,) weights of the unknown in x, v and a, see `Stage`.
    mass_weight
        (1,) weight of M in the matrix.
    x0, v0, a0
        (n, 3) x, v and a for q = 0.
    q
        (n, 3) the unknown.
    x, v, a
        (n, 3) x, v and a for q.
    f, R
        (n, 3) the forces and the residual [N].
    own_forces
        (terms, n, 3) the force of each term [N].
    energies
        (terms, SUM_BLOCKS) parts of the energy of each term [J].
    """

    t: np.ndarray
    wx: np.ndarray
    wv: np.ndarray
    wa: np.ndarray
    mass_weight: np.ndarray
    x0: np.ndarray
    v0: np.ndarray
    a0: np.ndarray
    q: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    f: np.ndarray
    R: np.ndarray
    own_forces: np.ndarray
    energies: np.ndarray

    @classmethod
    def of(cls, nodes: int, terms: int) -> Self:
        """Arrays for a number of nodes and of terms."""
        numbers = {name: np.zeros(1) for name in ("t", "wx", "wv", "wa", "mass_weight")}
        names = ("x0", "v0", "a0", "q", "x", "v", "a", "f", "R")
        fields = {name: np.zeros((nodes, 3)) for name in names}
        own_forces = np.zeros((terms, nodes, 3))
        return cls(
            **numbers, **fields, own_forces=own_forces, energies=np.zeros((terms, SUM_BLOCKS))
        )

    def place_call(self) -> AnyCall:
        """The call that sets x, v and a for q."""
        weights = Present(self.wx), Present(self.wv), Present(self.wa)
        return place, (*weights, self.x0, self.v0, self.a0, self.q, self.x, self.v, self.a)


@rounded_kernel
def place(
    wx: float,
    wv: float,
    wa: float,
    x0: Array,
    v0: Array,
    a0: Array,
    q: Array,
    x: Array,
    v: Array,
    a: Array,
) -> None:
    """x = x0 + wx q, v = v0 + wv q and a = a0 + wa q of arrays (n, 3)."""
    for i in range(len(q)):
        for k in range(3):
            x[i, k] = x0[i, k] + wx * q[i, k]
            v[i, k] = v0[i, k] + wv * q[i, k]
            a[i, k] = a0[i, k] + wa * q[i, k]


@rounded_kernel
def copy_blocks(a: Array, b: Array) -> None:
    """b (b, 3, 3) = a."""
    entries = a.reshape(-1)
    copies = b.reshape(-1)
    for i in range(len(entries)):
        copies[i] = entries[i]


@rounded_kernel
def balance(indptr: Array, indices: Array, mass: Array, a: Array, f: Array, R: Array) -> None:
    """R (n, 3) = M a − f, with M (n, n) by compressed rows of one component."""
    for i in range(len(R)):
        y1, y2, y3 = 0.0, 0.0, 0.0
        for s in range(indptr[i], indptr[i + 1]):
            m = mass[s]
            j = indices[s]
            y1 += m * a[j, 0]
            y2 += m * a[j, 1]
            y3 += m * a[j, 2]
        R[i, 0] = y1 - f[i, 0]
        R[i, 1] = y2 - f[i, 1]
        R[i, 2] = y3 - f[i, 2]
