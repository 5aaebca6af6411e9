"""Base of implicit methods with a memory: Newmark's family and BDF2.

The memory is a frozen record, `Step.memory`, that `march` hands to the next step; without it a
method starts anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fecloth.integrators.numerical_dissipation import memory_dissipation
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step
from fecloth.nonlinear.stage import Stage
from fecloth.system.state import State
from fecloth.system.system import System


class WithMemory:
    """Base class of methods with a memory; it supplies their numerical dissipation.

    A subclass supplies `traits` and `step`. The traits have θ = ½, because M Δv · v̄ with
    v̄ = (v₀ + v₁)/2 is the change of the kinetic energy.
    """

    traits: MethodTraits

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step, by `memory_dissipation`."""
        return memory_dissipation(system, old, step)


def hold_stage(system: System, stage: Stage, at: State, a: np.ndarray) -> Stage:
    """Return the stage with its held directions at x and v of `at` and at the acceleration a."""
    hold = system.constraints.hold
    x, v, a = hold(stage.x, at.x), hold(stage.v, at.v), hold(stage.a, a)
    return replace(stage, x=x, v=v, a=a)
