"""A spring over a step: the discrete gradient of its length in closed form.

With e₀, e and e₁ = 2e − e₀ the vector from its first to its second node at the start, in the middle
and at the end of a step, and the lengths l₀ and l₁,

    f₂ = −f₁ = −k (½ (l₀ + l₁) − L) ∂̄l = −k (1 − 2L/s) e,   ∂̄l = 2 e/s,   s = l₀ + l₁

because 4 e · (e₁ − e₀) / (2s) = (l₁² − l₀²)/s = l₁ − l₀: the work is the change of the energy
(Simo and Tarnow 1992, The Discrete Energy–Momentum Method, ZAMP 43, for such a force along e).

    −∂f₂/∂e = k ((1 − 2L/s) I + (4L/s²) e ⊗ e₁/l₁)         not symmetric unless l₀ = l₁

This is what the formula of `condition_discrete_gradient` gives for two nodes. But that one divides
by the deformation over the step, and has to leave the quotient out where the deformation is
small. In a net that turns by φ in a step without stretch the force then jumped by φ²/8 of itself,
and Newton's iteration met a jump in place of a solution.
"""

from __future__ import annotations

import math

import numpy as np

from fecloth.compiled.jit import inner, kernel
from fecloth.terms.loops.condition_discrete_gradient import DiscreteGradientKernels


@inner
def _vectors(nodes, s, start, x, e, e1):
    """Fill e and e₁ of spring s; return l₀ + l₁ and l₁."""
    a, b = np.uintp(nodes[s, 0]), np.uintp(nodes[s, 1])
    square0 = square1 = 0.0
    for i in range(3):
        before = start[b, i] - start[a, i]
        e[i] = x[b, i] - x[a, i]
        e1[i] = 2.0 * e[i] - before
        square0 += before * before
        square1 += e1[i] * e1[i]
    l1 = math.sqrt(square1)
    return math.sqrt(square0) + l1, l1


@kernel
def add_force(per_node, convex, nodes, c, ks, start, x, f):
    """f₂ −= k (1 − 2L/s) e and f₁ += the same."""
    e, e1 = np.empty(3), np.empty(3)
    for s in range(len(nodes)):
        lengths, _ = _vectors(nodes, s, start, x, e, e1)
        if lengths > 0.0:  # a spring of no length has no force
            k = ks[s, 0, 0] * (1.0 - 2.0 * c[s, 0] / lengths)
            for i in range(3):
                f[nodes[s, 0], i] += k * e[i]
                f[nodes[s, 1], i] -= k * e[i]


@inner
def _scatter(slots, s, block, J):
    """Add a block of −∂f₂/∂e to the four blocks of the spring."""
    for i in range(3):
        for j in range(3):
            J[slots[s, 0, 0], i, j] += block[i, j]
            J[slots[s, 1, 1], i, j] += block[i, j]
            J[slots[s, 0, 1], i, j] -= block[i, j]
            J[slots[s, 1, 0], i, j] -= block[i, j]


@kernel
def add_tangent(per_node, convex, nodes, slots, c, ks, start, x, scale, J):
    """J += scale k ((1 − 2L/s) I + (4L/s²) e ⊗ e₁/l₁)."""
    e, e1, block = np.empty(3), np.empty(3), np.empty((3, 3))
    for s in range(len(nodes)):
        lengths, l1 = _vectors(nodes, s, start, x, e, e1)
        if l1 > 0.0:
            k = scale * ks[s, 0, 0]
            along = k * 4.0 * c[s, 0] / (lengths * lengths * l1)
            for i in range(3):
                for j in range(3):
                    block[i, j] = along * e[i] * e1[j]
                block[i, i] += k * (1.0 - 2.0 * c[s, 0] / lengths)
            _scatter(slots, s, block, J)


@kernel
def add_symmetric_tangent(per_node, convex, nodes, slots, c, ks, start, x, scale, definite, J):
    """J += scale k ((1 − 2L/s) I + (4L/s²) e ⊗ e/|e|); `definite` cuts both stiffnesses at 0."""
    e, e1, block = np.empty(3), np.empty(3), np.empty((3, 3))
    for s in range(len(nodes)):
        lengths, _ = _vectors(nodes, s, start, x, e, e1)
        length = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        if length > 0.0:
            k = scale * ks[s, 0, 0]
            across = k * (1.0 - 2.0 * c[s, 0] / lengths)
            along = across + k * 4.0 * c[s, 0] * length / (lengths * lengths)
            if definite:
                across, along = max(across, 0.0), max(along, 0.0)
            for i in range(3):
                for j in range(3):
                    block[i, j] = (along - across) * e[i] * e[j] / (length * length)
                block[i, i] += across
            _scatter(slots, s, block, J)


OVER_STEP = DiscreteGradientKernels(add_force, add_tangent, add_symmetric_tangent)
