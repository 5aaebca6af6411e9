"""Derivatives by a parameter of all that a step, or an increment of the loads, begins with."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from fecloth.linalg.reductions import longest
from fecloth.nonlinear.linearised import NoDerivative
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import records


@dataclass(frozen=True, eq=False)
class Along:
    """Derivatives by p, which is a parameter over its width, so that x is in m and v in m/s.

    Attributes
    ----------
    x
        (n, 3) ∂x/∂p [m].
    v
        (n, 3) ∂v/∂p [m/s].
    memory
        Derivative of the memory of the method, as `records.slope` has it.
    history
        Derivative of the records of the terms, as `records.slope` has it.
    """

    x: np.ndarray
    v: np.ndarray
    memory: Any = None
    history: Any = None

    @classmethod
    def between(cls, plus: State, minus: State, width: float, *pairs: tuple[Any, Any]) -> Self:
        """Central differences of two states, and of pairs of memories and of histories."""
        try:
            slopes = [records.slope(*pair, width) for pair in pairs]
        except ValueError as error:
            reason = "what is remembered of the steps before changes its form"
            where = f"at t = {plus.t:.6g} s {reason}, as where a contact begins"
            raise NoDerivative(f"{where}: {error}") from None
        return cls((plus.x - minus.x) / width, (plus.v - minus.v) / width, *slopes)

    def shift(self, state: State, size: float) -> State:
        """The state at p + size."""
        return State(state.t, state.x + size * self.x, state.v + size * self.v)

    def longest(self, dt: float = 0.0) -> float:
        """The longest way of a node for a change of p by 1, also within a step dt [m]."""
        return max(longest(self.x), dt * longest(self.v))


class Sides(NamedTuple):
    """The systems at p + ε and p − ε, with ε = `size`."""

    plus: System
    minus: System
    size: float

    @property
    def signed(self) -> tuple[tuple[System, float], tuple[System, float]]:
        return (self.plus, self.size), (self.minus, -self.size)
