"""States of cloths near obstacles, and the slopes of contact there."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix


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


def two_layers(gap, h=0.1, element="P1", size=0.3):
    """Two squares, one over the other at 0.4 to 0.8 of the gap; x, and which nodes are upper."""
    lower = fc.Cloth.rectangle(size, size, h, element=element)
    upper = fc.Cloth.rectangle(29 / 30 * size, 28 / 30 * size, 0.9 * h, element=element)
    cloth = fc.Cloth.join([lower, upper], ["lower", "upper"])
    x, over = flat(cloth), np.isin(np.arange(len(cloth.X)), cloth.nodes("upper"))
    turn = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])  # no parallel edges
    x[over] = x[over] @ turn.T + [7 / 30 * size, -0.1 * size, 0.6 * gap]
    x[over, 2] += 0.2 * gap * np.sin(9 * x[over, 0] + 5 * x[over, 1])
    return cloth, x, over


def check_slopes(system, x, t, rng, size=1e-6, limit=1e-5):
    """The force of the last term is the slope of its energy, the tangent the slope of the force.

    By differences over `size`, which is small against the way to where a pair begins or ends.
    """
    term, still, along = (
        system.bound[-1].with_exact_tangent(),
        np.zeros_like(x),
        rng.standard_normal(x.shape),
    )
    ends, forces = (x + size * along, x - size * along), []
    for place in (*ends, x):
        forces.append(np.zeros_like(x))
        term.add_force(place, still, t, forces[-1])
    more, less = (term.energy(end, t) for end in ends)
    work = np.vdot(forces[2], along)
    assert abs(work) > 0.0
    assert (more - less) / (2 * size) == pytest.approx(-work, rel=limit)
    J = BlockMatrix.zeros(system.pattern)
    term.add_tangent(x, still, t, 1.0, 0.0, J, False)
    coupled = term.coupling(x, still, t, 1.0, 0.0, False)
    K = J.to_scipy() if coupled is None else J.to_scipy() + coupled
    expected = K @ along.ravel()
    error = (forces[1] - forces[0]).ravel() / (2 * size) - expected
    assert np.linalg.norm(error) < limit * np.linalg.norm(expected)
