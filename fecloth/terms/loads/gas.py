"""An ideal gas between the cloth and the plane of its rim: its pressure follows the volume."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.jit import inner, kernel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import LENGTH, PRESSURE, VOLUME
from fecloth.terms.loads.pressure import add_skew, cross, orientation


@dataclass(frozen=True)
class Gas:
    """f_a = (p(V) − p_ambient) ∂V/∂x_a with p V^γ = p₀ V₀^γ, for the volume V under the cloth.

    V = Σ (x₁ − o) · ((x₂ − o) × (x₃ − o)) / 6 over the triangles is the volume between the cloth
    and the plane of its rim, if the origin o and the rim lie in one plane: the disk that closes it
    has no share. It is positive where the cloth, oriented as in its plane, arches upwards.

        energy   p₀ V₀ ((V₀/V)^(γ−1) − 1)/(γ − 1) + p_ambient (V − V₀), or −p₀ V₀ ln(V/V₀) + …
        K_ab   = −(p − p_ambient) ∂²V_ab + γ p/V ∂V_a ∂V_bᵀ

    The last part couples all nodes: it is of rank one and does not enter the sparse matrix, but
    Newton's linear solve through the Sherman–Morrison formula (Hager 1989, Updating the Inverse
    of a Matrix, eq. 2). `System.stiffness` is without it; `System.dense` has it. The pressure is
    uniform at every instant: waves in the gas are left out. A gas needs a volume: start from a
    dome, for a flat cloth has forces that are not finite.

    Source: the gas law p V^γ = const of an ideal gas, and the derivatives of V; exact on P1.

    Valid while the volume is positive, the rim lies in one plane with o, and the gas is much
    faster than the cloth.

    Cost: that of `Pressure`, and a second linear solve.

    Parameters
    ----------
    pressure, volume
        Absolute p₀ [Pa] at V₀ [m³]: what amount of gas there is.
    ambient
        Absolute pressure on the other side [Pa].
    exponent
        γ: 1 isothermal, 1.4 air without exchange of heat.
    origin
        A point o in the plane of the rim [m].
    """

    pressure: Annotated[float, PRESSURE]
    volume: Annotated[float, VOLUME]
    ambient: Annotated[float, PRESSURE] = 101325.0
    exponent: float = 1.0
    origin: Annotated[tuple[float, float, float], LENGTH] = (0.0, 0.0, 0.0)

    def __post_init__(self):
        for name, unit in (("pressure", "Pa"), ("volume", "m³"), ("exponent", "-")):
            value = getattr(self, name)
            if not (is_number(value) and value > 0):
                raise InputError(f"{name} = {value!r}", f"must be finite and > 0 [{unit}]", "Gas")
        if not (is_number(self.ambient) and self.ambient >= 0):
            allowed = "must be finite and >= 0 [Pa]"
            raise InputError(f"ambient = {self.ambient!r}", allowed, "Gas")
        if np.shape(self.origin) != (3,) or not np.isfinite(self.origin).all():
            raise InputError(f"origin = {self.origin!r}", "must be three finite numbers", "Gas")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.stencil

    def bind(self, panel: Panel, slots) -> BoundGas:
        cloth = panel.cloth
        if cloth.stencil.shape[1] != 3:
            raise InputError(f"element {cloth.element}", "must be P1", "Gas")
        origin = np.array(self.origin, dtype=float)
        return BoundGas(self, origin, cloth.stencil, orientation(cloth), slots(cloth.stencil))


@dataclass(frozen=True, eq=False)
class BoundGas:
    """`Gas` on a cloth; `turns` (m,) is the orientation of each triangle's stencil."""

    given: Gas
    origin: np.ndarray
    nodes: np.ndarray
    turns: np.ndarray
    slots: np.ndarray

    name = "Gas"
    load = True
    symmetric = True
    has_energy = True
    dissipative = False
    velocity_dependent = False

    def enclosed(self, x) -> float:
        """V [m³]."""
        return volume(self.nodes, self.turns, self.origin, x)

    def absolute(self, V: float) -> float:
        """p(V) [Pa]; NaN for a volume that is not positive, which no gas can have."""
        gas = self.given
        return gas.pressure * (gas.volume / V) ** gas.exponent if V > 0 else math.nan

    def energy(self, x, t) -> float:
        """−∫ (p − p_ambient) dV from V₀ [J]; +∞ for a volume that is not positive."""
        gas, V = self.given, self.enclosed(x)
        if V <= 0:
            return math.inf
        work, rest = gas.pressure * gas.volume, gas.exponent - 1
        inner_ = -math.log(V / gas.volume)
        if rest:
            inner_ = math.expm1(rest * inner_) / rest
        return work * inner_ + gas.ambient * (V - gas.volume)

    def add_force(self, x, v, t, f) -> None:
        """f += (p − p_ambient) ∂V/∂x [N]."""
        p = self.absolute(self.enclosed(x)) - self.given.ambient
        add_gradient(self.nodes, self.turns, self.origin, p, x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J −= wx (p − p_ambient) ∂²V; nothing where it must be `definite`."""
        if not definite:
            scale = -wx * (self.absolute(self.enclosed(x)) - self.given.ambient)
            add_hessian(self.nodes, self.turns, self.origin, self.slots, scale, x, J.values)

    def dense(self, x, t) -> tuple[float, np.ndarray]:
        """γ p/V and ∂V/∂x (n, 3): the part of K of rank one."""
        V, u = self.enclosed(x), np.zeros_like(x)
        add_gradient(self.nodes, self.turns, self.origin, 1.0, x, u)
        return self.given.exponent * self.absolute(V) / V, u

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """None: at rest there may be no volume."""
        return 0.0, 0.0


@inner
def from_origin(x, i, o):
    """x_i − o."""
    return x[i, 0] - o[0], x[i, 1] - o[1], x[i, 2] - o[2]


@kernel
def volume(nodes, turns, o, x):
    """Σ x₁ · (x₂ × x₃) / 6, from o."""
    total = 0.0
    for e in range(len(nodes)):
        a = from_origin(x, nodes[e, 0], o)
        n = cross(from_origin(x, nodes[e, 1], o), from_origin(x, nodes[e, 2], o))
        total += turns[e] * (a[0] * n[0] + a[1] * n[1] + a[2] * n[2])
    return total / 6


@kernel
def add_gradient(nodes, turns, o, scale, x, f):
    """f_a += scale (x_b × x_c) / 6 for a, b, c in cyclic order, from o."""
    for e in range(len(nodes)):
        for a in range(3):
            b, c = nodes[e, (a + 1) % 3], nodes[e, (a + 2) % 3]
            n = cross(from_origin(x, b, o), from_origin(x, c, o))
            for j in range(3):
                f[nodes[e, a], j] += scale * turns[e] / 6 * n[j]


@kernel
def add_hessian(nodes, turns, o, slots, scale, x, J):
    """J_ab −= scale [x_c]× / 6 and J_ac += scale [x_b]× / 6, from o."""
    for e in range(len(nodes)):
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            part = scale * turns[e] / 6
            add_skew(slots[e, a, b], -part, from_origin(x, nodes[e, c], o), J)
            add_skew(slots[e, a, c], part, from_origin(x, nodes[e, b], o), J)
