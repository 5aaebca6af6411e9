"""An ideal gas between the cloth and the plane of its rim, with a pressure from its volume."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner, kernel
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.linalg.reductions import dot
from fecloth.quantities.units import LENGTH, PRESSURE, VOLUME
from fecloth.terms.bending.dihedral_angle import cross
from fecloth.terms.loads.pressure import add_skew, orientation_signs
from fecloth.terms.protocol import BoundTerm, element_nodes
from fecloth.terms.traits import LOAD


@dataclass(frozen=True)
class Gas:
    """f_a = (p(V) − p_ambient) ∂V/∂x_a with p V^γ = p₀ V₀^γ, for the volume V under the cloth.

    V = Σ (x₁ − o) · ((x₂ − o) × (x₃ − o)) / 6 over the triangles. If the origin o and the rim
    are in one plane, this is the volume between the cloth and the plane, because the
    contribution of the plane is zero. V is positive if the cloth is above the plane.

        energy   p₀ V₀ ((V₀/V)^(γ−1) − 1)/(γ − 1) + p_ambient (V − V₀), or −p₀ V₀ ln(V/V₀) + …
        K_ab   = −(p − p_ambient) ∂²V_ab + γ p/V ∂V_a ∂V_bᵀ

    The last part of K couples all nodes. It has rank one, and Newton's linear solve includes
    it by the Sherman–Morrison formula (Hager 1989, Updating the Inverse of a Matrix, eq. 2).
    `System.stiffness` does not contain it; `System.dense` returns it. Start from a dome: for a
    flat cloth the volume is zero and the forces are not finite.

    Source: the gas law p V^γ = const of an ideal gas, and the derivatives of V; exact on P1.

    Valid if the volume is positive, the rim and o are in one plane, and pressure waves in the
    gas are much faster than the cloth.

    Cost: as for `Pressure`, and a second linear solve.

    Parameters
    ----------
    pressure, volume
        Absolute pressure p₀ [Pa] at the volume V₀ [m³]. Both define the amount of gas.
    ambient
        Absolute pressure on the other side of the cloth [Pa].
    exponent
        γ: 1 for an isothermal gas, 1.4 for air without heat exchange.
    origin
        A point o in the plane of the rim [m].
    """

    pressure: Annotated[float, PRESSURE]
    volume: Annotated[float, VOLUME]
    ambient: Annotated[float, PRESSURE] = 101325.0
    exponent: float = 1.0
    origin: Annotated[tuple[float, float, float], LENGTH] = (0.0, 0.0, 0.0)

    traits = replace(LOAD, elements=("P1",), several_places=False, shared=False)

    def __post_init__(self):
        for name, unit in (("pressure", "Pa"), ("volume", "m³"), ("exponent", "-")):
            validation.positive(name, getattr(self, name), unit, "Gas")
        validation.positive("ambient", self.ambient, "Pa", "Gas", or_zero=True)
        validation.point("origin", self.origin, "Gas")

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        cloth = panel.cloth
        origin = np.array(self.origin, dtype=float)
        return BoundGas(self, origin, cloth.stencil, orientation_signs(cloth), slots)


@dataclass(frozen=True, eq=False)
class BoundGas(BoundTerm):
    """`Gas` on a cloth.

    Attributes
    ----------
    gas
        The term.
    origin
        (3,) The point o in the plane of the rim [m].
    nodes
        (m, 3) The nodes of the triangles.
    signs
        (m,) 1 or −1, see `pressure.orientation_signs`.
    find_slots
        Finds the blocks of the triangles in the matrix, at the first tangent.
    """

    gas: Gas
    origin: np.ndarray
    nodes: np.ndarray
    signs: np.ndarray
    find_slots: FindSlots

    name = "Gas"
    load = True
    symmetric = True
    has_energy = True

    @cached_property
    def slots(self) -> np.ndarray:
        """(m, k, k) blocks of the triangles in the matrix."""
        return self.find_slots(self.nodes)

    def gradient(self, x) -> np.ndarray:
        """(n, 3) ∂V/∂x [m²]."""
        out = np.zeros_like(x)
        add_gradient(self.nodes, self.signs, self.origin, x, out)
        return out

    def volume(self, x, gradient: np.ndarray | None = None) -> float:
        """V = ∂V/∂x · (x − o)/3 [m³], as V is cubic in the positions relative to o.

        `gradient` is ∂V/∂x at x, for a caller that has it.
        """
        if gradient is None:
            gradient = self.gradient(x)
        return dot(gradient, x - self.origin) / 3

    def absolute_pressure(self, V: float) -> float:
        """Absolute pressure p(V) [Pa]; NaN if the volume is not positive."""
        gas = self.gas
        if V > 0:
            return gas.pressure * (gas.volume / V) ** gas.exponent
        return math.nan

    def energy(self, x, t) -> float:
        """−∫ (p − p_ambient) dV from V₀ to V [J]; +∞ if the volume is not positive."""
        gas = self.gas
        V = self.volume(x)
        if V <= 0:
            return math.inf
        # The energy of the gas over p₀ V₀: ((V₀/V)^(γ−1) − 1)/(γ − 1), for γ = 1 its limit
        # ln(V₀/V). `expm1` keeps the digits where γ or V₀/V is near 1.
        exponent = gas.exponent - 1
        relative = -math.log(V / gas.volume)
        if exponent:
            relative = math.expm1(exponent * relative) / exponent
        return gas.pressure * gas.volume * relative + gas.ambient * (V - gas.volume)

    def add_force(self, x, v, t, f) -> None:
        """f += (p − p_ambient) ∂V/∂x [N]."""
        gradient = self.gradient(x)
        p = self.absolute_pressure(self.volume(x, gradient))
        f += (p - self.gas.ambient) * gradient

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J −= wx (p − p_ambient) ∂²V; do nothing if J must be `definite`."""
        if not definite:
            scale = -wx * (self.absolute_pressure(self.volume(x)) - self.gas.ambient)
            add_hessian(self.nodes, self.signs, self.origin, self.slots, scale, x, J.values)

    def dense(self, x, t) -> tuple[float, np.ndarray]:
        """γ p/V and ∂V/∂x (n, 3), which define the rank-one part of K."""
        gradient = self.gradient(x)
        V = self.volume(x, gradient)
        if V == 0.0:
            return math.nan, gradient
        rate = self.absolute_pressure(V) / V
        return self.gas.exponent * rate, gradient


@inner
def from_origin(x, i, o):
    """x_i − o."""
    return x[i, 0] - o[0], x[i, 1] - o[1], x[i, 2] - o[2]


@kernel
def add_gradient(nodes, signs, o, x, f):
    """f_a += (x_b × x_c) / 6 for a, b, c in cyclic order, with positions relative to o."""
    for e in range(len(nodes)):
        for a in range(3):
            b = nodes[e, (a + 1) % 3]
            c = nodes[e, (a + 2) % 3]
            n = cross(from_origin(x, b, o), from_origin(x, c, o))
            for j in range(3):
                f[nodes[e, a], j] += signs[e] / 6 * n[j]


@kernel
def add_hessian(nodes, signs, o, slots, scale, x, J):
    """J_ab −= scale [x_c]× / 6, J_ac += scale [x_b]× / 6, with positions relative to o."""
    for e in range(len(nodes)):
        for a in range(3):
            b = (a + 1) % 3
            c = (a + 2) % 3
            part = scale * signs[e] / 6
            add_skew(slots[e, a, b], -part, from_origin(x, nodes[e, c], o), J)
            add_skew(slots[e, a, c], part, from_origin(x, nodes[e, b], o), J)
