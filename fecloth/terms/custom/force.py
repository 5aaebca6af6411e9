"""A force on each node that the user gives as formulas or as a function of x, v and t."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import kernel
from fecloth.errors import InputError, errors_of
from fecloth.fabric.panel import Panel
from fecloth.linalg.reductions import dot
from fecloth.quantities.formula import Formula, FormulaVector
from fecloth.quantities.formula_kernel import write_columns, write_time
from fecloth.quantities.units import ACCELERATION, FORCE, PRESSURE
from fecloth.terms.loops.array_updates import add_scaled
from fecloth.terms.protocol import BoundTerm, uncoupled
from fecloth.terms.traits import LOAD

# Step of central differences in x [m] and v [m/s]. Their relative error is about 1e-10 f'''/f'
# by truncation and 1e-11 f/f' by round-off.
STEP_OF_DIFFERENCES = 1e-5
VARIABLES = ("X", "Y", "x", "y", "z", "vx", "vy", "vz", "t")


@dataclass(frozen=True)
class UserForce:
    """f_a = A_a g(x_a, v_a, t), a user-defined force on each node from its position and velocity.

    A_a is the share of the node in the reference area or in the mass, or 1. On P2 triangles the
    share in the area is zero at the corners: that is exact for a constant g, and the
    displacement keeps its third order in L2 (`Cloth.load` integrates to any degree). Check
    derivatives with `fecloth.verify.check_term`.

    Its work is ``work:UserForce`` in the energy ledger. The tangents use `derivatives`, or else
    central differences of g over ± 1e-5 m and ± 1e-5 m/s, which take twelve evaluations of g.

    Source: the user.

    Valid only if the force on a node does not depend on other nodes. Other limits depend on g.

    Parameters
    ----------
    force
        g: three numbers or formulas of X, Y, x, y, z [m], vx, vy, vz [m/s] and t [s] as text, or
        a function ``g(x, v, t)`` of all nodes, (n, 3) each, that returns (n, 3).
    per
        The unit of g: per "area" [N/m²], per "mass" [N/kg] or per "node" [N]. The first two give
        the same load on every mesh.
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
        validation.one_of("per", self.per, ("area", "mass", "node"), "UserForce")
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), "UserForce")
        if not callable(self.force):
            _validated_parts(self.force)

    traits = replace(LOAD, shared=False)
    stencil = uncoupled

    def bind(self, panel: Panel, slots) -> BoundTerm:
        """Bind the force, with the amount A_a of each node."""
        cloth = panel.cloth
        if self.per == "area":
            amount = cloth.load()
        elif self.per == "mass":
            amount = panel.nodal_mass
        else:  # per node
            amount = np.ones(len(cloth.X))
        function = self.force
        if not callable(function):
            function = FormulaForce(_validated_parts(function), cloth.X)
        return BoundUserForce(
            function=function,
            derivatives=self.derivatives,
            amount=amount,
            X=cloth.X,
            symmetric=self.tangent == "symmetric",
        )


def _validated_parts(parts) -> tuple:
    """Return the three components of a user's force, each as a number or a `Formula`.

    Raises `InputError` unless `parts` are a tuple or a list of three finite numbers or texts,
    and for a text that is no formula of `VARIABLES`.
    """
    allowed = "must be three finite numbers or formulas, or a function of x, v, t"
    if not isinstance(parts, tuple | list) or len(parts) != 3:
        raise InputError(f"force = {parts!r}", allowed, "UserForce")
    for part in parts:
        is_number = np.isscalar(part) and not isinstance(part, str | bool)
        if not isinstance(part, str) and not (is_number and np.isfinite(part)):
            raise InputError(f"force = {parts!r}", allowed, "UserForce")
    values: list[Formula | float] = []
    for part in parts:
        if isinstance(part, str):
            values.append(Formula(part, VARIABLES))
        else:
            values.append(float(part))
    return tuple(values)


