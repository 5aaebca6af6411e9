"""Arrays of a mesh: what is refused, turned, sorted and copied."""

import numpy as np
import pytest
from support.meshed import QUAD_T, QUAD_X, areas
from support.wrong_calls import FRAME, RING

from fecloth.errors import MeshError
from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.mesh.generate import rectangle


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_thin_triangles_just_above_the_limit_of_area_are_accepted(scale):
    """It is relative to the edges: 1e-12 of the longest one squared."""
    thin = scale * np.array([[0, 0], [1, 0], [2, 1e-10], [1, 1]])
    assert len(FlatMesh.from_arrays(thin, [[0, 1, 3], [1, 2, 3]]).X) == 4
    least = scale * np.array([[0, 0], [1, 0], [0.5, 3e-12]])
    assert FlatMesh.from_arrays(least, [[0, 1, 2]]).triangles.tolist() == [[0, 1, 2]]


def test_orientation():
    straight = FlatMesh.from_arrays(QUAD_X, QUAD_T)
    assert straight.triangles.tolist() == QUAD_T
    turned = FlatMesh.from_arrays(QUAD_X, [[2, 1, 0], [3, 2, 0]])
    assert (areas(turned) > 0).all()
    mesh = rectangle(1, 1, 0.25, "right")
    t = mesh.triangles.copy()
    t[[3, 8]] = t[[3, 8]][:, [0, 2, 1]]
    for some in (t, t[:, [0, 2, 1]]):
        assert np.array_equal(FlatMesh.from_arrays(mesh.X, some).triangles, mesh.triangles)
    assert FlatMesh.from_arrays(mesh.X, t).notes[0].startswith("2 of 32 triangles turned")
    assert mesh.notes == ()


@pytest.mark.parametrize("pattern", ["right", "cross", "equilateral"])
def test_a_tangled_mesh_overlaps_after_its_triangles_are_turned(pattern):
    mesh = rectangle(1, 1, 0.25, pattern)
    inner = np.setdiff1d(np.arange(len(mesh.X)), mesh.node_sets["boundary"])
    for node in inner:
        X = mesh.X.copy()
        X[node] += (0.31, 0.17)  # over the triangles around it
        with pytest.raises(MeshError, match="overlap"):
            FlatMesh.from_arrays(X, mesh.triangles)


def test_no_node_is_in_the_middle_of_an_edge():
    """A square in a frame, and a thin triangle on the boundary, whose apex is no such node."""
    assert len(FlatMesh.from_arrays(RING[:8], [*FRAME, [4, 5, 6], [4, 6, 7]]).X) == 8
    X = [[0, 0], [1, 0], [0.5, 1e-7], [0.5, -1]]
    assert len(FlatMesh.from_arrays(X, [[0, 1, 2], [1, 0, 3]]).X) == 4


def test_sets_are_sorted_unique_and_boundary_is_added():
    mesh = FlatMesh.from_arrays(QUAD_X, QUAD_T, {"a": [3, 0, 3]}, {"hem": [[1, 0], [0, 1]]})
    assert mesh.node_sets["a"].tolist() == [0, 3]
    assert mesh.edge_sets["hem"].tolist() == [[0, 1]]
    assert mesh.node_sets["hem"].tolist() == [0, 1]
    assert mesh.edge_sets["boundary"].tolist() == [[0, 1], [0, 3], [1, 2], [2, 3]]
    own = FlatMesh.from_arrays(QUAD_X, QUAD_T, {"boundary": [2]})
    assert own.node_sets["boundary"].tolist() == [2]
    assert "boundary" not in own.edge_sets


def test_arrays_of_the_caller_are_copied():
    X, t = np.array(QUAD_X), np.array(QUAD_T, dtype=np.int32)
    mesh = FlatMesh.from_arrays(X, t)
    X[:], t[:] = 7, 7
    assert mesh.X.max() == 1
    assert mesh.triangles.max() == 3
