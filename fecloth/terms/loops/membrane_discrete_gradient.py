"""Membranes whose energy is quadratic in E, over a step: the stress of the averaged Green strain.

From positions x₀ to x₁ = 2x − x₀, with F at x, F₁ at x₁, and E₀, E₁ at the two ends,

    f_a  = −Σ w F S̄ G_a,   S̄ = ½ (S(E₀) + S(E₁)) = S(½ (E₀ + E₁))
    K_ab = −∂f_a/∂x_b = Σ w (B_a(F)ᵀ ℂ B_b(F₁) + (G_a · S̄ G_b) I₃)

E is quadratic in x, so E₁ − E₀ = B(F)(x₁ − x₀) without error, and the work −f · (x₁ − x₀) is
Σ w S̄ : (E₁ − E₀) = Σ w (W₁ − W₀), whatever the step (Simo and Tarnow 1992, The Discrete
Energy–Momentum Method, ZAMP 43). K is not symmetric, as B is taken at two places.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.jit import inner, loop
from fecloth.terms.loops.green_strain import (
    clamped,
    gradient,
    green_strain,
    scatter_force,
    scatter_mixed,
    scatter_symmetric,
)
from fecloth.terms.loops.membrane import BoundMembrane, Kernels


@inner
def extrapolated(F, F0):
    """F₁ = 2F − F₀."""
    return (
        2.0 * F[0] - F0[0],
        2.0 * F[1] - F0[1],
        2.0 * F[2] - F0[2],
        2.0 * F[3] - F0[3],
        2.0 * F[4] - F0[4],
        2.0 * F[5] - F0[5],
    )


@inner
def half(E0, E1):
    """½ (E₀ + E₁)."""
    return 0.5 * (E0[0] + E1[0]), 0.5 * (E0[1] + E1[1]), 0.5 * (E0[2] + E1[2])


@inner
def mean_strain(F0, F1):
    """½ (E₀ + E₁)."""
    return half(green_strain(F0), green_strain(F1))


@loop
def add_force(law, K, Q, nodes, G, w, c, start, x, f):
    """f_a −= Σ w F S̄ G_a."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F0, F = gradient(K, nodes, G, e, q, start), gradient(K, nodes, G, e, q, x)
            _, S, _ = law(mean_strain(F0, extrapolated(F, F0)), c[e])
            scatter_force(K, nodes, G, e, q, w[e, q], F, S, f)


@loop
def add_symmetric(law, K, Q, nodes, slots, G, w, c, start, x, scale, floor, J):
    """J += scale · Σ w (B_a(F)ᵀ ℂ B_b(F) + (G_a · S̄ G_b) I₃), S̄ clamped from below at `floor`."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F0, F = gradient(K, nodes, G, e, q, start), gradient(K, nodes, G, e, q, x)
            _, S, C = law(mean_strain(F0, extrapolated(F, F0)), c[e])
            scatter_symmetric(K, slots, G, e, q, scale * w[e, q], F, clamped(S, floor), C, J)


@loop
def add_tangent(law, K, Q, nodes, slots, G, w, c, start, x, scale, J):
    """J_ab += scale · Σ w (B_a(F)ᵀ ℂ B_b(F₁) + (G_a · S̄ G_b) I₃)."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F0, F = gradient(K, nodes, G, e, q, start), gradient(K, nodes, G, e, q, x)
            F1 = extrapolated(F, F0)
            _, S, C = law(mean_strain(F0, F1), c[e])
            scatter_mixed(K, slots, G, e, q, scale * w[e, q], F, F1, S, C, J)


class Averaged(NamedTuple):
    """A law's compiled entry points over a step, each one of the loops above with the law."""

    add_force: Callable
    add_tangent: Callable
    add_symmetric: Callable


@dataclass(frozen=True, eq=False)
class SteppedMembrane(BoundMembrane):
    """A bound law with its entry points over a step."""

    averaged: Averaged

    def between(self, start: np.ndarray, symmetric: bool) -> OverStep:
        """The membrane over a step from positions `start` (n, 3)."""
        return OverStep(self, start, symmetric)


@dataclass(frozen=True, eq=False)
class OverStep:
    """The membrane as it acts over a step from `start` to 2x − start."""

    membrane: SteppedMembrane
    start: np.ndarray
    symmetric: bool

    has_energy = False  # at x alone
    dissipative = False
    velocity_dependent = False

    @property
    def name(self) -> str:
        return self.membrane.name

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w F S̄ G_a [N]."""
        self.membrane.averaged.add_force(*self.membrane._data, self.start, x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; the symmetric one has both B at x, the definite one S̄ clamped at zero."""
        K, Q, nodes, *data = self.membrane._data
        kernels, weights = self.membrane.averaged, (float(wx),)
        add = kernels.add_tangent
        if self.symmetric or definite:
            add, weights = kernels.add_symmetric, (float(wx), 0.0 if definite else -math.inf)
        add(K, Q, nodes, self.membrane.slots, *data, self.start, x, *weights, J.values)


def bind(
    name: str,
    kernels: Kernels,
    averaged: Averaged,
    constants: np.ndarray,
    moduli: np.ndarray,
    panel: Panel,
    slots: Callable,
) -> SteppedMembrane:
    """Bind a law with its constants (m, p) and moduli (m, 6) to a panel."""
    blocks = slots(panel.cloth.stencil)
    return SteppedMembrane(name, kernels, panel, blocks, constants, moduli, averaged)
