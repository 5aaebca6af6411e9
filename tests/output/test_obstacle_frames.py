"""Obstacles and contact in the frames: what is written, pressure, slip, and going on."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.output.frame_arrays import fields
from fecloth.output.obstacle_frames import ObstacleFrames, find_obstacles, read_obstacles
from fecloth.terms.contact import barrier
from fecloth.view.web_page import _obstacles as pack_obstacles
from fecloth.view.web_page import ground_of

FABRIC = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=1e-4)
UP = (0, 0, 1)


def make(*terms):
    cloth = fc.Cloth.rectangle(0.2, 0.2, h=0.06)
    return fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity(), *terms])


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_all_nodes_at_one_distance_have_one_pressure(element):
    cloth = fc.Cloth.rectangle(0.2, 0.2, h=0.06, element=element)
    plane = fc.Obstacle(fc.shapes.Plane((0, 0, 0), UP), stiffness=100.0)
    system = fc.System(cloth, FABRIC, [fc.StVK(), plane])
    state = system.state(flat(cloth) + [0, 0, 0.5e-3])
    expected = 100.0 * float(barrier.pressure(np.array(0.5)))
    np.testing.assert_allclose(fields(system, state)[0]["contact_pressure"], expected, rtol=1e-10)


def test_slip_is_along_the_obstacle_and_relative_to_it():
    table = fc.shapes.Plane((0, 0, 0), UP, motion=("0.1*t", 0, 0))
    system = make(fc.Obstacle(table))
    x = flat(system.cloth) + [0, 0, 0.5e-3]
    x[0, 2] = 0.1  # this node does not touch
    slip = fields(system, system.state(x, np.tile([0.4, 0.2, -1.0], (len(x), 1))))[0]["slip"]
    np.testing.assert_allclose(slip[1:], np.tile([0.3, 0.2, 0.0], (len(x) - 1, 1)), atol=1e-8)
    assert not slip[0].any()


def test_without_contact_there_are_no_such_arrays():
    system = make()
    assert not {"contact_pressure", "slip"} & fields(system, system.rest())[0].keys()
    assert find_obstacles(system, system.rest().x, 0.0) is None


@pytest.mark.parametrize("moves", [False, True])
def test_obstacles_are_written_when_they_have_moved(moves, tmp_path):
    ball = fc.shapes.Sphere((0.1, 0.1, -0.1), 0.05, motion=("t", 0, 0) if moves else None)
    system = make(fc.Obstacle(ball), fc.Obstacle(fc.shapes.Plane((0, 0, -1), UP)))
    frames, x = ObstacleFrames(tmp_path, system, system.rest().x), system.rest().x
    (tmp_path / "frames").mkdir()
    for i in range(4):
        frames.add(i, fc.State(0.1 * i, x, 0 * x))
    files = sorted(file.name for file in (tmp_path / "frames").iterdir())
    assert files == [f"obstacles_{i:06d}.vtu" for i in range(4 if moves else 1)]
    middle = read_obstacles(tmp_path, 2).points[:-4].mean(axis=0)
    assert middle[0] == pytest.approx(0.1 + (0.2 if moves else 0.0))
    again = ObstacleFrames(tmp_path, system, x)
    again.cut([0.0, 0.1])
    assert len(list((tmp_path / "frames").iterdir())) == (2 if moves else 1)
    again.add(2, fc.State(0.2, x, 0 * x))
    assert (tmp_path / "obstacles.pvd").read_text().count("<DataSet") == (3 if moves else 1)
    read = read_obstacles(tmp_path, 2)
    np.testing.assert_allclose(read.points[:-4].mean(axis=0), middle, atol=1e-12)


def test_a_mesh_obstacle_is_drawn_as_it_is(tmp_path):
    pytest.importorskip("ipctk")
    meshio = pytest.importorskip("meshio")
    points = np.array([[0, 0, -1], [1, 0, -1], [0, 1, -1], [1, 1, -1]], float)
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    meshio.Mesh(points, [("triangle", triangles)]).write(tmp_path / "table.stl")
    system = make(fc.MeshObstacle(tmp_path / "table.stl"))
    shown = find_obstacles(system, system.rest().x, 0.0)
    corners = shown.points[shown.triangles].reshape(-1, 3)
    np.testing.assert_allclose(corners, points[triangles].reshape(-1, 3), atol=1e-12)


@pytest.mark.parametrize(
    ("formula", "shown"),
    [("z + 2", [0, 0, 0]), ("z + 0.1 + 40*t**3", [1, 1, 0]), ("z + 0.4 - 2.5*t", [0, 1, 1])],
    ids=["outside", "leaves", "comes"],
)
def test_a_formula_whose_surface_is_far_away_is_not_drawn(tmp_path, formula, shown):
    pytest.importorskip("meshio")
    system = make(fc.Obstacle(fc.shapes.Sdf(formula)))
    x = system.rest().x
    frames = ObstacleFrames(tmp_path, system, x)
    for i in range(3):
        frames.add(i, fc.State(0.1 * i, x, 0 * x))
    read = [read_obstacles(tmp_path, i) for i in range(3)]
    assert [min(len(surface.triangles), 1) for surface in read] == shown
    assert [min(len(surface.points), 1) for surface in read] == shown
    low, high = x.min(axis=0), x.max(axis=0)
    if not any(shown):
        assert ground_of(low, high, read) == ground_of(low, high, [])
    assert [len(each["points"]) > 0 for each in pack_obstacles(read)] == [
        bool(now) for i, now in enumerate(shown) if i == 0 or (now, shown[i - 1]) != (0, 0)
    ]
