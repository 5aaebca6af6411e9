"""Derivatives of a step by a parameter of the problem, by the implicit function theorem."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from fecloth.integrators.linearly_implicit_euler import LinearOpening
from fecloth.integrators.step import Solution, Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.context import PRICES, SolverContext
from fecloth.nonlinear.linearised import ASSUMED_CONTRACTION, Map, NoDerivative, correct, inverse
from fecloth.system.system import System
from fecloth.terms.records import shift

ROUND_OFF = 1e-13  # of the unknown, in the solution of a step
LEAST = 1e-2  # of the change of the begin: an error of the unknown is relative to no less
SAFETY = 2.0  # on a contraction that was measured with another parameter
AGAIN = 8  # steps after which the factor of the run is tried again


class DerivedStep(NamedTuple):
    """The derivatives at the end of a step, and the steps at p + ε and p − ε."""

    end: Along
    steps: tuple[Step, Step]


@dataclass(eq=False)
class StepTangents:
    """What solves J y = b of the steps of a run: the factor that the run has, or an exact one.

    An exact one, of the tangent at the solved unknown, is made for all parameters of a step
    together, where it saves them more solves than it costs, or corrections with the other one
    shrink slowly. What is known of both is kept from step to step.
    """

    system: System
    symmetric: bool
    context: SolverContext  # of the run: its linear solver holds the matrix of the last iteration
    count: int  # number of parameters
    tolerance: float  # relative error of the unknown's derivative
    own: Any = None  # (linear solver, matrix) of exact tangents
    solution: Solution | None = None  # the last one
    exact: Solution | None = None  # for which `own` is prepared
    number: int = 0  # of the step
    # Contractions of the corrections, see `correct`: of this step, and of the last ones.
    known: dict[str, float] = field(default_factory=dict)
    usual: dict[str, float] = field(default_factory=dict)

    def solvers(self, solution: Solution, has_matrix: bool) -> dict[str, Callable[[], Map]]:
        """The solvers to try for this step, in their order; whether the run has a matrix of it."""
        if self.solution is not solution:
            self.solution, self.number = solution, self.number + 1
            self.usual = {**self.usual, **self.known}
            self.known = {}
        both = {"held": lambda: self._held(solution), "exact": lambda: self._exact(solution)}
        held, exact = (self._solves(self.usual.get(name, ASSUMED_CONTRACTION)) for name in both)
        price = PRICES.get(self.context.matrix_solver()[0].name, math.inf)
        saves = self.count * (held - exact) > price and self.number % AGAIN
        if self.exact is solution or saves or not has_matrix:
            del both["held"]
        return both

    def _solves(self, contraction: float) -> float:
        return max(1.0, math.log(self.tolerance) / math.log(contraction))

    def _held(self, solution: Solution) -> Map:
        return _solve_with(self.context.matrix_solver()[0], solution)

    def _exact(self, solution: Solution) -> Map:
        self.own = self.own or self.system.linear_solver("direct", self.symmetric)[:2]
        linear, matrix = self.own
        if self.exact is not solution:
            linear.prepare(solution.opening.tangent(solution.q, matrix))
            self.exact = solution
        return _solve_with(linear, solution)


def _solve_with(linear: Any, solution: Solution) -> Map:
    equation = getattr(solution.opening, "equation", None)
    return inverse(linear, equation.updates(solution.q) if equation else [])


def derive_step(
    step: Step, along: Along, sides: Sides, tangents: StepTangents | None
) -> DerivedStep:
    """The derivatives at the end of a step, from the derivatives at its begin.

    The step is opened at p + ε and p − ε, from the begin of the step there. With R(q; p) the
    residual, the derivative δq of the unknown satisfies

        [R(q + ε δq; p + ε) − R(q − ε δq; p − ε)]/(2ε) = 0,

    which corrections δq ← δq − J⁻¹ (left side) solve. So J need not be exact: the factor of
    the run serves. Both steps are then closed at q ± ε δq, and their difference is the result.
    An explicit step has no equation: q is the acceleration of each side.

    Explicit methods have no `tangents`. It raises `NoDerivative` for a method without `open` and
    `close`, where what terms remember has another form at both sides, as where a contact begins,
    and if the equation cannot be solved.
    """
    solution = step.solution
    if solution is None:
        raise NoDerivative("the method of this step has no open and close")
    openings = [_open(solution, along, system, size) for system, size in sides.signed]
    if tangents is None:
        unknowns = [opening.acceleration() for opening in openings]
    else:
        dq = _derive_unknown(step, solution, openings, along, sides.size, tangents)
        unknowns = [solution.q + size * dq for _, size in sides.signed]
    close = solution.method.close
    plus, minus = (close(*pair) for pair in zip(openings, unknowns, strict=True))
    records = (plus.memory, minus.memory), (plus.history, minus.history)
    end = Along.between(plus.state, minus.state, 2 * sides.size, *records)
    return DerivedStep(end, (plus, minus))


def _open(solution: Solution, along: Along, system: System, size: float) -> Any:
    """The step at p + size, open."""
    opened = solution.opening
    memory = shift(solution.memory, along.memory, size)
    history = shift(opened.history, along.history, size)
    begin = along.shift(opened.begin, size)
    opening = solution.method.open(system, begin, opened.dt, memory, history)
    if isinstance(opened, LinearOpening):  # its equation has the tangents
        return replace(opening, definite=opened.definite)
    return opening


def _derive_unknown(
    step: Step,
    solution: Solution,
    openings: list[Any],
    along: Along,
    size: float,
    tangents: StepTangents,
) -> np.ndarray:
    """δq (n, 3)."""
    plus, minus = openings
    opening = solution.opening
    q = solution.q
    norm = np.linalg.norm

    def residual(dq: np.ndarray) -> np.ndarray:
        r: np.ndarray = plus.residual(q + size * dq) - minus.residual(q - size * dq)
        return r / (2 * size)

    guess = np.zeros_like(q)
    if plus.guess is not None:
        guess = opening.system.constraints.project((plus.guess - minus.guess) / (2 * size))
    stage = getattr(opening, "stage", None)
    way = stage.w_end if stage else opening.dt  # ∂x/∂q at the end of the step
    least = LEAST * float(norm(along.x) + opening.dt * norm(along.v)) / way
    floor = ROUND_OFF * float(norm(q)) / size

    def size_of(dq: np.ndarray) -> float:
        return float(max(norm(dq), least))

    solvers = tangents.solvers(solution, step.counts.newton > 0)
    known = tangents.known
    allowed = size_of, tangents.tolerance, floor
    corrected = correct(residual, guess, solvers, known, *allowed)
    for name, contraction in corrected.contractions.items():
        known[name] = max(known.get(name, 0.0), SAFETY * contraction)
    return corrected.y
