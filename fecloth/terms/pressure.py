"""Follower pressure: it stays normal to the cloth and grows with its area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cloth import Cloth
from ..compiled import inner, kernel
from ..errors import InputError
from ..given import OfTime, Timed, scalar
from ..panel import Panel
from ..sums import dot
from .stencilbound import stencil_bound


@dataclass(frozen=True)
class Pressure:
    """f_a = (p/6) n with n = (x₂ − x₁) × (x₃ − x₁) on each corner a of a triangle.

    n is twice the deformed area times the unit normal of the triangle as it is oriented in the
    cloth: from a flat start in the plane xy, p > 0 pushes along +z. On a P1 triangle the normal is
    constant, so this is ∫ p N_a n dA exactly. With the edges e_b opposite to the corners (e₁ =
    x₃ − x₂, …), ∂n/∂x_b = [e_b]× and

        K_ab = −∂f_a/∂x_b = −(p/6) [e_b]×                   exact
        K_ab = −(p/12) [e_b − e_a]×                         its symmetric part

    Source: Hibbitt (1979), Some follower forces and load stiffness, Int. J. Numer. Meth. Engng 14,
    937–941; here for the P1 triangle, whose normal is quadratic in its corners.

    The assembled matrix is symmetric already, and the two choices give the same, on every node
    that is not on the cloth's edge; so it is for the whole projected matrix where the edge is
    pinned, or slides in one plane. With a free edge it is not: "exact" then takes a general
    linear solver, "symmetric" Newton's quadratic convergence.

    Work that the pressure does stands in the ledger's column ``work:Pressure``; it has no
    potential in general. P1 triangles only. Cost: a third of `StVK`'s, force and tangent.

    Parameters
    ----------
    p
        Pressure on the lower side less that on the upper one [Pa]: a number, a formula of t
        as text, or a function of t.
    tangent
        "symmetric" or "exact".

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(2.0, 1.0, h=0.5, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.Pressure(30.0)])
    >>> system.force(system.rest()).sum(axis=0).round(12)
    array([ 0.,  0., 60.])
    """

    p: OfTime
    tangent: str = "symmetric"

    def __post_init__(self):
        scalar(self.p, "p", "Pressure")
        if self.tangent not in ("symmetric", "exact"):
            allowed = 'must be "symmetric" or "exact"'
            raise InputError(f"tangent = {self.tangent!r}", allowed, "Pressure")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.stencil

    def bind(self, panel: Panel, slots) -> BoundPressure:
        cloth = panel.cloth
        if cloth.stencil.shape[1] != 3:
            raise InputError(f"element {cloth.element}", "must be P1", "Pressure")
        p = scalar(self.p, "p", "Pressure")
        turns = orientation(cloth)
        blocks = slots(cloth.stencil)
        rest = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
        return BoundPressure(p, cloth.stencil, turns, blocks, self.tangent == "symmetric", rest)


def orientation(cloth: Cloth) -> np.ndarray:
    """(m,) 1 where the stencil's corners run counter-clockwise on the flat cloth, else −1."""
    a, b, c = np.moveaxis(cloth.X[cloth.stencil[:, :3]], 1, 0)
    u, v = b - a, c - a
    return np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


@dataclass(frozen=True, eq=False)
class BoundPressure:
    """`Pressure` on a cloth; `turns` (m,) is the orientation of each triangle's stencil.

    `rest` are the positions (n, 3) of the flat cloth.
    """

    p: Timed
    nodes: np.ndarray
    turns: np.ndarray
    slots: np.ndarray
    symmetric: bool
    rest: np.ndarray

    name = "Pressure"
    load = True
    has_energy = False
    dissipative = False
    velocity_dependent = False

    def supply(self, x, v, t) -> float:
        """Power f · v of the pressure on the cloth [W]."""
        f = np.zeros_like(x)
        self.add_force(x, v, t, f)
        return dot(f, v)

    def add_force(self, x, v, t, f) -> None:
        """f += (p/6) n at each corner [N]."""
        add_force(self.nodes, self.turns, float(self.p(t)), x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; nothing where it must be `definite`: K has as much of either sign."""
        if definite:
            return
        scale = wx * float(self.p(t))
        add_tangent(self.nodes, self.turns, self.slots, scale, self.symmetric, x, J.values)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²], of either sign, and of M⁻¹D, at rest.

        With the pressure at t = 0.
        """
        m, k = self.nodes.shape
        slots = np.arange(m * k * k, dtype=np.int32).reshape(m, k, k)
        K, p = np.zeros((m * k * k, 3, 3)), float(self.p(0.0))
        add_tangent(self.nodes, self.turns, slots, p, self.symmetric, self.rest, K)
        return stencil_bound(self.nodes, K.reshape(m, k, k, 3, 3), mass), 0.0


@inner
def edge(x, i, j):
    """x_j − x_i."""
    return x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]


@inner
def cross(a, b):
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


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
def add_force(nodes, turns, p, x, f):
    """f_a += (p/6) n."""
    for e in range(len(nodes)):
        i, j, k = nodes[e, 0], nodes[e, 1], nodes[e, 2]
        n = cross(edge(x, i, j), edge(x, i, k))
        sixth = turns[e] * p / 6
        for a in range(3):
            node = nodes[e, a]
            f[node, 0] += sixth * n[0]
            f[node, 1] += sixth * n[1]
            f[node, 2] += sixth * n[2]


@kernel
def add_tangent(nodes, turns, slots, p, symmetric, x, J):
    """J_ab −= (p/6) [e_b]×, or (p/12) [e_b − e_a]×."""
    for e in range(len(nodes)):
        i, j, k = nodes[e, 0], nodes[e, 1], nodes[e, 2]
        edges = (edge(x, j, k), edge(x, k, i), edge(x, i, j))
        part, own = (-turns[e] * p / 12, 1.0) if symmetric else (-turns[e] * p / 6, 0.0)
        for a in range(3):
            d = edges[a]
            for b in range(3):
                g = edges[b]
                change = (g[0] - own * d[0], g[1] - own * d[1], g[2] - own * d[2])
                add_skew(slots[e, a, b], part, change, J)
