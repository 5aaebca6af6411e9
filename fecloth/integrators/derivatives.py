"""Derivatives of a step by a parameter of the problem, by the implicit function theorem."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.integrators.linearly_implicit_euler import LinearOpening
from fecloth.integrators.step import Solution, Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.context import PRICES, SolverContext
from fecloth.nonlinear.linearised import ASSUMED_CONTRACTION, Map, NoDerivative, correct, inverse
from fecloth.system.system import System
from fecloth.terms.records import shift

# Round-off of the unknown in the solution of a step, relative to the unknown: about a thousand
# times the round-off of a single operation.
UNKNOWN_ROUND_OFF = 1e-13
# The error of the unknown's derivative is relative to no less than this share of the derivatives
# at the begin of the step: where the unknown hardly changes, its error need not be smaller.
SHARE_OF_BEGIN = 1e-2
# Factor on a contraction that was measured with another parameter, whose corrections may shrink
# more slowly.
CONTRACTION_SAFETY = 2.0
# After this number of steps the factor of the run is tried again, if the exact one was better.
STEPS_BETWEEN_TRIALS = 8


class DerivedStep(NamedTuple):
    """The result of `derive_step`.

    Attributes
    ----------
    end
        The derivatives at the end of the step.
    steps
        The steps at p + ε and at p − ε.
    """

    end: Along
    steps: tuple[Step, Step]


@dataclass(eq=False)
class StepTangents:
    """Solvers of J y = b for the steps of a run, by the factor of the run or by an exact one.

    The exact factor is of the tangent at the solved unknown. It is made once for all parameters
    of a step, where it saves them more solves than it costs, or where corrections with the
    factor of the run shrink slowly. The contractions of both are kept from step to step.

    Attributes
    ----------
    system
        The system of the run.
    symmetric
        Whether the tangents are symmetric.
    context
        The solver of the run; its linear solver holds the matrix of the last iteration.
    count
        Number of parameters.
    tolerance
        Relative error of the unknown's derivative.
    own
        The linear solver and the matrix of exact tangents; None until they are needed.
    solution, exact
        The solution of the last step, and the solution for which `own` is prepared.
    number
        Number of steps so far.
    known, usual
        Contraction of the corrections by the name of the solver, see `correct`: in this step,
        and in the steps before.
    """

    system: System
    symmetric: bool
    context: SolverContext
    count: int
    tolerance: float
    own: Any = None
    solution: Solution | None = None
    exact: Solution | None = None
    number: int = 0
    known: dict[str, float] = field(default_factory=dict)
    usual: dict[str, float] = field(default_factory=dict)

    def solvers(self, solution: Solution, has_matrix: bool) -> dict[str, Callable[[], Map]]:
        """The solvers to try for this step, in their order: "held" is the factor of the run.

        `has_matrix` says whether the run has a matrix of this step.
        """
        if self.solution is not solution:
            self.solution = solution
            self.number += 1
            self.usual = {**self.usual, **self.known}
            self.known = {}
        held = partial(self._hold_factor, solution)
        exact = partial(self._make_exact, solution)
        saved = self.count * (self._solves_with("held") - self._solves_with("exact"))
        price = PRICES.get(self.context.matrix_solver()[0].name, math.inf)
        is_trial = self.number % STEPS_BETWEEN_TRIALS == 0
        is_better = saved > price and not is_trial
        if self.exact is solution or is_better or not has_matrix:
            return {"exact": exact}
        return {"held": held, "exact": exact}

    def _solves_with(self, name: str) -> float:
        """Number of solves for a parameter, as its corrections have shrunk before."""
        contraction = self.usual.get(name, ASSUMED_CONTRACTION)
        return max(1.0, math.log(self.tolerance) / math.log(contraction))

    def _hold_factor(self, solution: Solution) -> Map:
        """b ↦ J⁻¹ b with the factor that the run has."""
        return _solve_with(self.context.matrix_solver()[0], solution)

    def _make_exact(self, solution: Solution) -> Map:
        """b ↦ J⁻¹ b with a factor of the tangent at the solution."""
        self.own = self.own or self.system.linear_solver("direct", self.symmetric)[:2]
        linear, matrix = self.own
        if self.exact is not solution:
            linear.prepare(solution.opening.tangent(solution.q, matrix))
            self.exact = solution
        return _solve_with(linear, solution)


def _solve_with(linear: Any, solution: Solution) -> Map:
    """b ↦ J⁻¹ b with the matrix that `linear` has prepared, and the parts of J of low rank."""
    equation = getattr(solution.opening, "equation", None)
    updates = equation.updates(solution.q) if equation else []
    return inverse(linear, updates)


def derive_step(
    step: Step, along: Along, sides: Sides, tangents: StepTangents | None
) -> DerivedStep:
    """The derivatives at the end of a step, from the derivatives at its begin.

    The step is opened at p + ε and p − ε, from the begin of the step there. With R(q; p) the
    residual, the derivative δq of the unknown satisfies

        [R(q + ε δq; p + ε) − R(q − ε δq; p − ε)]/(2ε) = 0,

    which corrections δq ← δq − J⁻¹ (left side) solve. So J need not be exact: the factor of
    the run serves. Both steps are then closed at q ± ε δq, and their difference is the result.
    An explicit step has no equation, and no `tangents`: q is the acceleration of each side.

    Raises `NoDerivative` for a method without `open` and `close`; where the records of the terms
    have another form at p + ε than at p − ε, as where a contact begins; and if the equation
    cannot be solved.
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
    end = Along.between(
        plus.state,
        minus.state,
        2 * sides.size,
        (plus.memory, minus.memory),
        (plus.history, minus.history),
    )
    return DerivedStep(end, (plus, minus))


def _open(solution: Solution, along: Along, system: System, size: float) -> Any:
    """Open the step at p + size."""
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
    """The derivative δq (n, 3) of the unknown, see `derive_step`."""
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
    x_by_q = stage.w_end if stage else opening.dt  # ∂x/∂q at the end of the step
    moved = float(norm(along.x) + opening.dt * norm(along.v))
    smallest = SHARE_OF_BEGIN * moved / x_by_q

    def size_of(dq: np.ndarray) -> float:
        return float(max(norm(dq), smallest))

    solvers = tangents.solvers(solution, has_matrix=step.counts.newton > 0)
    known = tangents.known
    corrected = correct(
        residual,
        guess,
        solvers=solvers,
        known=known,
        size_of=size_of,
        tolerance=tangents.tolerance,
        floor=UNKNOWN_ROUND_OFF * float(norm(q)) / size,
    )
    for name, contraction in corrected.contractions.items():
        known[name] = max(known.get(name, 0.0), CONTRACTION_SAFETY * contraction)
    return corrected.y
