"""Rotations by an angle that depends on time."""

import numpy as np

import fecloth as fc


def test_matrix_turns_by_the_change_of_the_angle_since_a_time():
    turn = fc.Rotation((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "t")
    matrix = turn.matrix(0.7, since=0.2)
    assert np.allclose(matrix @ [1.0, 0.0, 0.0], [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-14)
