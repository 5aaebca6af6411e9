"""The motion of bodies as signals of time."""

import numpy as np

import fecloth as fc
from fecloth import shapes as S
from fecloth.simulation.doubts.signals import _place


def test_the_place_of_a_body_has_arms_of_the_given_size_that_turn_with_it():
    turn = fc.Rotation((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "t")
    ball = S.Sphere((0.0, 0.0, 0.0), 0.1, motion=("0.3 * t", "0", "0"), rotate=turn)
    place = _place(ball, 0.2, 0.5)
    c, s = np.cos(0.5), np.sin(0.5)
    assert np.allclose(place[0], [0.15, 0.0, 0.0])
    assert np.allclose(place[1:], 0.2 * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
