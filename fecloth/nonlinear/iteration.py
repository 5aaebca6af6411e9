"""Newton's iteration with a line search: one loop for time steps and for static equilibrium."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed, amount
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import Equation, Remedies, Remedy
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.line_search import Point, find_step
from fecloth.nonlinear.statistics import Counts

STALLED = 0.25  # of the residual left after an iteration: it may have met round-off, if
STANDING = 1e-7  # extents of the cloth is the longest way that a node moved in it
TINY = 1e-6  # extents: on shorter steps round-off hides the change of the potential
NO_FORCE = 1e-6  # of the forces: where more of them is round-off, it moves no node of its own
LONGER = 2.0  # times the last way: the longest of a solve cut short, after a step of full length
ROUGH = 0.1  # relative residual of solves with a matrix that is not the exact one, with contact
CLAMPED = 4  # iterations of a step that try clamped tangents before they add mass
EXPLORED = 12  # whole steps within which the potential must fall below the end of a search
SLOW = 0.5  # of the residual left after a whole step with a definite matrix: it is slow
FEW = 20  # iterations; a smaller limit is the cause of a failure
PATIENCE, REFINED = 3, 30  # slow steps in a row before `refine`, and its most iterations
ROUND_OFF = 8.0  # times the change of the residual when the last digits of all numbers change


class Progress(NamedTuple):
    """One iteration: its number from 1, where it led, with which remedy, and α of its step."""

    number: int
    point: Point
    remedy: Remedy
    length: float


def iterate(
    equation: Equation,
    context: SolverContext,
    y: np.ndarray,
    least: int = 0,
    report: Callable[[Progress], None] = lambda progress: None,
    instead: np.ndarray | None = None,
    left: ErrorLeft | None = None,
) -> tuple[np.ndarray, Counts]:
    """Iterate from y until ‖R‖ ≤ tolerance × scale, and at least `least` times.

    With `left` the iteration ends also where the error left is small against the error in time.

    If the forces at y are not finite, the iteration starts from `instead`. Where it cannot go
    on, or takes too long, the error is `Equation.failure`.

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
    work = _Work(equation, context, left)
    most = context.options.max_iterations
    point = work.at(y, 0.0)
    if instead is not None and not np.isfinite(point.norm):
        point = work.at(instead, 0.0)
    least_norm = point.norm
    remedies = work.remedies
    ask, length = least == 0, 1.0  # whether to compare with round-off; α of the last step
    for number in range(most + 1):
        if number >= least and point.norm <= work.goal(point) and not work.left.is_needed:
            return point.y, work.counts(number, point)
        if work.left.is_small or point.norm == 0:
            return point.y, work.counts(number, point)
        if ask and point.norm <= (floor := ROUND_OFF * equation.round_off(point.y)):
            return point.y, work.counts(number, point, floor)
        if number == most or length == 0.0:
            break
        before, (point, length) = point, work.advance(point, least_norm)
        work.correct(before, point, length)
        least_norm = min(least_norm, point.norm)
        ask = work.stands(before, point) or length == 0.0 or number + 1 == most
        ask = ask or work.left.stands
        if length > 0.0:
            report(Progress(number + 1, point, remedies.order[remedies.last], length))
    missed = f"Newton did not converge in {amount(most, 'iteration')}"
    if most < FEW:
        missed += f", as max_iterations = {most} allows no more"
    reason = work.reason if length == 0.0 else missed
    raise equation.failure(reason, point, work.relative(point))


