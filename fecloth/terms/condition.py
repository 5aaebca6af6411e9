"""The condition loop: springs, hinges and every other condition C(x) run through these kernels.

A condition C(x) with r components on a stencil of k nodes, a stiffness k_s and a damping k_d give
(Baraff and Witkin 1998, Large Steps in Cloth Simulation, equations in brackets)

    energy   ½ Cᵀ k_s C                                                               (6)
    force    f_a = −∂C_a k_s C                                                        (7)
    K_ab   = ∂C_a k_s ∂C_bᵀ + Σ_r (k_s C)_r ∂²C_r,ab                                  (8)
    damping  d_a = −∂C_a k_d Ċ,  Ċ = Σ_a ∂C_aᵀ v_a                                   (11)
    −∂d_a/∂x_b = Σ_r (k_d Ċ)_r ∂²C_r,ab + ∂C_a k_d (∂Ċ/∂x_b)ᵀ,  ∂Ċ/∂x_b = ∂²C_ba v   (12)
    −∂d_a/∂v_b = ∂C_a k_d ∂C_bᵀ                                                      (13)

with the last part of (12) not symmetric: Baraff and Witkin drop it. k_s and k_d are (r, r)
matrices, the stencil's own: for one component they are numbers, else mostly diagonal.

A family of conditions is a compiled function

    condition(y, c, order, C, g, H)      decorated with @inner

    y (k, 3)             positions of the stencil's nodes [m]
    c (p,)               the constants of the stencil
    order                what is asked for: 0 only C, 1 also g, 2 also H
    C (r,), g (r, k, 3), H (r, k, 3, k, 3)
                         to be filled with C, ∂C/∂y and ∂²C/∂y∂y: every entry that `order` asks for,
                         for they hold the values of another stencil before

and four module-level entry points, which hand it to the loops below (as springs.py does), in a
`Kernels`. `K` is a tuple with one zero for each node and `R` a tuple with, for each component, 1
if its ∂²C is positive semi-definite at every x and 0 if it is not: the compiler knows their
length. `bind` makes the bound term. A term whose constants change with x or t extends
`BoundCondition` and its `table`, as user_condition.py and tether.py do.

`definite` keeps the part (k_s C + k_d Ċ)_r ∂²C_r where both factors are not negative, drops the
others and the non-symmetric part. Gauss–Newton drops all of ∂²C.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..compiled import inner, loop
from ..errors import InputError
from ..panel import Panel
from .stencilbound import bound_of_squares, squares

GAUSS_NEWTON, EXACT, DEFINITE = 0, 1, 2  # what becomes of the part with ∂²C


@inner
def gather(K, nodes, e, x, y):
    """y_a = x of the stencil's node a."""
    for a in range(len(K)):
        i = np.uintp(nodes[e, a])
        for j in range(3):
            y[a, j] = x[i, j]


@inner
def rate(K, R, g, u, out):
    """Ċ_r = Σ_a ∂C_r/∂x_a · v_a."""
    for r in range(len(R)):
        out[r] = 0.0
        for a in range(len(K)):
            out[r] += g[r, a, 0] * u[a, 0] + g[r, a, 1] * u[a, 1] + g[r, a, 2] * u[a, 2]


@loop
def energy(condition, K, R, nodes, c, ks, x):
    """½ Σ Cᵀ k_s C [J]."""
    y, C = np.empty((len(K), 3)), np.empty(len(R))
    g, H = np.empty((len(R), len(K), 3)), np.empty((0, 0, 0, 0, 0))
    total = 0.0
    for e in range(len(nodes)):
        gather(K, nodes, e, x, y)
        condition(y, c[e], 0, C, g, H)
        for r in range(len(R)):
            for s in range(len(R)):
                total += 0.5 * ks[e, r, s] * C[r] * C[s]
    return total


@loop
def power(condition, K, R, nodes, c, kd, x, v):
    """Dissipated power Σ Ċᵀ k_d Ċ [W]."""
    y, u = np.empty((len(K), 3)), np.empty((len(K), 3))
    C, Cdot = np.empty(len(R)), np.empty(len(R))
    g, H = np.empty((len(R), len(K), 3)), np.empty((0, 0, 0, 0, 0))
    total = 0.0
    for e in range(len(nodes)):
        gather(K, nodes, e, x, y)
        gather(K, nodes, e, v, u)
        condition(y, c[e], 1, C, g, H)
        rate(K, R, g, u, Cdot)
        for r in range(len(R)):
            for s in range(len(R)):
                total += kd[e, r, s] * Cdot[r] * Cdot[s]
    return total


