"""Normal and tangential drag of the air on each triangle."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, TypeVar

import numpy as np

from fecloth import validation
from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import DENSITY, RESISTANCE
from fecloth.terms.bending.dihedral_angle import cross, dot
from fecloth.terms.loads.air_velocity import (
    AirVelocity,
    Uniform,
    fill_centroids,
    velocity_field,
)
from fecloth.terms.loads.pressure import edge
from fecloth.terms.loops.shared_loop import SharedLoop
from fecloth.terms.protocol import BoundTerm, element_nodes, taken_from
from fecloth.terms.traits import DRAG

Coefficient = Annotated[float, DENSITY.where(law="quadratic"), RESISTANCE.where(law="linear")]

Bound = TypeVar("Bound", bound="BoundDrag")

STILL_AIR = velocity_field((0.0, 0.0, 0.0), "Drag")


@dataclass(frozen=True)
class Drag:
    """F = −A (k_n |w_n|ᵖ⁻¹ w_n n + k_t |w_t|ᵖ⁻¹ w_t) on each triangle, F/3 on each corner.

    w = v̄ − u is the velocity of the centroid relative to the air. Its parts are w_n = w · n and
    w_t = w − w_n n. A and n are the deformed area and normal. In still air u = 0; for moving air
    see `Wind`. p is 1 (linear) or 2 (quadratic). The dissipated power is −Σ F · w ≥ 0.

    With N = (x₂ − x₁) × (x₃ − x₁) = 2 A n and the edges e_b opposite to the corners, the
    tangents are

        D_ab = −(1/9) ∂F/∂w                                   symmetric, semi-definite
        K_ab = −(1/3) (∂F/∂N [e_b]× − ⅓ ∂F/∂w ∂u/∂x)          not symmetric

    Source: the independence principle of Taylor (1952), Analysis of the swimming of long and
    narrow animals, Proc. R. Soc. A 214: normal and tangential flow act independently of each
    other.

    Valid if the inertia of the air (added mass), lift by circulation and shielding are
    negligible, as for cloth that falls, or that a steady wind meets at a large angle. "linear"
    is for creeping flow only. P1 triangles only.

    Cost relative to `StVK`: force 1.3, tangent 1.4; with gusts 50 and 12.

    Parameters
    ----------
    normal, tangential
        k_n (normal) and k_t (tangential), >= 0. Linear: [Pa s/m]. Quadratic: ½ ρ C [Pa s²/m²],
        with ρ = 1.2 kg/m³ of air. For a square plate C is 1.17 and `normal` 0.7, for a long
        plate 1.98 and 1.2; the tangential C is about 0.01 (Matthews 2002, Aeronautical
        Engineer's Data Book, fig. 5.13).
    law
        "quadratic" or "linear".
    tangent
        "symmetric" (D only) or "exact" (D and K).
    """

    normal: Coefficient
    tangential: Coefficient = 0.0
    law: str = "quadratic"
    tangent: str = "symmetric"

    traits = DRAG

    def __post_init__(self):
        check_drag(self)

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        return bind_drag(self, STILL_AIR, panel, slots, BoundDrag)


def check_drag(drag) -> None:
    """Raise `InputError` if a coefficient, `law` or `tangent` is not allowed."""
    where = type(drag).__name__
    validation.positive("normal", drag.normal, "", where, or_zero=True)
    validation.positive("tangential", drag.tangential, "", where, or_zero=True)
    if drag.normal == drag.tangential == 0:
        raise InputError("normal = tangential = 0", "at least one must be > 0", where)
    validation.one_of("law", drag.law, ("quadratic", "linear"), where)
    validation.one_of("tangent", drag.tangent, ("symmetric", "exact"), where)


def bind_drag(drag, wind: AirVelocity, panel: Panel, slots, bound_class: type[Bound]) -> Bound:
    """Bind a drag to a cloth, in air with the velocity `wind`, as a `bound_class`."""
    cloth = panel.cloth
    law = (float(drag.normal), float(drag.tangential), drag.law == "quadratic")
    symmetric = drag.tangent == "symmetric"
    loop = SharedLoop.over_elements(panel, cloth.stencil, slots)
    return bound_class(panel=panel, loop=loop, wind=wind, law=law, symmetric=symmetric)


@dataclass(frozen=True, eq=False)
class BoundDrag(BoundTerm):
    """`Drag` on a cloth.

    Attributes
    ----------
    panel
        The cloth with its fabrics.
    loop
        The loop over the triangles.
    wind
        The velocity of the air.
    law
        k_n, k_t, and whether the law is quadratic.
    symmetric
        Whether the tangent has only the symmetric part D.
    """

    panel: Panel
    loop: SharedLoop
    wind: AirVelocity
    law: tuple[float, float, bool]
    symmetric: bool

    nodes = taken_from("loop.nodes")  # (m, 3)
    name = "Drag"
    has_energy = False
    dissipative = True
    velocity_dependent = True

    def _centroids(self, x) -> np.ndarray:
        """(m, 3) centroids of the triangles [m], where the velocity of the air is taken."""
        if isinstance(self.wind, Uniform):
            return x  # not used: this saves the time for the means
        points = np.empty((len(self.nodes), 3))
        fill_centroids(self.nodes, x, points)
        return points

    def _air(self, x, t) -> np.ndarray:
        """(m, 3) or (1, 3) velocity of the air [m/s]."""
        return self.wind.velocity(self._centroids(x), t)

    def power(self, x, v, t) -> float:
        """Dissipated power −Σ F · w >= 0 [W]."""
        return self.powers(x, v, t)[0]

    def powers(self, x, v, t) -> tuple[float, float]:
        """The dissipated power, and the power of the air on the cloth [W], as a pair."""
        u = self._air(x, t)
        dissipated = 0.0
        supplied = 0.0
        for part in self.loop.runs:  # the ranges of triangles that count in sums
            air = by_triangle(u, part)
            heat, work = powers(self.nodes[part], self.law, air, x, v)
            dissipated += heat
            supplied += work
        return dissipated, supplied

    def add_force(self, x, v, t, f) -> None:
        """f += F/3 at each corner [N]."""
        self.loop.add(partial(self._force, self._air(x, t), x, v), f)

    def _force(self, u, x, v, part, f) -> Call:
        return add_force, (self.nodes[part], self.law, by_triangle(u, part), x, v, f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        compiled = self.wind.compiled(self.nodes, x, t)
        if compiled is None:
            return None
        u, calls = compiled
        return [*calls, self.loop.shared_add(partial(self._force, u, x, v), f)]

    def supply_calls(self, x, v, t, power) -> Calls | None:
        compiled = self.wind.compiled(self.nodes, x, t)
        if compiled is None:
            return None
        u, calls = compiled
        return [*calls, (fill_supply, (self.nodes, self.law, u, x, v, power))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wv D + wx K, without K if J must be symmetric or `definite`."""
        u = self._air(x, t)
        if self.symmetric or definite:
            wx = 0.0  # K is not symmetric
            gradient = np.zeros((1, 3, 3))
        else:
            gradient = self.wind.gradient(self._centroids(x), t)
        self.loop.add_blocks(partial(self._tangent, u, gradient, x, v, float(wx), float(wv)), J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls | None:
        if not (self.symmetric or definite):
            return None  # the gradient of the wind needs Python
        compiled = self.wind.compiled(self.nodes, x, t)
        if compiled is None:
            return None
        u, calls = compiled
        call = partial(self._tangent, u, np.zeros((1, 3, 3)), x, v, 0.0, wv)
        return [*calls, self.loop.shared_add_blocks(call, J)]

    def _tangent(self, u, gradient, x, v, wx, wv, part, values) -> Call:
        of_part = self.nodes[part], self.loop.slots[part]
        air = by_triangle(u, part), by_triangle(gradient, part)
        return add_tangent, (*of_part, self.law, *air, x, v, wx, wv, values)


def by_triangle(values: np.ndarray, part: slice) -> np.ndarray:
    """The rows of a range of the triangles, or the only row, which is for all of them."""
    if len(values) == 1:
        return values
    return values[part]


@inner
def flow(nodes, e, u, x, v):
    """The flow at triangle e: N, |N|, w = v̄ − u, s = w · N, and w_t, the tangential part of w.

    N is the normal of twice the triangle's area [m²], v̄ the mean of v (n, 3) at its corners, and
    u (m, 3) or (1, 3) the velocity of the air [m/s].
    """
    i, j, k = nodes[e, 0], nodes[e, 1], nodes[e, 2]
    N = cross(edge(x, i, j), edge(x, i, k))
    L = np.sqrt(dot(N, N))
    a = min(e, len(u) - 1)  # u has one row for all triangles, or one row for each
    w = (
        (v[i, 0] + v[j, 0] + v[k, 0]) / 3 - u[a, 0],
        (v[i, 1] + v[j, 1] + v[k, 1]) / 3 - u[a, 1],
        (v[i, 2] + v[j, 2] + v[k, 2]) / 3 - u[a, 2],
    )
    s = dot(w, N)
    y = 0.0  # w_t = w − y N
    if L > 0.0:  # a triangle without area has no direction of N
        y = s / (L * L)
    return N, L, w, s, (w[0] - y * N[0], w[1] - y * N[1], w[2] - y * N[2])


@inner
def drag_force(law, N, L, s, wt):
    """The force on a triangle F = −½ (k_n g(s/L) N + k_t L φ w_t) [N], see `flow`; L is |N|.

    Linear: g(y) = y, φ = 1. Quadratic: g(y) = |y| y, φ = |w_t|. The ½ is there because L is
    twice the area.
    """
    kn, kt, quadratic = law
    wn = s / L if L > 0.0 else 0.0  # the normal part of w; below it becomes g(wn)
    if quadratic:
        wn *= abs(wn)
        kt *= np.sqrt(dot(wt, wt))
    n = -0.5 * kn * wn  # the factors of N and of w_t
    t = -0.5 * kt * L
    return n * N[0] + t * wt[0], n * N[1] + t * wt[1], n * N[2] + t * wt[2]


@kernel
def add_force(nodes, law, u, x, v, f):
    """f_a += F/3."""
    for e in range(len(nodes)):
        N, L, _, s, wt = flow(nodes, e, u, x, v)
        F = drag_force(law, N, L, s, wt)
        for a in range(3):
            for i in range(3):
                f[nodes[e, a], i] += F[i] / 3


@kernel
def powers(nodes, law, u, x, v):
    """Return the dissipated power −Σ F · w, and the power of the air Σ F · u [W].

    The arguments are as for `flow`, with the `law` (k_n, k_t, whether it is quadratic).
    """
    dissipated = supplied = 0.0
    for e in range(len(nodes)):
        N, L, w, s, wt = flow(nodes, e, u, x, v)
        F = drag_force(law, N, L, s, wt)
        a = min(e, len(u) - 1)  # u has one row for all triangles, or one row for each
        dissipated -= dot(F, w)
        supplied += F[0] * u[a, 0] + F[1] * u[a, 1] + F[2] * u[a, 2]
    return dissipated, supplied


@kernel
def fill_supply(nodes, law, u, x, v, power):
    """Write the power of the air Σ F · u to `power` (1,) [W]; the others are as for `powers`."""
    _, power[0] = powers(nodes, law, u, x, v)


@kernel
def add_tangent(nodes, slots, law, u, du, x, v, wx, wv, J):
    """J_ab −= (1/3) (wx ∂F/∂N [e_b]× + (wv/3) ∂F/∂w − (wx/3) ∂F/∂w ∂u/∂x), equal for all a.

    Each corner a has a third of F. e_b is the edge opposite to corner b, u (m, 3) or (1, 3) the
    velocity of the air, and du (m, 3, 3) or (1, 3, 3) its gradient ∂u_i/∂x_j. Triangles without
    area are left out.
    """
    kn, kt, quadratic = law
    Fw = np.empty((3, 3))  # ∂F/∂w
    FN = np.empty((3, 3))  # ∂F/∂N
    own = np.empty((3, 3))  # a third of the parts with ∂F/∂w, equal for all b
    for e in range(len(nodes)):
        N, L, _, s, wt = flow(nodes, e, u, x, v)
        if L == 0.0:  # no direction of N, and no force
            continue
        wn = s / L
        speed = np.sqrt(dot(wt, wt))
        # g(w_n) and its slope; φ(|w_t|) and φ′/|w_t|
        g = wn
        slope = 1.0
        phi = 1.0
        phi_slope = 0.0
        if quadratic:
            g = abs(wn) * wn
            slope = 2 * abs(wn)
            phi = speed
            if speed > 0.0:
                phi_slope = 1 / speed
        y = s / (L * L)  # w_t = w − y N
        for i in range(3):
            for j in range(3):
                delta = 1.0 if i == j else 0.0
                NN = N[i] * N[j]
                tt = wt[i] * wt[j]
                across = delta - NN / (L * L)
                along = kn * slope / L * NN
                Fw[i, j] = -0.5 * (along + kt * L * (phi * across + phi_slope * tt))
                rotation = wt[i] * N[j] - N[i] * (wt[j] - y * N[j]) - s * delta
                FN[i, j] = -0.5 * kn * (g * delta + slope / L * N[i] * wt[j])
                FN[i, j] -= 0.5 * kt / L * (phi * rotation - s * phi_slope * tt)
        a = min(e, len(du) - 1)  # du has one row for all triangles, or one row for each
        for i in range(3):
            for j in range(3):
                change = Fw[i, 0] * du[a, 0, j] + Fw[i, 1] * du[a, 1, j] + Fw[i, 2] * du[a, 2, j]
                own[i, j] = (wv * Fw[i, j] - wx * change) / 9
        for b in range(3):
            g1, g2, g3 = edge(x, nodes[e, (b + 1) % 3], nodes[e, (b + 2) % 3])
            for i in range(3):
                # row i of ∂F/∂N [e_b]×
                r1 = wx / 3 * (FN[i, 1] * g3 - FN[i, 2] * g2) + own[i, 0]
                r2 = wx / 3 * (FN[i, 2] * g1 - FN[i, 0] * g3) + own[i, 1]
                r3 = wx / 3 * (FN[i, 0] * g2 - FN[i, 1] * g1) + own[i, 2]
                for a in range(3):
                    block = slots[e, a, b]
                    J[block, i, 0] -= r1
                    J[block, i, 1] -= r2
                    J[block, i, 2] -= r3
