"""The steps of Newton's iteration.

An iteration finds a direction (`directions`), with the exact matrix or with the first remedy
that helps (`remedies`), and how far to go along it (`line_search`). What it knows after that
is a `progress.Progress`.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.directions import Directions
from fecloth.nonlinear.equation import Equation
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.line_search import Point, find_step
from fecloth.nonlinear.progress import Pause, Progress
from fecloth.nonlinear.remedies import Remedy, RemedySearch

# An iteration may have met round-off if it left more than this part of the residual …
STALLED_RESIDUAL = 0.25
# … and if it moved no node by more than this part of the extent of the cloth.
STAGNANT_MOVE = 1e-7
# Of the extent of the cloth: on shorter steps round-off hides the change of the potential.
TINY_MOVE = 1e-6
# A solve that was cut short may go so many times the way of the last step, if that was a whole
# one. Its direction is one of descent, but its length means little.
LONGER_MOVE = 2.0
# A whole step with mass in its matrix is slow if it leaves more than this part of the residual;
# after so many slow steps in a row, conjugate gradients refine the direction.
SLOW_RESIDUAL = 0.5
SLOW_STEPS = 3
# α of a short step. Chosen: thirty of them come less far than one whole step.
SHORT_STEP = 1 / 32
# Within so many whole steps the potential must fall below the end of a line search.
MOST_WHOLE_STEPS = 12


class Steps:
    """One iteration after the other: `advance` takes a `Progress` and returns the next one.

    The attributes stay the same in all iterations. Only the linear solver, the record of its
    factor, and the estimate of the error left have a memory of their own.
    """

    def __init__(
        self, equation: Equation, context: SolverContext, error_left: ErrorLeft | None = None
    ):
        self.equation = equation
        self.system = equation.system
        self.context = context
        self.error_left = error_left or ErrorLeft()
        self.tolerance = self.error_left.goal or context.options.residual
        self.directions = Directions(equation, context, self.tolerance)
        self.extent = float(np.ptp(self.system.cloth.X, axis=0).max())

    def at(self, y: np.ndarray, scale: float) -> Point:
        """The point at y; `scale` is the one at the point before, 0.0 at the first."""
        R, scale = self.equation.residual(y, scale)
        return Point(y, R, self.system.sums.norm(R), scale)

    def goal(self, point: Point) -> float:
        """The residual at which the iteration may end."""
        return self.tolerance * point.scale

    def longest_move(self, step: np.ndarray) -> float:
        """How far a step (n, 3) of the unknown moves the node that it moves most [m]."""
        return self.equation.wx * float(abs(step).max())

    def begin(self, y: np.ndarray, other_start: np.ndarray | None = None) -> Progress:
        """The progress before the first iteration.

        It is at y (n, 3) or, if the forces there are not finite, at `other_start`.
        """
        point = self.at(y, scale=0.0)
        if other_start is not None and not np.isfinite(point.norm):
            point = self.at(other_start, scale=0.0)
        search = RemedySearch.begin(self.equation.remedies)
        return Progress(number=0, point=point, search=search, least_norm=point.norm)

    def advance(self, before: Progress) -> Progress:
        """The progress after one more iteration, also recorded in the error left.

        It tries a step with the old factor, if one is held and may be used, and else a step with
        a new matrix, exact or with a remedy. If that finds no step, the length of the last step
        is 0, and its `reason` says why.
        """
        if not np.isfinite(before.point.norm):
            after = replace(before, length=0.0, reason="the forces are not finite")
        else:
            after = self.step_with_old_factor(before) or self.step_with_remedies(before)
        longest_move = self.longest_move(after.point.y - before.point.y)
        is_slow = self.is_slow(before, after)
        after = replace(
            after,
            number=before.number + 1,
            least_norm=min(before.least_norm, after.point.norm),
            longest_move=longest_move,
            stagnates=self.stagnates(before.point, after.point, longest_move),
            slow_steps=before.slow_steps + 1 if is_slow else 0,
            short_steps=before.short_steps + 1 if after.length < SHORT_STEP else 0,
        )
        self.record_error(before, after)
        return after

    def stagnates(self, before: Point, after: Point, longest_move: float) -> bool:
        """Whether a step hardly moved the cloth and left much of the residual."""
        left_much = after.norm > max(STALLED_RESIDUAL * before.norm, self.goal(after))
        return left_much and longest_move <= STAGNANT_MOVE * self.extent

    def is_slow(self, before: Progress, after: Progress) -> bool:
        """Whether a whole step with mass in its matrix left much of the residual."""
        may_refine = self.equation.explores and self.equation.potential
        is_whole_with_mass = after.remedy.shift > 0.0 and after.length >= 1.0
        left_much = after.point.norm > SLOW_RESIDUAL * before.point.norm
        return bool(may_refine and is_whole_with_mass and left_much)

    def record_error(self, before: Progress, after: Progress) -> None:
        """Record a step in the estimate of the error left.

        A step that was shortened, or held back by a remedy, tells nothing about that error.
        """
        held_back = bool(after.remedy.shift or after.cut_short)
        if self.equation.takes_short_solves:  # with clamped tangents too, which may be many
            held_back = held_back or after.search.last > 0
        is_whole = after.length == 1.0 and not held_back
        point = after.point
        self.error_left.correct(self.system, point.y - before.point.y, is_whole)
        self.error_left.move(point.y, point.norm, point.scale)

    def step_with_old_factor(self, before: Progress) -> Progress | None:
        """The progress after a whole step with an old factor, or None.

        None if no factor is held of the remedy that is next weaker than the last one, if the
        step leads into an obstacle, or if ‖R‖ falls too little. It must fall, and with a
        potential to a half, because that might rise while the residual falls.
        """
        point = before.point
        search = before.search.take(max(before.search.last - 1, 0))
        step = self.directions.find_with_old_factor(point, search.remedy)
        if step is None:
            return None
        if self.equation.largest_step(point.y, step) < 1.0:
            return None
        end = self.at(point.y + step, point.scale)
        self.context.factor_reuse.record_iteration(
            contraction=end.norm / point.norm,
            to_go=self.to_go(point, end),
            linear=self.directions.linear_solver,
        )
        norm_to_reach = 0.5 * point.norm if self.equation.potential else point.norm
        if not end.norm < norm_to_reach:
            return None
        return replace(before, point=end, length=1.0, search=search, cut_short=False)

    def to_go(self, before: Point, point: Point) -> float:
        """The goal over the residual, or the allowed error over that left if it is nearer."""
        if not point.norm:
            return 1.0
        length = self.error_left.measure(self.system, point.y - before.y)
        to_go = self.error_left.to_go(length * point.norm / before.norm)
        return max(self.goal(point) / point.norm, to_go)

    def step_with_remedies(self, before: Progress) -> Progress:
        """The progress after a step with the first remedy that leads to an improvement.

        If none does, the length of the step is 0, and `reason` says why the last one failed.
        """
        reason = ""
        for number in before.search.to_try():
            search = before.search.take(number)
            try:
                step, cut_short = self.find_direction(before, search.remedy)
            except SolveFailed as failure:  # IndefiniteMatrix, or singular within round-off
                reason = str(failure)
                continue
            improvement = self.search_along(before, step)
            if improvement is None:
                reason = "no step along Newton's direction is an improvement"
                continue
            point, length = improvement
            after = replace(before, point=point, length=length, search=search, cut_short=cut_short)
            if number == 0:  # the exact matrix
                return self.explore(before, step, after)
            return after
        return replace(before, length=0.0, reason=reason)

    def find_direction(self, before: Progress, remedy: Remedy) -> tuple[np.ndarray, bool]:
        """The direction (n, 3) with a remedy, and whether its solve was cut short.

        Raises `SolveFailed` where the matrix has no factor or no solution.

        Where conjugate gradients find that J is not definite, their iterate is a direction of
        descent, shorter than s (Nocedal and Wright 2006, algorithm 7.1). It is taken if the
        equation allows, but not in the first iterations of a step: clamped tangents lead
        farther there. After slow steps the direction is refined.
        """
        try:
            step = self.directions.find(before.point, remedy)
        except IndefiniteMatrix as failure:
            takes_it = self.equation.takes_short_solves and before.search.has_clamped_enough
            if failure.so_far is None or not takes_it:
                raise
            return self.shorten(self.system.constraints.expand(failure.so_far), before), True
        if remedy.shift and before.slow_steps >= SLOW_STEPS:
            return self.directions.refine(before.point, step), False
        return step, False

    def shorten(self, step: np.ndarray, before: Progress) -> np.ndarray:
        """The step, or the part of it that moves no node much farther than the last step did."""
        allowed_move = before.longest_move
        if before.length >= 1.0:
            allowed_move *= LONGER_MOVE
        move = self.longest_move(step)
        if allowed_move and move:
            return step * min(1.0, allowed_move / move)
        return step

    def search_along(self, before: Progress, step: np.ndarray) -> tuple[Point, float] | None:
        """An improvement along the step and its α, by a line search; None without one."""
        point = before.point
        move = self.longest_move(step) or 1.0  # of the whole step; 1 m for a step of zeros
        largest_part = self.equation.longest / move
        return find_step(
            self.system.sums,
            at=partial(self.at, scale=point.scale),
            start=point,
            step=step,
            enough=max(self.goal(point), 0.5 * before.least_norm),
            potential=self.equation.potential,
            longest=min(largest_part, self.equation.largest_step(point.y, step)),
            tiny=TINY_MOVE * self.extent / move,
        )

    def explore(self, before: Progress, step: np.ndarray, searched: Progress) -> Progress:
        """The progress at the end of a few whole Newton steps, or else at `searched`.

        `searched` is the progress after the line search along `step`. The whole steps begin at
        `before`, and their end is taken where the potential is lower.

        A sheet that is stiff in its plane stretches where a step turns it, so that a line search
        allows only short steps. The next steps take this stretch back (the watchdog technique of
        Chamberlain et al. 1982, Math. Programming Study 16). After steps in vain the search
        alone goes on for 1, 2, 4, … iterations.
        """
        potential = self.equation.potential
        pause = before.pause
        if searched.length >= 1.0 or not potential or not self.equation.explores:
            return searched
        if pause.left > 0:
            return replace(searched, pause=replace(pause, left=pause.left - 1))
        potential_of_search = potential(searched.point.y)
        for point in self.whole_steps(before.point, step):
            if potential(point.y) <= potential_of_search:
                return replace(searched, point=point, length=1.0, pause=Pause())
        pause_length = 2 * pause.length or 1
        return replace(searched, pause=Pause(left=pause_length, length=pause_length))

    def whole_steps(self, point: Point, step: np.ndarray) -> Iterator[Point]:
        """Yield the ends of whole Newton steps with the exact matrix; the first one is `step`.

        A step is shortened only where it would move a node by more than `Equation.longest`. The
        steps end after `MOST_WHOLE_STEPS`, where the matrix has no factor, and where the forces
        are not finite.
        """
        for number in range(MOST_WHOLE_STEPS):
            if number > 0:
                try:
                    step = self.directions.find(point, self.directions.exact)
                except SolveFailed:
                    return
            part = min(1.0, self.equation.longest / self.longest_move(step))
            point = self.at(point.y + part * step, point.scale)
            if not np.isfinite(point.norm):
                return
            yield point
