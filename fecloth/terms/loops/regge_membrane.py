"""Loops over quadratic triangles whose membrane law takes the Regge-interpolated strain E_h.

They stand in place of those in `membrane` and `membrane_discrete_gradient`; `regge_strain` has the
formulas. `rest` is subtracted from the strain: E⁰ of the flat cloth, or for a viscous law over a
step that of the method's difference. Over a step from x₀ to x₁ = 2x − x₀ the stress is

    S̄ = S(Ē) + β e,   β = (W₁ − W₀ − S(Ē) : e) / (e : e),   Ē = ½ (E₀ + E₁),   e = E₁ − E₀

(Gonzalez 2000), whose work is Σ w (W₁ − W₀), because E_h is quadratic in x; β = 0 for a law with W
quadratic in E.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import Array, specialise
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.mesh.recovery import LINEAR, Samples
from fecloth.terms.loops.eigenvalue_bounds import membrane_bound
from fecloth.terms.loops.green_strain import Six, Three, clamp
from fecloth.terms.loops.membrane_discrete_gradient import (
    add_multiple,
    mean,
    quotient,
    quotient_derivative,
    strain_increment,
)
from fecloth.terms.loops.regge_strain import (
    NODES,
    POINTS,
    ReggeStrain,
    add_sample_stress,
    fill_rows,
    gather,
    scatter_force,
    scatter_geometric,
    scatter_material,
    scatter_tension,
    strain,
)
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.recovered_error import membrane_error
from fecloth.terms.step_difference import StepDifference


def law(E: Three, c: Array) -> tuple[float, Three, Six]:
    """Return W, S and ℂ; `kernels` puts a law in place of this one (see `membrane.law`)."""
    raise NotImplementedError


def energy(nodes: Array, A: Array, w: Array, c: Array, rest: Array, x: Array) -> float:
    """Σ w W [J]."""
    u, B, total = np.empty((NODES, 3)), np.empty((3, NODES, 3)), 0.0
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            W, _, _ = law(strain(A[e, p], rest[e, p], u, B), c[e])
            total += w[e, p] * W
    return total


def add_force(nodes: Array, A: Array, w: Array, c: Array, rest: Array, x: Array, f: Array) -> None:
    """f_b −= Σ w S̃ · B_b."""
    u, B = np.empty((NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            _, S, _ = law(strain(A[e, p], rest[e, p], u, B), c[e])
            scatter_force(nodes, e, w[e, p], S, B, f)


def add_tangent(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, slots: Array, x: Array, scale: float,
    J: Array,
) -> None:  # fmt: skip
    """J += scale · K."""
    u, B, T = np.empty((NODES, 3)), np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            _, S, C = law(strain(A[e, p], rest[e, p], u, B), c[e])
            scatter_material(slots, e, scale * w[e, p], B, C, B, T, J)
            scatter_geometric(slots, e, scale * w[e, p], S, A[e, p], J)


def add_definite_tangent(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, slots: Array, H: Array, G: Array,
    M: Array, x: Array, scale: float, J: Array,
) -> None:  # fmt: skip
    """J += scale · K with the stresses of the geometric part clamped from below at zero."""
    u, B, T = np.empty((NODES, 3)), np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    sigma = np.empty(9)
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        sigma[:] = 0.0
        for p in range(POINTS):
            _, S, C = law(strain(A[e, p], rest[e, p], u, B), c[e])
            scatter_material(slots, e, scale * w[e, p], B, C, B, T, J)
            add_sample_stress(M[e], p, w[e, p], S, sigma)
        S = clamp((sigma[6], sigma[7], 0.5 * sigma[8]), 0.0)
        scatter_tension(slots, e, scale, sigma, H[e], S, G[e], J)


def add_stress(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, x: Array, out: Array
) -> None:
    """out[e] += (S11, S22, S12, W), the means over the triangle."""
    u, B = np.empty((NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            W, S, _ = law(strain(A[e, p], rest[e, p], u, B), c[e])
            out[e, 0] += S[0] / POINTS
            out[e, 1] += S[1] / POINTS
            out[e, 2] += S[2] / POINTS
            out[e, 3] += W / POINTS


def add_moduli(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, x: Array, out: Array
) -> None:
    """out[e] += ℂ (6,), the mean over the triangle."""
    u, B = np.empty((NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            _, _, C = law(strain(A[e, p], rest[e, p], u, B), c[e])
            for k in range(6):
                out[e, k] += C[k] / POINTS


def add_step_force(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, start: Array, x: Array, f: Array
) -> None:
    """f_b −= Σ w S̄ · B_b with B at x."""
    u0, u, u1 = np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((NODES, 3))
    B, B1 = np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, start, u0)
        gather(nodes, e, x, u)
        u1[:] = 2.0 * u - u0
        for p in range(POINTS):
            E0, E1 = strain(A[e, p], rest[e, p], u0, B), strain(A[e, p], rest[e, p], u1, B1)
            W0, _, _ = law(E0, c[e])
            W1, _, _ = law(E1, c[e])
            _, S, _ = law(mean(E0, E1), c[e])
            d = strain_increment(E0, E1)
            B[:] = 0.5 * (B + B1)
            scatter_force(nodes, e, w[e, p], add_multiple(S, quotient(W1 - W0, S, d), d), B, f)


def add_step_tangent(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, slots: Array, start: Array, x: Array,
    scale: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += scale Σ w (B_a (2 ∂S̄/∂E₁) B_b(x₁)ᵀ + Σ_k S̄_k A^k_ab I₃)."""
    u0, u, u1 = np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((NODES, 3))
    B, B1, T = np.empty((3, NODES, 3)), np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, start, u0)
        gather(nodes, e, x, u)
        u1[:] = 2.0 * u - u0
        for p in range(POINTS):
            E0, E1 = strain(A[e, p], rest[e, p], u0, B), strain(A[e, p], rest[e, p], u1, B1)
            W0, _, _ = law(E0, c[e])
            W1, S1, _ = law(E1, c[e])
            _, S, C = law(mean(E0, E1), c[e])
            d, W = strain_increment(E0, E1), scale * w[e, p]
            beta = quotient(W1 - W0, S, d)
            z = quotient_derivative(S1, S, C, beta, d)
            B[:] = 0.5 * (B + B1)
            C = (C[0] + 2.0 * beta, C[1] + 2.0 * beta, C[2] + beta, C[3], C[4], C[5])
            scatter_material(slots, e, W, B, C, B1, T, J)
            scatter_geometric(slots, e, W, add_multiple(S, beta, d), A[e, p], J)
            for b in range(NODES):  # the part e ⊗ z of the moduli
                for j in range(3):
                    zB = z[0] * B1[0, b, j] + z[1] * B1[1, b, j] + 2.0 * z[2] * B1[2, b, j]
                    for a in range(NODES):
                        s = np.uintp(slots[e, a, b])
                        for i in range(3):
                            dB = d[0] * B[0, a, i] + d[1] * B[1, a, i] + 2.0 * d[2] * B[2, a, i]
                            J[s, i, j] += W * dB * zB


