"""Follower pressure, normal to the deformed cloth and proportional to its area."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.time_function import OfTime, TimeFunction, scalar
from fecloth.quantities.units import PRESSURE
from fecloth.terms.bending.dihedral_angle import cross
from fecloth.terms.loops.green_strain import gradient
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import BoundTerm, element_nodes, taken_from
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class Pressure:
    """f_a = (p/6) n with n = (x₂ − x₁) × (x₃ − x₁) on each corner a of a triangle.

    n is the unit normal times twice the deformed area: on a flat cloth of the plane xy, p > 0
    pushes along +z. It is constant on a P1 triangle, so that f_a is exactly ∫ p N_a n dA. With
    the edges e_b opposite to the corners (e₁ = x₃ − x₂, …), ∂n/∂x_b = [e_b]× and

        K_ab = −∂f_a/∂x_b = −(p/6) [e_b]×                   exact
        K_ab = −(p/12) [e_b − e_a]×                         its symmetric part

    Source: Hibbitt (1979), Some follower forces and load stiffness, Int. J. Numer. Meth. Engng
    14, 937–941; here for the P1 triangle, whose normal is quadratic in the positions of its
    corners.

    Where the border is pinned, or slides in one plane, the projected exact matrix is
    symmetric, and both tangents are equal. With a free border "exact" needs a linear solver
    for general matrices, and with "symmetric" Newton's method does not converge quadratically.

    On P2 triangles the normal is n = F₁ × F₂, where F₁ and F₂ are the columns of F. With
    d_b = G_b1 F₂ − G_b2 F₁, and exactly integrated by the 6 points,

        f_a = p ∫ N_a n dA,   K_ab = p ∫ N_a [d_b]× dA   or   (p/2) ∫ [N_a d_b − N_b d_a]× dA

    Its work is ``work:Pressure`` in the energy ledger. In general it has no potential.

    Valid at any deformation, for a prescribed pressure. Use `Gas` for an enclosed gas, whose
    pressure depends on the volume, and `Wind` for moving air.

    Cost on P1: a third of `StVK`, force and tangent.

    Parameters
    ----------
    pressure
        p, the pressure on the lower side minus the pressure on the upper side [Pa]: a number, a
        formula of t as text, or a function of t.
    tangent
        "symmetric" or "exact".
    """

    pressure: Annotated[OfTime, PRESSURE]
    tangent: str = "symmetric"

    def __post_init__(self):
        scalar(self.pressure, "pressure", "Pressure")
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), "Pressure")

    traits = LOAD
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Return the pressure on the triangles of a panel; on P2 they are curved."""
        cloth = panel.cloth
        p = scalar(self.pressure, "pressure", "Pressure")
        symmetric = self.tangent == "symmetric"
        loop = SharedLoop.over_elements(panel, cloth.stencil, slots)
        bound_class = BoundPressure if cloth.element == "P1" else BoundCurved
        return bound_class(
            p=p, loop=loop, signs=orientation_signs(cloth), symmetric=symmetric, panel=panel
        )


def orientation_signs(cloth: Cloth) -> np.ndarray:
    """(m,) 1 if the corners of the stencil are counter-clockwise on the flat cloth, else −1."""
    a, b, c = np.moveaxis(cloth.X[cloth.stencil[:, :3]], 1, 0)
    edge = b - a
    arm = c - a
    return np.sign(edge[:, 0] * arm[:, 1] - edge[:, 1] * arm[:, 0])


@dataclass(frozen=True, eq=False)
class BoundPressure(BoundTerm):
    """`Pressure` on a cloth of P1 triangles.

    Attributes
    ----------
    p
        The pressure as a function of time [Pa].
    loop
        The loop over the triangles.
    signs
        (m,) 1 or −1, see `orientation_signs`.
    symmetric
        Whether the tangent is the symmetric part only.
    panel
        The cloth with its fabrics.
    """

    p: TimeFunction
    loop: SharedLoop
    signs: np.ndarray
    symmetric: bool
    panel: Panel

    nodes = taken_from("loop.nodes")  # (m, k) of the triangles
    name = "Pressure"
    load = True
    has_energy = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the pressure on the cloth [W]."""
        f = np.zeros_like(x)
        self.add_force(x, v, t, f)
        return dot(self.panel.count(f), v)

    def add_force(self, x, v, t, f) -> None:
        """f += (p/6) n at each corner [N]."""
        self.loop.add(partial(self._force, self.p(t).reshape(1), x), f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        p = np.empty(1)
        calls = self.p.calls(t, p)
        if calls is None:
            return None
        return [*calls, self.loop.shared_add(partial(self._force, p, x), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; do nothing if J must be `definite`, because the trace of K is zero."""
        if definite:
            return
        p = self.p(t).reshape(1)
        self.loop.add_blocks(partial(self._tangent, self.loop.slots, p, x, float(wx)), J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls | None:
        if definite:
            return []
        p = np.empty(1)
        calls = self.p.calls(t, p)
        if calls is None:
            return None
        call = partial(self._tangent, self.loop.slots, p, x, wx)
        return [*calls, self.loop.shared_add_blocks(call, J)]

    def _force(self, p, x, part, f) -> Call:
        return add_force, (self.nodes[part], self.signs[part], p, x, f)

    def _tangent(self, slots, p, x, wx, part, J) -> Call:
        arrays = cut((self.nodes, self.signs, slots), part)
        return add_tangent, (*arrays, p, self.symmetric, x, wx, J)


@dataclass(frozen=True, eq=False)
class BoundCurved(BoundPressure):
    """`Pressure` on P2 triangles."""

    def _force(self, p, x, part, f) -> Call:
        cloth = self.panel.cloth
        arrays = cut((self.nodes, cloth.gradients, cloth.weights), part)
        return add_curved_force, (*cloth.shape, *arrays, cloth.values, p, x, f)

    def _tangent(self, slots, p, x, wx, part, J) -> Call:
        cloth = self.panel.cloth
        arrays = cut((self.nodes, slots, cloth.gradients, cloth.weights), part)
        return add_curved_tangent, (
            *cloth.shape,
            *arrays,
            cloth.values,
            p,
            self.symmetric,
            x,
            wx,
            J,
        )


@inner
def edge(x, i, j):
    """x_j − x_i."""
    return x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]


