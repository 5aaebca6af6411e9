"""Obstacles with edges, or thin against the triangles, act by their own points, edges and faces."""

import math

import numpy as np
import pytest
from support.obstacles import check_slopes, near
from support.planned import warnings_before
from support.tiers import stories_except

import fecloth as fc
from fecloth import shapes as S
from fecloth.errors import InputError
from fecloth.terms.contact import obstacle as obstacles
from fecloth.terms.contact.bound_obstacle import BoundObstacle
from fecloth.terms.contact.obstacle import BoundSkeleton

pytest.importorskip("ipctk")
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
SHAPES = {
    "needle": S.Capsule((0.1, 0.107, -0.1), (0.1, 0.107, 0.0), 1e-3),
    "rod across": S.Capsule((-0.1, 0.107, -0.01), (0.3, 0.112, -0.01), 5e-4),
    "wire": S.Cylinder((0.0, 0.107, -0.01), (1.0, 0.05, 0.0), 5e-4),
    "bar": S.Box((0.1, 0.107, -0.1), (2e-3, 2e-3, 0.2)),
    "edge": S.Box((0.1, 0.107, -0.1), (0.02, 0.02, 0.2)),
    "pellet": S.Sphere((0.1, 0.107, 0.0), 2e-3),
    "table": S.Box((0.1, 0.107, -0.1), (0.11, 0.13, 0.2)),
    "plate": S.Disk((0.1, 0.107, -0.05), (0.0, 0.0, 1.0), 0.06, 0.1),
    "coin on edge": S.Disk((0.1, 0.107, -0.01), (0.0, 1.0, 0.0), 0.01, 1e-3),
}


def bind(shape, h=0.05, gap=1e-3, **options):
    """A sheet of 0.2 m, 20 mm above the plane z = 0, and the obstacle bound to it."""
    cloth = fc.Cloth.rectangle(0.2, 0.2, h)
    terms = [fc.StVK(), fc.PlateBending(), fc.Obstacle(shape, gap, **options)]
    system = fc.System(cloth, FABRIC, terms)
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 0.02)])
    return system, system.bound[-1], x


def crossings(skeleton, x, triangles):
    """How many pairs of an edge of the skeleton and a triangle of the cloth meet."""
    faces = skeleton.triangles
    sides = np.vstack([skeleton.edges, *(faces[:, [i, (i + 1) % 3]] for i in range(3))])
    a, b, c = x[triangles].transpose(1, 0, 2)
    count = 0
    for start, end in skeleton.points[sides]:
        way = np.broadcast_to(start - end, a.shape)
        solved = np.linalg.solve(np.stack([b - a, c - a, way], axis=-1), (start - a)[..., None])
        u, v, part = solved[..., 0].T
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (part >= 0) & (part <= 1)
        count += int(inside.sum())
    return count


@pytest.mark.parametrize("name", stories_except(SHAPES, "needle", "table"))
def test_an_edged_or_thin_shape_never_pierces_the_cloth(name, rng):
    """Thrown at 3 m/s, from a start turned a little, so that nothing is parallel."""
    system, term, x = bind(SHAPES[name], friction=0.3)
    assert isinstance(term, BoundSkeleton)
    x += 1e-4 * rng.standard_normal(x.shape)
    start = system.state(x, np.broadcast_to([0.0, 0.0, -3.0], x.shape))
    parts = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    for state, _ in fc.march(system, fc.BackwardEuler(), start, dt=0.01, t_end=0.04):
        places = np.einsum("pa,mai->mpi", parts, state.x[system.cloth.triangles]).reshape(-1, 3)
        assert SHAPES[name].distance(places, 0.0).min() > 0
        assert crossings(SHAPES[name].skeleton(0.2), state.x, system.cloth.triangles) == 0
    assert np.ptp(state.v[:, 2]) > 0.5  # it has met the obstacle


