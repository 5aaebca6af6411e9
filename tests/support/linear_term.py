"""A user's own term for tests: a membrane linearised about a stretched state, with damping.

E = ½ u·K u and d = −c K v with u = x − x₀ and a constant, symmetric, semi-definite K.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

import fecloth as fc


@dataclass(frozen=True)
class LinearMembrane:
    stretch: float = 1.2

    def stencil(self, cloth):
        return cloth.stencil

    def bind(self, panel, slots):
        cloth = panel.cloth
        system = fc.System(cloth, panel.fabrics[0], [fc.StVK()])
        x = np.column_stack([self.stretch * cloth.X, np.zeros(len(cloth.X))])
        K = system.stiffness(system.state(x)).tobsr((3, 3))
        return BoundLinear(K, x, slots(cloth.stencil), cloth.stencil, 0.0)


@dataclass(frozen=True)
class LinearDamping:
    time: float = 0.01
    stretch: float = 1.2

    def stencil(self, cloth):
        return cloth.stencil

    def bind(self, panel, slots):
        bound = LinearMembrane(self.stretch).bind(panel, slots)
        return BoundLinear(bound.K, bound.x0, bound.slots, panel.cloth.stencil, self.time)


@dataclass(frozen=True, eq=False)
class BoundLinear(fc.BoundTerm):
    K: sparse.bsr_matrix
    x0: np.ndarray
    slots: np.ndarray
    stencil: np.ndarray
    time: float  # 0: elastic

    symmetric = True

    @property
    def name(self):
        return "LinearDamping" if self.time else "LinearMembrane"

    @property
    def has_energy(self):
        return not self.time

    @property
    def dissipative(self):
        return bool(self.time)

    @property
    def velocity_dependent(self):
        return bool(self.time)

    def energy(self, x, t):
        u = (x - self.x0).ravel()
        return 0.5 * float(u @ (self.K @ u))

    def power(self, x, v, t):
        return self.time * float(v.ravel() @ (self.K @ v.ravel()))

    def add_force(self, x, v, t, f):
        y = self.time * v if self.time else x - self.x0
        f -= (self.K @ y.ravel()).reshape(f.shape)

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        # every triangle's slots name the same blocks, so each is filled once, from the pattern
        factor = wv * self.time if self.time else wx
        rows = J.pattern.rows
        dense = {}
        K = self.K
        for i in range(len(K.indptr) - 1):
            for s in range(K.indptr[i], K.indptr[i + 1]):
                dense[i, K.indices[s]] = K.data[s]
        for s, (i, j) in enumerate(zip(rows, J.pattern.indices, strict=True)):
            J.values[s] += factor * dense[i, j]
