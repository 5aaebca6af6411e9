"""A term over a step of energy–momentum: a force whose work is the change of the energy.

From positions x₀ to x₁ = 2x − x₀, with d = x₁ − x₀ and a force f near −∂U/∂x of the mean x,

    f̄ = f − (N / u·d) u,   N = U(x₁) − U(x₀) + f · d

has the work f̄ · d = U(x₀) − U(x₁), whatever the step and the direction u. For f = −∂U/∂x and
u = d this is the discrete gradient of Gonzalez (1996), Time Integration and Discrete
Hamiltonian Systems, J. Nonlinear Sci. 6, for the cloth as a whole: N is one number for all
elements. N is of third order in d. So f̄ − f is of second order, and the step keeps its order.

u is d times the mass, like a change of momentum. Where no rigid motion changes U, the rigid
part of d is left out,

    u_a = m_a (d_a − d̄ − ω × p_a),   p_a = x_a − x̄,   Θω = Σ m p × d,   Θ = Σ m (|p|² I − p pᵀ)

with the means d̄ and x̄ by mass. Then neither f nor u has a resultant or a moment about x, and
the step keeps linear and angular momentum. Of other terms, such as loads that are fixed in
space, a rigid motion changes U, and their forces have a resultant and a moment: there u = M d.

The tangent is the tangent of f. The derivative of N u/(u·d) is left out. It is of second order
in d, so that Newton's iteration converges linearly, and the faster the shorter the step. Where
a step turns the cloth and hardly deforms it, N and u are small, and N/(u·d) is a quotient of
small numbers, for which the iteration may fail. So stiff terms do not use f = −∂U/∂x at x, but
other forces there, for which N is zero or small (`OverMean`):

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

# |N| over the sum of both energies. At or below it, N is the round-off of their difference, a
# few times 2e-16, and no correction is due.
ROUND_OFF_OVER_ENERGIES = 1e-15


@dataclass(frozen=True, eq=False)
class DiscreteGradient(BoundTerm):
    """A term as it acts over a step from `start` to 2x − start, evaluated at the mean x.

    Attributes
    ----------
    term
        It gives the energy. Of a term with a history it is `acting`, whose energy includes the
        heat of the step.
    acting
        It gives the force f and the tangent: the term, or the result of its `over_step`.
    start
        Positions x₀ (n, 3) [m].
    mass
        Masses (n,) of the nodes, all > 0 [kg].
    t
        Time [s] of the mean, at which both energies are taken.
    """

    term: BoundTerm
    acting: BoundTerm
    start: np.ndarray
    mass: np.ndarray
    t: float

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
        """f (n, 3) += f̄ [N], and the damping by the velocity v (n, 3) at the mean x.

        Only the force at v = 0 is corrected, as it alone must do the work of the energy.
        """
        elastic_force = np.zeros_like(f)
        d = 2.0 * (x - self.start)
        self.acting.add_force(x, np.zeros_like(v), t, elastic_force)
        f += elastic_force + self.correction(x, d, elastic_force)
        if self.velocity_dependent:
            # The term adds both forces at once: the elastic one, already added, is taken away.
            self.acting.add_force(x, v, t, f)
            f -= elastic_force

    def correction(self, x: np.ndarray, d: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Return −N/(u·d) u (n, 3) [N], which makes the work of f that of the energy.

        x (n, 3) are the mean positions, d = x₁ − x₀ (n, 3) is the motion over the step, and
        f (n, 3) the force at x. The correction is zero where N or u·d is round-off.
        """
        energy_before = self.energy_before
        energy_after = self.term.energy(x + 0.5 * d, self.t)
        N = energy_after - energy_before + dot(f, d)
        if abs(N) <= ROUND_OFF_OVER_ENERGIES * (abs(energy_before) + abs(energy_after)):
            return np.zeros_like(f)
        mass_times_d = self.mass[:, None] * d
        u = mass_times_d
        if self.term.objective:  # no rigid motion changes its energy
            u = deformation(self.mass, x, d)
        u_dot_d = dot(u, d)
        is_rigid_motion = u_dot_d <= np.finfo(float).eps * dot(mass_times_d, d)
        if is_rigid_motion:
            return np.zeros_like(f)
        return -N / u_dot_d * u

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps: the change of energy by time alone.

        Over the step the normals are taken at the mean time, and the forces on the nodes do the
        work of the energy with these normals. What is left is the change of the energy at the
        old positions up to the mean time, and at the new positions from then on.
        """
        if self.term.work_of_clamps(old, new, stages) == 0.0:  # no clamps that move
            return 0.0
        energy = self.term.energy
        x_old, t_old = old
        x_new, t_new = new
        before = -energy(x_old, t_old) + energy(x_old, self.t)
        return before - energy(x_new, self.t) + energy(x_new, t_new)


@dataclass(frozen=True, eq=False)
class OverMean(BoundTerm):
    """A term over a step from `start` to 2x − start: at x, ``term.between(start, x)``.

    The change of `between` with x is left out of the tangent, which is exact for a step without
    motion only.

    Attributes
    ----------
    term
        A bound term with a function `between`.
    start
        Positions x₀ (n, 3) [m].
    symmetric
        Whether the tangent must be symmetric.
    conserves
        Whether N is zero.
    """

    term: Any
    start: np.ndarray
    symmetric: bool
    conserves: bool

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
    """Return u (n, 3) [kg m]: the mass times a motion d (n, 3), without the rigid part of d.

    The nodes are at x (n, 3) [m], with masses (n,). The formulas stand at the top of this
    module.
    """
    p = x - mean(mass, x)
    d_without_mean = d - mean(mass, d)
    products = np.einsum("a,ai,aj->ij", mass, p, p)
    moment = np.einsum("a,ai->i", mass, np.cross(p, d_without_mean))
    inertia = np.trace(products) * np.eye(3) - products
    # The inertia of nodes on one straight line is singular. Least squares then give the ω that
    # has no part along this line.
    omega, *_ = np.linalg.lstsq(inertia, moment, rcond=None)
    return mass[:, None] * (d_without_mean - np.cross(omega, p))
