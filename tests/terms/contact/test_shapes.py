"""Shapes of obstacles: distance, its derivatives, motion, and the way that is left."""

from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.terms.contact.advance import LEAST_PART_LEFT, advance

S = fc.shapes
TURN = fc.Rotation((0.1, -0.2, 0.05), (1, 2, -1), "0.3 + 0.9*t + t**2")
SHAPES = {
    "plane": S.Plane((0, 0, 0.1), (1, 2, 4)),
    "sphere": S.Sphere((0.1, 0, -0.2), 0.3),
    "cylinder": S.Cylinder((0.1, 0, -0.2), (1, 1, 0.5), 0.2),
    "capsule": S.Capsule((-0.2, 0, 0), (0.2, 0.1, 0.05), 0.1),
    "box": S.Box((0.1, 0, 0), (0.4, 0.5, 0.3)),
    "disk": S.Disk((0, 0.1, 0), (0.2, 0.1, 1), 0.3, 0.05),
    "sdf": S.Sdf("sqrt(x**2 + 2*y**2 + z**2 + 0.05*x*z) - 0.3 - 0.02*sin(9*x)"),
}
CONVEX = {name: shape for name, shape in SHAPES.items() if shape.convex}


def outside(shape, rng, count=4000, t=0.0):
    """Random points outside, away from the surface by at least 5 mm."""
    y = rng.uniform(-0.7, 0.7, (count, 3))
    return y[shape.distance(y, t) > 5e-3]


@pytest.mark.parametrize("name", SHAPES)
def test_slopes_are_the_derivatives_of_the_distance(name, rng):
    """Errors of central differences fall fourfold; points next to an edge's bisector do not."""
    shape, errors = SHAPES[name], []
    y = outside(shape, rng)
    gradient, hessian = shape.slopes(y, 0.0)
    for h in (2e-4, 1e-4):
        steps = [h * np.eye(3)[i] for i in range(3)]
        d = [(shape.distance(y + s, 0.0) - shape.distance(y - s, 0.0)) / (2 * h) for s in steps]
        n = [(shape.slopes(y + s, 0.0)[0] - shape.slopes(y - s, 0.0)[0]) / (2 * h) for s in steps]
        differences = np.stack(d, -1) - gradient, np.stack(n, -1) - hessian
        errors.append([np.quantile(abs(each), 0.98) for each in differences])
    assert (np.array(errors[1]) < 0.3 * np.array(errors[0]) + 1e-8).all()
    assert np.max(errors[1]) < 1e-3


@pytest.mark.parametrize("name", CONVEX)
def test_distance_is_that_of_the_nearest_point_of_the_surface(name, rng):
    """|∇d| = 1, and d ∇d leads back to the surface: then d is the distance."""
    shape = SHAPES[name]
    y = outside(shape, rng)
    d, n = shape.distance(y, 0.0), shape.slopes(y, 0.0)[0]
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(shape.distance(y - d[:, None] * n, 0.0), 0.0, atol=1e-12)
    pairs = rng.integers(0, len(y), (2, 20000))  # convexity, on which `advance` relies
    part = rng.uniform(size=(20000, 1))
    between = part * y[pairs[0]] + (1 - part) * y[pairs[1]]
    chord = part[:, 0] * d[pairs[0]] + (1 - part[:, 0]) * d[pairs[1]]
    assert (np.maximum(shape.distance(between, 0.0), 0) <= chord + 1e-12).all()


def test_box_and_disk_against_points_of_their_surface(rng):
    """The distance from the nearest of many points of the surface, from outside and inside."""
    box, disk = SHAPES["box"], S.Disk((0, 0.1, 0), (0, 0, 1), 0.3, 0.1)
    u = rng.uniform(-1, 1, (60_000, 3))
    face = rng.integers(0, 3, len(u))
    u[np.arange(len(u)), face] = np.sign(u[np.arange(len(u)), face])
    of_box = np.array(box.center) + 0.5 * u * np.array(box.size)
    angle, r = rng.uniform(0, 2 * np.pi, len(u)), np.where(face == 2, np.sqrt(abs(u[:, 1])), 1.0)
    height = np.where(face == 2, np.sign(u[:, 2]), u[:, 1])
    of_disk = np.column_stack(
        [0.3 * r * np.cos(angle), 0.1 + 0.3 * r * np.sin(angle), 0.05 * height]
    )
    for shape, surface in ((box, of_box), (disk, of_disk)):
        for y in rng.uniform(-0.5, 0.5, (40, 3)):
            nearest = np.linalg.norm(surface - y, axis=1).min()
            assert abs(shape.distance(y[None], 0.0)[0]) == pytest.approx(nearest, abs=6e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_a_moved_shape_is_the_shape_seen_from_its_frame(name, rng):
    shape = SHAPES[name]
    moved = replace(shape, motion=("t", "0.1", "-t**2"), rotate=TURN)
    x, t = rng.standard_normal((50, 3)), 0.7
    pose, p = moved.pose(t), np.array(TURN.point)
    u = np.array([0.7, 0.0, -0.49])  # only the changes of the motion count
    R = TURN.matrix(0.7) @ TURN.matrix(0.0).T
    np.testing.assert_allclose(pose.to_body(p + u + (x - p) @ R.T), x, atol=1e-14)
    np.testing.assert_allclose(pose.to_space(pose.to_body(x)), x, atol=1e-14)
    np.testing.assert_allclose(moved.pose(0.0).to_body(x), x, atol=1e-14)
    velocity, omega, centre = moved.rates(t)
    later, now = (moved.pose(t + dt).to_space(pose.to_body(x)) for dt in (1e-6, -1e-6))
    exact = velocity + np.cross(omega, x - centre)
    np.testing.assert_allclose((later - now) / 2e-6, exact, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("name", SHAPES)
def test_no_way_leads_inside_and_none_is_cut_in_vain(name, rng):
    """On the way taken the points keep their distance; what is beyond it comes near or enters."""
    shape, gap = SHAPES[name], 0.01
    y = outside(shape, rng, 3000)
    way = 0.3 * rng.standard_normal(y.shape) - y * rng.uniform(0.0, 2.0, (len(y), 1))
    parts = advance(shape, y, way, 0.0, gap)
    least = LEAST_PART_LEFT * np.minimum(shape.distance(y, 0.0), gap)
    some = np.linspace(0, 1, 200)
    d = np.array([shape.distance(y + (a * parts)[:, None] * way, 0.0) for a in some])
    assert (d >= 0.99 * least).all()
    cut = parts < 1
    assert 0.1 < cut.mean() < 0.95
    end = d[-1][cut] / least[cut]
    assert (end < 1.1).mean() > (0.999 if shape.convex else 0.9)


def test_a_point_stops_before_a_thin_disk_that_the_whole_way_crosses():
    disk = S.Disk((0, 0, 0), (0, 0, 1), 0.3, 1e-4)
    y, way = np.array([[0.1, 0.0, 0.5]]), np.array([[0.0, 0.0, -1.0]])
    part = advance(disk, y, way, 0.0, 1e-3)
    assert part[0] == pytest.approx(0.5 - 0.5e-4 - LEAST_PART_LEFT * 1e-3, abs=1e-5)


def test_lengths_may_have_units():
    assert S.Sphere((0, "5 cm", 0), "10 cm") == S.Sphere((0, 0.05, 0), 0.1)
