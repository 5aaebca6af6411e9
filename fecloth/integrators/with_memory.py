"""What implicit methods with a memory share: Newmark's family and BDF2.

The memory is a frozen record, the `q` of each step, that `march` hands to the next one; without
it a method starts anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fecloth.integrators.numerical_dissipation import taken_beyond
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step
from fecloth.nonlinear.stage import Stage
from fecloth.system.system import State, System


@dataclass(frozen=True, eq=False)
class RememberedStep(Step):
    """A step with what its energy balance needs; its forces are evaluated once, if asked for.

    M a = f(stage) along the free directions is what the method solved, at the stage's time. What
    the forces did over the step is of second order by their mean over both ends, and what
    damping and loads did by their power in the middle: at the stage it is of first order.

    Where `share` is given, M a is the mean of the forces at both ends with that weight of the new.
    """

    a: np.ndarray
    old: State
    system: System
    share: float | None = None

    @cached_property
    def stages(self) -> tuple[State]:
        """The mean of old and new state."""
        return (blend(self.old, self.state, 0.5),)

    @cached_property
    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) forces [N] at both ends."""
        return self.system.force(self.old), self.system.force(self.state)

    @property
    def force(self) -> np.ndarray:
        """(n, 3) their mean [N]."""
        return 0.5 * (self.forces[0] + self.forces[1])

    @cached_property
    def solved(self) -> np.ndarray:
        """(n, 3) the force [N] that M a is along the free directions."""
        if self.share is None:
            return self.system.force(self.stage)
        return (1 - self.share) * self.forces[0] + self.share * self.forces[1]


class WithMemory:
    """Base class of methods with a memory: their energy balance.

    A subclass supplies `traits`, with θ = ½ as M Δv · v̄ is the change of the kinetic energy, and
    `step` and `weights`.
    """

    traits: MethodTraits

    def numerical(self, system: System, old: State, step: RememberedStep) -> float:
        """Energy [J] that the method itself took in a step, by `losses.taken_beyond`."""
        return taken_beyond(system, old, step)


def blend(old: State, new: State, theta: float) -> State:
    """old + θ (new − old)."""
    dt, dx, dv = new.t - old.t, new.x - old.x, new.v - old.v
    return State(old.t + theta * dt, old.x + theta * dx, old.v + theta * dv)


def holding(system: System, stage: Stage, at: State, a: np.ndarray) -> Stage:
    """The stage with its held directions at x and v of a state, and at the acceleration a."""
    hold = system.constraints.hold
    x, v, a = hold(stage.x, at.x), hold(stage.v, at.v), hold(stage.a, a)
    return replace(stage, x=x, v=v, a=a)