@loop
def add_force(condition, K, R, nodes, c, ks, kd, x, v, f):
    """f_a −= ∂C_a (k_s C + k_d Ċ)."""
    y, u = np.empty((len(K), 3)), np.empty((len(K), 3))
    C, Cdot = np.empty(len(R)), np.empty(len(R))
    g, H = np.empty((len(R), len(K), 3)), np.empty((0, 0, 0, 0, 0))
    for e in range(len(nodes)):
        gather(K, nodes, e, x, y)
        gather(K, nodes, e, v, u)
        condition(y, c[e], 1, C, g, H)
        rate(K, R, g, u, Cdot)
        for r in range(len(R)):
            tension = 0.0
            for s in range(len(R)):
                tension += ks[e, r, s] * C[s] + kd[e, r, s] * Cdot[s]
            for a in range(len(K)):
                i = np.uintp(nodes[e, a])
                for j in range(3):
                    f[i, j] -= tension * g[r, a, j]


@loop
def add_tangent(condition, K, R, nodes, slots, c, ks, kd, x, v, wx, wv, part, mixed, J):
    """J_ab += ∂C_a (wx k_s + wv k_d) ∂C_bᵀ + wx Σ (k_s C + k_d Ċ)_r ∂²C_r,ab + the mixed part.

    `part` says what becomes of the second part, `mixed` whether wx ∂C_a k_d (∂Ċ/∂x_b)ᵀ is there.
    """
    k, n = len(K), len(R)
    y, u = np.empty((k, 3)), np.empty((k, 3))
    C, Cdot, tension = np.empty(n), np.empty(n), np.empty(n)
    g, H = np.empty((n, k, 3)), np.empty((n, k, 3, k, 3))
    turn, T = np.zeros((n, k, 3)), np.empty((n, k, 3))  # ∂Ċ/∂x; what ∂C_a is multiplied by
    order = 2 if part != GAUSS_NEWTON or mixed else 1
    for e in range(len(nodes)):
        gather(K, nodes, e, x, y)
        gather(K, nodes, e, v, u)
        condition(y, c[e], order, C, g, H)
        rate(K, R, g, u, Cdot)
        if mixed:
            for r in range(n):
                for b in range(k):
                    for j in range(3):
                        total = 0.0
                        for a in range(k):
                            for i in range(3):
                                total += H[r, b, j, a, i] * u[a, i]
                        turn[r, b, j] = wx * total
        for r in range(n):
            s = 0.0
            for q in range(n):
                s += ks[e, r, q] * C[q] + kd[e, r, q] * Cdot[q]
            drop = part == GAUSS_NEWTON or (part == DEFINITE and (R[r] == 0 or wx * s < 0.0))
            tension[r] = 0.0 if drop else wx * s
            for b in range(k):
                for j in range(3):
                    T[r, b, j] = 0.0
                    for q in range(n):
                        weight = wx * ks[e, r, q] + wv * kd[e, r, q]
                        T[r, b, j] += weight * g[q, b, j] + kd[e, r, q] * turn[q, b, j]
        for a in range(k):
            for b in range(k):
                slot = np.uintp(slots[e, a, b])
                for i in range(3):
                    for j in range(3):
                        total = 0.0
                        for r in range(n):
                            total += g[r, a, i] * T[r, b, j]
                            if tension[r] != 0.0:
                                total += tension[r] * H[r, a, i, b, j]
                        J[slot, i, j] += total


class Kernels(NamedTuple):
    """A family's compiled entry points, each one of the loops above written out with it."""

    energy: Callable
    power: Callable
    add_force: Callable
    add_tangent: Callable


