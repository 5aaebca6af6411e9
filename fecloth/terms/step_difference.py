"""A step as the terms see it that act over it, with the method's difference for rates."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np


class Increment(NamedTuple):
    """An increment of the loads in place of a step in time; `StepDifference.dt` is its size.

    Friction alone depends on speeds: its potential takes the way over the increment for them.
    """

    t: float  # at its end, of what moves with t
    # (n, 3) positions at its end [m] where friction has its normal forces; None: at its begin
    place: np.ndarray | None = None
    friction: float = 1.0  # part that is left of the moments of `BendingFriction`


@dataclass(frozen=True, eq=False)
class StepDifference:
    """The rate of a quantity y(x) over a step, ẏ = (y(x) − Σ cᵢ y(xᵢ))/h with Σ cᵢ = 1.

    A method makes one for each step and hands it to `System.over_step`. For y = x it is the
    method's own velocity, v = (x − Σ cᵢ xᵢ)/h.
    """

    start: np.ndarray  # (n, 3) positions x₀ at the begin of the step [m]
    dt: float  # size of the step [s]
    h: float  # [s]
    past: tuple[tuple[float, np.ndarray], ...]  # ((cᵢ, xᵢ), …) with xᵢ (n, 3) [m]
    # Whether x is the mean of both ends of the step, so that x₁ = 2x − x₀, and the energy is to
    # be conserved: −f(x) · (x₁ − x₀) = energy(x₁) − energy(x₀). Otherwise x is the end x₁.
    at_mean: bool = False
    # with `at_mean`: whether tangents must be symmetric, and may be inexact
    symmetric: bool = False
    t: float = 0.0  # time at the begin of the step [s]
    # The record that the term keeps, at the begin of the step; see `BoundTerm.start_history`.
    # None for a term that keeps no record, and where a system over a step is made without a
    # history: then the step is the first step.
    history: Any = None
    increment: Increment | None = None  # of the loads, in statics

    @property
    def end(self) -> float:
        """The time at the end of the step [s]."""
        if self.increment:
            return self.increment.t
        return self.t + self.dt

    @classmethod
    def between(cls, start: np.ndarray, dt: float, t: float) -> Self:
        """The mean rate over a step of `dt` [s] from x₀ (n, 3) at t: ẏ = (y(x) − y(x₀))/dt."""
        return cls(start, dt, dt, ((1.0, start),), t=t)
