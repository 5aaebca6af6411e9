"""Conditions of one family bound to the stencils of a cloth, as a `System` calls them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import Array, Zeros, specialise
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.terms.loops import condition, condition_discrete_gradient
from fecloth.terms.loops.condition import DEFINITE, EXACT, GAUSS_NEWTON
from fecloth.terms.loops.condition_discrete_gradient import DiscreteGradientKernels
from fecloth.terms.loops.eigenvalue_bounds import bound_from_squares, squared_norms
from fecloth.terms.loops.shared_loop import SharedLoop, by_part
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.step_difference import StepDifference


class ConditionKernels(NamedTuple):
    """The entry points of a family, each a template of `condition` compiled with the family."""

    energy: Callable[..., float]
    power: Callable[..., float]
    add_force: Callable[..., None]
    add_tangent: Callable[..., None]
    over_step: DiscreteGradientKernels


def kernels(family: Callable[..., Any]) -> ConditionKernels:
    """The entry points of a family; each is compiled at its first call, or read from disk."""
    # `family` is a compiled function as `fecloth.terms.loops.condition` describes it.
    templates = condition.energy, condition.power, condition.add_force, condition.add_tangent
    made = [specialise(template, condition=family) for template in templates]
    over_step = condition_discrete_gradient.kernels(family)
    return ConditionKernels._make([*made, over_step])


@dataclass(frozen=True, eq=False)
class BoundCondition(BoundTerm):
    """Conditions of one family on a cloth, made by `bind`; see `RigidCondition`."""

    name: str
    kernels: ConditionKernels  # the family's entry points
    shape: tuple[Zeros, Zeros]  # (per_node, convex), as the kernels take them
    loop: SharedLoop  # over the stencils
    constants: np.ndarray  # (m, p) constants of each stencil
    # (m, r, r) k_s and k_d.
    stiffness: np.ndarray
    damping: np.ndarray
    rest: np.ndarray  # (n, 3) positions at which `rate_bounds` is taken
    hessian: str = "exact"  # "exact" or "gauss_newton" (without ∂²C)
    # Of the damping: "symmetric" (without its non-symmetric part) or "exact".
    tangent: str = "symmetric"

    @classmethod
    def bind(
        cls,
        name: str,
        kernels: ConditionKernels,
        convex: tuple[int, ...],
        panel: Panel,
        slots: FindSlots,
        nodes: np.ndarray,
        constants: np.ndarray,
        stiffness: np.ndarray | float,
        damping: np.ndarray | float = 0.0,
        hessian: str = "exact",
        tangent: str = "symmetric",
        **own: Any,
    ) -> Self:
        """Bind a family of conditions to the stencils `nodes` (m, k) of a panel.

        `convex` has, for each of the r components, 1 if its ∂²C is positive semi-definite
        everywhere, else 0. The condition gets the rows of `constants` (m, p) as `c`. k_s and k_d
        are a number, (m,) one for each stencil, (m, r) also for each component, or (m, r, r).
        `own` are the fields of a subclass.
        """
        nodes = np.ascontiguousarray(nodes, dtype=np.int32)
        (m, k), r, X = nodes.shape, len(convex), panel.cloth.X
        rows = np.ascontiguousarray(np.broadcast_to(constants, (m, np.shape(constants)[-1])), float)
        shape = (0,) * k, tuple(int(flag) for flag in convex)
        loop = SharedLoop.over_elements(panel, nodes, slots)
        ks, kd = _matrices(stiffness, m, r), _matrices(damping, m, r)
        rest = np.column_stack([X, np.zeros(len(X))])
        return cls(name, kernels, shape, loop, rows, ks, kd, rest, hessian, tangent, **own)

    @property
    def nodes(self) -> np.ndarray:
        return self.loop.nodes

    @cached_property
    def has_energy(self) -> bool:
        return bool(self.stiffness.any())

    @cached_property
    def dissipative(self) -> bool:
        return bool(self.damping.any())

    @property
    def velocity_dependent(self) -> bool:
        return self.dissipative

    @property
    def symmetric(self) -> bool:
        return self.tangent == "symmetric" or not self.dissipative

    def table(self, x: np.ndarray, t: float, order: int) -> np.ndarray:
        """Constants (m, p) at x and t, as far as C, ∂C and ∂²C up to `order` need them."""
        return self.constants

    def energy(self, x: np.ndarray, t: float) -> float:
        """½ Σ Cᵀ k_s C [J]."""
        arrays = self.nodes, self.table(x, t, 0), self.stiffness
        return self.loop.total(by_part(self.kernels.energy, self.shape, arrays, x))

    def power(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Dissipated power Σ Ċᵀ k_d Ċ [W]."""
        arrays = self.nodes, self.table(x, t, 1), self.damping
        return self.loop.total(by_part(self.kernels.power, self.shape, arrays, x, v))

    def _force(self, table: np.ndarray, x: np.ndarray, v: np.ndarray) -> Callable[..., Call]:
        arrays = self.nodes, table, self.stiffness, self.damping
        return by_part(self.kernels.add_force, self.shape, arrays, x, v)

    def add_force(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> None:
        """f_a −= ∂C_a (k_s C + k_d Ċ) [N]."""
        self.loop.add(self._force(self.table(x, t, 1), x, v), f)

    def force_calls(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> Calls | None:
        if type(self).table is not BoundCondition.table:
            return None  # it makes the constants in Python
        return [self.loop.shared_add(self._force(self.constants, x, v), f)]

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        part = EXACT if self.hessian == "exact" else GAUSS_NEWTON
        if definite and part == EXACT:
            part = DEFINITE
        mixed = not self.symmetric and not definite
        arrays = self.nodes, self.loop.slots, self.table(x, t, 2), self.stiffness, self.damping
        others = x, v, float(wx), float(wv), part, mixed
        self.loop.add_blocks(by_part(self.kernels.add_tangent, self.shape, arrays, *others), J)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] at rest and of M⁻¹D [1/s]."""
        return self._bound(mass, 1.0, 0.0), self._bound(mass, 0.0, 1.0)

    def _bound(self, mass: np.ndarray, wx: float, wv: float) -> float:
        """Bound the eigenvalues of M⁻¹(wx K + wv D) by the eigenvalues of the stencils."""
        if not (self.stiffness.any() if wx else self.damping.any()):
            return 0.0
        parts = [squared_norms(blocks) for blocks in self._blocks(wx, wv)]
        return bound_from_squares(self.nodes, np.concatenate(parts), mass)

    def _blocks(self, wx: float, wv: float, size: int = 8192) -> Iterator[np.ndarray]:
        """Yield the matrices (s, k, k, 3, 3) of the stencils at rest, `size` of them at once."""
        zero, constants = np.zeros_like(self.rest), self.table(self.rest, 0.0, 2)
        for start in range(0, len(self.nodes), size):
            part = slice(start, start + size)
            s, k = self.nodes[part].shape
            slots = np.arange(s * k * k, dtype=np.int32).reshape(s, k, k)
            values = np.zeros((s * k * k, 3, 3))
            data = constants[part], self.stiffness[part], self.damping[part]
            weights = wx, wv, EXACT if self.hessian == "exact" else GAUSS_NEWTON, False
            arrays = *self.shape, self.nodes[part], slots, *data
            self.kernels.add_tangent(*arrays, self.rest, zero, *weights, values)
            yield values.reshape(s, k, k, 3, 3)


@dataclass(frozen=True, eq=False)
class RigidCondition(BoundCondition):
    """Conditions that no rigid motion changes."""

    objective = True

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The conditions over a step at whose mean they are evaluated; otherwise themselves."""
        if not (step.at_mean and self.has_energy):
            return self
        return OverStep(self, step.start, step.symmetric)


@dataclass(frozen=True, eq=False)
class OverStep(BoundTerm):
    """Conditions as they act over a step from `start` to 2x − start; their damping acts at x."""

    condition: RigidCondition
    start: np.ndarray
    symmetric_elastic: bool

    has_energy = False  # at x alone
    conserves = True
    name = taken_from("condition.name")
    dissipative = velocity_dependent = taken_from("condition.dissipative")

    @property
    def symmetric(self) -> bool:
        return self.symmetric_elastic and self.condition.symmetric

    @property
    def _damping(self) -> BoundCondition:
        return replace(self.condition, stiffness=np.zeros_like(self.condition.stiffness))

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f_a −= ḡ_a k_s C̄ + ∂C_a k_d Ċ [N]."""
        bound, add = self.condition, self.condition.kernels.over_step.add_force
        arrays = bound.nodes, bound.constants, bound.stiffness
        bound.loop.add(by_part(add, bound.shape, arrays, self.start, x), f)
        if self.dissipative:
            self._damping.add_force(x, v, t, f)

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        bound, kernels = self.condition, self.condition.kernels.over_step
        weights: tuple[float, ...] = (float(wx),)
        add = kernels.add_tangent
        if self.symmetric_elastic or definite:
            add, weights = kernels.add_symmetric_tangent, (float(wx), bool(definite))
        arrays = bound.nodes, bound.loop.slots, bound.constants, bound.stiffness
        bound.loop.add_blocks(by_part(add, bound.shape, arrays, self.start, x, *weights), J)
        if self.dissipative:
            self._damping.add_tangent(x, v, t, wx, wv, J, definite)


def _matrices(values: ArrayLike, m: int, r: int) -> np.ndarray:
    """Make (m, r, r) from a number, (m,), (m, r) or (m, r, r)."""
    values = np.asarray(values, dtype=float)
    if values.ndim < 3:
        rows = values[:, None] if values.ndim == 1 else values
        values = np.broadcast_to(rows, (m, r))[:, :, None] * np.eye(r)
    return np.ascontiguousarray(np.broadcast_to(values, (m, r, r)))
