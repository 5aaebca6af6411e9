"""Derivatives of an equilibrium by a parameter, by the implicit function theorem."""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.linalg import select
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.increments import LoadIncrement, SolvedIncrement
from fecloth.nonlinear.linearised import Map, correct, inverse
from fecloth.nonlinear.remedies import Remedy
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import shift

EXACT = Remedy(0.0, False)
ROUND_OFF = 1e-15  # of positions


class DerivedIncrement(NamedTuple):
    """The derivatives at the end of an increment, and states and systems at p + ε and p − ε."""

    end: Along
    states: tuple[State, State]
    over: tuple[System, System]


@dataclass(frozen=True, eq=False)
class StaticTangent:
    """K at an equilibrium, with its factor."""

    solve: Map
    known: dict[str, float] = field(default_factory=dict)  # contractions, see `correct`

    @classmethod
    def at(cls, solved: SolvedIncrement) -> Self:
        """Factorise K; raise `SolveFailed` where it is singular."""
        increment, x = solved
        lags = any(term.lags for term in increment.system.bound)
        equation = increment.equation(x if lags else None)
        system = equation.system
        linear, J, _ = system.linear_solver("direct", system.symmetric)
        equation.assemble(x, EXACT, J)
        coupled = equation.couple(x, EXACT, J)
        try:
            linear.prepare(coupled)
        except IndefiniteMatrix:  # of an unstable equilibrium
            linear = select.direct(symmetric=False)
            linear.prepare(coupled)
        return cls(inverse(linear, equation.updates(x)))


def derive_increment(
    solved: SolvedIncrement,
    along: Along,
    sides: Sides,
    tangent: StaticTangent,
    tolerance: float = 1e-6,
) -> DerivedIncrement:
    """The derivatives at the end of an increment of the loads, from the derivatives at its begin.

    With f(x; p) the forces, the derivative δx of the free directions satisfies

        [f(x + ε δx; p + ε) − f(x − ε δx; p − ε)]/(2ε) = 0,

    where held directions are where the pins have them at p ± ε. Corrections by K⁻¹ solve it.
    The normal forces of friction are those at x ± ε δx. It raises `NoDerivative` where K is
    singular.
    """
    increment, x = solved
    ends = [_Side.of(increment, along, *side) for side in sides.signed]
    plus, minus = ends

    def residual(dx: np.ndarray) -> np.ndarray:
        r = plus.residual(x + sides.size * dx) - minus.residual(x - sides.size * dx)
        return r / (2 * sides.size)

    def size_of(dx: np.ndarray) -> float:
        return float(np.linalg.norm(dx)) or 1.0

    floor = ROUND_OFF * float(np.linalg.norm(x)) / sides.size
    solvers = {"exact": lambda: tangent.solve}
    first = np.zeros_like(x)
    corrected = correct(residual, first, solvers, tangent.known, size_of, tolerance, floor)
    dx = corrected.y
    for name, contraction in corrected.contractions.items():
        tangent.known[name] = max(tangent.known.get(name, 0.0), contraction)
    states = []
    overs = []
    histories = []
    for side, size in zip(ends, (sides.size, -sides.size), strict=True):
        at = side.place(x + size * dx)
        over = side.equation(at).system
        states.append(State(increment.start.t, at, np.zeros_like(at)))
        overs.append(over)
        histories.append(over.commit(states[-1], side.increment.history))
    pairs = (None, None), (histories[0], histories[1])
    end = Along.between(states[0], states[1], 2 * sides.size, *pairs)
    return DerivedIncrement(end, (states[0], states[1]), (overs[0], overs[1]))


@dataclass(frozen=True, eq=False)
class _Side:
    """An increment at p + ε or p − ε, and where its pins are at its end (n, 3) [m]."""

    increment: LoadIncrement
    target: np.ndarray
    fixed: Any  # the equation, where it does not depend on the place

    @classmethod
    def of(cls, increment: LoadIncrement, along: Along, system: System, size: float) -> Self:
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

    def equation(self, x: np.ndarray) -> Any:
        return self.fixed or self.increment.equation(x)

    def residual(self, x: np.ndarray) -> np.ndarray:
        at = self.place(x)
        return self.equation(at).residual(at, 0.0)[0]