@dataclass(frozen=True, eq=False)
class FormulaForce:
    """Three numbers or formulas as a function of x (n, 3), v (n, 3) and t.

    `X` (n, 2) are the places of the nodes in the flat cloth [m].
    """

    parts: tuple
    X: np.ndarray

    def __call__(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """Return the values (n, 3) of the three parts, at all nodes."""
        variables = np.empty((len(VARIABLES), len(x)))
        for row, column in enumerate((*self.X.T, *x.T, *v.T, t)):  # in the order of VARIABLES
            variables[row] = column
        with errors_of("UserForce", "force: "):
            return self._components(variables)

    def calls(self, x: np.ndarray, v: np.ndarray, t: np.ndarray, g: np.ndarray) -> list[Call]:
        """The compiled calls that write the values (n, 3) at x, v and t (1,) to g."""
        variables = np.empty((len(VARIABLES), len(x)))
        variables[:2] = self.X.T
        return [
            (write_columns, (x, variables[2:5])),
            (write_columns, (v, variables[5:8])),
            (write_time, (t, variables[8])),
            self._components.call(variables, g),
        ]

    @cached_property
    def _components(self) -> FormulaVector:
        return FormulaVector(self.parts)


@dataclass(frozen=True, eq=False)
class BoundUserForce(BoundTerm):
    """`UserForce` on a cloth.

    Attributes
    ----------
    function
        g of x, v and t.
    derivatives
        The user's function for ∂g/∂x and ∂g/∂v, or None.
    amount
        A_a (n,).
    X
        Places (n, 2) of the nodes in the flat cloth [m].
    symmetric
        Whether the tangent is the symmetric part.
    """

    function: Callable
    derivatives: Callable | None
    amount: np.ndarray
    X: np.ndarray
    symmetric: bool

    name = "UserForce"
    load = True
    has_energy = False
    velocity_dependent = True

    def _value(self, x, v, t) -> np.ndarray:
        """Return g (n, 3); raise `InputError` if its shape is wrong or it is not finite."""
        return _check_value(self.function(x, v, t), x.shape, "force", t)

    def _differentiate(self, x, v, t) -> tuple[np.ndarray, ...]:
        """Return ∂g/∂x and ∂g/∂v, (n, 3, 3) each, by the user's function or by differences.

        All nodes are shifted at once, as the force on a node depends on this node only. Raises
        `InputError` for a value that is not finite or has a wrong shape.
        """
        if self.derivatives is not None:
            parts = self.derivatives(x, v, t)
            return tuple(_check_value(part, (len(x), 3, 3), "derivative", t) for part in parts)
        shifts = STEP_OF_DIFFERENCES * np.eye(3)  # along the three axes
        changes_by_x = [self._value(x + s, v, t) - self._value(x - s, v, t) for s in shifts]
        changes_by_v = [self._value(x, v + s, t) - self._value(x, v - s, t) for s in shifts]
        width = 2 * STEP_OF_DIFFERENCES
        return np.stack(changes_by_x, axis=2) / width, np.stack(changes_by_v, axis=2) / width

    def supply(self, x, v, t) -> float:
        """Power f · v [W]."""
        return dot(self.amount[:, None] * self._value(x, v, t), v)

    def add_force(self, x, v, t, f) -> None:
        """f_a += A_a g_a [N]."""
        f += self.amount[:, None] * self._value(x, v, t)

    def force_calls(self, x, v, t, f) -> Calls | None:
        if not isinstance(self.function, FormulaForce):
            return None
        g = np.empty_like(x)
        calls = self.function.calls(x, v, t, g)
        return [*calls, (add_scaled, (self.amount[:, None], g, f))]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J_aa −= A_a (wx ∂g/∂x + wv ∂g/∂v).

        Of the blocks that are added, only the symmetric part counts if `symmetric`. If
        `definite`, its negative eigenvalues are set to 0, too.
        """
        dg_dx, dg_dv = self._differentiate(x, v, t)
        blocks = -self.amount[:, None, None] * (wx * dg_dx + wv * dg_dv)
        if self.symmetric or definite:
            blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
        if definite:
            eigenvalues, vectors = np.linalg.eigh(blocks)
            positive_values = np.maximum(eigenvalues, 0.0)
            blocks = np.einsum("nij,nj,nkj->nik", vectors, positive_values, vectors)
        add_blocks(J.pattern.diagonal, blocks, J.values)


def _check_value(value, shape: tuple[int, ...], name: str, t: float) -> np.ndarray:
    """Return the value of a user's function as an array.

    Raises `InputError` if it does not have the `shape`, or is not finite. `name` says which
    function it is, and t [s] the time of the call.
    """
    value = np.asarray(value, dtype=float)
    if value.shape != shape or not np.isfinite(value).all():
        what = f"{name} of shape {value.shape} at t = {t:g}"
        raise InputError(what, f"must be finite and of shape {shape}", "UserForce")
    return value


@kernel
def add_blocks(diagonal, blocks, J):
    """J_aa += blocks[a]."""
    for a in range(len(diagonal)):
        for i in range(3):
            for j in range(3):
                J[diagonal[a], i, j] += blocks[a, i, j]
