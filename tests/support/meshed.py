"""What the tests of meshes share: places, small arrays, lengths and areas, refusals."""

from pathlib import Path

import numpy as np
import pytest

from fecloth.errors import MeshError
from fecloth.mesh.generate import checked

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


def refused(what, *args, error=MeshError, by=checked, **kwargs):
    """Call, expect the refusal, and ask that its message holds each of the texts in ``what``."""
    with pytest.raises(error) as caught:
        by(*args, **kwargs)
    for text in what:
        assert text in str(caught.value)
    return str(caught.value)
