"""In-plane coordinates of meshes with three coordinates."""

import math

import numpy as np
import pytest
from support.meshed import QUAD_T, QUAD_X, areas, rejects

from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.mesh.generate import rectangle


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
def test_coordinate_planes_keep_their_two_coordinates(axes):
    mesh = rectangle(1, 0.5, 0.25, "right")
    xyz = np.full((len(mesh.X), 3), 3.25)
    xyz[:, axes] = mesh.X
    assert np.array_equal(FlatMesh.from_arrays(xyz, mesh.triangles).X, mesh.X)


def rotation(v):
    angle = np.linalg.norm(v)
    if angle == 0:
        return np.eye(3)
    x, y, z = np.array(v) / angle * math.sin(angle / 2)
    w = math.cos(angle / 2)
    q = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * q + 2 * q @ q


def test_first_axis_of_a_tilted_plane_is_the_projection_of_x():
    c = math.sqrt(0.5)
    about_x = np.array([[1, 0, 0], [0, c, -c], [0, c, c]])  # x stays x
    about_y = np.array([[c, 0, c], [0, 1, 0], [-c, 0, c]])  # x is shortened, y stays y
    X = np.array(QUAD_X)
    flat = np.c_[X, np.zeros(4)]
    np.testing.assert_allclose(FlatMesh.from_arrays(flat @ about_x.T, QUAD_T).X, X, atol=1e-12)
    np.testing.assert_allclose(FlatMesh.from_arrays(flat @ about_y.T, QUAD_T).X, X, atol=1e-12)


def test_nodes_off_the_plane_are_rejected_with_their_distance():
    mesh = rectangle(1, 1, 0.25, "right")
    xyz = np.c_[mesh.X, 0 * mesh.X[:, 0]] @ rotation((0.4, 0.2, 0.1)).T
    assert not FlatMesh.from_arrays(xyz, mesh.triangles).notes
    near = FlatMesh.from_arrays(xyz + 4e-7 * np.sin(37 * xyz), mesh.triangles)
    assert "away from their plane" in near.notes[0]
    rejects(["away from the plane"], xyz + 4e-6 * np.sin(37 * xyz), mesh.triangles)
    bump = xyz.copy()
    bump[12] += 0.02 * rotation((0.4, 0.2, 0.1))[:, 2]
    rejects(["0.019", "away from the plane", "1e-6", "flat"], bump, mesh.triangles, where="s.vtu")


@pytest.mark.parametrize(
    ("write", "lengths"),
    [
        (lambda x: x.astype(np.float32), (0.3, 1.0)),
        (lambda x: np.round(x, 6), (0.05, 0.3, 1.0)),
    ],
)
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_tilted_plane_is_flat_to_the_rounding_of_its_numbers(write, lengths, shift):
    for length in lengths:
        mesh = rectangle(length, length, length / 4, "right")
        xyz = np.c_[mesh.X, 0 * mesh.X[:, 0]] @ rotation((0.4, 0.2, 0.1)).T + shift
        flat = FlatMesh.from_arrays(write(xyz), mesh.triangles)
        assert areas(flat) == pytest.approx(areas(mesh), rel=1e-4)
        assert "moved into it" in flat.notes[0]
