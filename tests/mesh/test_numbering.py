"""The numbers of nodes in joined pieces: all corners first, then all midpoints."""

import numpy as np

import fecloth as fc


def test_corners_of_all_pieces_come_before_midpoints_of_all_pieces():
    pieces = [fc.Cloth.rectangle(1.0, 1.0, h=h, element="P2") for h in (1.0, 0.5)]
    cloth = fc.Cloth.join(pieces, names=["coarse", "fine"])
    corners = [piece.triangles[:, :3].max() + 1 for piece in pieces]
    X = np.concatenate(
        [piece.X[:count] for piece, count in zip(pieces, corners, strict=True)]
        + [piece.X[count:] for piece, count in zip(pieces, corners, strict=True)]
    )
    assert cloth.triangles[:, :3].max() + 1 == sum(corners)
    assert np.array_equal(cloth.X, X)
