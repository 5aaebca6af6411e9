"""States of cloths near obstacles."""

import numpy as np
from conftest import flat


def near(cloth, obstacle, t, phase=0.0):
    """Positions with each node at 0.4 to 0.9 of the gap from the obstacle."""
    x, shape = flat(cloth) + [0, 0, 0.15], obstacle.shape
    d = obstacle.gap * (0.65 + 0.25 * np.sin(20 * cloth.X[:, 0] + phase))
    for _ in range(20):
        y = shape.pose(t).to_body(x)
        n, _ = shape.slopes(y, t)
        away = (d - shape.distance(y, t)) / np.einsum("ni,ni->n", n, n)
        x = shape.pose(t).to_space(y + away[:, None] * n)
    return x
