"""Lengths and rates without their rigid part."""

import numpy as np
import pytest

from fecloth.simulation.rigid_motion import rms_without_rigid

RANDOM = np.random.default_rng(4)
W = RANDOM.uniform(0.5, 2.0, 40)
X = RANDOM.normal(size=(40, 3)) * [1.0, 0.6, 0.1]


def rms(y):
    return np.sqrt(W @ (y**2).sum(axis=1) / W.sum())


def test_the_rigid_part_of_a_field_is_taken_out():
    """Compared with a least squares fit of the six rigid fields."""
    y = RANDOM.normal(size=(40, 3))
    r = X - 7.0
    fields = [np.tile(axis, (40, 1)) for axis in np.eye(3)]
    fields += [np.cross(axis, r) for axis in np.eye(3)]
    A, root = np.array([f.ravel() for f in fields]).T, np.repeat(np.sqrt(W), 3)
    rest = y.ravel() - A @ np.linalg.lstsq(root[:, None] * A, root * y.ravel(), rcond=None)[0]
    assert rms_without_rigid(W, r, y) == pytest.approx(rms(rest.reshape(-1, 3)), rel=1e-12)


def test_points_on_a_line_cannot_be_turned_about_it():
    x = np.outer(np.linspace(0, 1, 9), [1.0, 2.0, 0.0])
    y = np.outer(np.linspace(0, 1, 9) ** 2, [0.0, 0.0, 1.0])
    result = rms_without_rigid(np.ones(9), x, y)
    line = np.polyval(np.polyfit(np.linspace(0, 1, 9), y[:, 2], 1), np.linspace(0, 1, 9))
    assert result == pytest.approx(np.sqrt(np.mean((y[:, 2] - line) ** 2)), rel=1e-9)