def add_symmetric_step_tangent(
    nodes: Array, A: Array, w: Array, c: Array, rest: Array, slots: Array, start: Array, x: Array,
    scale: float, J: Array,
) -> None:  # fmt: skip
    """J += scale Σ w (B_a ℂ(Ē) B_bᵀ + Σ_k S(Ē)_k A^k_ab I₃) with B at x."""
    u0, u, u1 = np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((NODES, 3))
    B, T = np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, start, u0)
        gather(nodes, e, x, u)
        u1[:] = 2.0 * u - u0
        for p in range(POINTS):
            E0, E1 = strain(A[e, p], rest[e, p], u0, B), strain(A[e, p], rest[e, p], u1, B)
            _, S, C = law(mean(E0, E1), c[e])
            fill_rows(A[e, p], u, B)
            scatter_material(slots, e, scale * w[e, p], B, C, B, T, J)
            scatter_geometric(slots, e, scale * w[e, p], S, A[e, p], J)


class ReggeKernels(NamedTuple):
    """The entry points of a law, each a template above compiled with the law."""

    energy: Callable[..., float]
    add_force: Callable[..., None]
    add_tangent: Callable[..., None]
    add_definite_tangent: Callable[..., None]
    add_stress: Callable[..., None]
    add_moduli: Callable[..., None]  # of the definite law
    add_step_force: Callable[..., None]
    add_step_tangent: Callable[..., None]
    add_symmetric_step_tangent: Callable[..., None]


def kernels(law: Callable[..., Any], definite_law: Callable[..., Any]) -> ReggeKernels:
    """Compile the entry points of a law; each is compiled at its first call, or read from disk."""
    return ReggeKernels(
        specialise(energy, law=law),
        specialise(add_force, law=law),
        specialise(add_tangent, law=law),
        specialise(add_definite_tangent, law=definite_law),
        specialise(add_stress, law=law),
        specialise(add_moduli, law=definite_law),
        specialise(add_step_force, law=law),
        specialise(add_step_tangent, law=law),
        specialise(add_symmetric_step_tangent, law=law),
    )


