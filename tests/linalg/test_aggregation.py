"""Motions of aggregates: orthonormal to round-off, however alike they are, and where they end."""

import numpy as np
import pytest

from fecloth.linalg import aggregation


def factors(motions):
    """Q (3n, 6) and R (6, 6) of one aggregate of all nodes, from B (3n, 6)."""
    Q = motions.T.reshape(6, -1, 3).copy()
    R = aggregation.orthonormalise(np.zeros(Q.shape[1], np.int32), Q)
    return Q.reshape(6, -1).T, R.reshape(6, 6).T


def alike(apart, n=6):
    """(3n, 6) independent motions that are all `apart` from the first."""
    rng = np.random.default_rng(1)
    B = np.linalg.qr(rng.normal(size=(3 * n, 6)))[0]
    B[:, 1:] = B[:, :1] + apart * B[:, 1:]
    return B


@pytest.mark.parametrize("apart", [1.0, 1e-3, 1e-6, 1e-9])
def test_motions_are_orthonormal_to_round_off_however_alike_they_are(apart):
    """With one pass the error would grow with 1/apart."""
    B = alike(apart)
    Q, R = factors(B)
    assert abs(Q.T @ Q - np.eye(6)).max() < 1e-14
    assert abs(Q @ R - B).max() < 1e-14
    assert not np.tril(R, -1).any()


@pytest.mark.parametrize(("apart", "is_kept"), [(0.8e-10, False), (1.25e-10, True)])
def test_a_motion_that_is_another_but_for_1e_10_of_its_size_leaves_zeros(apart, is_kept):
    B = np.linalg.qr(np.random.default_rng(1).normal(size=(18, 6)))[0]
    B[:, 3] = B[:, 1] + apart * B[:, 3]
    Q, R = factors(B)
    assert Q[:, 3].any() == (R[3, 3] > 0) == is_kept
    kept = np.eye(6)
    kept[3, 3] = is_kept
    assert abs(Q.T @ Q - kept).max() < 1e-14
