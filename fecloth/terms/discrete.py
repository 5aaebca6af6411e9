"""Conditions over a step: a discrete gradient of C, which takes part of the work of its energy.

From positions y₀ of a stencil to y₁ = 2y − y₀, with d = y₁ − y₀ and C₀, C₁ at the two ends,

    f_a = −ḡ_a k_s C̄,   C̄ = ½ (C₀ + C₁),   ḡ = ∂C(y) + (N/s) u,   N = C₁ − C₀ − ∂C(y) · d

where u is d without its rigid part, d_a − d̄ − ω × p_a with p = y − ȳ and Θω = Σ p_a × d_a for the
tensor Θ = Σ |p_a|² I − p_a p_aᵀ, and s = u · u = u · d. Then ḡ · d = C₁ − C₀, so that the work
−f · d is ½ C₁ᵀk_s C₁ − ½ C₀ᵀk_s C₀, and ḡ has no resultant and no moment about y, as ∂C(y) has none
for a C that no rigid motion changes: energy and both momenta are kept at any step (Gonzalez 1996,
Time Integration and Discrete Hamiltonian Systems, J. Nonlinear Sci. 6; here the correction is
kept from turning the stencil). For a spring ḡ is ± 2 (y₂ − y₁)/(l₀ + l₁).

    −∂f_a/∂y_b = ḡ_a k_s ∂C(y₁)_bᵀ + Σ_r (k_s C̄)_r ∂ḡ_r,a/∂y_b         not symmetric

The symmetric tangent takes ∂C(y) on both sides and ∂²C(y), if `definite` as in `condition`. Where
u is shorter than 1e-8 of the stencil N is left out: of the order of φ²|u| if the step turns by φ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..compiled import inner, loop
from .condition import BoundCondition, gather

SHORT = 1e-16  # of s, relative to Σ |p|²


@inner
def centred(K, y, p):
    """p_a = y_a − ȳ; Σ |p|²."""
    total = 0.0
    for i in range(3):
        mean = 0.0
        for a in range(len(K)):
            mean += y[a, i] / len(K)
        for a in range(len(K)):
            p[a, i] = y[a, i] - mean
            total += p[a, i] * p[a, i]
    return total


@inner
def inverse_inertia(K, p, total):
    """Θ⁻¹ = (11, 22, 33, 12, 13, 23), of two nodes without p pᵀ, for ω is across their line."""
    if len(K) == 2:
        inverse = 1.0 / total if total > 0.0 else 0.0  # a spring of no length turns nothing
        return inverse, inverse, inverse, 0.0, 0.0, 0.0
    a11, a22, a33, a12, a13, a23 = total, total, total, 0.0, 0.0, 0.0
    for a in range(len(K)):
        a11 -= p[a, 0] * p[a, 0]
        a22 -= p[a, 1] * p[a, 1]
        a33 -= p[a, 2] * p[a, 2]
        a12 -= p[a, 0] * p[a, 1]
        a13 -= p[a, 0] * p[a, 2]
        a23 -= p[a, 1] * p[a, 2]
    b11, b12, b13 = a22 * a33 - a23 * a23, a13 * a23 - a12 * a33, a12 * a23 - a13 * a22
    det = a11 * b11 + a12 * b12 + a13 * b13
    b22, b33, b23 = a11 * a33 - a13 * a13, a11 * a22 - a12 * a12, a12 * a13 - a11 * a23
    return b11 / det, b22 / det, b33 / det, b12 / det, b13 / det, b23 / det


@inner
def times(A, b):
    """A b of a symmetric A."""
    return (
        A[0] * b[0] + A[3] * b[1] + A[4] * b[2],
        A[3] * b[0] + A[1] * b[1] + A[5] * b[2],
        A[4] * b[0] + A[5] * b[1] + A[2] * b[2],
    )


@inner
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def without_rigid_part(K, p, d, inverse, u):
    """u_a = d_a − d̄ − ω × p_a; ω and s = u · u."""
    L1 = L2 = L3 = 0.0
    for a in range(len(K)):
        turn = cross(p[a], d[a])
        L1, L2, L3 = L1 + turn[0], L2 + turn[1], L3 + turn[2]
    omega = times(inverse, (L1, L2, L3))
    centred(K, d, u)
    s = 0.0
    for a in range(len(K)):
        turn = cross(omega, p[a])
        for i in range(3):
            u[a, i] -= turn[i]
            s += u[a, i] * u[a, i]
    return omega, s


@inner
def missing(K, g, d, change):
    """N = C₁ − C₀ − g · d."""
    for a in range(len(K)):
        change -= g[a, 0] * d[a, 0] + g[a, 1] * d[a, 1] + g[a, 2] * d[a, 2]
    return change


@inner
def ends(K, nodes, e, start, x, y0, y, y1, d):
    """y₀, y, y₁ = 2y − y₀ and d = y₁ − y₀ of a stencil."""
    gather(K, nodes, e, start, y0)
    gather(K, nodes, e, x, y)
    for a in range(len(K)):
        for i in range(3):
            y1[a, i] = 2.0 * y[a, i] - y0[a, i]
            d[a, i] = y1[a, i] - y0[a, i]


@loop
def add_force(condition, K, R, nodes, c, ks, start, x, f):
    """f_a −= ḡ_a k_s C̄."""
    k, n = len(K), len(R)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    p, u, g = np.empty((k, 3)), np.empty((k, 3)), np.empty((n, k, 3))
    C0, C, C1, H = np.empty(n), np.empty(n), np.empty(n), np.empty((0, 0, 0, 0, 0))
    for e in range(len(nodes)):
        ends(K, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 0, C1, g, H)
        condition(y, c[e], 1, C, g, H)
        total = centred(K, y, p)
        _, s = without_rigid_part(K, p, d, inverse_inertia(K, p, total), u)
        for r in range(n):
            N = missing(K, g[r], d, C1[r] - C0[r])
            factor = N / s if s > SHORT * total else 0.0
            tension = 0.0
            for q in range(n):
                tension += 0.5 * ks[e, r, q] * (C0[q] + C1[q])
            for a in range(k):
                i = np.uintp(nodes[e, a])
                for j in range(3):
                    f[i, j] -= tension * (g[r, a, j] + factor * u[a, j])


@inner
def turned(K, p, d, omega, inverse, b, j, du):
    """du = ∂u/∂y_bj, with ∂d = 2 ∂y and ∂ω = Θ⁻¹(∂L − ∂Θ ω)."""
    k = len(K)
    unit = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
    m1 = m2 = m3 = 0.0
    for a in range(k):
        m1, m2, m3 = m1 + d[a, 0] / k, m2 + d[a, 1] / k, m3 + d[a, 2] / k
    first = cross(unit, (d[b, 0] - m1, d[b, 1] - m2, d[b, 2] - m3))
    second = cross(p[b], unit)
    along = p[b, 0] * omega[0] + p[b, 1] * omega[1] + p[b, 2] * omega[2] if k > 2 else 0.0
    across = omega[j] if k > 2 else 0.0
    twice = 2.0 * p[b, j]
    turn = times(
        inverse,
        (
            first[0] + 2.0 * second[0] - twice * omega[0] + unit[0] * along + p[b, 0] * across,
            first[1] + 2.0 * second[1] - twice * omega[1] + unit[1] * along + p[b, 1] * across,
            first[2] + 2.0 * second[2] - twice * omega[2] + unit[2] * along + p[b, 2] * across,
        ),
    )
    swept = cross(omega, unit)
    for a in range(k):
        share = (1.0 if a == b else 0.0) - 1.0 / k
        moved = cross(turn, p[a])
        for i in range(3):
            du[a, i] = share * (2.0 * unit[i] - swept[i]) - moved[i]


@loop
def add_tangent(condition, K, R, nodes, slots, c, ks, start, x, scale, J):
    """J_ab += scale (ḡ_a k_s ∂C(y₁)_bᵀ + Σ_r (k_s C̄)_r ∂ḡ_r,a/∂y_b)."""
    k, n = len(K), len(R)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    p, u, du = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    g, g1, H = np.empty((n, k, 3)), np.empty((n, k, 3)), np.empty((n, k, 3, k, 3))
    C0, C, C1, N, tension = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for e in range(len(nodes)):
        ends(K, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 1, C1, g1, H)
        condition(y, c[e], 2, C, g, H)
        total = centred(K, y, p)
        inverse = inverse_inertia(K, p, total)
        omega, s = without_rigid_part(K, p, d, inverse, u)
        corrected = s > SHORT * total
        for r in range(n):
            N[r] = missing(K, g[r], d, C1[r] - C0[r])
            tension[r] = 0.0
            for q in range(n):
                tension[r] += 0.5 * scale * ks[e, r, q] * (C0[q] + C1[q])
        for b in range(k):
            for j in range(3):
                ds = 0.0
                if corrected:
                    turned(K, p, d, omega, inverse, b, j, du)
                    for a in range(k):
                        for i in range(3):
                            ds += 2.0 * u[a, i] * du[a, i]
                for r in range(n):
                    T, dN = 0.0, 2.0 * (g1[r, b, j] - g[r, b, j])
                    for q in range(n):
                        T += scale * ks[e, r, q] * g1[q, b, j]
                    for a in range(k):
                        for i in range(3):
                            dN -= H[r, a, i, b, j] * d[a, i]
                    for a in range(k):
                        slot = np.uintp(slots[e, a, b])
                        for i in range(3):
                            gradient, change = g[r, a, i], H[r, a, i, b, j]
                            if corrected:
                                gradient += N[r] / s * u[a, i]
                                change += (dN - N[r] * ds / s) / s * u[a, i]
                                change += N[r] / s * du[a, i]
                            J[slot, i, j] += gradient * T + tension[r] * change


@loop
def add_symmetric(condition, K, R, nodes, slots, c, ks, start, x, scale, definite, J):
    """J_ab += scale (∂C_a k_s ∂C_bᵀ + Σ_r (k_s C̄)_r ∂²C_r,ab) at y; `definite`: what is of it."""
    k, n = len(K), len(R)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    g, H = np.empty((n, k, 3)), np.empty((n, k, 3, k, 3))
    C0, C, C1 = np.empty(n), np.empty(n), np.empty(n)
    for e in range(len(nodes)):
        ends(K, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 0, C1, g, H)
        condition(y, c[e], 2, C, g, H)
        for r in range(n):
            tension = 0.0
            for q in range(n):
                tension += 0.5 * scale * ks[e, r, q] * (C0[q] + C1[q])
            if definite and (R[r] == 0 or tension < 0.0):
                tension = 0.0
            for b in range(k):
                for j in range(3):
                    T = 0.0
                    for q in range(n):
                        T += scale * ks[e, r, q] * g[q, b, j]
                    for a in range(k):
                        slot = np.uintp(slots[e, a, b])
                        for i in range(3):
                            J[slot, i, j] += g[r, a, i] * T + tension * H[r, a, i, b, j]


class Discrete(NamedTuple):
    """A family's compiled entry points over a step, each one of the loops above with it."""

    add_force: Callable
    add_tangent: Callable
    add_symmetric: Callable