class RemedySearch:
    """Which remedies an iteration tries, after the remedy that the iteration before it took."""

    def __init__(self, remedies: Remedies):
        self.order, self.next, self.clamped = remedies  # `next`: where the first remedy fails
        self.last = 0  # number of the remedy that was taken before
        self.clamps = 0  # iterations that took the remedy `clamped`

    def to_try(self) -> Iterator[tuple[int, Remedy]]:
        """Numbers and remedies in order.

        After the first remedy, and after one that clamps, the first is tried again, then in the
        first CLAMPED such iterations `clamped`, and then the remedies from `next` on. After any
        other, the remedies from the next weaker one on are tried.
        """
        numbers = list(range(len(self.order)))
        if self.last and not self.order[self.last].definite:
            tried = numbers[self.last - 1 :]
        else:
            if self.clamped and self.clamps < CLAMPED:
                second = [self.clamped]
            else:
                second = []
            tried = [0, *second, *numbers[self.next :]]
        return ((number, self.order[number]) for number in tried)

    def take(self, number: int) -> None:
        """Record the remedy of an iteration; where the first one fails, go on one before it."""
        self.last = number
        if number == self.clamped:
            self.clamps += 1
        elif number:
            self.next = max(number - 1, 1)


class _Work:
    """The matrix, the solver and the counters of one call of `iterate`."""

    def __init__(self, equation: Equation, context: SolverContext, left: ErrorLeft | None = None):
        self.equation = equation
        self.context = context
        self.system = equation.system
        self.linear_solver, self.J = context.matrix_solver()
        self.extent = float(np.ptp(self.system.cloth.X, axis=0).max())
        self.linear = self.modified = self.factorisations = self.reused_solves = 0
        self.seconds = {"assemble": 0.0, "factor": 0.0, "solve": 0.0}
        self.reason = ""  # why the last attempt failed
        self.left = left or ErrorLeft()
        self.remedies = RemedySearch(equation.remedies)
        self.moves = False  # whether the last iteration moved the cloth
        self.pause = self.waited = 0  # iterations without `explore` after steps in vain
        self.longest = 0.0  # the longest way [m] of a node in the next step that was cut short
        self.slow_steps = 0  # in a row
        self.cut_short = False  # whether conjugate gradients stopped before the last direction

    def at(self, y: np.ndarray, scale: float) -> Point:
        R, scale = self.equation.residual(y, scale)
        return Point(y, R, self.system.sums.norm(R), scale)

    def relative(self, point: Point) -> float:
        if point.scale:
            return float(point.norm / point.scale)
        return 0.0

    def goal(self, point: Point) -> float:
        return (self.left.goal or self.context.options.residual) * point.scale

    def correct(self, before: Point, point: Point, length: float) -> None:
        """Record an iteration for the estimate of the error left."""
        last = self.remedies.last
        held_back = self.remedies.order[last].shift or self.cut_short
        if self.equation.takes_short_solves:
            held_back = held_back or last  # clamped tangents too, of which there may be many
        whole = length == 1.0 and not held_back
        way = self.equation.wx * float(abs(point.y - before.y).max())
        self.longest = way * (LONGER if length >= 1.0 else 1.0)
        may = bool(self.equation.explores and self.equation.potential)
        slow = self.remedies.order[last].shift > 0.0 and point.norm > SLOW * before.norm
        if may and slow and length >= 1.0:
            self.slow_steps = self.slow_steps + 1
        else:
            self.slow_steps = 0
        self.left.correct(self.system, point.y - before.y, whole)
        self.left.move(point.y, point.norm, point.scale)

    def stands(self, before: Point, point: Point) -> bool:
        """Whether an iteration hardly moved the cloth, and hardly changed the residual."""
        way = self.equation.wx * float(abs(point.y - before.y).max())
        self.moves = way > STANDING * self.extent
        stalled = max(STALLED * before.norm, self.goal(point)) < point.norm
        return stalled and not self.moves

    def counts(self, iterations: int, point: Point, floor: float = 0.0) -> Counts:
        """The counts at the end; `floor` is the round-off of the residual where it governs."""
        self.context.factor_reuse.end_step(self.reused_solves, self.linear_solver)
        left = self.left
        met = self.goal(point) >= point.norm
        by_estimate = left.is_small and not met
        # Round-off does no harm where the forces are little more, and moved no node.
        harmless = floor >= point.scale or (floor >= NO_FORCE * point.scale and not self.moves)
        return Counts(
            estimated=int(by_estimate),
            newton_error=left.error if by_estimate else 0.0,
            step_error=left.in_time if by_estimate else 0.0,
            newton=iterations,
            linear=self.linear,
            modified=self.modified,
            residual=self.relative(point) if point.scale > floor else 0.0,
            seconds=self.seconds,
            factorisations=self.factorisations,
            limited=int(not (met or by_estimate or harmless)),
        )

    def advance(self, point: Point, least_norm: float) -> tuple[Point, float]:
        """Return the next point, and α of its step; α = 0 for failure."""
        if not np.isfinite(point.norm):
            self.reason = "the forces are not finite"
            return point, 0.0
        remedies = self.remedies
        weaker = max(self.remedies.last - 1, 0)
        if there := self.advance_with_old_factor(point, remedies.order[weaker]):
            remedies.take(weaker)
            return there, 1.0
        for number, remedy in remedies.to_try():
            try:
                step = self.direction(point, remedy)
            except SolveFailed as failure:  # IndefiniteMatrix, or singular within round-off
                self.reason = str(failure)
                continue
            if improved := self.search(point, step, least_norm):
                remedies.take(number)
                if number == 0:
                    return self.explore(point, step, improved)
                return improved
            self.reason = "no step along Newton's direction is an improvement"
        return point, 0.0

    def search(self, point: Point, step: np.ndarray, least_norm: float):
        """Return the `Point` of an improvement along the step, and α; None without one."""
        way = self.equation.wx * float(abs(step).max()) or 1.0
        longest = min(self.equation.longest / way, self.equation.largest_step(point.y, step))
        at = partial(self.at, scale=point.scale)
        enough = max(self.goal(point), 0.5 * least_norm)
        rules = enough, self.equation.potential, longest, TINY * self.extent / way
        return find_step(self.system.sums, at, point, step, *rules)

    def explore(self, point: Point, step: np.ndarray, searched: tuple[Point, float]):
        """Return the end of a few whole Newton steps where that is lower than `searched`.

        A sheet that is stiff in its plane stretches where a step turns it, so that a line search
        allows only short steps. The next steps take this stretch back (the watchdog technique of
        Chamberlain et al. 1982, Math. Programming Study 16). After steps in vain the search
        alone goes on for 1, 2, 4, … iterations.
        """
        potential = self.equation.potential
        alpha = searched[1]
        if alpha >= 1.0 or not potential or not self.equation.explores:
            return searched
        if self.pause > 0:
            self.pause -= 1
            return searched
        goal, (first, *_) = potential(searched[0].y), self.remedies.order
        for number in range(EXPLORED):
            if number:
                try:
                    step = self.direction(point, first)
                except SolveFailed:
                    break
            way = self.equation.wx * float(abs(step).max())
            point = self.at(point.y + min(1.0, self.equation.longest / way) * step, point.scale)
            if not np.isfinite(point.norm):
                break
            if potential(point.y) <= goal:
                self.waited = 0
                return point, 1.0
        self.pause = self.waited = 2 * self.waited or 1
        return searched

    def advance_with_old_factor(self, point: Point, remedy: Remedy) -> Point | None:
        """Return the point after a whole step with an old factor; None if R falls too little."""
        reuse = self.context.factor_reuse
        key = self.equation.key(remedy)
        may_reuse = self.context.options.reuse and point.norm > 0
        if not (may_reuse and reuse.is_usable(key, self.linear_solver)):
            return None
        try:
            step = self.solve_linear(point)
        except SolveFailed:  # a factor too poor for refinement
            reuse.drop()
            return None
        self.reused_solves = self.reused_solves + 1
        self.cut_short = False
        if self.equation.largest_step(point.y, step) < 1.0:  # it leads into an obstacle
            return None
        there = self.at(point.y + step, point.scale)
        to_go = self.to_go(point, there)
        reuse.record_iteration(there.norm / point.norm, to_go, self.linear_solver)
        most = point.norm * (0.5 if self.equation.potential else 1.0)  # else Φ might rise
        return there if there.norm < most else None

    def to_go(self, before: Point, point: Point) -> float:
        """The goal over the residual, or the allowed error over that left if it is nearer."""
        if not point.norm:
            return 1.0
        length = self.left.measure(self.system, point.y - before.y)
        to_go = self.left.to_go(length * point.norm / before.norm)
        return max(self.goal(point) / point.norm, to_go)

    def direction(self, point: Point, remedy: Remedy) -> np.ndarray:
        """s = −J⁻¹ R with a remedy, or what conjugate gradients had of it, if the equation allows.

        Where they find that J is not definite, their iterate is a direction of descent,
        shorter than s (Nocedal and Wright 2006, algorithm 7.1). The first CLAMPED such
        iterations of a step take clamped tangents instead: these lead farther there.
        """
        begin = time.perf_counter()
        reuse = self.context.factor_reuse
        reuse.key = None  # from here on the matrix is another one, also if this fails
        self.equation.assemble(point.y, remedy, self.J)
        self.modified += remedy.definite or remedy.shift > 0
        self.factorisations += 1
        self.seconds["assemble"] += time.perf_counter() - begin
        self.linear_solver.prepare(self.equation.couple(point.y, remedy, self.J))
        self.cut_short = False
        try:
            rough = self.equation.takes_short_solves and remedy != self.remedies.order[0]
            step = self.solve_linear(point, ROUGH if rough else 0.0, new=True)
        except IndefiniteMatrix as failure:
            may = self.equation.takes_short_solves and self.remedies.clamps >= CLAMPED
            if failure.so_far is None or not may:
                raise
            self.cut_short = True
            return self.shorten(self.system.constraints.project(failure.so_far))
        reuse.record_factor(self.equation.key(remedy), self.linear_solver)
        if remedy.shift and self.slow_steps >= PATIENCE:
            return self.refine(point, step)
        return step

    def refine(self, point: Point, step: np.ndarray) -> np.ndarray:
        """The step of the exact matrix, by conjugate gradients with the factor that made `step`.

        A direction without positive curvature ends them and is the result (Nocedal and Wright
        2006, algorithm 7.1). With the definite matrix alone wrinkled sheets converge slowly.
        """
        first = self.remedies.order[0]
        equation = self.equation
        K = BlockMatrix.zeros(self.J.pattern, self.system.team)
        equation.assemble(point.y, first, K)
        K = equation.couple(point.y, first, K)
        updates = equation.updates(point.y)
        dot = self.system.sums.dot
        project = self.system.constraints.project
        s = np.zeros_like(step)
        r = -point.R
        z = step
        p = step
        rz = dot(r, z)
        for _ in range(REFINED):
            q = project(K @ p + sum(c * dot(u, p) * u for c, u in updates))
            pq = dot(p, q)
            if pq <= 0:
                return p
            s = s + rz / pq * p
            r = r - rz / pq * q
            if self.system.sums.norm(r) <= ROUGH * point.norm:
                break
            before, (solved, _) = rz, solve_updated(self.linear_solver, updates, r, ROUGH)
            z = project(solved)
            rz = dot(r, z)
            p = z + rz / before * p
        return s

    def shorten(self, step: np.ndarray) -> np.ndarray:
        """The step, or the part of it that moves no node farther than `longest`."""
        way = self.equation.wx * float(abs(step).max())
        if self.longest and way:
            return step * min(1.0, self.longest / way)
        return step

    def solve_linear(self, point: Point, least: float = 0.0, new: bool = False) -> np.ndarray:
        """−J⁻¹ R for the prepared J, to the option `forcing` or to `least`, if that is more."""
        goal = 0.5 * self.goal(point) / point.norm
        forcing = max(self.context.options.forcing, goal, least)
        updates = self.equation.updates(point.y)
        step, infos = solve_updated(self.linear_solver, updates, -point.R, min(0.5, forcing))
        self.linear += sum(info.iterations for info in infos)
        self.seconds["factor"] += infos[0].seconds_factor if new else 0.0
        self.seconds["solve"] += sum(info.seconds_solve for info in infos)
        return self.system.constraints.project(step)
