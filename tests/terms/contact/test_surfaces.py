"""Surfaces of obstacles: they lie on the shape, their normals point out, their volume is right."""

import math

import numpy as np
import pytest

import fecloth as fc
from fecloth.terms.contact.surfaces import surface_of

S = fc.shapes
TURN = fc.Rotation((0.1, 0, 0), (1, 2, 3), "t")
RING = "sqrt((sqrt(x**2 + y**2) - 0.1)**2 + z**2) - 0.03"
CASES = {  # a shape and its volume; of an endless one none
    "sphere": (S.Sphere((0, 0, -0.1), 0.1, motion=("t", 0, 0)), 4 / 3 * math.pi * 1e-3),
    "capsule": (
        S.Capsule((0, 0, 0), (0.1, 0.1, 0.2), 0.03),
        math.pi * 0.03**2 * (math.sqrt(0.06) + 0.04),
    ),
    "disk": (S.Disk((0.1, 0, 0), (1, 1, 1), 0.1, 0.02, rotate=TURN), math.pi * 0.01 * 0.02),
    "box": (S.Box((0, 0, 0.1), (0.1, 0.2, 0.3), motion=("t", 0, 0), rotate=TURN), 0.006),
    "sdf": (S.Sdf(RING, radius=0.03, rotate=TURN), 2 * math.pi**2 * 0.1 * 0.03**2),
    "plane": (S.Plane((0, 0, 0.1), (0.1, 0, 1)), None),
    "cylinder": (S.Cylinder((0, 0, 0), (1, 0, 0.2), 0.05), None),
}


@pytest.mark.parametrize("name", CASES)
def test_a_surface_is_that_of_its_shape(name):
    shape, volume = CASES[name]
    t, place = 0.3, np.array([0.05, 0.02, 0.0])
    points, triangles = surface_of(shape, t, place, 0.3)
    pose = shape.pose(t)
    assert abs(shape.distance(pose.to_body(points), t)).max() < 2e-5
    a, b, c = points[triangles].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    beside = (a + b + c) / 3 + 2e-3 * normal / np.maximum(length, 1e-12)
    outside = shape.distance(pose.to_body(beside), t) > 0.0  # but for slivers
    assert length[outside].sum() > 0.99 * length.sum()
    if volume:
        enclosed = np.einsum("qi,qi->q", np.cross(a, b), c).sum() / 6
        assert enclosed == pytest.approx(volume, rel=0.03)  # polyhedra inside
    else:
        assert np.linalg.norm(points - place, axis=1).max() > 0.25


def test_a_formula_that_is_not_near_has_no_surface():
    points, triangles = surface_of(S.Sdf("z + 9"), 0.0, np.zeros(3), 0.3)
    assert points.shape == triangles.shape == (0, 3)
