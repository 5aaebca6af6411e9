"""How far Newton's direction may be followed, and where the iteration may start, with contact."""

from __future__ import annotations

import math

import numpy as np

from fecloth.system.system import System

REACH = 16.0  # times the whole direction: how far a longer step is looked at


def largest_step(system: System, x: np.ndarray, s: np.ndarray, t: float) -> float:
    """The largest α for which all terms allow x + α s, both (n, 3) [m]; infinite without contact.

    Terms limit a direction by their `limit`. An α above 1 is right for a step that is doubled; it
    is not looked for with terms that couple nodes, whose `limit` is expensive.
    """
    limits = [term.limit for term in system.bound if term.limits_direction]
    if not limits:
        return math.inf
    if any(term.couples_nodes for term in system.bound):
        return min(limit(x, s, t) for limit in limits)
    far = REACH * min(limit(x, REACH * s, t) for limit in limits)
    return far if far >= 1.0 else min(limit(x, s, t) for limit in limits)


def has_limits(system: System) -> bool:
    """Whether a term limits directions."""
    return any(term.limits_direction for term in system.bound)


def admit(system: System, x: np.ndarray, t: float) -> np.ndarray:
    """Positions near x (n, 3) at the end of a step that all terms over the step allow."""
    for term in system.bound:
        x = term.admit(x, t)
    return x
