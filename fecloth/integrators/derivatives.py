"""Derivatives of a step by a parameter of the problem, by the implicit function theorem."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.integrators.linearly_implicit_euler import LinearOpening
from fecloth.integrators.step import Solution, Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.nonlinear.linearised import Map, NoDerivative, correct, inverse
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
    """Solvers of J y = b for the steps of a run: by the factor of the run, or else an exact one.

    The exact factor is of the tangent at the solved unknown. It is made where corrections with
    the factor of the run do not shrink by half, once for all parameters of a step.

    Attributes
    ----------
    system
        The system of the run.
    symmetric
        Whether the tangents are symmetric.
    context
        The solver of the run; its linear solver holds the matrix of the last iteration.
    tolerance
        Relative error of the unknown's derivative.
    exact_solver
        The linear solver and the matrix of exact tangents; None until they are needed.
    solution, exact_solution
        The solution of the last step, and the solution for which `exact_solver` is prepared.
    contractions
        Contraction of the corrections in this step by the name of the solver, see `correct`.
    """

    system: System
    symmetric: bool
    context: SolverContext
    tolerance: float
    exact_solver: Any = None
    solution: Solution | None = None
    exact_solution: Solution | None = None
    contractions: dict[str, float] = field(default_factory=dict)

    def solvers(self, solution: Solution, has_matrix: bool) -> dict[str, Callable[[], Map]]:
        """Return functions that prepare a solver of J y = b for this step, by the solver's name.

        They are in the order in which to try them. "held" has the factor of the run, "exact" a
        factor of its own. `has_matrix` says whether the run has a matrix of this step. Once the
        exact factor of this step is made, it alone is returned. With a new solution a new step
        begins, of which no contractions are known.
        """
        if self.solution is not solution:
            self.solution = solution
            self.contractions = {}
        exact: dict[str, Callable[[], Map]] = {"exact": partial(self._make_exact, solution)}
        if self.exact_solution is solution or not has_matrix:
            return exact
        return {"held": partial(self._hold_factor, solution), **exact}

    def _hold_factor(self, solution: Solution) -> Map:
        """b ↦ J⁻¹ b with the factor that the run has."""
        return _solve_with(self.context.matrix_solver()[0], solution)

    def _make_exact(self, solution: Solution) -> Map:
        """b ↦ J⁻¹ b with a factor of the tangent at the solution, made once for a solution."""
        if self.exact_solver is None:
            self.exact_solver = make_linear_solver(self.system, "direct", self.symmetric)[:2]
        linear, matrix = self.exact_solver
        if self.exact_solution is not solution:
            linear.prepare(solution.opening.tangent(solution.q, matrix))
            self.exact_solution = solution
        return _solve_with(linear, solution)


def _solve_with(linear: Any, solution: Solution) -> Map:
    """b ↦ J⁻¹ b with the matrix that `linear` has prepared, and the parts of J of low rank."""
    equation = getattr(solution.opening, "equation", None)
    updates = equation.updates(solution.q) if equation else []
    return inverse(linear, updates)


def derive_step(
    step: Step, along: Along, sides: Sides, tangents: StepTangents | None
) -> DerivedStep:
    """Return the derivatives at the end of a step with respect to a parameter p.

    `along` are the derivatives at its begin; `sides` has ε and the systems at p + ε and p − ε.
    The step is opened at p + ε and at p − ε, each from the begin of the step there. With R(q; p)
    the residual, the derivative δq of the unknown satisfies

        [R(q + ε δq; p + ε) − R(q − ε δq; p − ε)]/(2ε) = 0,

    which corrections δq ← δq − J⁻¹ (left side) solve. So J need not be exact: the factor of
    the run serves. Both steps are then closed at q ± ε δq, and their difference is the result.
    An explicit step has no equation, and no `tangents`: q is the acceleration at p + ε and at
    p − ε. The contractions of the corrections are noted in `tangents`.

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
    step_plus, step_minus = (close(*pair) for pair in zip(openings, unknowns, strict=True))
    end = Along.between(
        step_plus.state,
        step_minus.state,
        2 * sides.size,
        (step_plus.memory, step_minus.memory),
        (step_plus.history, step_minus.history),
    )
    return DerivedStep(end, (step_plus, step_minus))


def _open(solution: Solution, along: Along, system: System, size: float) -> Any:
    """Open the solved step again at p + size, where the system is `system`.

    Its state, memory and history at the begin are moved by size times their derivatives `along`.
    """
    opened = solution.opening
    memory = shift(solution.memory, along.memory, size)
    history = shift(opened.history, along.history, size)
    begin = along.shift(opened.begin, size)
    opening = solution.method.open(system, begin, opened.dt, memory, history)
    if isinstance(opened, LinearOpening):  # clamped tangents are part of its equation
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
    """Return the derivative δq (n, 3) of the step's unknown q with respect to the parameter p.

    It is solved by corrections, see `derive_step`. `openings` are the step opened at p + ε and
    at p − ε with ε = `size`, and `along` are the derivatives at the begin of the step. The
    contractions of the corrections are noted in `tangents`. Raises `NoDerivative` if the
    equation cannot be solved.
    """
    opening_plus, opening_minus = openings
    q = solution.q

    follow = solution.opening.system.constraints.followers.follow

    def residual(dq: np.ndarray) -> np.ndarray:
        dq = follow(dq.copy())
        plus: np.ndarray = opening_plus.residual(q + size * dq)
        minus: np.ndarray = opening_minus.residual(q - size * dq)
        derivative: np.ndarray = (plus - minus) / (2 * size)
        return derivative

    guess = np.zeros_like(q)
    if opening_plus.guess is not None:  # the derivative of the first guess of q
        guess = (opening_plus.guess - opening_minus.guess) / (2 * size)
        guess = solution.opening.system.constraints.project(guess)
    smallest = _smallest_scale(solution.opening, along)

    def size_of(dq: np.ndarray) -> float:
        return max(float(np.linalg.norm(dq)), smallest)

    solvers = tangents.solvers(solution, has_matrix=step.counts.newton > 0)
    contractions = tangents.contractions
    corrected = correct(
        residual,
        guess,
        solvers=solvers,
        known=contractions,
        size_of=size_of,
        tolerance=tangents.tolerance,
        floor=UNKNOWN_ROUND_OFF * float(np.linalg.norm(q)) / size,
    )
    for name, contraction in corrected.contractions.items():
        with_safety = CONTRACTION_SAFETY * contraction
        contractions[name] = max(contractions.get(name, 0.0), with_safety)
    dq: np.ndarray = follow(corrected.y)
    return dq


def _smallest_scale(opening: Any, along: Along) -> float:
    """Return the least size to which the error of δq is relative, see `SHARE_OF_BEGIN`.

    It is the size of the δq that moves x at the end of the step by this share of the
    displacement which the derivatives `along` at the begin give alone.
    """
    stage = getattr(opening, "stage", None)
    x_by_q: float = stage.w_end if stage else opening.dt  # ∂x/∂q at the end of the step
    displacement = float(np.linalg.norm(along.x) + opening.dt * np.linalg.norm(along.v))
    return SHARE_OF_BEGIN * displacement / x_by_q
