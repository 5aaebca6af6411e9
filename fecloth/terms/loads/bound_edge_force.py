"""`EdgeForce` on a cloth: dead, with the shares of the nodes, or following the cloth."""

import math
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot as node_dot
from fecloth.mesh.elements import EdgeRule
from fecloth.quantities.time_function import TimeFunction
from fecloth.terms.bending.dihedral_angle import cross, dot
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import BoundTerm, taken_from


@dataclass(frozen=True, eq=False)
class DeadEdgeForce(BoundTerm):
    """A dead `EdgeForce`: f_a = B_a q(t), with B_a (k, 3, c) [m] of the nodes (k,)."""

    nodes: np.ndarray
    shares: np.ndarray
    per_length: TimeFunction

    name = "EdgeForce"
    load = True
    symmetric = True
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the force [W]."""
        return float(np.einsum("aic,ai,c", self.shares, v[self.nodes], self.per_length(t)))

    def add_force(self, x, v, t, f) -> None:
        """f_a += B_a q [N]."""
        add_dead_force(self.nodes, self.shares, self.per_length(t), f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        q = np.empty(self.per_length.shape)
        calls = self.per_length.calls(t, q)
        if calls is None:
            return None
        return [*calls, (add_dead_force, (self.nodes, self.shares, q, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Do nothing: the force does not depend on x and v."""

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return []


@dataclass(frozen=True, eq=False)
class FollowingEdgeForce(BoundTerm):
    """An `EdgeForce` that follows the cloth.

    Attributes
    ----------
    per_length
        F (3,), or p and s (2,), as a function of time [N/m].
    loop
        The loop over the edges, with the nodes of their triangles.
    rule
        The quadrature on an edge.
    panel
        The cloth with its fabrics.
    """

    per_length: TimeFunction
    loop: SharedLoop
    rule: EdgeRule
    panel: Panel

    nodes = taken_from("loop.nodes")  # (e, k)
    name = "EdgeForce"
    load = True
    symmetric = False
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the force on the cloth [W]."""
        f = np.zeros_like(x)
        self.add_force(x, v, t, f)
        return node_dot(self.panel.count(f), v)

    def _room(self) -> tuple[np.ndarray, np.ndarray]:
        """The force (5,) with F, p and s, at first 0, and its part that changes with time."""
        q = np.zeros(5)
        return q, q[:3] if self.per_length.shape == (3,) else q[3:]

    def _at(self, t: float) -> np.ndarray:
        """(5,) F, p and s at a time [N/m]."""
        q, part = self._room()
        part[:] = self.per_length(t)
        return q

    def add_force(self, x, v, t, f) -> None:
        """f_a += ∫ N_a (|t| F + p t × ν + s t) dξ [N]."""
        self.loop.add(partial(self._force, self._at(t), x), f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        q, part = self._room()
        calls = self.per_length.calls(t, part)
        if calls is None:
            return None
        return [*calls, self.loop.shared_add(partial(self._force, q, x), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; do nothing if J must be `definite`, because K has no definite part."""
        if definite:
            return
        call = partial(self._tangent, self.loop.slots, self._at(t), x, float(wx))
        self.loop.add_blocks(call, J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls | None:
        if definite:
            return []
        q, part = self._room()
        calls = self.per_length.calls(t, part)
        if calls is None:
            return None
        call = partial(self._tangent, self.loop.slots, q, x, wx)
        return [*calls, self.loop.shared_add_blocks(call, J)]

    @cached_property
    def _shapes(self) -> tuple:
        """A tuple with a zero for each node, and the arrays of the rule, for the kernels."""
        rule = self.rule
        per_node = (0,) * rule.values.shape[1]
        return per_node, rule.weights, rule.values, rule.along, rule.across

    def _force(self, q, x, part, f) -> Call:
        return add_following_force, (*self._shapes, self.nodes[part], q, x, f)

    def _tangent(self, slots, q, x, wx, part, J) -> Call:
        arrays = cut((self.nodes, slots), part)
        return add_following_tangent, (*self._shapes, *arrays, q, x, wx, J)


@kernel
def add_dead_force(nodes, shares, q, f):
    """f_a += B_a q at the nodes (k,), with B (k, 3, c) [m] and q (c,) [N/m]."""
    for n in range(len(nodes)):
        i = nodes[n]
        for k in range(3):
            for c in range(len(q)):
                f[i, k] += shares[n, k, c] * q[c]


@inner
def slope(K, nodes, D, e, q, x):
    """Σ D_a x_a at point q of edge e, for the derivatives D (q, k) of the shape functions."""
    s0 = s1 = s2 = 0.0
    for a in range(len(K)):
        i = nodes[e, a]
        s0 += D[q, a] * x[i, 0]
        s1 += D[q, a] * x[i, 1]
        s2 += D[q, a] * x[i, 2]
    return s0, s1, s2


@inner
def inverse(value):
    """1/value, or 0 for 0: a collapsed triangle has no normal, and gives no force along it."""
    return 1.0 / value if value > 0.0 else 0.0


@kernel
def add_following_force(K, w, N, D, H, nodes, load, x, f):
    """f_a += Σ w N_a (|t| F + p t × ν + s t) over the points of each edge.

    K is a tuple with a zero for each node; w (q,), N, D and H (q, k) are arrays of the
    `EdgeRule`, `nodes` (e, k) the triangle of each edge, and `load` (5,) is F, p and s [N/m].
    """
    for e in range(len(nodes)):
        for q in range(len(w)):
            t = slope(K, nodes, D, e, q, x)
            m = cross(t, slope(K, nodes, H, e, q, x))
            outward = cross(t, m)
            length = math.sqrt(dot(t, t))
            p = load[3] * inverse(math.sqrt(dot(m, m)))
            for a in range(len(K)):
                i = nodes[e, a]
                scale = w[q] * N[q, a]
                for k in range(3):
                    f[i, k] += scale * (length * load[k] + p * outward[k] + load[4] * t[k])


@kernel
def add_following_tangent(K, w, N, D, H, nodes, slots, load, x, wx, J):
    """J_ab −= wx Σ w N_a (D_b A + H_b B) over the points of each edge; see `EdgeForce`.

    `slots` (e, k, k) are the blocks of J; the other arguments are as in `add_following_force`.
    """
    A = np.empty((3, 3))
    B = np.empty((3, 3))
    for e in range(len(nodes)):
        for q in range(len(w)):
            t = slope(K, nodes, D, e, q, x)
            g = slope(K, nodes, H, e, q, x)
            m = cross(t, g)
            over_m = inverse(math.sqrt(dot(m, m)))
            over_t = inverse(math.sqrt(dot(t, t)))
            nu = (m[0] * over_m, m[1] * over_m, m[2] * over_m)
            p = load[3]
            for i in range(3):
                for j in range(3):
                    A[i, j] = load[i] * t[j] * over_t + p * dot(t, g) * over_m * nu[i] * nu[j]
                    B[i, j] = -p * dot(t, t) * over_m * nu[i] * nu[j]
                A[i, i] += load[4]
            # −p [ν]×
            A[0, 1] += p * nu[2]
            A[0, 2] -= p * nu[1]
            A[1, 0] -= p * nu[2]
            A[1, 2] += p * nu[0]
            A[2, 0] += p * nu[1]
            A[2, 1] -= p * nu[0]
            for a in range(len(K)):
                scale = wx * w[q] * N[q, a]
                for b in range(len(K)):
                    s = slots[e, a, b]
                    for i in range(3):
                        for j in range(3):
                            J[s, i, j] -= scale * (D[q, b] * A[i, j] + H[q, b] * B[i, j])
