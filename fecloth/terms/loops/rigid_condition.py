"""Conditions that no rigid motion changes, and their force over a step of energy–momentum."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fecloth.compiled.jit import Array
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.loops.bound_condition import BoundCondition
from fecloth.terms.loops.shared_loop import cut
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference


@dataclass(frozen=True, eq=False)
class RigidCondition(BoundCondition):
    """Conditions that no rigid motion changes; made from a `BoundCondition` of the same fields."""

    objective = True

    def over_step(self, step: StepDifference) -> OverStep | RigidCondition:
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

    @property
    def name(self) -> str:
        return self.condition.name

    @property
    def symmetric(self) -> bool:
        return self.symmetric_elastic and self.condition.symmetric

    @property
    def dissipative(self) -> bool:
        return self.condition.dissipative

    @property
    def velocity_dependent(self) -> bool:
        return self.condition.velocity_dependent

    @property
    def _damping(self) -> BoundCondition:
        return replace(self.condition, stiffness=np.zeros_like(self.condition.stiffness))

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f_a −= ḡ_a k_s C̄ + ∂C_a k_d Ċ [N]."""
        bound, add = self.condition, self.condition.kernels.over_step.add_force
        arrays = bound.nodes, bound.constants, bound.stiffness
        bound.loop.add(
            lambda part, f: (add, (*bound.shape, *cut(arrays, part), self.start, x, f)), f
        )
        if self.dissipative:
            self._damping.add_force(x, v, t, f)

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K + wv D."""
        bound, kernels = self.condition, self.condition.kernels.over_step
        weights: tuple[float, ...] = (float(wx),)
        add = kernels.add_tangent
        if self.symmetric_elastic or definite:
            add, weights = kernels.add_symmetric_tangent, (float(wx), bool(definite))
        arrays = bound.nodes, bound.slots, bound.constants, bound.stiffness
        others = self.start, x, *weights
        bound.loop.add_blocks(
            lambda part, values: (add, (*bound.shape, *cut(arrays, part), *others, values)), J
        )
        if self.dissipative:
            self._damping.add_tangent(x, v, t, wx, wv, J, definite)
