"""A step of an implicit method between its begin and its solution, and the step of all of them.

A step is opened, from the state, the memory of the method and the history of the terms; solved,
for the unknown q at which R(q) = 0; and closed, from q to the new state, memory and history. Each
part is a function of its own, so that others can evaluate the residual, and the end of the step,
at a q that they have.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fecloth.integrators.step import Step
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear import newton
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import Remedy
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.stage_equation import StageEquation
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System

UNCOUNTED = Counts()  # of a step that is closed at a q which it did not solve for


@dataclass(frozen=True, eq=False)
class Opening:
    """An implicit step that is open: ``method.open(system, state, dt, memory, history)``.

    The unknown q (n, 3) gives x = x̃ + wx q, v = ṽ + wv q and a = ã + wa q at the `stage`. The step
    is solved where `residual` vanishes, and ``method.close(opening, q)`` is the `Step` to any q.
    """

    method: Any  # whose step it is; the first step of BDF2 is a step of another method
    system: System
    over: System  # the system over the step
    stage: Stage  # the affine maps of q, with what the pins prescribe
    begin: State
    end: State  # of the held directions
    dt: float  # size of the step [s]
    memory: Any = None  # what the method remembers of the step before; None in the first step
    guess: np.ndarray | None = None  # of q; None for zero
    history: History | None = None  # the records that terms keep, at the begin; None without any

    @cached_property
    def equation(self) -> StageEquation:
        """The equation of the step, with exact tangents."""
        return StageEquation(self.over, self.stage, "none")

    def residual(self, q: np.ndarray) -> np.ndarray:
        """R(q) = M a − f(x, v, t) along the free directions, (n, 3) [N]."""
        return self.equation.residual(q, 1.0)[0]

    def tangent(self, q: np.ndarray, J: BlockMatrix) -> BlockMatrix:
        """∂R/∂q = wa M + wv D + wx K along the free directions, in place of what J held.

        What terms couple outside the pattern of J is in a matrix of its own, which is returned
        then. Without what `System.dense` gives.
        """
        exact = Remedy(0.0, False)
        self.equation.assemble(q, exact, J)
        return self.equation.couple(q, exact, J)


def ending(opening: Any, new: State) -> dict[str, Any]:
    """The fields that the `Step` to the state `new` has of its opening, of any kind."""
    history = opening.over.commit(new, opening.history)
    return {"over": opening.over, "history": history, "earlier": opening.history}


def newton_step(
    self: Any,
    system: System,
    state: State,
    dt: float,
    solver: SolverContext,
    memory: Any = None,
    history: History | None = None,
) -> Step:
    """One step from `state` over `dt` [s]: opened, solved by Newton's iteration, and closed.

    It is the `step` of every method that has `open` and `close`.
    """
    opening = self.open(system, state, dt, memory, history, solver)
    q, counts = newton.solve(opening.over, opening.stage, solver, opening.guess, dt)
    step: Step = self.close(opening, q, counts)
    return step
