"""Limits of meshes, each from both sides."""

import numpy as np
import pytest

from fecloth import validation
from fecloth.errors import InputError, MeshError
from fecloth.mesh.gmsh_import import refuse_coarse
from fecloth.mesh.raw_mesh import RawMesh
from fecloth.mesh.surface import count_intersections


def test_edges_of_three_h_are_a_mesh_and_edges_of_five_h_are_not():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    none = np.zeros(3, bool)
    numbers = np.arange(3)
    raw = RawMesh(corners, numbers[None], {}, {}, numbers, numbers[:1], none)
    refuse_coarse(raw, np.sqrt(2) / 3, "disk")
    with pytest.raises(MeshError, match="must be about h"):
        refuse_coarse(raw, np.sqrt(2) / 5, "disk")


def test_twenty_million_triangles_are_the_most():
    """A square of 1 m has about 4/√3/h² triangles."""
    validation.mesh_size(np.sqrt(4 / np.sqrt(3) / 1.9e7), 1.0, 1.0, "rectangle")
    with pytest.raises(InputError, match=r"would make about 2\.1e\+07 triangles"):
        validation.mesh_size(np.sqrt(4 / np.sqrt(3) / 2.1e7), 1.0, 1.0, "rectangle")


@pytest.mark.parametrize(("depth", "count"), [(1e-12, 1), (3e-14, 0)])
def test_a_depth_beyond_round_off_is_an_intersection(depth, count):
    floor = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    wall = [[0.5, 0.5, -depth], [1.0, 0.5, 1.0], [0.5, 1.0, 1.0]]
    x = np.array([*floor, *wall])
    assert count_intersections(np.arange(6).reshape(2, 3), x) == count