@pytest.mark.parametrize("name", ["bar", "table", "plate"])
def test_the_triangles_of_a_skeleton_are_the_surface_of_the_shape(name):
    """They are closed, turned outwards, on the surface, and have its area."""
    shape, skeleton = SHAPES[name], SHAPES[name].skeleton(0.2)
    corners = skeleton.points[skeleton.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    normal = across / (2 * areas[:, None])
    if isinstance(shape, S.Box):
        a, b, c = shape.size
        exact = 2 * (a * b + b * c + c * a)
    else:
        exact = 2 * math.pi * shape.radius * (shape.radius + shape.thickness)
    assert areas.sum() == pytest.approx(exact, rel=1e-3)
    middles = corners.mean(axis=1)
    assert abs(shape.distance(middles, 0.0)).max() < 1e-3 * exact**0.5
    assert (np.einsum("mi,mi->m", across, shape.slopes(middles + 1e-4 * normal, 0.0)[0]) > 0).all()
    sides = [tuple(t[[i, (i + 1) % 3]]) for t in skeleton.triangles for i in range(3)]
    assert len(set(sides)) == len(sides)
    assert all((b, a) in set(sides) for a, b in sides)


@pytest.mark.parametrize("name", ["needle", "wire", "pellet"])
def test_round_shapes_lie_within_their_radius_of_the_skeleton(name, rng):
    shape, skeleton = SHAPES[name], SHAPES[name].skeleton(0.2)
    y = np.array([0.1, 0.107, 0.0]) + 0.03 * rng.standard_normal((50, 3))
    start, end = skeleton.points[0], skeleton.points[-1]
    way = end - start
    part = np.clip((y - start) @ way / max(way @ way, 1e-30), 0, 1)
    away = np.linalg.norm(y - start - part[:, None] * way, axis=1) - skeleton.thickness
    np.testing.assert_allclose(shape.distance(y, 0.0), away, rtol=0, atol=1e-12)
    assert name != "wire" or np.linalg.norm(way) == pytest.approx(2 * 100 * 0.2)


@pytest.mark.parametrize("name", ["needle", "edge", "pellet"])
def test_the_forces_are_slopes_of_the_energy(name, rng):
    system, term, x = bind(SHAPES[name], stiffness=50.0)
    top = {"needle": 1e-3, "edge": 0.0, "pellet": 2e-3}[name]
    x[:, 2] = top + 0.5e-3 + 1e-5 * rng.standard_normal(len(x))
    check_slopes(system, x, 0.0, rng, size=1e-8)
    assert term.push(x, 0.0)[:, 2].sum() > 0


@pytest.mark.parametrize("name", ["table", "plate"])
def test_the_energy_has_no_jump_where_pairs_of_edges_become_pairs_of_points(name):
    """Slopes of random places near large faces: an area cut off for a pair made the energy jump."""
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.05, element="P2")
    obstacle = fc.Obstacle(SHAPES[name], gap=0.01, stiffness=200.0)
    term = fc.System(cloth, FABRIC, [obstacle]).bound[0]
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x = near(cloth, obstacle, 0.0, rng.uniform(0, 6))
        s, eps = rng.standard_normal(x.shape), 1e-7
        slope = (term.energy(x + eps * s, 0.0) - term.energy(x - eps * s, 0.0)) / (2 * eps)
        assert -(term.push(x, 0.0) * s).sum() == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize(("part", "skeleton"), [(0.8, True), (1.25, False)])
def test_the_skeleton_acts_where_the_shape_is_thinner_than_four_eighths_of_an_edge(part, skeleton):
    width = part * 4 * 0.05 * math.sqrt(2) / 8 - 2e-3
    _, term, _ = bind(S.Sphere((0.1, 0.1, -1.0), width / 2))
    assert isinstance(term, BoundSkeleton if skeleton else BoundObstacle)


@pytest.mark.parametrize("name", ["table", "plate"])
def test_a_wide_shape_with_edges_acts_by_its_skeleton_where_the_toolkit_is(name, monkeypatch):
    """Without it the cloth touches the shape by its points, and a doubt says what edges may cut."""
    assert isinstance(bind(SHAPES[name])[1], BoundSkeleton)
    assert not warnings_before(bind(SHAPES[name])[0], 0.01, 0.1)
    monkeypatch.setattr(obstacles, "is_installed", lambda: False)
    assert isinstance(bind(SHAPES[name])[1], BoundObstacle)
    assert "or install ipctk" in warnings_before(bind(SHAPES[name])[0], 0.01, 0.1)[0]


@pytest.mark.parametrize(("part", "refused"), [(0.8, True), (1.25, False)])
def test_without_the_toolkit_what_fits_between_the_points_is_refused(part, refused, monkeypatch):
    monkeypatch.setattr(obstacles, "is_installed", lambda: False)
    width = part * 0.05 * math.sqrt(2) / 8 - 2e-3
    rod = S.Capsule((-0.1, 0.1, -0.01), (0.3, 0.1, -0.01), width / 2)
    if refused:
        with pytest.raises(InputError, match=r"Capsule is .* mm wide.*an eighth.*ipctk"):
            bind(rod)
    else:
        assert isinstance(bind(rod)[1], BoundObstacle)


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")  # its steps are coarse
@pytest.mark.parametrize("beside", [0.005, 0.02])
def test_a_needle_lifts_a_triangle_with_nodes_that_are_held(beside):
    """Its tip rises by 2.5 mm a step, where the triangles keep nodes of the border."""
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.03)
    axis = (0.107, beside, -0.2), (0.107, beside, -0.001)
    needle = fc.Obstacle(S.Capsule(*axis, 5e-4, motion=(0, 0, "0.5 * t")), gap=2e-4)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK(), needle], ["boundary"])
    tip, t_end = -0.001 + 5e-4, 0.01
    result = fc.run(system, fc.BackwardEuler(), system.rest(), dt=0.005, t_end=t_end)
    assert result.state.x[:, 2].max() > tip + 0.5 * t_end
    assert system.bound[-1].allows(result.state.x, t_end)
