"""The rigid motion of connected pieces, free and held."""

from types import SimpleNamespace

import numpy as np
import pytest

from fecloth.system.constraints import Constraints
from fecloth.system.pieces import movable_pieces
from fecloth.system.pins import Pin, Slide

CELLS = np.array([[0, 1, 2], [3, 4, 5], [3, 5, 6]])  # two pieces
MASS = np.array([1.0, 2.0, 3.0, 1.0, 1.0, 2.0, 2.0])
X = np.random.default_rng(0).normal(size=(7, 3))


def pieces(*pins):
    cloth = SimpleNamespace(stencil=CELLS, X=X, nodes=lambda where: np.array(where))
    return movable_pieces(cloth, [], Constraints.bind(pins, cloth))


def rigid(piece, v, pin_v=None):
    m = MASS[:, None]
    return piece.rigid_velocity(X, m * v, MASS, m * X, v if pin_v is None else pin_v)


def turning(omega, u):
    return np.cross(omega, X) + u


def test_free_pieces_have_their_own_motion():
    first, second = pieces()
    assert [list(piece.nodes) for piece in (first, second)] == [[0, 1, 2], [3, 4, 5, 6]]
    v = turning([1.0, -2.0, 0.5], [3.0, 0.0, 1.0])
    v[3:] = turning([0.0, 4.0, 0.0], [0.0, -5.0, 0.0])[3:]
    for piece in (first, second):
        assert np.allclose(rigid(piece, v), v[piece.nodes], atol=1e-12)


def test_motion_without_rigid_part_has_no_momentum_and_less_energy():
    piece = pieces()[1]
    v = np.random.default_rng(1).normal(size=(7, 3))
    left, m, x = v[3:] - rigid(piece, v), MASS[3:, None], X[3:]
    assert abs((m * left).sum(axis=0)).max() < 1e-12
    assert abs(np.cross(x, m * left).sum(axis=0)).max() < 1e-12
    parts = [(m * part**2).sum() for part in (left, v[3:] - left)]
    assert sum(parts) == pytest.approx((m * v[3:] ** 2).sum())


def test_pins_carry_a_piece_and_fixed_ones_hold_it():
    assert len(pieces(Pin([0, 1, 2]), Pin([3]))) == 0
    moved = pieces(Pin([0]), Pin([3, 4, 6], motion=lambda t: (t, 0.0, 0.0)))
    assert [list(piece.held) for piece in moved] == [[3, 4, 6]]
    v = turning([1.0, -2.0, 0.5], [3.0, 0.0, 1.0])
    assert np.allclose(rigid(moved[0], 0 * v, v), v[3:])
    line = pieces(Pin([0]), Pin([3, 4], motion=lambda t: (t, 0.0, 0.0)))[0]
    assert np.allclose(rigid(line, 0 * v, 0 * v + [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0])


def test_a_piece_on_slides_moves_freely_along_them():
    piece = pieces(Pin([0]), Slide([3, 4], normal=(0.0, 0.0, 1.0)))[0]
    v = np.tile([3.0, -4.0, 0.0], (7, 1))
    assert np.allclose(rigid(piece, v), [3.0, -4.0, 0.0])
    assert np.allclose(rigid(piece, v + [0.0, 0.0, 2.0], v), [3.0, -4.0, 0.0])
