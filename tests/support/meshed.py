"""Paths, small meshes, and functions that the tests of meshes share."""

from pathlib import Path

import numpy as np
import pytest

from fecloth.errors import MeshError
from fecloth.mesh.flat_mesh import FlatMesh

MESHES = Path(__file__).parents[2] / "meshes"
PATTERNS = ["unstructured", "right", "cross", "equilateral"]
STRUCTURED = PATTERNS[1:]
QUAD_X = [[0.0, 0], [1, 0], [1, 1], [0, 1]]
QUAD_T = [[0, 1, 2], [0, 2, 3]]


def areas(mesh):
    a, b, c = (mesh.X[mesh.triangles[:, i]] for i in range(3))
    return 0.5 * np.cross(np.c_[b - a, 0 * a[:, 0]], np.c_[c - a, 0 * a[:, 0]])[:, 2]


def length(mesh, edges):
    return np.linalg.norm(np.diff(mesh.X[mesh.edge_sets[edges]], axis=1), axis=-1).sum()


def rejects(texts, *args, error=MeshError, by=FlatMesh.from_arrays, **kwargs):
    """Call a function and check that it raises an error whose message contains all `texts`."""
    with pytest.raises(error) as caught:
        by(*args, **kwargs)
    for text in texts:
        assert text in str(caught.value)
    return str(caught.value)
