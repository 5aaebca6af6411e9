"""Gradings: edge lengths follow their formula in every shape."""

import numpy as np
import pytest
from support.meshed import MESHES, areas

from fecloth.mesh.generate import disk, rectangle
from fecloth.mesh.grading import Grading
from fecloth.mesh.read import read


def to_points(*points):
    return lambda X: np.linalg.norm(X[:, None] - np.array(points), axis=2).min(axis=1)


CORNERS = to_points((0, 0), (1, 0), (1, 0.5), (0, 0.5))
SHAPES = {
    "corners": (lambda g, h: rectangle(1.0, 0.5, h, grading=[g]), CORNERS),
    "left": (lambda g, h: rectangle(1.0, 0.5, h, grading=[g]), lambda X: X[:, 0]),
    "boundary": (lambda g, h: disk(0.5, h, grading=[g]), lambda X: 0.5 - np.hypot(*X.T)),
    "hoist": (lambda g, h: read(MESHES / "flag.geo", h, grading=[g]), lambda X: X[:, 0]),
    "hoist_top": (lambda g, h: read(MESHES / "flag.geo", h, grading=[g]), to_points((0, 1))),
}


def measured_factors(mesh, h):
    """Edge length of the equilateral triangle of the same area, over h."""
    return np.sqrt(areas(mesh) * 4 / np.sqrt(3)) / h


@pytest.mark.parametrize("where", SHAPES)
def test_sizes_follow_the_formula(where):
    h, d, power = 0.04, 0.2, 0.5
    make, distance = SHAPES[where]
    mesh = make(Grading(where, distance=d, power=power), h)
    r = distance(mesh.X[mesh.triangles].mean(axis=1))
    expected = np.clip((r / d) ** power, (h / d) ** (power / (1 - power)), 1)
    ratio = measured_factors(mesh, h) / expected
    for near, far in ((0, 0.02), (0.02, 0.1), (0.1, 0.3)):
        ring = ratio[(near <= r) & (r < far)]
        assert np.median(ring) == pytest.approx(0.9, abs=0.12), (near, far)
    assert np.percentile(ratio, 2) > 0.6
    assert np.percentile(ratio, 98) < 1.5


def test_a_finer_h_alone_refines_the_family():
    """Four times the triangles with half of h, and a corner that is finer by 2^(1/(1-power))."""
    corner = Grading(point=(0.0, 0.5), distance=0.4, power=0.6)
    coarse, fine = (rectangle(1.0, 0.5, h, grading=[corner]) for h in (0.05, 0.025))
    assert len(fine.triangles) / len(coarse.triangles) == pytest.approx(4, rel=0.1)
    least = [measured_factors(mesh, h).min() * h for mesh, h in ((coarse, 0.05), (fine, 0.025))]
    assert least[0] / least[1] == pytest.approx(2**2.5, rel=0.15)
