"""Small files as other programs write them: the flat cloth, its start, and frames of a run.

What is read of many more, and why others are refused, is in `tests/messages/files.txt`. Their
files were written by hand, as Gmsh, Blender, CLO, ParaView, MeshLab and Git LFS write them.
"""

import shutil

import numpy as np
import pytest
from support.tiers import in_turn
from support.wrong_calls import FILES

import fecloth as fc
from fecloth.errors import MeshError
from fecloth.mesh.cells import split_quadrilaterals
from fecloth.mesh.read import read_surface

TENT = FILES / "tent.obj"


def rows(key):
    """The numbers of the lines of the tent that begin with this key."""
    lines = map(str.split, TENT.read_text().splitlines())
    return np.array([line[1:] for line in lines if line[0] == key], float)


def test_vt_is_the_cloth_and_v_its_start():
    cloth = fc.Cloth.read(TENT)
    assert np.array_equal(cloth.X, rows("vt")[cloth.source_nodes])
    assert np.array_equal(cloth.start, rows("v")[cloth.source_nodes])
    quadratic = fc.Cloth.read(TENT, element="P2")
    edges = quadratic.cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    middle = quadratic.cells[:, 3:].ravel()
    for values in (quadratic.X, quadratic.start):
        assert np.allclose(values[middle], values[edges].mean(axis=1))


@pytest.mark.parametrize(
    ("stretch", "agrees"), [(1.15, True), (1.25, False), (0.87, True), (0.8, False)]
)
def test_edges_within_20_percent_agree(tmp_path, stretch, agrees):
    """One edge of the flat cloth is longer or shorter than in space; the others are equal."""
    text = TENT.read_text().partition("f ")[0].replace("vt 0 1\n", f"vt 0 {stretch:g}\n")
    text = text.replace(" 0.95 ", " 0.948683 ").replace(" 1.9 ", " 1.897367 ")
    (path := tmp_path / "tent.obj").write_text(
        text + "f 1/1 2/2 4/4\nf 2/2 3/3 5/5\nf 2/2 5/5 4/4\n"
    )
    if agrees:
        assert fc.Cloth.read(path).X[:, 1].max() == pytest.approx(max(1.0, stretch))
    else:
        with pytest.raises(MeshError, match="vt not used"):
            fc.Cloth.read(path)


def test_a_scale_is_of_the_file_or_with_the_reference_vt_of_vt_alone():
    in_mm, by_itself = fc.Cloth.read(TENT, scale=1e-3), fc.Cloth.read(TENT)
    assert np.allclose(in_mm.X, 1e-3 * by_itself.X, atol=0)
    assert np.allclose(in_mm.start, 1e-3 * by_itself.start, atol=0)
    asked = fc.Cloth.read(TENT, reference="vt", scale=0.9)
    assert np.allclose(asked.X, 0.9 * by_itself.X, atol=0)
    assert np.array_equal(asked.start, by_itself.start)


def test_a_tube_is_cut_where_its_texture_is_cut(tmp_path):
    """A closed ring of eight quadrilaterals in space, unrolled by its texture."""
    angle = 2 * np.pi * np.arange(8) / 8
    side = 2 * np.sin(np.pi / 8)
    lines = [f"v {np.cos(a):.7f} {np.sin(a):.7f} {z}" for z in (0, 0.5) for a in angle]
    lines += [f"vt {side * i:.7f} {y}" for y in (0, 0.5) for i in range(9)]
    for i in range(8):
        j = (i + 1) % 8
        corners = [(i, i), (j, i + 1), (8 + j, 10 + i), (8 + i, 9 + i)]
        lines.append("f " + " ".join(f"{v + 1}/{vt + 1}" for v, vt in corners))
    (path := tmp_path / "tube.obj").write_text("\n".join(lines) + "\n")
    cloth = fc.Cloth.read(path)
    assert len(cloth.X) == 18
    assert cloth.area == pytest.approx(8 * side * 0.5)
    assert np.linalg.norm(cloth.start[:, :2], axis=1) == pytest.approx(np.ones(18))
    assert "2 nodes added where the texture is cut" in cloth.notes[-1]
    nodes, triangles = read_surface(path)  # as an obstacle it is closed
    assert (len(nodes), len(triangles)) == (16, 16)


# --- quadrilaterals -------------------------------------------------------------------------------


def test_quadrilaterals_are_split_along_the_better_diagonal():
    kite = np.array([[0.0, 0], [1, -0.2], [3, 0], [1, 0.2]])
    dart = np.array([[0.0, 0], [2, 1], [0.5, 1], [0, 4]])  # reentrant at node 2
    for points, diagonal in ((kite, {1, 3}), (dart, {0, 2}), (dart[[3, 2, 1, 0]], {1, 3})):
        for flip in (1, -1):
            turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
            xyz = np.c_[points * [flip, 1], np.zeros(4)] @ turn + [0.3, -0.2, 0.7]
            a, b = split_quadrilaterals(xyz, np.arange(4)[None]).tolist()
            assert set(a) & set(b) == diagonal


# --- frames of a run ------------------------------------------------------------------------------


@pytest.mark.parametrize(("element", "suffix"), in_turn(["P1", "P2"], [".vtu", ".vtkhdf"]))
def test_a_frame_is_read_as_its_flat_cloth(tmp_path, element, suffix):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right", element=element)
    system = fc.System(cloth, fc.Fabric(0.2, 1e3, 0.3), [fc.StVK()])
    x = system.rest().x @ np.array([[1, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]]) + [0, 0, 2]
    x[:, 2] += 0.1 * cloth.X[:, 0] ** 2
    fc.write_vtk(tmp_path / "run", cloth, [system.state(x)])
    path = tmp_path / "run_000000.vtu"
    if suffix == ".vtkhdf":
        pytest.importorskip("pyvista")
        pytest.importorskip("h5py")
        from fecloth.output.frame_reader import Series
        from fecloth.output.vtkhdf_writer import gather

        path = gather(Series.open(tmp_path / "run"), tmp_path / "run.vtkhdf")
    again = fc.Cloth.read(path)
    assert (again.element, len(again.triangles)) == (element, len(cloth.triangles))
    assert again.area == pytest.approx(cloth.area, rel=1e-6)
    corners = again.source_nodes >= 0
    assert np.allclose(again.start[corners], x[again.source_nodes[corners]], atol=1e-6)
    assert "a frame" in again.notes[0]
    with pytest.raises(MeshError, match="away from the plane"):
        fc.Cloth.read(path, reference="v")


# --- in a scene -----------------------------------------------------------------------------------

SCENE = """
[cloth]
shape = "file"
path = "tent.obj"
{keys}
[fabric]
areal_density = 0.2
tensile_stiffness = 500.0
[[terms]]
type = "StVK"
[start]
shift = [0.0, 0.0, 1.0]
{start}
[time]
method = "backward_euler"
dt = 0.01
t_end = 0.02
"""


def test_a_scene_starts_from_v_and_says_what_was_done(tmp_path):
    shutil.copy(TENT, tmp_path)
    (path := tmp_path / "scene.toml").write_text(SCENE.format(keys="", start=""))
    problem = fc.load_scene(path).build()
    assert problem.start.x[:, 2].max() == pytest.approx(1.3)
    assert any("vt is the flat cloth" in note for note in problem.notes())
    path.write_text(SCENE.format(keys='reference = "vt"\nscale = 2.0', start='plane = "xz"'))
    problem = fc.load_scene(path).build()
    assert np.ptp(problem.start.x, axis=0) == pytest.approx([3.8, 0.0, 2.0])
