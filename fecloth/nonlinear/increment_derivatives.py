"""Derivatives of an equilibrium by a parameter, by the implicit function theorem."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.linalg import select
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.increments import LoadIncrement, SolvedIncrement
from fecloth.nonlinear.linear_solver import make_linear_solver
from fecloth.nonlinear.linearised import Map, correct, inverse
from fecloth.nonlinear.remedies import Remedy
from fecloth.nonlinear.static_equation import StaticEquation
from fecloth.system.reuse import reusing
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.records import shift
from fecloth.terms.traits import parameters_of

EXACT = Remedy(0.0, definite=False)
ROUND_OFF_OF_POSITIONS = 1e-15  # relative: a few units of the last digit


class DerivedIncrement(NamedTuple):
    """The derivatives at the end of an increment.

    Attributes
    ----------
    end
        The derivatives of the state and of what the terms remember.
    states
        The states at the end for p + ε and for p − ε.
    over
        The systems over the increment for p + ε and for p − ε.
    """

    end: Along
    states: tuple[State, State]
    over: tuple[System, System]


@dataclass(frozen=True, eq=False)
class StaticTangent:
    """K at an equilibrium, with its factor.

    Attributes
    ----------
    solve
        b ↦ K⁻¹ b.
    known
        By what factor corrections shrink, see `linearised.correct`.
    """

    solve: Map
    known: dict[str, float] = field(default_factory=dict)

    @classmethod
    def at(cls, solved: SolvedIncrement) -> Self:
        """Assemble and factorise the exact K at the end of a solved increment.

        Raise `SolveFailed` where it is singular.
        """
        increment, x = solved
        increment = replace(increment, system=with_exact_tangents(increment.system))
        # Friction lags: its equation needs the place of its normal forces.
        lags = any(term.lags for term in increment.system.bound)
        equation = increment.equation(x if lags else None)
        system = equation.system
        linear, J, _ = make_linear_solver(system, "direct", system.symmetric)
        equation.assemble(x, EXACT, J)
        coupled = equation.couple(x, EXACT, J)
        try:
            linear.prepare(coupled)
        except IndefiniteMatrix:  # an unstable equilibrium: LU in place of Cholesky
            linear = select.direct(symmetric=False)
            linear.prepare(coupled)
        return cls(inverse(linear, equation.updates(x)))


def with_exact_tangents(system: System) -> System:
    """The system whose terms have their exact tangents; itself if it has no symmetric ones.

    Newton's iteration does with a symmetric tangent; a derivative would need many corrections.
    """
    options = [parameters_of(term).get("tangent") for term in system.terms]
    if "symmetric" not in options:
        return system
    terms = [
        replace(term, tangent="exact") if option == "symmetric" else term
        for term, option in zip(system.terms, options, strict=True)
    ]
    with reusing(system):
        return system.replace(terms=terms)


def derive_increment(
    solved: SolvedIncrement,
    along: Along,
    sides: Sides,
    tangent: StaticTangent,
    tolerance: float = 1e-6,
) -> DerivedIncrement:
    """The derivatives at the end of an increment of the loads, from those at its begin.

    With f(x; p) the forces, the derivative δx of the free directions satisfies

        [f(x + ε δx; p + ε) − f(x − ε δx; p − ε)]/(2ε) = 0,

    where held directions are where the pins have them at p ± ε. Corrections by K⁻¹ solve it.
    Friction has the normal forces at x ± ε δx. Raises `NoDerivative` where no corrections
    converge.

    Parameters
    ----------
    solved
        The increment, and the equilibrium at its end for p.
    along
        The derivatives at the begin of the increment.
    sides
        The systems at p + ε and p − ε, and ε.
    tangent
        K⁻¹ at the end. The contractions that are measured here are added to its `known`.
    tolerance
        The relative error of δx.
    """
    increment, x = solved
    epsilon = sides.size
    plus_side = _Side.of(increment, along, sides.plus, epsilon)
    minus_side = _Side.of(increment, along, sides.minus, -epsilon)

    def residual(dx: np.ndarray) -> np.ndarray:
        force = _difference(plus_side, minus_side, x + epsilon * dx, x - epsilon * dx)
        return -force / (2 * epsilon)

    def size_of(dx: np.ndarray) -> float:
        return float(np.linalg.norm(dx)) or 1.0

    # The last digits of x ± ε δx change δx by this much.
    floor = ROUND_OFF_OF_POSITIONS * float(np.linalg.norm(x)) / epsilon
    corrected = correct(
        residual,
        y=np.zeros_like(x),
        solvers={"exact": lambda: tangent.solve},
        known=tangent.known,
        size_of=size_of,
        tolerance=tolerance,
        floor=floor,
    )
    dx = corrected.y
    for name, contraction in corrected.contractions.items():
        tangent.known[name] = max(tangent.known.get(name, 0.0), contraction)
    state_plus, over_plus, history_plus = plus_side.end(x + epsilon * dx)
    state_minus, over_minus, history_minus = minus_side.end(x - epsilon * dx)
    no_memory = (None, None)  # a static search keeps none from step to step
    histories = (history_plus, history_minus)
    end = Along.between(state_plus, state_minus, 2 * epsilon, no_memory, histories)
    return DerivedIncrement(end, (state_plus, state_minus), (over_plus, over_minus))


@dataclass(frozen=True, eq=False)
class _Side:
    """An increment at p + ε or p − ε.

    Attributes
    ----------
    increment
        The increment there.
    target
        (n, 3) where its pins are at its end [m].
    fixed
        Its equation, where this does not depend on the place; else None.
    """

    increment: LoadIncrement
    target: np.ndarray
    fixed: StaticEquation | None

    @classmethod
    def of(cls, increment: LoadIncrement, along: Along, system: System, size: float) -> Self:
        """The increment for the `system` at p + `size`, begun where `along` leads by that."""
        start = along.shift(increment.start, size)
        history = shift(increment.history, along.history, size)
        at = replace(increment, system=system, start=start, history=history)
        span = increment.end - increment.begin
        target, _ = system.constraints.target(increment.begin, span, start.x)
        lags = any(term.lags for term in system.bound)
        return cls(at, target, None if lags else at.equation())

    def place(self, x: np.ndarray) -> np.ndarray:
        """Positions (n, 3) with held directions at the target."""
        return self.increment.system.constraints.hold(x, self.target)

    def equation(self, x: np.ndarray) -> StaticEquation:
        """The equation of the end; friction has the normal forces at x (n, 3)."""
        return self.fixed or self.increment.equation(x)

    def end(self, x: np.ndarray) -> tuple[State, System, History | None]:
        """The state at x (n, 3), the system over the increment, and what its terms remember."""
        at = self.place(x)
        state = State(self.increment.start.t, at, np.zeros_like(at))
        over = self.equation(at).system
        return state, over, over.commit(state, self.increment.history)


def _difference(plus: _Side, minus: _Side, x_plus: np.ndarray, x_minus: np.ndarray) -> np.ndarray:
    """The forces (n, 3) of the free directions at p + ε and x₊ less those at p − ε and x₋.

    A term that both sides have in common cancels where both positions are the same, so that it
    is not evaluated there.
    """
    at_plus = plus.place(x_plus)
    at_minus = minus.place(x_minus)
    are_same_places = np.array_equal(at_plus, at_minus)
    force = np.zeros_like(x_plus)
    pairs = zip(plus.equation(at_plus).terms(), minus.equation(at_minus).terms(), strict=True)
    for (term_plus, factor, t), (term_minus, _, _) in pairs:
        if not (are_same_places and term_plus is term_minus):
            force += factor * _force(term_plus, at_plus, t)
            force -= factor * _force(term_minus, at_minus, t)
    return plus.increment.system.constraints.reduce(force)


def _force(term: BoundTerm, x: np.ndarray, t: float) -> np.ndarray:
    """The force (n, 3) of a term at rest at x."""
    force = np.zeros_like(x)
    term.add_force(x, np.zeros_like(x), t, force)
    return force