@dataclass(frozen=True, eq=False)
class BoundCondition:
    """Conditions of one family on a cloth, made by `bind`.

    Attributes
    ----------
    kernels
        The family's entry points.
    shape
        (K, R), as the kernels take them.
    nodes, slots
        (m, k) int32 nodes of each stencil and (m, k, k) its blocks in the system matrix.
    constants
        (m, p) constants of each stencil.
    stiffness, damping
        (m, r, r) k_s and k_d.
    rest
        (n, 3) positions at which `rate_bounds` is taken.
    hessian
        "exact" or "gauss_newton" (without ∂²C).
    tangent
        Of the damping: "symmetric" (without its non-symmetric part) or "exact".
    """

    name: str
    kernels: Kernels
    shape: tuple[tuple, tuple]
    nodes: np.ndarray
    slots: np.ndarray
    constants: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest: np.ndarray
    hessian: str = "exact"
    tangent: str = "symmetric"

    @property
    def has_energy(self) -> bool:
        return bool(self.stiffness.any())

    @property
    def dissipative(self) -> bool:
        return bool(self.damping.any())

    @property
    def velocity_dependent(self) -> bool:
        return self.dissipative

    @property
    def symmetric(self) -> bool:
        return self.tangent == "symmetric" or not self.dissipative

    def table(self, x, t, order) -> np.ndarray:
        """(m, p) constants at x and t, for terms whose are not: up to what `order` asks for."""
        return self.constants

    def energy(self, x: np.ndarray, t: float) -> float:
        """½ Σ Cᵀ k_s C [J]."""
        return self.kernels.energy(*self.shape, self.nodes, self.table(x, t, 0), self.stiffness, x)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ Ċᵀ k_d Ċ [W]."""
        return self.kernels.power(*self.shape, self.nodes, self.table(x, t, 1), self.damping, x, v)

    def add_force(self, x, v, t, f) -> None:
        """f_a −= ∂C_a (k_s C + k_d Ċ) [N]."""
        data = self.table(x, t, 1), self.stiffness, self.damping
        self.kernels.add_force(*self.shape, self.nodes, *data, x, v, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D."""
        part = EXACT if self.hessian == "exact" else GAUSS_NEWTON
        if definite and part == EXACT:
            part = DEFINITE
        mixed = not self.symmetric and not definite
        data = self.table(x, t, 2), self.stiffness, self.damping
        weights = float(wx), float(wv), part, mixed
        self.kernels.add_tangent(
            *self.shape, self.nodes, self.slots, *data, x, v, *weights, J.values
        )

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] at rest and of M⁻¹D [1/s]."""
        return self._bound(mass, 1.0, 0.0), self._bound(mass, 0.0, 1.0)

    def _bound(self, mass, wx, wv) -> float:
        """Bound for wx K + wv D, by stencils."""
        if not (self.stiffness.any() if wx else self.damping.any()):
            return 0.0
        parts = [squares(blocks) for blocks in self._blocks(wx, wv)]
        return bound_of_squares(self.nodes, np.concatenate(parts), mass)

    def _blocks(self, wx, wv, size=8192):
        """(s, k, k, 3, 3), the stencils' own matrices at rest, `size` of them at once."""
        still, constants = np.zeros_like(self.rest), self.table(self.rest, 0.0, 2)
        for start in range(0, len(self.nodes), size):
            part = slice(start, start + size)
            s, k = self.nodes[part].shape
            slots = np.arange(s * k * k, dtype=np.int32).reshape(s, k, k)
            values = np.zeros((s * k * k, 3, 3))
            data = constants[part], self.stiffness[part], self.damping[part]
            weights = wx, wv, EXACT if self.hessian == "exact" else GAUSS_NEWTON, False
            nodes = self.nodes[part]
            self.kernels.add_tangent(
                *self.shape, nodes, slots, *data, self.rest, still, *weights, values
            )
            yield values.reshape(s, k, k, 3, 3)


def bind(
    name: str,
    kernels: Kernels,
    convex: tuple[int, ...],
    panel: Panel,
    slots: Callable,
    nodes: np.ndarray,
    constants: np.ndarray,
    stiffness: np.ndarray | float,
    damping: np.ndarray | float = 0.0,
    hessian: str = "exact",
    tangent: str = "symmetric",
) -> BoundCondition:
    """Bind a family of conditions to the stencils `nodes` of a panel.

    Parameters
    ----------
    name
        The term's name in the ledger.
    convex
        For each of the r components, 1 if its ∂²C is positive semi-definite everywhere, else 0.
    panel, slots
        As a term's ``bind`` gets them.
    nodes
        (m, k) int32; the very array that the term's ``stencil`` gives, or an equal one.
    constants
        (m, p), what the condition gets as `c`.
    stiffness, damping
        k_s and k_d: a number, (m,) one for each stencil, (m, r) also for each component, or
        (m, r, r).
    hessian, tangent
        See `BoundCondition`.
    """
    nodes = np.ascontiguousarray(nodes, dtype=np.int32)
    m, k = nodes.shape
    X = panel.cloth.X
    return BoundCondition(
        name,
        kernels,
        ((0,) * k, tuple(int(flag) for flag in convex)),
        nodes,
        slots(nodes),
        np.ascontiguousarray(np.broadcast_to(constants, (m, np.shape(constants)[-1])), dtype=float),
        _matrices(stiffness, m, len(convex)),
        _matrices(damping, m, len(convex)),
        np.column_stack([X, np.zeros(len(X))]),
        hessian,
        tangent,
    )


def _matrices(values, m: int, r: int) -> np.ndarray:
    """(m, r, r) from a number, (m,), (m, r) or (m, r, r)."""
    values = np.asarray(values, dtype=float)
    if values.ndim < 3:
        rows = values[:, None] if values.ndim == 1 else values
        values = np.broadcast_to(rows, (m, r))[:, :, None] * np.eye(r)
    return np.ascontiguousarray(np.broadcast_to(values, (m, r, r)))


def check_options(where: str, hessian: str = "exact", tangent: str = "symmetric") -> None:
    """Refuse a choice that there is not."""
    for name, value, allowed in (
        ("hessian", hessian, ("exact", "gauss_newton")),
        ("tangent", tangent, ("symmetric", "exact")),
    ):
        if value not in allowed:
            raise InputError(f"{name} = {value!r}", f"must be one of {', '.join(allowed)}", where)
