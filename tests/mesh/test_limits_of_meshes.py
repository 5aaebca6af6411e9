"""Thresholds of the mesh package, each held from both sides."""

import numpy as np
import pytest

import fecloth as fc
from fecloth import validation
from fecloth.errors import InputError, MeshError
from fecloth.mesh.edge_slopes import EdgeSlopes
from fecloth.mesh.geo_commands import check_geo
from fecloth.mesh.gmsh_import import refuse_coarse
from fecloth.mesh.grading import Grading
from fecloth.mesh.hinges import HalfEdges
from fecloth.mesh.raw_mesh import RawMesh
from fecloth.mesh.surface import count_intersections


def test_a_name_in_a_geo_file_may_have_198_characters():
    assert 198 * "a" in check_geo(f'Physical Point("{198 * "a"}") = {{1}};', "a.geo")
    with pytest.raises(MeshError, match="the text"):
        check_geo(f'Physical Point("{300 * "a"}") = {{1}};', "a.geo")


def test_edges_of_three_h_are_a_mesh_and_edges_of_five_h_are_not():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    none = np.zeros(3, bool)
    numbers = np.arange(3)
    raw = RawMesh(corners, numbers[None], {}, {}, numbers, numbers[:1], none)
    refuse_coarse(raw, np.sqrt(2) / 3, "disk")
    with pytest.raises(MeshError, match="must be about h"):
        refuse_coarse(raw, np.sqrt(2) / 5, "disk")


def test_one_row_of_equilateral_triangles_may_have_edges_a_little_shorter_than_h():
    edge = 0.1 / np.sqrt(0.75)
    fc.Cloth.rectangle(1.0, 0.1, h=1.4 * edge, pattern="equilateral")
    with pytest.raises(InputError, match="the edges of one row"):
        fc.Cloth.rectangle(1.0, 0.1, h=1.6 * edge, pattern="equilateral")


def test_the_least_factors_of_a_grading():
    steep = {"distance": 1.0, "power": 0.9}
    assert Grading("corners", **steep).smallest(1e-4) == 1e-3
    assert Grading(point=(0.0, 0.0), **steep).smallest(1e-4) == 1e-5
    with pytest.raises(InputError, match=r"at most 0\.9"):
        Grading("corners", distance=1.0, power=0.95)


def test_twenty_million_triangles_are_the_most():
    """A square of 1 m has about 4/√3/h² triangles."""
    validation.mesh_size(np.sqrt(4 / np.sqrt(3) / 1.9e7), 1.0, 1.0, "rectangle")
    with pytest.raises(InputError, match=r"would make about 2\.1e\+07 triangles"):
        validation.mesh_size(np.sqrt(4 / np.sqrt(3) / 2.1e7), 1.0, 1.0, "rectangle")


def test_coordinates_of_a_million_kilometres_are_the_most():
    validation.length("width", 0.9e9, "rectangle")
    with pytest.raises(InputError, match="must be at most 1e"):
        validation.length("width", 1.1e9, "rectangle")


def count_weights(noise: float) -> int:
    """Weights of the slopes on a regular mesh whose nodes have moved by about `noise` [m]."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.2, pattern="cross")
    X = cloth.X + noise * np.random.default_rng(0).standard_normal(cloth.X.shape)
    edges = HalfEdges.from_triangles(X, cloth.triangles)
    return EdgeSlopes(edges, np.zeros(len(cloth.triangles), int)).plain.nnz


def test_weights_are_zero_where_triangles_are_images_up_to_round_off():
    assert count_weights(1e-13) == count_weights(0.0) < count_weights(1e-12)


def stack(count: int) -> int | None:
    """Intersections of so many triangles at nearly the same place."""
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    x = np.concatenate([flat + [0.0, 0.0, 1e-3 * i] for i in range(count)])
    return count_intersections(np.arange(3 * count).reshape(-1, 3), x)


def test_intersections_are_counted_up_to_500_neighbours():
    assert stack(400) == 0
    assert stack(700) is None


@pytest.mark.parametrize(("depth", "count"), [(1e-12, 1), (3e-14, 0)])
def test_a_depth_beyond_round_off_is_an_intersection(depth, count):
    floor = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    wall = [[0.5, 0.5, -depth], [1.0, 0.5, 1.0], [0.5, 1.0, 1.0]]
    x = np.array([*floor, *wall])
    assert count_intersections(np.arange(6).reshape(2, 3), x) == count
