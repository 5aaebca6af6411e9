"""The round-off of forces, measured."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fecloth.system.state import State


def measure_round_off(force: Callable[[State], np.ndarray], state: State) -> np.ndarray:
    """Change of the force (n, 3) [N] when x and v change in their last digits, at random.

    The random numbers are the same in every call. This holds for all terms; a bound from the
    stiffness holds only for forces that are differences of positions.
    """
    random, eps = np.random.default_rng(0), float(np.finfo(float).eps)
    x, v = (y * (1 + eps * random.uniform(-1, 1, y.shape)) for y in (state.x, state.v))
    return force(State(state.t, x, v)) - force(state)
