"""Conditions of one family bound to the stencils of a cloth, as a `System` calls them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from fecloth.compiled.calls import Call, Calls, Present
from fecloth.compiled.jit import Array, Zeros, specialise
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.terms.discrete_gradient import OverMean
from fecloth.terms.loops import condition
from fecloth.terms.loops.shared_loop import SharedLoop, by_part
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference


def entry_point(template: Callable[..., Any]) -> cached_property[Any]:
    """A template of `condition`, compiled with the family of `ConditionKernels`."""
    return cached_property(lambda kernels: specialise(template, condition=kernels.family))


@dataclass(frozen=True, eq=False)
class ConditionKernels:
    """The entry points of a family, made at their first use.

    Attributes
    ----------
    family
        A compiled function as `fecloth.terms.loops.condition` describes it.
    """

    family: Callable[..., Any]

    energy = entry_point(condition.energy)
    power = entry_point(condition.power)
    add_force = entry_point(condition.add_force)
    add_tangent = entry_point(condition.add_tangent)


@dataclass(frozen=True, eq=False)
class BoundCondition(BoundTerm):
    """Conditions of one family on a cloth, made by `bind`; see `RigidCondition`.

    Attributes
    ----------
    name
        The name of the term.
    kernels
        The entry points of the family.
    shape
        The tuples `per_node` and `convex` that the kernels take.
    loop
        The loop over the stencils.
    constants
        (m, p) The constants of each stencil.
    stiffness, damping
        (m, r, r) k_s and k_d of each stencil.
    hessian
        "exact", or "gauss_newton" for a tangent without ∂²C.
    tangent
        Whether the tangent of the damping is "exact", or "symmetric": without its
        non-symmetric part.
    """

    name: str
    kernels: ConditionKernels
    shape: tuple[Zeros, Zeros]
    loop: SharedLoop
    constants: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    hessian: str = "exact"
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
        """Return a family of conditions, bound to the stencils `nodes` (m, k) of a panel.

        `slots` finds blocks in the system matrix. `convex` says for each of the r components
        whether its ∂²C is positive semi-definite everywhere. The condition gets the rows of
        `constants` (m, p) as `c`. `stiffness` and `damping` are numbers, (m,) with a number for
        each stencil, (m, r) for each component too, or matrices (m, r, r). `own` are the fields
        of a subclass.
        """
        nodes = np.ascontiguousarray(nodes, dtype=np.int32)
        m, k = nodes.shape
        r = len(convex)
        rows = np.broadcast_to(constants, (m, np.shape(constants)[-1]))
        return cls(
            name=name,
            kernels=kernels,
            shape=((0,) * k, tuple(int(flag) for flag in convex)),
            loop=SharedLoop.over_elements(panel, nodes, slots),
            constants=np.ascontiguousarray(rows, float),
            stiffness=_matrices(stiffness, m, r),
            damping=_matrices(damping, m, r),
            hessian=hessian,
            tangent=tangent,
            **own,
        )

    @property
    def nodes(self) -> np.ndarray:
        """(m, k) the nodes of the stencils."""
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
        """Constants (m, p) at x and t, as C and its derivatives up to `order` need them."""
        return self.constants

    def energy(self, x: np.ndarray, t: float) -> float:
        """½ Σ Cᵀ k_s C [J]."""
        return self.loop.total(self._energy(self.table(x, t, 0), x))

    def _energy(self, table: Array, x: Array) -> Callable[..., Call]:
        arrays = self.nodes, table, self.stiffness
        return by_part(self.kernels.energy, self.shape, arrays, x)

    def energy_calls(self, x: Array, t: Array, sums: Array) -> Calls | None:
        if self._has_table or self.loop.counted is not None:
            return None
        return self.loop.total_calls(self._energy(self.constants, x), sums)

    @property
    def _has_table(self) -> bool:
        """Whether it makes the constants in Python."""
        return type(self).table is not BoundCondition.table

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

    def force_calls(
        self, x: np.ndarray, v: np.ndarray, t: np.ndarray, f: np.ndarray
    ) -> Calls | None:
        if self._has_table:
            return None
        return [self.loop.shared_add(self._force(self.constants, x, v), f)]

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K + wv D, see `condition.add_tangent`.

        `definite` keeps only positive semi-definite parts, as the head of that module says.
        """
        call = self._tangent(self.table(x, t, 2), x, v, float(wx), float(wv), definite)
        self.loop.add_blocks(call, J)

    def tangent_calls(
        self, x: Array, v: Array, t: Array, wx: Present, wv: Present, J: BlockMatrix, definite: bool
    ) -> Calls | None:
        if self._has_table:
            return None
        call = self._tangent(self.constants, x, v, wx, wv, definite)
        return [self.loop.shared_add_blocks(call, J)]

    def _tangent(
        self,
        table: Array,
        x: Array,
        v: Array,
        wx: float | Present,
        wv: float | Present,
        definite: bool,
    ) -> Callable[..., Call]:
        arrays = self.nodes, self.loop.slots, table, self.stiffness, self.damping
        geometric = self.hessian == "exact"
        mixed = not self.symmetric and not definite  # the part of (12) that is not symmetric
        others = x, v, wx, wv, geometric, definite, mixed
        return by_part(self.kernels.add_tangent, self.shape, arrays, *others)