@dataclass(frozen=True, eq=False)
class BoundRegge(BoundTerm):
    """An elastic membrane law of E_h bound to a cloth of P2 triangles, as a `System` calls it.

    Attributes
    ----------
    kernels
        The law's entry points.
    panel, find_slots
        As `bind` of a term gets them; the matrix is not looked at before the first tangent.
    constants
        (m, p) constants of the law in each triangle.
    moduli
        (m, 6) ℂ at E = 0 [N/m], for the bound on the frequency.
    strain
        E_h of the panel.
    """

    name: str
    kernels: ReggeKernels
    panel: Panel
    find_slots: FindSlots
    constants: np.ndarray
    moduli: np.ndarray
    strain: ReggeStrain

    symmetric = True
    has_energy = True

    @cached_property
    def slots(self) -> np.ndarray:
        """(m, k, k) blocks of the triangles in the matrix."""
        return self.find_slots(self.panel.cloth.stencil)

    @cached_property
    def loop(self) -> SharedLoop:
        """The loop over the triangles."""
        return SharedLoop.of(self.panel, self.strain.nodes)

    @cached_property
    def data(self) -> tuple[Any, ...]:
        """What every entry point takes first, by triangle; those of tangents take `slots` next."""
        E = self.strain
        return E.nodes, E.forms, E.weights, self.constants, E.rest

    def energy(self, x: np.ndarray, t: float) -> float:
        """Σ w W [J]."""
        return self.loop.total(lambda part: (self.kernels.energy, (*cut(self.data, part), x)))

    def _force(self, x: Array, part: slice, f: Array) -> Call:
        return self.kernels.add_force, (*cut(self.data, part), x, f)

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f −= Σ w S̃ · B [N]."""
        self.loop.add(partial(self._force, x), f)

    def force_calls(self, x: Array, v: Array, t: float, f: Array) -> Calls:
        return [self.loop.shared_add(partial(self._force, x), f)]

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K; `definite` clamps the stresses of the geometric part at zero."""
        E, add, arrays = self.strain, self.kernels.add_tangent, (*self.data, self.slots)
        if definite:
            add = self.kernels.add_definite_tangent
            arrays = *arrays, E.slopes, E.gradients, E.samples
        self.loop.add_blocks(lambda part, values: (add, (*cut(arrays, part), x, wx, values)), J)

    def add_stress(self, x: Array, out: Array) -> None:
        """out (m, 4) += S11, S22, S12 [N/m] and W [J/m²], the means over each triangle."""
        self.kernels.add_stress(*self.data, x, out)

    def strain_error(self, x: Array, t: float) -> np.ndarray:
        """(m,) energy [J] of what recovery changes of the strain in each triangle."""
        return membrane_error(self.panel, *self.sampled_strain(x))

    def sampled_strain(self, x: Array) -> tuple[Array, Array, Samples]:
        """E (m, q, 3) at the points of samples, ℂ (m, 6) [N/m], and the samples."""
        moduli = np.zeros((len(self.moduli), 6))
        self.kernels.add_moduli(*self.data, x, moduli)
        return self.strain.values(x), moduli, LINEAR

    def nbytes(self, explicit: bool) -> int:
        return self.strain.nbytes

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] at rest, where E_h equals E."""
        return membrane_bound(self.panel, self.moduli, mass), 0.0

    def over_step(self, step: StepDifference) -> ReggeOverStep | BoundRegge:
        """The membrane over a step at whose mean it is evaluated; otherwise itself."""
        return ReggeOverStep(self, step.start, step.symmetric) if step.at_mean else self


@dataclass(frozen=True, eq=False)
class ReggeOverStep(BoundTerm):
    """A membrane of E_h as it acts over a step from `start` to 2x − start."""

    membrane: BoundRegge
    start: np.ndarray
    symmetric: bool

    has_energy = False  # at x alone
    conserves = True

    @property
    def name(self) -> str:
        return self.membrane.name

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f −= Σ w S̄ · B [N]."""
        add, data = self.membrane.kernels.add_step_force, self.membrane.data
        self.membrane.loop.add(lambda part, f: (add, (*cut(data, part), self.start, x, f)), f)

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K; the symmetric one has both B at x, the definite one is the membrane's at x."""
        if definite:
            self.membrane.add_tangent(x, v, t, wx, wv, J, definite)
            return
        kernels = self.membrane.kernels
        add = kernels.add_symmetric_step_tangent if self.symmetric else kernels.add_step_tangent
        arrays = *self.membrane.data, self.membrane.slots
        self.membrane.loop.add_blocks(
            lambda part, values: (add, (*cut(arrays, part), self.start, x, wx, values)), J
        )
