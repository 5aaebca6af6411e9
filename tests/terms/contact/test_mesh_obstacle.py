"""Obstacles of triangles: force and tangent, rest, files, scenes."""

import meshio
import numpy as np
import pytest
from support.obstacles import check_slopes

import fecloth as fc
from fecloth.errors import InputError, MeshError
from fecloth.mesh.read import read_surface
from fecloth.scene.scene import load_scene
from fecloth.study.scene_source import digest_of_files
from fecloth.terms.step_difference import StepDifference

pytest.importorskip("ipctk")
FABRIC = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=1e-5)
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0.0], [-1, 1, 0]])


@pytest.fixture
def table(tmp_path):
    """A plane of two triangles, with its nodes written twice, as in an STL file, in centimetres."""
    soup = 100 * CORNERS[[0, 1, 2, 0, 2, 3]]
    path = tmp_path / "table.stl"
    meshio.write_points_cells(path, soup, [("triangle", np.arange(6).reshape(2, 3))])
    return path


def test_equal_nodes_are_united(table):
    nodes, triangles = read_surface(table)
    assert nodes.shape == (4, 3)
    assert triangles.shape == (2, 3)
    a, b, c = nodes[triangles].transpose(1, 0, 2)
    assert np.cross(b - a, c - a)[:, 2] == pytest.approx(2e4 * 2)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_force_and_tangent_are_derivatives(element, table, rng):
    cloth = fc.Cloth.rectangle(0.3, 0.2, 0.1, element=element)
    term = fc.MeshObstacle(table, gap=0.02, stiffness=200.0, scale=0.01)
    system = fc.System(cloth, FABRIC, [term])
    height = 0.01 + 0.005 * np.sin(20 * cloth.X[:, 0] + 7 * cloth.X[:, 1])
    place = cloth.X + [0.36, -0.27]  # no node over the common edge of both triangles
    check_slopes(system, np.column_stack([place, height]), 0.0, rng, size=2.5e-7)


def test_it_carries_the_weight(table):
    cloth = fc.Cloth.rectangle(0.3, 0.2, 0.05)
    terms = [fc.StVK(), fc.Gravity(), fc.MeshObstacle(table, gap=2e-3, scale=0.01)]
    system = fc.System(cloth, FABRIC, terms, pins=[fc.Slide("corners", direction=(0, 0, 1))])
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 1e-3)])
    state = fc.equilibrium(system, system.state(x))
    push = fc.System(cloth, FABRIC, terms[2:]).force(state).sum(axis=0)
    weight = 9.81 * system.total_mass
    assert push[2] == pytest.approx(weight, rel=1e-6)
    assert 1.5e-3 < state.x[:, 2].min() < state.x[:, 2].max() < 2.1e-3


@pytest.mark.stories
def test_a_cloth_that_falls_on_it_stays_above(table):
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.05)
    ball = fc.MeshObstacle(table, gap=3e-3, friction=0.3, scale=0.01)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.HingeBending(), fc.Gravity(), ball])
    x = np.column_stack([cloth.X, 0.02 + 0.1 * cloth.X[:, 0]])
    least = []
    for state, _ in fc.march(system, fc.BDF2(), system.state(x), 4e-3, 0.2):
        least.append(state.x[:, 2].min())
    assert 0 < min(least) < 3e-3


def test_mistakes(table, tmp_path):
    cloth = fc.Cloth.rectangle(0.3, 0.2, 0.1)
    with pytest.raises(MeshError, match="no such file"):
        fc.System(cloth, FABRIC, [fc.MeshObstacle(tmp_path / "none.stl")])
    lines = tmp_path / "lines.vtu"
    meshio.write_points_cells(lines, CORNERS, [("line", np.array([[0, 1]]))])
    with pytest.raises(MeshError, match="no triangles"):
        fc.System(cloth, FABRIC, [fc.MeshObstacle(lines)])
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.MeshObstacle(table, scale=0.01)])
    tilted = system.state(np.column_stack([cloth.X, cloth.X[:, 0] - 0.15]))
    with pytest.raises(InputError, match="passes through the mesh at the start"):
        fc.run(system, fc.BackwardEuler(), tilted, 0.01, 0.01)


def test_its_file_lies_beside_the_scene(table):
    scene = table.with_name("drop.toml")
    scene.write_text("""
cloth = { shape = "rectangle", width = 0.2, height = 0.2, h = 0.1 }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0 }
terms = [
  { type = "StVK" }, { type = "MeshObstacle", path = "table.stl", gap = "2 mm", scale = 0.01 },
]
start = { shift = [0, 0, 0.1] }
time = { method = "bdf2", dt = 0.01, t_end = 0.02 }
""")
    opened = load_scene(scene)
    assert opened.build().system.bound[1].sets.gap == 0.002
    before = digest_of_files(opened)
    table.write_bytes(table.read_bytes() + b" ")
    assert digest_of_files(opened) != before


def test_the_force_of_a_mesh_that_moves_is_the_derivative_of_its_energy(table, rng):
    """At a time when it has moved and turned; its work is the change of its energy with t."""
    cloth = fc.Cloth.rectangle(0.3, 0.2, 0.1)
    turn = fc.Rotation((0.1, 0.2, 0), (0.2, 0.1, 1), "0.7*t")
    lift = ("0.1*t", 0, "0.05*t")
    term = fc.MeshObstacle(
        table, gap=0.02, stiffness=200.0, scale=0.01, motion=lift, rotate=turn, restitution=1.0
    )
    system, t = fc.System(cloth, FABRIC, [term]), 0.3
    bound = system.bound[-1]
    height = 0.01 + 0.005 * np.sin(20 * cloth.X[:, 0] + 7 * cloth.X[:, 1])
    place = np.column_stack([cloth.X + [0.36, -0.27], height])
    x, dt = bound.body.pose(t).to_space(place), 2.5e-7
    check_slopes(system, x, t, rng, size=dt)
    over = bound.over_step(StepDifference.between(x, dt, t))
    change = 0.5 * (bound.energy(x, t + 2 * dt) - bound.energy(x, t))  # as the force, at t + dt
    assert over.work(x) == pytest.approx(change, rel=1e-5)
