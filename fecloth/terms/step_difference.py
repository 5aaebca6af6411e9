"""A step as the terms see it that act over it, with the method's difference for rates."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np


class Increment(NamedTuple):
    """An increment of the loads in place of a step in time; `StepDifference.dt` is its size.

    Attributes
    ----------
    t
        Time at its end, for all that moves with t.
    place
        Positions (n, 3) [m] at its end, for the normal forces of friction; None: at its begin.
    friction
        Part of the moments of `BendingFriction` that is left.
    """

    t: float
    place: np.ndarray | None = None
    friction: float = 1.0


@dataclass(frozen=True, eq=False)
class StepDifference:
    """The rate of a quantity y(x) over a step, ẏ = (y(x) − Σ cᵢ y(xᵢ))/h with Σ cᵢ = 1.

    A method makes one for each step and hands it to `System.over_step`. For y = x it is the
    method's own velocity, v = (x − Σ cᵢ xᵢ)/h.

    Attributes
    ----------
    start
        Positions x₀ (n, 3) at the begin of the step [m].
    dt
        Size of the step [s].
    h
        The h of the rate [s].
    past
        ((cᵢ, xᵢ), …) with positions xᵢ (n, 3) [m].
    at_mean
        Whether x is the mean of both ends of the step, so that x₁ = 2x − x₀, and the energy is
        to be conserved: −f(x) · (x₁ − x₀) = energy(x₁) − energy(x₀). Otherwise x is the end x₁.
    symmetric
        With `at_mean`: whether tangents must be symmetric, and may be inexact.
    t
        Time at the begin of the step [s].
    history
        The record of the term at the begin of the step; see `BoundTerm.start_history`. None for
        a term without a record, and where a system over a step is made without a history: then
        the step is the first step.
    increment
        The increment of the loads, in statics.
    """

    start: np.ndarray
    dt: float
    h: float
    past: tuple[tuple[float, np.ndarray], ...]
    at_mean: bool = False
    symmetric: bool = False
    t: float = 0.0
    history: Any = None
    increment: Increment | None = None

    @property
    def end(self) -> float:
        """The time at the end of the step [s]."""
        if self.increment:
            return self.increment.t
        return self.t + self.dt

    @classmethod
    def between(cls, start: np.ndarray, dt: float, t: float) -> Self:
        """The mean rate over a step of `dt` [s] from x₀ (n, 3) at t: ẏ = (y(x) − y(x₀))/dt."""
        return cls(start=start, dt=dt, h=dt, past=((1.0, start),), t=t)
