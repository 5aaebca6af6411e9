"""A force on each node that the user gives as formulas or as a function of x, v and t."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.jit import kernel
from fecloth.linalg.reductions import dot
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.formula import Formula
from fecloth.quantities.units import ACCELERATION, FORCE, PRESSURE

STEP = 1e-5  # m and m/s: a central difference is then good to about 1e-10 of f'''/f'
VARIABLES = ("X", "Y", "x", "y", "z", "vx", "vy", "vz", "t")


@dataclass(frozen=True)
class UserForce:
    """f_a = A_a g(x_a, v_a, t): a force of one's own at each node, from where it is and moves.

    A_a is the node's share of the reference area, of the mass, or 1. On P2 triangles the middles
    of the edges have all of it: a rule that is exact for g of degree 0 and keeps the third order
    of the displacement in L2 (`Cloth.load` integrates to any degree). For forces between nodes see
    the conditions, for their derivatives `fecloth.verify.check_term`.

    Its power stands in the ledger as ``work:UserForce``, whatever it may be. Tangents: the
    derivatives that are given, else central differences of g over ± 1e-5 m and ± 1e-5 m/s, twelve
    evaluations.

    Source: your own.

    Valid only if the force on a node depends on no other node; its own range is yours to know.

    Parameters
    ----------
    force
        g: three numbers or formulas of X, Y, x, y, z [m], vx, vy, vz [m/s] and t [s] as text, or
        a function ``g(x, v, t)`` of all nodes, (n, 3) each, that returns (n, 3).
    per
        What g is counted by: "area" [N/m²], "mass" [N/kg] or "node" [N]; the first two mean the
        same on every mesh.
    derivatives
        A function ``(x, v, t)`` that returns ∂g/∂x and ∂g/∂v, (n, 3, 3) each.
    tangent
        "symmetric" (the symmetric part) or "exact".

    Examples
    --------
    >>> import fecloth as fc
    >>> floor = fc.UserForce((0, 0, "where(z < 0, -1e4 * z - 50 * vz, 0)"))
    >>> magnet = fc.UserForce(lambda x, v, t: -3.0 * x, per="mass")
    """

    force: Annotated[
        tuple[float | str, float | str, float | str]
        | Callable[[np.ndarray, np.ndarray, float], np.ndarray],
        PRESSURE.where(per="area"),
        ACCELERATION.where(per="mass"),
        FORCE.where(per="node"),
    ]
    per: str = "area"
    derivatives: Callable[[np.ndarray, np.ndarray, float], tuple] | None = None
    tangent: str = "symmetric"

    def __post_init__(self):
        for name, choices in (
            ("per", ("area", "mass", "node")),
            ("tangent", ("symmetric", "exact")),
        ):
            value = getattr(self, name)
            if value not in choices:
                allowed = " or ".join(f'"{choice}"' for choice in choices)
                raise InputError(f"{name} = {value!r}", f"must be {allowed}", "UserForce")
        if not callable(self.force):
            _formulas(self.force)

    elements = ("P1", "P2")

    def stencil(self, cloth: Cloth) -> None:
        return None

    def bind(self, panel: Panel, slots) -> BoundUserForce:
        cloth = panel.cloth
        amount = {
            "area": cloth.load,
            "mass": lambda: cloth.weighted_load(panel.density),
            "node": lambda: np.ones(len(cloth.X)),
        }[self.per]()
        given = self.force if callable(self.force) else Written(_formulas(self.force), cloth.X)
        diagonal = slots(np.arange(len(cloth.X), dtype=np.int32)[:, None]).ravel()
        symmetric = self.tangent == "symmetric"
        return BoundUserForce(given, self.derivatives, amount, cloth.X, diagonal, symmetric)


def _formulas(parts) -> tuple:
    """Numbers and formulas, checked."""
    allowed = "must be three finite numbers or formulas, or a function of x, v, t"
    if isinstance(parts, str) or not isinstance(parts, tuple | list) or len(parts) != 3:
        raise InputError(f"force = {parts!r}", allowed, "UserForce")
    for part in parts:
        number = np.isscalar(part) and not isinstance(part, str | bool)
        if not isinstance(part, str) and not (number and np.isfinite(part)):
            raise InputError(f"force = {parts!r}", allowed, "UserForce")
    return tuple(Formula(p, VARIABLES) if isinstance(p, str) else float(p) for p in parts)


@dataclass(frozen=True, eq=False)
class Written:
    """Three numbers or formulas as a function of the nodes' x (n, 3), v (n, 3) and of t."""

    parts: tuple
    X: np.ndarray

    def __call__(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        columns = (*self.X.T, *x.T, *v.T, t)
        values = dict(zip(VARIABLES, columns, strict=True))
        g = np.empty_like(x)
        for c, part in enumerate(self.parts):
            g[:, c] = part(**values) if isinstance(part, Formula) else part
        return g


@dataclass(frozen=True, eq=False)
class BoundUserForce:
    """`UserForce` on a cloth; `amount` (n,) is A_a."""

    given: Callable
    derivatives: Callable | None
    amount: np.ndarray
    X: np.ndarray
    diagonal: np.ndarray
    symmetric: bool

    name = "UserForce"
    load = True
    has_energy = False
    dissipative = False
    velocity_dependent = True

    def _value(self, x, v, t) -> np.ndarray:
        """g (n, 3), checked."""
        return _checked(self.given(x, v, t), x.shape, "force", t)

    def _blocks(self, x, v, t) -> tuple[np.ndarray, np.ndarray]:
        """∂g/∂x and ∂g/∂v, (n, 3, 3)."""
        if self.derivatives is not None:
            given = self.derivatives(x, v, t)
            return tuple(_checked(part, (len(x), 3, 3), "derivative", t) for part in given)
        shifts = STEP * np.eye(3)
        of_x = [self._value(x + s, v, t) - self._value(x - s, v, t) for s in shifts]
        of_v = [self._value(x, v + s, t) - self._value(x, v - s, t) for s in shifts]
        return tuple(np.stack(columns, axis=2) / (2 * STEP) for columns in (of_x, of_v))

    def supply(self, x, v, t) -> float:
        """Power f · v [W]."""
        return dot(self.amount[:, None] * self._value(x, v, t), v)

    def add_force(self, x, v, t, f) -> None:
        """f_a += A_a g_a [N]."""
        f += self.amount[:, None] * self._value(x, v, t)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J_aa −= A_a (wx ∂g/∂x + wv ∂g/∂v), or its symmetric or positive part."""
        of_x, of_v = self._blocks(x, v, t)
        blocks = -self.amount[:, None, None] * (wx * of_x + wv * of_v)
        if self.symmetric or definite:
            blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
        if definite:
            values, vectors = np.linalg.eigh(blocks)
            blocks = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 0.0), vectors)
        add_blocks(self.diagonal, blocks, J.values)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """The largest eigenvalues of M⁻¹K [1/s²] and of M⁻¹D [1/s], symmetric parts, at rest."""
        x = np.column_stack([self.X, np.zeros(len(self.X))])
        bounds = []
        for part in self._blocks(x, np.zeros_like(x), 0.0):
            K = -(self.amount / mass)[:, None, None] * part
            bounds.append(
                max(0.0, float(np.linalg.eigvalsh(0.5 * (K + K.transpose(0, 2, 1))).max()))
            )
        return tuple(bounds)


def _checked(value, shape: tuple[int, ...], name: str, t: float) -> np.ndarray:
    value = np.asarray(value, dtype=float)
    if value.shape != shape or not np.isfinite(value).all():
        what = f"{name} of shape {value.shape} at t = {t:g}"
        raise InputError(what, f"must be finite and of shape {shape}", "UserForce")
    return value


@kernel
def add_blocks(diagonal, blocks, J):
    """J_aa += the block of the node a."""
    for a in range(len(diagonal)):
        for i in range(3):
            for j in range(3):
                J[diagonal[a], i, j] += blocks[a, i, j]
