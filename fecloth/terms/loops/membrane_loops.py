"""The membrane loops: every law in the Green strain, with every kind of strain, runs through these.

A law is a compiled function ``law(E, c) -> (W, S, ℂ)`` of the Green strain E = (E11, E22, E12)
and the constants c of the triangle, in the Voigt order (11, 22, 12) with the engineering shear
2 E12:

    W    energy per reference area [J/m²]
    S    second Piola–Kirchhoff stress resultant ∂W/∂E = (S11, S22, S12) [N/m]
    ℂ    tangent moduli ∂S/∂E = (C11, C22, C66, C12, C16, C26) [N/m]

A kind of strain is a mapping of plain functions, whose bodies are inserted for the calls below:

    scratch       work space: u and r (6, 3) and B (3, 6, 3); none for pointwise strains
    tangent_scratch   R and T (3, 6, 3), likewise
    load          u and r, what the strain needs of x and y at the nodes of triangle e
    load_motion   r of a motion v
    strain        E at point q of triangle e, and what ∂E/∂x is made of there: F, or B in place
    push          f −= w S : ∂E/∂x
    weigh         weight, S and ℂ with the weights wx of K and wv of D
    stiffen       J += w (∂E/∂x : ℂ : ∂E/∂x + S : ∂²E/∂x²), a pointwise S clamped at a floor
    mix           J += w (∂E/∂x : ℂ : (wv ∂E/∂x + mixed ∂E/∂x at v) + wx S : ∂²E/∂x²)
    add_means     out[e] += what a point adds of some values to their means over the triangle

`kinds_of_strain` has them. A is G or the forms of E_h, and y is what the strain is taken
against:

    POINTWISE     E = (FᵀF − I)/2
    RESTED        E = (FᵀF − I)/2 − y        with a rest strain y, of damping over a step
    RATE          Ė = sym(FᵀḞ)               of the velocities y
    REGGE         E = E_h − y                with a rest strain, also of the flat cloth
    REGGE_RATE    Ė_h                        of the velocities y

`per_node` and `per_point` are tuples with one zero for each node and each point, so that the
compiler knows their number and unrolls the loops (three times faster than a count read from an
array).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np

from fecloth.compiled.bodies import insert_bodies
from fecloth.compiled.jit import Array, Zeros, specialise
from fecloth.terms.loops.green_strain import Six, Three, clamp
from fecloth.terms.loops.kinds_of_strain import POINTWISE, RATE, REGGE, REGGE_RATE, RESTED, Kind
from fecloth.terms.loops.regge_strain import add_sample_stress, scatter_material, scatter_tension

T = TypeVar("T")


def law(E: Three, c: Array) -> tuple[float, Three, Six]:
    """Return W, S (3,) and ℂ (6,) at E (3,); `Kernels` puts a law in place of this one."""
    raise NotImplementedError


def inserted(*arguments: Any) -> Any:
    """Stands for the functions of a kind of strain, whose bodies take the place of the calls."""
    raise NotImplementedError


scratch = tangent_scratch = load = load_motion = strain = inserted
push = weigh = stiffen = mix = add_means = inserted


# --- templates ------------------------------------------------------------------------------------


def energy(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array, y: Array,
    x: Array,
) -> float:  # fmt: skip
    """Σ w W [J]."""
    u, r, B = scratch()
    total = 0.0
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            _, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            W, _, _ = law(E, c[e])
            total += w[e, q] * W
    return total


def add_force(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array, y: Array,
    x: Array, f: Array,
) -> None:  # fmt: skip
    """f −= Σ w S : ∂E/∂x."""
    u, r, B = scratch()
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            F, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            _, S, _ = law(E, c[e])
            push(per_node, nodes, A, e, q, w[e, q], F, B, S, f)


def add_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    y: Array, x: Array, wx: float, wv: float, floor: float, J: Array,
) -> None:  # fmt: skip
    """J += wx K + wv D, symmetric; a pointwise stress of the geometric part is ≥ `floor`."""
    u, r, B = scratch()
    _, T = tangent_scratch()
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            F, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            _, S, C = law(E, c[e])
            weight, S, C = weigh(w[e, q], wx, wv, S, C)
            stiffen(per_node, slots, A, e, q, weight, floor, F, B, T, S, C, J)


def add_mixed_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    y: Array, x: Array, v: Array, wx: float, wv: float, mixed: float, J: Array,
) -> None:  # fmt: skip
    """J += Σ w (∂E/∂x : ℂ : (wv ∂E/∂x + mixed ∂E/∂x at v) + wx S : ∂²E/∂x²)."""
    u, r, B = scratch()
    R, T = tangent_scratch()
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        load_motion(nodes, e, v, r)
        for q in range(len(per_point)):
            F, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            _, S, C = law(E, c[e])
            mix(per_node, nodes, slots, A, e, q, w[e, q], wx, wv, mixed, F, v, r, B, R, T, S, C, J)


def add_definite_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    slopes: Array, gradients: Array, samples: Array, y: Array, x: Array, wx: float, wv: float,
    J: Array,
) -> None:  # fmt: skip
    """J += wx K + wv D of E_h with the stresses of the geometric part clamped at zero."""
    u, r, B = scratch()
    _, T = tangent_scratch()
    sigma = np.empty(9)
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        sigma[:] = 0.0
        for q in range(len(per_point)):
            _, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            _, S, C = law(E, c[e])
            scatter_material(slots, e, wv * w[e, q], B, C, B, T, J)
            add_sample_stress(samples[e], q, w[e, q], S, sigma)
        S = clamp((sigma[6], sigma[7], 0.5 * sigma[8]), 0.0)
        scatter_tension(slots, e, wx, sigma, slopes[e], S, gradients[e], J)


def add_stress(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array, y: Array,
    x: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += (S11, S22, S12, W), the means over the triangle."""
    u, r, B = scratch()
    for e in range(len(nodes)):
        area = 0.0
        for q in range(len(per_point)):
            area += w[e, q]
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            _, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            W, S, _ = law(E, c[e])
            add_means(e, w[e, q], area, (S[0], S[1], S[2], W), out)


