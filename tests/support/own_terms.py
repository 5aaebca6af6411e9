"""A membrane, a bending term, a damping and a load, as a user writes them: each says what it is."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

import fecloth as fc
from fecloth.linalg.block_matrix import add_mass, find_entries

# --- a membrane -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rubber(fc.MembraneLaw):
    """W = k/2 E:E with k [N/m]; `MembraneLaw` says what it is."""

    k: float = 1000.0

    def constants(self, fabric):
        return [self.k]

    @staticmethod
    def law(E, c):
        k = c[0]
        W = 0.5 * k * (E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2)
        return W, (k * E[0], k * E[1], k * E[2]), (k, k, 0.5 * k, 0.0, 0.0, 0.0)


# --- bending --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ribs:
    """½ k Σ |Σ g_a x_a|² over the hinges with k [N m], flat at rest."""

    k: float = 1e-5

    traits = fc.TermTraits(
        kind="bending",
        exclusive=True,
        shared=True,
        cheaper=("QuadraticBending",),
        by_pattern=True,
        space_error="is as stiff as its ribs",
    )

    def stencil(self, cloth):
        return cloth.hinges.nodes

    def bind(self, panel, slots):
        nodes, g, n = panel.cloth.hinges.nodes, panel.cloth.hinges.flat_gradient, len(panel.cloth.X)
        Q = self.k * g[:, :, None] * g[:, None, :]
        i, j = (np.broadcast_to(at, Q.shape) for at in (nodes[:, :, None], nodes[:, None, :]))
        matrix = sparse.csr_matrix((Q.ravel(), (i.ravel(), j.ravel())), shape=(n, n))
        return BoundRibs(matrix, find_entries(matrix, slots), panel)


@dataclass(frozen=True, eq=False)
class BoundRibs(fc.BoundTerm):
    matrix: sparse.csr_matrix
    blocks: np.ndarray
    panel: object
    name = "Ribs"
    symmetric = has_energy = True
    dissipative = velocity_dependent = False

    def energy(self, x, t):
        return 0.5 * float((self.panel.count(x) * (self.matrix @ x)).sum())

    def add_force(self, x, v, t, f):
        f -= self.matrix @ x

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        add_mass(self.blocks, self.matrix.data, wx, J.values)


# --- a damping ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Syrup:
    """f_a = −c m_a v_a with the rate c [1/s]."""

    rate: float = 1.0

    traits = fc.TermTraits(kind="damping", exclusive=True, shared=True, damps="motion")

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        nodes = np.arange(len(panel.cloth.X), dtype=np.int32)
        return BoundSyrup(self.rate * panel.nodal_mass, slots(nodes[:, None]).ravel(), self.rate)


@dataclass(frozen=True, eq=False)
class BoundSyrup(fc.BoundTerm):
    drag: np.ndarray
    own: np.ndarray
    rate: float
    name = "Syrup"
    symmetric = dissipative = velocity_dependent = True
    has_energy = False

    def power(self, x, v, t):
        return float((self.drag[:, None] * v * v).sum())

    def add_force(self, x, v, t, f):
        f -= self.drag[:, None] * v

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        for i in range(3):
            J.values[self.own, i, i] += wv * self.drag


# --- a load ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Breeze:
    """A constant force per area along y [Pa]."""

    push: float = 0.5

    traits = fc.TermTraits(kind="load", shared=True)

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        return BoundBreeze(self.push * panel.cloth.load())


@dataclass(frozen=True, eq=False)
class BoundBreeze(fc.BoundTerm):
    force: np.ndarray
    name = "Breeze"
    load = symmetric = has_energy = True
    dissipative = velocity_dependent = False

    def energy(self, x, t):
        return -float(self.force @ x[:, 1])

    def add_force(self, x, v, t, f):
        f[:, 1] += self.force

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        pass


OWN = {"Rubber": Rubber, "Ribs": Ribs, "Syrup": Syrup, "Breeze": Breeze}
