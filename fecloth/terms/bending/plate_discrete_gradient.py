"""A plate over a step: a discrete gradient of its measures, whose work is the change of energy.

From positions y₀ of a hinge to y₁ = 2y − y₀ the force is −Σ m̄_e ḡ_e with the moments
m̄ = Q (½ (μ(y₀) + μ(y₁)) − μ⁰), and ḡ is the gradient at the mean y with the correction of Gonzalez
for which ḡ · (y₁ − y₀) = μ(y₁) − μ(y₀) (`condition_discrete_gradient` has the formulas). As Q is
constant the work of the force is that of the energy, and both momenta are conserved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.compiled.jit import inner, kernel
from fecloth.terms.bending.dihedral_angle import angle, arms, cross, gradient, hessian, side
from fecloth.terms.bending.fold_measure import measure
from fecloth.terms.bending.plate_angles import PlateAngles
from fecloth.terms.bending.plate_loops import gather
from fecloth.terms.loops.condition_discrete_gradient import SHORT, gradient_defect
from fecloth.terms.loops.rigid_motion import (
    differentiate_deformation,
    inverse_inertia,
    remove_rigid_part,
    subtract_mean,
)
from fecloth.terms.protocol import BoundTerm

FOUR = (0, 0, 0, 0)  # a zero for each node of a hinge, whose number the compiler must know


@inner
def measure_gradient(y, g):
    """Return μ at y (4, 3), and fill g (4, 3) = ∂μ/∂y."""
    e, a, b = arms(y)
    mu, slope, _ = measure(angle(e, a, b))
    gradient(side(e, a, cross(e, a)), side(e, b, cross(b, e)), g)
    for k in range(4):
        for c in range(3):
            g[k, c] *= slope
    return mu


@inner
def measure_hessian(y, g, H):
    """Fill g (4, 3) = ∂μ/∂y and H (4, 3, 4, 3) = ∂²μ/∂y∂y."""
    e, a, b = arms(y)
    _, slope, bend = measure(angle(e, a, b))
    left, right = side(e, a, cross(e, a)), side(e, b, cross(b, e))
    gradient(left, right, g)
    hessian(e, left, right, H)
    for k in range(4):
        for c in range(3):
            for m in range(4):
                for d in range(3):
                    H[k, c, m, d] = slope * H[k, c, m, d] + bend * g[k, c] * g[m, d]
    for k in range(4):
        for c in range(3):
            g[k, c] *= slope


@inner
def gather_step(nodes, held, first, e, start, x, y0, y, y1, d):
    """y₀, y, y₁ = 2y − y₀ and d = y₁ − y₀ of a hinge; a held node does not move in the step."""
    gather(nodes, held, first, e, start, y0)
    gather(nodes, held, first, e, x, y)
    for a in range(4):
        for c in range(3):
            y1[a, c] = 2.0 * y[a, c] - y0[a, c]
            d[a, c] = y1[a, c] - y0[a, c]


@kernel
def fill_step(nodes, held, first, start, x, mean, g, end):
    """mean (h,) = ½ (μ₀ + μ₁), g (h, 4, 3) = ḡ and end (h, 4, 3) = ∂μ(y₁)/∂y₁."""
    y0, y, y1, d = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    p, u = np.empty((4, 3)), np.empty((4, 3))
    for e in range(len(nodes)):
        gather_step(nodes, held, first, e, start, x, y0, y, y1, d)
        mu0 = measure(angle(*arms(y0)))[0]
        mu1 = measure_gradient(y1, end[e])
        measure_gradient(y, g[e])
        mean[e] = 0.5 * (mu0 + mu1)
        total = subtract_mean(FOUR, y, p)
        _, s = remove_rigid_part(FOUR, p, d, inverse_inertia(FOUR, p, total), u)
        if s > SHORT * total:
            factor = gradient_defect(FOUR, g[e], d, mu1 - mu0) / s
            for a in range(4):
                for c in range(3):
                    g[e, a, c] += factor * u[a, c]


@kernel
def add_gradient_changes(
    nodes, held, first, start, x, end, place, own, row, width, slots, moment, scale, J
):
    """J += scale Σ m̄_e ∂ḡ_e/∂y."""
    y0, y, y1, d = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    p, u, du = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    g, H = np.empty((4, 3)), np.empty((4, 3, 4, 3))
    for e in range(len(nodes)):
        m = scale * moment[e]
        gather_step(nodes, held, first, e, start, x, y0, y, y1, d)
        mu0, mu1 = measure(angle(*arms(y0)))[0], measure(angle(*arms(y1)))[0]
        measure_hessian(y, g, H)
        total = subtract_mean(FOUR, y, p)
        inverse = inverse_inertia(FOUR, p, total)
        omega, s = remove_rigid_part(FOUR, p, d, inverse, u)
        corrected = s > SHORT * total
        N = gradient_defect(FOUR, g, d, mu1 - mu0)
        for b in range(4):
            if nodes[e, b] < 0:
                continue
            for j in range(3):
                ds, dN = 0.0, 2.0 * (end[e, b, j] - g[b, j])
                if corrected:
                    differentiate_deformation(FOUR, p, d, omega, inverse, b, j, du)
                    for a in range(4):
                        for i in range(3):
                            ds += 2.0 * u[a, i] * du[a, i]
                for a in range(4):
                    for i in range(3):
                        dN -= H[a, i, b, j] * d[a, i]
                for a in range(4):
                    if nodes[e, a] < 0:
                        continue
                    block = np.uintp(slots[row[e] + a * width[e] + place[own[e], b]])
                    for i in range(3):
                        change = H[a, i, b, j]
                        if corrected:
                            change += (dN - N * ds / s) / s * u[a, i] + N / s * du[a, i]
                        J[block, i, j] += m * change


@dataclass(frozen=True, eq=False)
class PlateOverStep(BoundTerm):
    """A plate as it acts over a step from `start` (n, 3) to 2x − start, evaluated at the mean x."""

    plate: PlateAngles
    rest: np.ndarray
    start: np.ndarray
    symmetric: bool

    name = "PlateBending"
    has_energy = False  # at x alone
    dissipative = False
    velocity_dependent = False

    def add_force(self, x, v, t, f) -> None:
        """f_a −= Σ m̄ ḡ_a [N]."""
        mean, g, _ = self._step(x, t)
        self.plate.add_force(mean - self.rest, g, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; a symmetric one takes both gradients and ∂²μ at the mean."""
        mean, g, end = self._step(x, t)
        moment = self.plate.stiffness @ (mean - self.rest)
        if self.symmetric or definite:
            _, g = self.plate.gradients(x, t)
            self.plate.add_products(g, g, wx, J)
            if not definite:
                self.plate.add_curvatures(x, t, moment, wx, J)
            return
        self.plate.add_products(g, end, wx, J)
        rows = self.plate.rows
        data = rows.place, rows.own, rows.start, rows.width, rows.slots
        add_gradient_changes(*self.plate.at(t), self.start, x, end, *data, moment, wx, J.values)

    def work_of_clamps(self, old, new, stages) -> float:
        """Work [J] that moves the normals of clamps: the change of energy by time alone.

        Over the step the normals are those of the mean time, and the forces on the nodes have the
        work of the energy for these. What is left are the changes before and after that time.
        """
        if self.plate.moved is None:
            return 0.0
        ((_, mean),) = stages
        path = (*old, -1), (old[0], mean, 1), (new[0], mean, -1), (*new, 1)
        return sum(sign * self.plate.energy(x, t, self.rest) for x, t, sign in path)

    def _step(self, x, t) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        h = len(self.plate.nodes)
        mean, g, end = np.empty(h), np.empty((h, 4, 3)), np.empty((h, 4, 3))
        fill_step(*self.plate.at(t), self.start, x, mean, g, end)
        return mean, g, end
