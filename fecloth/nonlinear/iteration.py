"""Newton's iteration with a line search: one loop for time steps and for static equilibrium.

`steps.Steps` makes the iterations. This module says when they end, and with which result.
"""

from collections.abc import Callable

import numpy as np

from fecloth.errors import amount
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import Equation
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.progress import Progress
from fecloth.nonlinear.statistics import Counts
from fecloth.nonlinear.steps import STAGNANT_MOVE, Steps

# The residual is round-off if it is at most so many times the change of the residual when the
# last digits of all numbers change. That change is a sample, at random, of a sum of round-off.
ROUND_OFF_FACTOR = 8.0
# Round-off above this part of the forces: the forces of a cloth at rest, which move nothing.
FORCES_AT_REST = 1e-6
# Short steps in a row with which the iteration of a step in time creeps, with contact. Such an
# iteration takes hundreds of steps or fails: half of the step is solved sooner.
MOST_SHORT_STEPS = 10
# A smaller limit to the iterations than this is told as the cause of a failure.
FEW_ITERATIONS = 20


def iterate(
    equation: Equation,
    context: SolverContext,
    y: np.ndarray,
    least: int = 0,
    report: Callable[[Progress], None] = lambda progress: None,
    other_start: np.ndarray | None = None,
    error_left: ErrorLeft | None = None,
) -> tuple[np.ndarray, Counts]:
    """Iterate from y (n, 3) until ‖R‖ ≤ tolerance × scale, and at least `least` times.

    Return the solution (n, 3) and the `Counts`. Raise `Equation.failure` where the iteration
    cannot go on, creeps, or takes more than the option `max_iterations`.

    With `error_left` the iteration also ends where the error left is small against the error in
    time. If the forces at y are not finite, it starts from `other_start`. `report` is called
    after each iteration that found a step.

    Each iteration solves J s = −R with the exact matrix J or, where that is not positive
    definite or s is no improvement of any length (`line_search.find_step`), with the first
    remedy for which it is. With a potential the iteration always ends: the steps that are
    taken for their residual alone halve the least one so far, so they are few, and all others
    lower the potential.

    The iteration also ends where the residual is round-off. That is measured at the start if
    no iteration is asked for, after an iteration that hardly moved the cloth and left more
    than a quarter of the residual, and before a failure. Then `Counts.limited` is 1, unless
    the forces are below a million times their round-off, as in a cloth at rest, and the last
    iteration moved no node by 1e-7 of the extent of the cloth. If no force exceeds its
    round-off, the residual counts as 0.
    """
    steps = Steps(equation, context, error_left)
    progress = steps.begin(y, other_start)
    most = context.options.max_iterations
    while True:
        counts = _counts_if_ended(steps, progress, least)
        if counts:
            return progress.point.y, counts
        if progress.failed or progress.number == most or _creeps(equation, progress):
            raise _failure(steps, progress)
        progress = steps.advance(progress)
        if not progress.failed:
            report(progress)


def _counts_if_ended(steps: Steps, progress: Progress, least: int) -> Counts | None:
    """The counts if the iteration ends here, or None if it must go on.

    It ends with a small residual after at least `least` iterations, with a small error left, or
    where the residual is round-off.
    """
    point = progress.point
    has_small_residual = progress.number >= least and point.norm <= steps.goal(point)
    if has_small_residual and not steps.error_left.is_needed:
        return _make_counts(steps, progress)
    if steps.error_left.is_small or point.norm == 0:
        return _make_counts(steps, progress)
    if _may_be_round_off(steps, progress, least):
        round_off = ROUND_OFF_FACTOR * steps.equation.round_off(point.y)
        norm = steps.system.sums.norm
        # At the start along each axis: the round-off in the plane of a flat cloth may be more
        # than a load across it, which moves the cloth far.
        parts = [1.0] if progress.number else np.eye(3)
        if all(norm(point.R * part) <= norm(round_off * part) for part in parts):
            return _make_counts(steps, progress, norm(round_off))
    return None


def _creeps(equation: Equation, progress: Progress) -> bool:
    """Whether to give up a step in time with contact, which may then be taken in parts."""
    may_give_up = equation.takes_short_solves and not equation.explores
    return may_give_up and progress.short_steps >= MOST_SHORT_STEPS


def _may_be_round_off(steps: Steps, progress: Progress, least: int) -> bool:
    """Whether to compare the residual with round-off, for which more forces are computed."""
    if progress.number == 0:
        return least == 0
    most = steps.context.options.max_iterations
    is_last = progress.failed or progress.number == most
    return progress.stagnates or is_last or steps.error_left.stagnates


def _make_counts(steps: Steps, progress: Progress, floor: float = 0.0) -> Counts:
    """The counts at the end of the iteration; also end the step of `FactorReuse`.

    `floor` is the round-off of the residual, if the iteration ends because of it.
    """
    costs = steps.directions.costs
    steps.context.factor_reuse.end_step(costs.reused_solves, steps.directions.linear_solver)
    point = progress.point
    meets_goal = steps.goal(point) >= point.norm
    ends_by_error = steps.error_left.is_small and not meets_goal
    has_moved = progress.longest_move > STAGNANT_MOVE * steps.extent
    # Round-off does no harm where the forces are little more, and moved no node.
    is_at_rest = floor >= FORCES_AT_REST * point.scale and not has_moved
    is_harmless = floor >= point.scale or is_at_rest
    return Counts(
        newton=progress.number,
        linear=costs.linear,
        modified=costs.modified,
        residual=point.relative if point.scale > floor else 0.0,
        seconds=costs.seconds,
        factorisations=costs.factorisations,
        limited=int(not (meets_goal or ends_by_error or is_harmless)),
        estimated=int(ends_by_error),
        newton_error=steps.error_left.error if ends_by_error else 0.0,
        step_error=steps.error_left.in_time if ends_by_error else 0.0,
    )


def _failure(steps: Steps, progress: Progress) -> Exception:
    """The error of an iteration that found no step, or took too many."""
    most = steps.context.options.max_iterations
    reason = progress.reason
    if _creeps(steps.equation, progress):
        reason = f"Newton creeps: {MOST_SHORT_STEPS} steps in a row were nearly as short as none"
    elif not progress.failed:
        reason = f"Newton did not converge in {amount(most, 'iteration')}"
        if most < FEW_ITERATIONS:
            reason += f", as max_iterations = {most} allows no more"
    return steps.equation.failure(reason, progress.point, progress.point.relative)