@dataclass(frozen=True, eq=False)
class RigidCondition(BoundCondition):
    """Conditions that no rigid motion changes, with their entry points over a step."""

    discrete: Discrete = None

    def between(self, start: np.ndarray, symmetric: bool) -> OverStep | RigidCondition:
        """The conditions over a step from positions `start` (n, 3)."""
        return OverStep(self, start, symmetric) if self.has_energy else self


@dataclass(frozen=True, eq=False)
class OverStep:
    """Conditions as they act over a step from `start` to 2x − start; their damping acts at x."""

    given: RigidCondition
    start: np.ndarray
    symmetric_elastic: bool

    has_energy = False  # at x alone

    @property
    def name(self) -> str:
        return self.given.name

    @property
    def symmetric(self) -> bool:
        return self.symmetric_elastic and self.given.symmetric

    @property
    def dissipative(self) -> bool:
        return self.given.dissipative

    @property
    def velocity_dependent(self) -> bool:
        return self.given.velocity_dependent

    @property
    def _damping(self) -> BoundCondition:
        return replace(self.given, stiffness=np.zeros_like(self.given.stiffness))

    def add_force(self, x, v, t, f) -> None:
        """f_a −= ḡ_a k_s C̄ + ∂C_a k_d Ċ [N]."""
        given = self.given
        data = given.nodes, given.constants, given.stiffness, self.start
        given.discrete.add_force(*given.shape, *data, x, f)
        if self.dissipative:
            self._damping.add_force(x, v, t, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D."""
        given = self.given
        add, weights = given.discrete.add_tangent, (float(wx),)
        if self.symmetric_elastic or definite:
            add, weights = given.discrete.add_symmetric, (float(wx), bool(definite))
        data = given.nodes, given.slots, given.constants, given.stiffness, self.start
        add(*given.shape, *data, x, *weights, J.values)
        if self.dissipative:
            self._damping.add_tangent(x, v, t, wx, wv, J, definite)


def with_steps(bound: BoundCondition, discrete: Discrete) -> RigidCondition:
    """A bound condition with its entry points over a step."""
    return RigidCondition(**vars(bound), discrete=discrete)