@inner
def add_skew(s, scale, e, J):
    """J_s += scale [e]×, the matrix of y ↦ e × y."""
    J[s, 0, 1] -= scale * e[2]
    J[s, 0, 2] += scale * e[1]
    J[s, 1, 0] += scale * e[2]
    J[s, 1, 2] -= scale * e[0]
    J[s, 2, 0] -= scale * e[1]
    J[s, 2, 1] += scale * e[0]


@kernel
def add_force(nodes, signs, p, x, f):
    """f_a += (p/6) n on the corners `nodes` (m, 3) of each triangle, with the pressure p (1,) [Pa].

    n is (x₂ − x₁) × (x₃ − x₁), times the triangle's sign from `orientation_signs`.
    """
    for e in range(len(nodes)):
        i, j, k = nodes[e, 0], nodes[e, 1], nodes[e, 2]
        n = cross(edge(x, i, j), edge(x, i, k))
        sixth = signs[e] * p[0] / 6
        for a in range(3):
            node = nodes[e, a]
            f[node, 0] += sixth * n[0]
            f[node, 1] += sixth * n[1]
            f[node, 2] += sixth * n[2]


@kernel
def add_tangent(nodes, signs, slots, p, symmetric, x, wx, J):
    """J_ab −= wx (p/6) [e_b]×, or if `symmetric` wx (p/12) [e_b − e_a]×.

    e_b is the edge opposite to corner b, `slots` (m, 3, 3) are the blocks of J, and p (1,) is
    the pressure [Pa].
    """
    weighted = wx * p[0]
    for e in range(len(nodes)):
        i, j, k = nodes[e, 0], nodes[e, 1], nodes[e, 2]
        edges = (edge(x, j, k), edge(x, k, i), edge(x, i, j))
        if symmetric:
            scale = -signs[e] * weighted / 12
            own = 1.0  # the factor of e_a
        else:
            scale = -signs[e] * weighted / 6
            own = 0.0
        for a in range(3):
            d = edges[a]
            for b in range(3):
                g = edges[b]
                change = (g[0] - own * d[0], g[1] - own * d[1], g[2] - own * d[2])
                add_skew(slots[e, a, b], scale, change, J)


@kernel
def add_curved_force(K, Q, nodes, G, w, N, p, x, f):
    """f_a += p Σ w N_a F₁ × F₂ over the points q of each triangle of P2.

    K and Q are tuples with a zero for each node, and for each point. `nodes` is (m, k), G the
    gradients of the shape functions (m, q, k, 2) [1/m], w the weights (m, q) [m²], N (q, k) the
    shape functions, and p (1,) the pressure [Pa].
    """
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F11, F21, F31, F12, F22, F32 = gradient(K, nodes, G, e, q, x)
            n = cross((F11, F21, F31), (F12, F22, F32))
            for a in range(len(K)):
                node = nodes[e, a]
                scale = p[0] * w[e, q] * N[q, a]
                f[node, 0] += scale * n[0]
                f[node, 1] += scale * n[1]
                f[node, 2] += scale * n[2]


@kernel
def add_curved_tangent(K, Q, nodes, slots, G, w, N, p, symmetric, x, wx, J):
    """J_ab += wx p Σ w N_a [d_b]×, or if `symmetric` wx (p/2) Σ w [N_a d_b − N_b d_a]×.

    d_b = G_b1 F₂ − G_b2 F₁. The arguments are as for `add_curved_force`, with the blocks `slots`
    (m, k, k) of J.
    """
    weighted = wx * p[0]
    own = 0.5 if symmetric else 0.0  # the factor of N_b d_a; 1 − own is that of N_a d_b
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F11, F21, F31, F12, F22, F32 = gradient(K, nodes, G, e, q, x)
            for a in range(len(K)):
                for b in range(len(K)):
                    # d = (1 − own) N_a d_b − own N_b d_a
                    s = (1.0 - own) * N[q, a]
                    t = own * N[q, b]
                    g1 = s * G[e, q, b, 0] - t * G[e, q, a, 0]
                    g2 = s * G[e, q, b, 1] - t * G[e, q, a, 1]
                    d = (g1 * F12 - g2 * F11, g1 * F22 - g2 * F21, g1 * F32 - g2 * F31)
                    add_skew(slots[e, a, b], weighted * w[e, q], d, J)