def add_moduli(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array, y: Array,
    x: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += ℂ (6,), the mean over the triangle."""
    u, r, B = scratch()
    for e in range(len(nodes)):
        area = 0.0
        for q in range(len(per_point)):
            area += w[e, q]
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            _, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            _, _, C = law(E, c[e])
            add_means(e, w[e, q], area, C, out)


def add_strain(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, y: Array, weight: float, x: Array,
    out: Array,
) -> None:  # fmt: skip
    """out (m, points, 3) += weight E."""
    u, r, B = scratch()
    for e in range(len(nodes)):
        load(nodes, e, x, y, u, r)
        for q in range(len(per_point)):
            _, E = strain(per_node, nodes, A, e, q, x, y, u, r, B)
            out[e, q, 0] += weight * E[0]
            out[e, q, 1] += weight * E[1]
            out[e, q, 2] += weight * E[2]


# --- entry points ---------------------------------------------------------------------------------


def entry_point(template: Callable[..., Any], law: str = "law") -> cached_property[Any]:
    """A template made with the law of `Kernels` in this field."""
    return cached_property(lambda kernels: kernels.make(template, getattr(kernels, law)))


def of_kind(kind: Kind) -> cached_property[Any]:
    """The `Kernels` of the same law with another kind of strain."""
    return cached_property(lambda kernels: replace(kernels, kind=kind))


@dataclass(frozen=True, eq=False)
class Kernels:
    """The entry points of a law with a kind of strain, made and compiled at their first use."""

    law: Callable[..., Any]  # the compiled function (see above)
    # The same law with ℂ positive semi-definite, for the definite tangent.
    definite_law: Callable[..., Any]
    # W is quadratic in E, so that the stress of the mean of two strains does the work of the
    # energy between them.
    is_quadratic: bool
    kind: Kind = field(default_factory=lambda: POINTWISE)  # the kind of strain

    energy = entry_point(energy)
    add_force = entry_point(add_force)
    add_tangent = entry_point(add_tangent)
    add_mixed_tangent = entry_point(add_mixed_tangent)
    add_stress = entry_point(add_stress)
    add_moduli = entry_point(add_moduli, "definite_law")

    @cached_property
    def add_definite_tangent(self) -> Callable[..., None]:
        """Of a pointwise strain the tangent of the definite law."""
        if self.kind is REGGE or self.kind is REGGE_RATE:
            return self.make(add_definite_tangent, self.definite_law)
        return self.make(add_tangent, self.definite_law)

    @cached_property
    def add_strain(self) -> Callable[..., None]:
        """For any law."""
        return specialise(insert_bodies(add_strain, self.kind))

    @cached_property
    def rested(self) -> Self:
        """With a rest strain, which E_h has anyway."""
        if self.kind is REGGE:
            return self
        return replace(self, kind=RESTED)

    rate = of_kind(RATE)
    regge = of_kind(REGGE)
    regge_rate = of_kind(REGGE_RATE)

    def make(self, template: Callable[..., T], law: Any) -> Callable[..., T]:
        """A template with a law and the kind of strain."""
        made: Callable[..., T] = insert_bodies(template, self.kind)
        return specialise(made, law=law)


def kernels(
    law: Callable[..., Any],
    definite_law: Callable[..., Any] | None = None,
    is_quadratic: bool = False,
) -> Kernels:
    """The entry points of a law; without `definite_law` its ℂ must be semi-definite everywhere."""
    return Kernels(law, definite_law or law, is_quadratic)
