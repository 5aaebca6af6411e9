"""Condition C(x) of a user, a Python function: energy ½ k_s CᵀC and damping along it."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner
from fecloth.errors import InputError, floats
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.arguments import checks_arguments
from fecloth.terms.custom.finite_differences import Derivatives, Function
from fecloth.terms.loops import bound_condition
from fecloth.terms.traits import TermTraits

# columns of the ledger
RESERVED = ("t", "kinetic", "pins", "numerical", "impacts", "total", "remainder")


@checks_arguments
@dataclass(frozen=True, eq=False)
class Condition:
    """Energy ½ k_s CᵀC and damping −k_d ∂C Ċ of a condition C(x) on stencils of k nodes.

        f_a = −∂C_a k_s C,   d_a = −∂C_a k_d Ċ,   Ċ = Σ_a ∂C_aᵀ v_a

    The forces and their tangents follow from C, ∂C and ∂²C. The functions take and return
    arrays of all stencils.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 7, 8 and 11–13; see
    `fecloth.terms.loops.condition`.

    Valid where C is twice differentiable, in every state of the motion: a length is not
    differentiable at zero, an angle not at a full turn. Momentum is conserved only if C does
    not change in rigid motion.

    A derivative without a function comes from central differences of order 4 with a step of
    1e-3 of the stencil's size. Where C is smooth, ∂C is good to 1e-10 and ∂²C to 1e-7 of their
    largest entries. ∂C takes 12 k calls of C, and ∂²C takes (12 k)². A function for a
    derivative is compared with differences when the term is bound, near the rest state.

    Parameters
    ----------
    value
        C: positions (m, k, 3) [m] → (m,), or (m, r) for r components.
    nodes
        (m, k) nodes of each stencil, as the cloth numbers them (`Cloth.nodes` finds them).
    stiffness
        k_s ≥ 0 in J per unit of C²: a number, (m,), or (m, r).
    damping
        k_d ≥ 0 in J s per unit of C², likewise.
    gradient, hessian
        ∂C: (m, k, 3) → (m, r, k, 3) and ∂²C → (m, r, k, 3, k, 3), without r if C is (m,).
    gauss_newton
        Leave the parts with ∂²C, of k_s C and of the damping, out of the tangent.
    tangent
        Of the damping: "symmetric" (without the first part of eq. 12) or "exact".
    convex
        ∂²C is positive semi-definite everywhere, as for a length: a definite tangent then
        keeps the part with ∂²C where it is under tension, else it drops all of it.
    name
        In the ledger.

    Raises
    ------
    InputError
        From `System`: for shapes that do not fit, and for a derivative that is wrong.
    """

    value: Function
    nodes: np.ndarray
    stiffness: float | np.ndarray
    damping: float | np.ndarray = 0.0
    gradient: Function | None = None
    hessian: Function | None = None
    gauss_newton: bool = False
    tangent: str = "symmetric"
    convex: bool = False
    name: str = "Condition"

    def __post_init__(self):
        """Raise `InputError` for wrong arguments, and keep `nodes` as an array of int32."""
        has_plain_name = all(c.isalnum() or c in " _-" for c in str(self.name))
        if self.name in RESERVED or not has_plain_name:
            reserved = ", ".join(RESERVED)
            allowed = f"must be letters, digits, spaces, _ and -, and none of {reserved}"
            raise InputError(f"name = {self.name!r}", allowed, "Condition")
        if not callable(self.value):
            raise InputError(f"value = {self.value!r}", "must be a function", "Condition")
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), self.name)
        for key in ("stiffness", "damping"):
            value = floats(key, getattr(self, key), self.name)
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise InputError(f"{key} = {getattr(self, key)!r}", "must be >= 0", self.name)
        if not np.any(self.stiffness) and not np.any(self.damping):
            raise InputError("stiffness = 0 and damping = 0", "one must be > 0", self.name)
        stencil = np.array(self.nodes)
        if stencil.ndim != 2 or not stencil.size or stencil.dtype.kind not in "iu":
            what = f"nodes of shape {stencil.shape} and type {stencil.dtype}"
            remedy = "One stencil is a list of one list."
            raise InputError(what, "must be whole numbers (m, k)", self.name, remedy)
        object.__setattr__(self, "nodes", np.ascontiguousarray(stencil, dtype=np.int32))

    traits = TermTraits(elements=("P1", "P2"))

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """Return `nodes` (m, k).

        Raises `InputError` for nodes that the cloth does not have, and for a stencil with a node
        twice.
        """
        low = self.nodes.min()
        high = self.nodes.max()
        if low < 0 or high >= len(cloth.X):
            allowed = f"must lie in 0 … {len(cloth.X) - 1}"
            raise InputError(f"node indices {low} … {high}", allowed, self.name)
        sorted_nodes = np.sort(self.nodes, axis=1)
        if (sorted_nodes[:, 1:] == sorted_nodes[:, :-1]).any():
            raise InputError("a stencil", "must not hold a node twice", self.name)
        return self.nodes

    def bind(self, panel: Panel, slots) -> bound_condition.BoundCondition:
        """Check the user's functions near rest, and bind the condition.

        Raises `InputError` for nodes that the cloth does not have, for shapes that do not fit,
        for values that are not finite, and for a derivative that is wrong.
        """
        cloth = panel.cloth
        flat_cloth = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
        rest = flat_cloth[self.stencil(cloth)]
        size_of_triangle = float(np.sqrt(cloth.area / len(cloth.triangles)))
        functions = self._make_functions(rest, size_of_triangle)
        functions.check(rest)
        hessian = "exact"
        if self.gauss_newton:
            hessian = "gauss_newton"
        try:
            return BoundUserCondition.bind(
                self.name,
                KERNELS,
                convex=(int(self.convex),) * functions.r,
                panel=panel,
                slots=slots,
                nodes=self.nodes,
                constants=np.zeros(1),  # `BoundUserCondition.table` takes their place
                stiffness=self.stiffness,
                damping=self.damping,
                hessian=hessian,
                tangent=self.tangent,
                functions=functions,
                rest=rest,
            )
        except ValueError as error:
            if isinstance(error, InputError):  # it says already what is wrong
                raise
            # Numpy could not bring stiffness and damping to the shape (m, r).
            raise self._wrong_shapes(functions.r) from None

    def _make_functions(self, rest: np.ndarray, least_size: float) -> Derivatives:
        """Return the functions C, ∂C and ∂²C of stencils that are at `rest` (m, k, 3).

        The size of a stencil, for finite differences, is the largest distance of a node from the
        mean of its nodes. A stencil of one node has no size: it takes `least_size` [m]. Raises
        `InputError` as `_count_components` does.
        """
        extent = np.linalg.norm(rest - rest.mean(axis=1, keepdims=True), axis=2).max(axis=1)
        return Derivatives(
            value=self.value,
            gradient=self.gradient,
            hessian=self.hessian,
            size=np.where(extent > 0, extent, least_size),
            r=self._count_components(rest),
            name=self.name,
        )

    def _wrong_shapes(self, r: int) -> InputError:
        """The error for a stiffness or a damping that does not fit r components."""
        shapes = f"{np.shape(self.stiffness)} and {np.shape(self.damping)}"
        m = len(self.nodes)
        what = f"stiffness and damping of shapes {shapes}"
        return InputError(what, f"must be numbers, ({m},) or ({m}, {r})", self.name)

    def _count_components(self, rest: np.ndarray) -> int:
        """Return r, the number of components of C, from its value at `rest` (m, k, 3).

        Raises `InputError` for a wrong shape, and for values that are not finite.
        """
        C = np.asarray(self.value(rest), dtype=float)
        m = len(rest)
        if C.ndim not in (1, 2) or len(C) != m:
            allowed = f"must be ({m},) or ({m}, r) for y of shape {rest.shape}"
            raise InputError(f"value(y) of shape {C.shape}", allowed, self.name)
        not_finite_rows = np.flatnonzero(~np.isfinite(C.reshape(m, -1)).all(axis=1))
        if len(not_finite_rows):
            first_row = not_finite_rows[0]
            what = f"C = {C[first_row]} at rest in stencil {first_row}"
            raise InputError(what, "must be finite", self.name)
        return C.reshape(m, -1).shape[1]


@dataclass(frozen=True, eq=False)
class BoundUserCondition(bound_condition.BoundCondition):
    """`Condition` on a cloth: the constants of a stencil are the values of C, ∂C and ∂²C.

    Attributes
    ----------
    functions
        C and its derivatives.
    rest
        Positions (m, k, 3) of the nodes of the stencils at rest [m].
    """

    functions: Derivatives = field(kw_only=True)
    rest: np.ndarray = field(kw_only=True)

    @cached_property
    def objective(self) -> bool:
        return self.functions.is_objective(self.rest)

    def table(self, x, t, order) -> np.ndarray:
        """Rows (m, p) with C of each stencil, for `order` 1 also with ∂C, for 2 also with ∂²C.

        A symmetric tangent of Gauss and Newton has no ∂²C, so that it is left out.
        """
        y = x[self.nodes]
        m = len(self.nodes)
        parts = [self.functions.C, self.functions.dC, self.functions.ddC][: order + 1]
        if self.hessian == "gauss_newton" and self.symmetric:
            parts = parts[:2]
        return np.concatenate([part(y).reshape(m, -1) for part in parts], axis=1)


@inner
def read_table(y, c, order, C, g, H):
    """Fill C, g = ∂C and H = ∂²C from the row c of `BoundUserCondition.table`.

    The row has the n values of C, then n d values of ∂C, then n d² values of ∂²C, for the d
    coordinates of the nodes. Coordinate a is the component a % 3 of node a // 3. The arguments
    are those of every family of conditions: see `loops.condition`.
    """
    n = len(C)
    d = 3 * len(y)
    for r in range(n):
        C[r] = c[r]
        if order > 0:
            for a in range(d):
                g[r, a // 3, a % 3] = c[n + r * d + a]
        if order > 1:
            for a in range(d):
                for b in range(d):
                    H[r, a // 3, a % 3, b // 3, b % 3] = c[n + n * d + (r * d + a) * d + b]


KERNELS = bound_condition.ConditionKernels(read_table)