@dataclass(frozen=True, eq=False)
class RigidCondition(BoundCondition):
    """Conditions that no rigid motion changes: C(x) less values at rest."""

    objective = True

    def between(self, start: Array, x: Array) -> Self:
        """The conditions with the values at rest for which C at x is ½ (C₀ + C₁).

        C₀ and C₁ belong to the two ends of the step, at `start` and 2x − start.
        """
        raise NotImplementedError

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The conditions over a step at whose mean they are evaluated; otherwise themselves."""
        if not step.at_mean or not self.has_energy:
            return self
        return OverMean(self, step.start, step.symmetric and self.symmetric, conserves=False)


class LengthCondition(RigidCondition):
    """Conditions on lengths and products of vectors e_r = Σ_a D_ra x_a.

    With other values at rest the force at the mean of a step does the work of the energy. Take
    a spring of the length L at rest, with the vectors e₀, e and e₁ = 2e − e₀ at the begin, mean
    and end of the step, and with s = l₀ + l₁. Over the step it has the force f = −k (1 − 2L/s)
    e. As 2 e · (e₁ − e₀) = l₁² − l₀², its work −k (½ s − L) (l₁ − l₀) is minus the change of
    ½ k (l − L)² (Simo and Tarnow 1992, The Discrete Energy–Momentum Method, ZAMP 43, for such a
    force along e).
    """

    @property
    def differences(self) -> Array:
        """D (r, k) of all stencils, or (m, r, k)."""
        raise NotImplementedError

    def rest_over_step(self, e0: Array, e: Array) -> Array:
        """Constants (m, p) over a step; (m, r, 3) e₀ at its begin and e at its mean."""
        raise NotImplementedError

    def moduli_over_step(self, e0: Array, e: Array) -> Array:
        """−∂f_r/∂e_s (m, r, r, 3, 3) of the force over the step."""
        raise NotImplementedError

    def vectors(self, x: Array) -> Array:
        """(m, r, 3) e_r."""
        e: Array = np.einsum("...ra,...ai->...ri", self.differences, x[self.nodes])
        return e

    def between(self, start: Array, x: Array) -> Self:
        """The conditions with the force at x of a step from `start` to 2x − start."""
        constants = self.rest_over_step(self.vectors(start), self.vectors(x))
        return replace(self, constants=constants)

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The conditions over a step, which conserve energy; or themselves, as above."""
        over = super().over_step(step)
        if not isinstance(over, OverMean):
            return over
        return LengthsOverStep(self, step.start, over.symmetric, conserves=True)


class LengthsOverStep(OverMean):
    """Conditions on lengths over a step; their damping acts at the mean."""

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K + wv D, exact unless the term is symmetric or J must be `definite`.

        −∂f_r/∂e_s becomes blocks of nodes by e_r = Σ_a D_ra x_a. The damping is added as it is
        without a step.
        """
        if definite or self.symmetric:
            super().add_tangent(x, v, t, wx, wv, J, definite)
            return
        term = self.term
        D = term.differences
        M = term.moduli_over_step(term.vectors(self.start), term.vectors(x))
        blocks = np.einsum("...ra,...sb,...rsij->...abij", D, D, wx * M, optimize=True)
        np.add.at(J.values, term.loop.slots, blocks)
        if self.dissipative:
            damping = replace(term, stiffness=np.zeros_like(term.stiffness))
            damping.add_tangent(x, v, t, wx, wv, J, definite)


def mean_ratio(e0: Array, e: Array) -> Array:
    """2 |e|/s of vectors (…, 3), which turns L into the length at rest for the force at e."""
    l0 = np.linalg.norm(e0, axis=-1)
    l = np.linalg.norm(e, axis=-1)
    l1 = np.linalg.norm(2.0 * e - e0, axis=-1)
    return _quotient(2.0 * l, l0 + l1)


def spring_modulus(L: Array, e0: Array, e: Array) -> Array:
    """(…, 3, 3) −∂f/∂e = (1 − 2L/s) I + (4L/s²) e ⊗ e₁/l₁ of a spring of k = 1 over a step.

    e₀ and e (…, 3) are its vectors at the begin and mean of the step, e₁ = 2e − e₀, s = l₀ + l₁
    the sum of both lengths, and L (…) the length at rest; see `LengthCondition`.
    """
    e1 = 2.0 * e - e0
    l0 = np.linalg.norm(e0, axis=-1)
    l1 = np.linalg.norm(e1, axis=-1)
    s = l0 + l1
    across = 1.0 - _quotient(2.0 * L, s)
    along = _quotient(4.0 * L, s * s * l1)
    dyads: Array = (along[..., None] * e)[..., :, None] * e1[..., None, :]
    dyads += across[..., None, None] * np.eye(3)
    return dyads


def _quotient(a: Array, b: Array) -> Array:
    """a/b; 0 where b is 0."""
    quotient: Array = np.divide(a, b, out=np.zeros_like(b), where=b > 0.0)
    return quotient


def _matrices(values: ArrayLike, m: int, r: int) -> np.ndarray:
    """Make (m, r, r) from a number, (m,), (m, r) or (m, r, r)."""
    values = np.asarray(values, dtype=float)
    if values.ndim < 3:
        if values.ndim == 1:
            values = values[:, None]
        values = np.broadcast_to(values, (m, r))[:, :, None] * np.eye(r)
    return np.ascontiguousarray(np.broadcast_to(values, (m, r, r)))
