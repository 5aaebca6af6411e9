"""The solution of the stage equation of an implicit step by Newton's iteration."""

from __future__ import annotations

import numpy as np

from fecloth.errors import FeclothError
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.limits import admit, has_limits
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.stage_equation import NewtonFailed, StageEquation
from fecloth.nonlinear.statistics import Counts
from fecloth.system.system import System

__all__ = ["NewtonFailed", "solve"]


def solve(
    system: System,
    stage: Stage,
    solver: SolverContext,
    guess: np.ndarray | None = None,
    dt: float | None = None,
) -> tuple[np.ndarray, Counts]:
    """Return the unknown q (n, 3) of a stage, and the `Counts`.

    It starts from the `guess`, or from zero where the potential is less there, without a guess,
    or where the forces there are not finite. Nodes that would be inside an obstacle there are
    stopped on their way from the begin of the step. With `dt`, the size of the step [s], the
    tolerance "auto" ends the iteration by the error in time of the step; without it, by the
    residual.
    If the solver holds a factor for the same weights, its direction is tried first. The full step
    is taken if the residual falls; otherwise a new factor is computed. `iteration.iterate` says
    how the length of a step is chosen, and what happens where the matrix is not definite. The norm
    of the residual alone would not do to choose the length: a cloth that turns stretches in
    proportion to the angle squared, and as it is so much stiffer in its plane than across, good
    steps increase the residual.

    Raises `NewtonFailed` if the tolerance is not met, unless by round-off: then `Counts.limited` is
    1.

    Notes
    -----
    Where a step does not resolve the motion, the acceleration of the last step is a poor guess:
    its waves have turned since. On sheets of stiff cotton that crumple, generalised-α took half of
    the iterations from the better one of both.
    """
    equation = StageEquation(system, stage, solver.options.definiteness)
    zero = np.zeros_like(stage.x)
    q = zero if guess is None else system.constraints.project(guess.copy())
    if has_limits(system):
        q, zero = _admitted(system, stage, q), _admitted(system, stage, zero)
    if (potential := equation.potential) and potential(zero) < potential(q):
        q = zero
    left = None
    if solver.options.tolerance == "auto" and solver.step_error and dt:
        left = ErrorLeft(float(dt * stage.wv), float(solver.step_error.over(dt)))
    solver.begin(stage.wx, stage.wa, stage.x)
    try:
        return iterate(equation, solver, q, least=1, instead=zero, left=left)
    except FeclothError:
        solver.factor_reuse.drop()
        raise


def _admitted(system: System, stage: Stage, q: np.ndarray) -> np.ndarray:
    """The unknown (n, 3) near q at which no node is inside an obstacle."""
    x, _, _ = stage.at(q)
    there = admit(system, x, stage.t)
    return q if there is x else q + system.constraints.project((there - x) / stage.wx)
