"""A term over a step of energy–momentum: a force whose work is the change of the energy.

From positions x₀ to x₁ = 2x − x₀, with d = x₁ − x₀ and a force f near −∂U/∂x of the mean x,

    f̄ = f − (N / u·d) u,   N = U(x₁) − U(x₀) + f · d

has the work f̄ · d = U(x₀) − U(x₁), whatever the step and the direction u. For f = −∂U/∂x and
u = d this is the discrete gradient of Gonzalez (1996), Time Integration and Discrete
Hamiltonian Systems, J. Nonlinear Sci. 6, taken for the cloth as a whole: N is one number, not
one of each element. N is of third order in d, so f̄ − f of second, and the step keeps its
order.

u is d times the mass, like a change of momentum. Where no rigid motion changes U, it is
without the rigid part of d,

    u_a = m_a (d_a − d̄ − ω × p_a),   p_a = x_a − x̄,   Θω = Σ m p × d,   Θ = Σ m (|p|² I − p pᵀ)

with the means d̄ and x̄ by mass. Then neither f nor u has a resultant or a moment about x, and
the step keeps linear and angular momentum. Other terms, as loads that are fixed in space, have
both, and a rigid motion changes U: there u = M d.

The tangent is the tangent of f. It lacks the derivative of N u/(u·d), of second order in d, so
that Newton's iteration converges linearly, the faster the shorter the step. Where a step turns
the cloth and hardly deforms it, N and u are small, and N/(u·d) is a quotient of small numbers,
for which the iteration may fail. So stiff terms do not use −∂U/∂x at x for f, but forces there
for which N is zero, or small (`OverMean`):

    membrane        S((E₀ + E₁)/2): N = 0 for an energy quadratic in E (Simo and Tarnow 1992, The
                    Discrete Energy–Momentum Method, ZAMP 43)
    spring          as for the rest length 2 L l/(l₀ + l₁): N = 0 (`spring_modulus`)
    BaraffWitkin    as springs along warp and weft, the mean shear: N = 0
    hinge           the mean (θ₀ + θ₁)/2
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fecloth.compiled.jit import Array
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.reductions import dot, mean
from fecloth.terms.protocol import At, BoundTerm, taken_from

SHORT = 1e-16  # of u·d, relative to d·M d: at or below it the motion is rigid
ROUND_OFF = 1e-15  # of N, relative to the energies


@dataclass(frozen=True, eq=False)
class DiscreteGradient(BoundTerm):
    """A term as it acts over a step from `start` to 2x − start, evaluated at the mean x."""

    # It has the energy: of a term with a history `acting`, whose energy has the heat of the
    # step.
    term: BoundTerm
    acting: BoundTerm  # it has the force f and the tangent: the term, or what its `over_step` gave
    start: np.ndarray  # (n, 3) positions x₀ [m]
    mass: np.ndarray  # (n,) masses of the nodes, all > 0 [kg]
    t: float  # time of the mean [s]; both energies are of this time

    has_energy = False  # at x alone
    name = taken_from("term.name")
    dissipative = taken_from("term.dissipative")
    velocity_dependent = taken_from("term.velocity_dependent")
    power = taken_from("term.power")
    symmetric = taken_from("acting.symmetric")
    dense = taken_from("acting.dense")
    dissipates_over_step = taken_from("acting.dissipates_over_step")
    dissipation = taken_from("acting.dissipation")
    commit = taken_from("acting.commit")
    add_tangent = taken_from("acting.add_tangent")

    @cached_property
    def energy_before(self) -> float:
        """U(x₀) [J]."""
        return self.term.energy(self.start, self.t)

    def add_force(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> None:
        """f += f̄, and damping by the velocity v as at x [N]."""
        elastic = np.zeros_like(f)
        d = 2.0 * (x - self.start)
        self.acting.add_force(x, np.zeros_like(v), t, elastic)
        f += elastic + self.correction(x, d, elastic)
        if self.velocity_dependent:
            self.acting.add_force(x, v, t, f)
            f -= elastic

    def correction(self, x: np.ndarray, d: np.ndarray, f: np.ndarray) -> np.ndarray:
        """−N/(u·d) u (n, 3) [N] for the force f at x, or zero if N or u·d is round-off."""
        before = self.energy_before
        after = self.term.energy(x + 0.5 * d, self.t)
        momentum = self.mass[:, None] * d
        u = deformation(self.mass, x, d) if self.term.objective else momentum
        change = after - before + dot(f, d)
        along = dot(u, d)
        if abs(change) <= ROUND_OFF * (abs(before) + abs(after)):
            return np.zeros_like(f)
        if along <= SHORT * dot(momentum, d):
            return np.zeros_like(f)
        return -change / along * u

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps: the change of energy by time alone.

        Over the step the normals are taken at the mean time, and the forces on the nodes have
        the work of the energy for these. What is left are the changes before and after that
        time.
        """
        if self.term.work_of_clamps(old, new, stages) == 0.0:
            return 0.0
        path = (*old, -1), (old[0], self.t, 1), (new[0], self.t, -1), (*new, 1)
        return sum(sign * self.term.energy(x, t) for x, t, sign in path)


@dataclass(frozen=True, eq=False)
class OverMean(BoundTerm):
    """A term over a step from `start` to 2x − start, as ``term.between(start, x)`` is at x.

    Its tangent lacks the change of `between` with x: it is the exact one of a step that goes
    nowhere.
    """

    term: Any
    start: np.ndarray  # (n, 3) positions x₀ [m]
    symmetric: bool  # whether the tangent must be symmetric
    conserves: bool  # whether N is zero

    has_energy = False  # at x alone
    name = taken_from("term.name")
    dissipative = taken_from("term.dissipative")
    velocity_dependent = taken_from("term.velocity_dependent")

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        self.term.between(self.start, x).add_force(x, v, t, f)

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        self.term.between(self.start, x).add_tangent(x, v, t, wx, wv, J, definite)


def deformation(mass: np.ndarray, x: np.ndarray, d: np.ndarray) -> np.ndarray:
    """u (n, 3) [kg m] of a motion d (n, 3) of nodes at x (n, 3), without its rigid part."""
    p = x - mean(mass, x)
    r = d - mean(mass, d)
    products = np.einsum("a,ai,aj->ij", mass, p, p)
    moment = np.einsum("a,ai->i", mass, np.cross(p, r))
    inertia = np.trace(products) * np.eye(3) - products
    omega = np.linalg.lstsq(inertia, moment, rcond=None)[0]  # no ω along a straight line of nodes
    return mass[:, None] * (r - np.cross(omega, p))
