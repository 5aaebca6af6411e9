"""fecloth export: a run for other programs, read back with their own libraries."""

import math
from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.frame_reader import Series, straight
from fecloth.view.export import _changes
from fecloth.view.exported_run import node_normals, texture_coordinates


@pytest.fixture(scope="module", params=["P1", "P2"])
def run(request, tmp_path_factory):
    """Frames of a sheet that falls on a ball that moves; at 0, 0.02 and 0.05 s."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "scene.toml").write_text(f"""
        [cloth]
        shape = "rectangle"
        width = 1.0
        height = 0.5
        h = 0.25
        element = "{request.param}"
        [fabric]
        areal_density = 0.2
        tensile_stiffness = 500.0
        [[terms]]
        type = "StVK"
        [[terms]]
        type = "Gravity"
        [[terms]]
        type = "Obstacle"
        shape = {{ type = "Sphere", center = [0.5, 0.25, -0.2], radius = 0.1 }}
        [time]
        method = "backward_euler"
        dt = 0.01
        t_end = 0.05
        [output]
        every_steps = 2
        """)
    assert main(["run", str(folder / "scene.toml"), "-o", str(folder / "out")]) == 0
    return folder / "out"


def cloth_of(run, i):
    frame = Series.open(run).read(i)
    return frame.points, straight(frame.cells), frame.point_data["displacement"]


def test_usd_has_the_positions_normals_and_texture_at_their_times(run, tmp_path):
    Usd, Geom = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    target = tmp_path / "cloth.usda"
    assert main(["export", str(run), "-o", str(target), "--fps", "50"]) == 0
    stage, times = Usd.Stage.Open(str(target)), Series.open(run).times
    assert Geom.GetStageUpAxis(stage) == "Z"
    assert Geom.GetStageMetersPerUnit(stage) == 1
    assert stage.GetTimeCodesPerSecond() == 50
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == pytest.approx((0, 2.5))
    mesh = Geom.Mesh(stage.GetPrimAtPath("/World/Cloth"))
    assert mesh.GetPointsAttr().GetTimeSamples() == pytest.approx([50 * t for t in times])
    for i, t in enumerate(times):
        points, triangles, u = cloth_of(run, i)
        assert np.allclose(mesh.GetPointsAttr().Get(50 * t), points, atol=1e-7)
        for code in (50 * t, Usd.TimeCode.Default()):
            indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(code)).reshape(-1, 3)
            assert np.array_equal(indices, triangles)
            assert list(mesh.GetFaceVertexCountsAttr().Get(code)) == [3] * len(triangles)
        normals = mesh.GetNormalsAttr().Get(50 * t)
        assert np.allclose(normals, node_normals(points, triangles), atol=1e-6)
    assert not mesh.GetFaceVertexIndicesAttr().ValueMightBeTimeVarying()
    assert not mesh.GetFaceVertexCountsAttr().GetTimeSamples()
    assert mesh.GetNormalsInterpolation() == "vertex"
    st = Geom.PrimvarsAPI(mesh).GetPrimvar("st")
    assert st.GetInterpolation() == "vertex"
    assert np.allclose(st.Get(), (points - u)[:, :2], atol=1e-6)  # the longer side is 1 m long
    ball = Geom.Mesh(stage.GetPrimAtPath("/World/Obstacles"))
    away = np.array(ball.GetPointsAttr().Get(0)) - [0.5, 0.25, -0.2]
    assert np.allclose(np.linalg.norm(away, axis=1), 0.1, atol=1e-6)
    outwards = np.einsum("ni,ni->n", away, np.array(ball.GetNormalsAttr().Get(0)))
    assert outwards.min() > 0.09
    assert not ball.GetPointsAttr().GetTimeSamples()  # it does not move
    assert ball.GetNormalsInterpolation() == "vertex"


def test_obj_files_have_the_frames(run, tmp_path):
    files = fc.export(run, tmp_path / "frames" / "cloth.obj")
    assert [file.name for file in files] == [f"cloth_{i:04d}.obj" for i in range(len(files))]
    assert len(files) == len(Series.open(run).times) == 4
    points, triangles, u = cloth_of(run, 3)
    lines = [line.split() for line in files[3].read_text().splitlines()]
    rows = {key: [line[1:] for line in lines if line[0] == key] for key in ("v", "vt", "vn", "f")}
    v, st, vn = (np.array(rows[key], float) for key in ("v", "vt", "vn"))
    assert np.allclose(v[: len(points)], points, atol=1e-6)
    assert np.allclose(st, (points - u)[:, :2], atol=1e-6)
    assert np.allclose(vn[: len(points)], node_normals(points, triangles), atol=1e-6)
    cloth, ball = rows["f"][: len(triangles)], rows["f"][len(triangles) :]
    assert cloth == [["/".join([str(i + 1)] * 3) for i in row] for row in triangles]
    corners = np.array([[corner.split("//") for corner in row] for row in ball], int) - 1
    assert np.array_equal(corners[..., 0], corners[..., 1])
    assert (corners.min(), corners.max()) == (len(points), len(v) - 1)
    assert np.allclose(np.linalg.norm(v[len(points) :] - [0.5, 0.25, -0.2], axis=1), 0.1)


def test_obj_files_at_a_rate_lie_between_the_frames(run, tmp_path):
    """The frames are at 0, 0.02, 0.04 and 0.05 s; 100 files a second are at 0, 0.01, … 0.05 s."""
    files = fc.export(run, tmp_path / "cloth.obj", fps=100)
    assert len(files) == 6
    frames = [cloth_of(run, i)[0] for i in range(4)]
    expected = [frames[0], (frames[0] + frames[1]) / 2, frames[1], (frames[1] + frames[2]) / 2]
    for file, x in zip(files, [*expected, frames[2], frames[3]], strict=True):
        v = [line.split()[1:] for line in file.read_text().splitlines() if line[:2] == "v "]
        assert np.allclose(np.array(v, float)[: len(x)], x, atol=1e-6)
    assert len(fc.export(run, tmp_path / "slow.obj", fps=30)) == 2  # at 0 and 1/30 s


@pytest.mark.parametrize("named", [False, True])
def test_each_piece_of_a_cloth_is_a_mesh(tmp_path, named):
    names = ["Cloth_front", "Cloth_back__"] if named else ["Cloth_1", "Cloth_2"]
    Usd, Geom = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    pieces = [fc.Cloth.rectangle(w, 1.0, h=0.5, pattern="right", element="P2") for w in (1.0, 2.0)]
    cloth = fc.Cloth.join(pieces, names=["front", "back"])
    system = fc.System(cloth, fc.Fabric(0.2, 1e3, 0.3), [fc.StVK()])
    state = replace(system.rest(), t=0.5, x=system.rest().x + 0.5 * (cloth.X[:, :1] > 0.9))
    fc.write_vtk(tmp_path / "out", cloth, [system.rest(), state])
    if named:
        scene = '[cloth.pieces.front]\nh = 1\n[cloth.pieces."back ä"]\nh = 1\n'
        (tmp_path / "scene.resolved.toml").write_text(scene, encoding="utf-8")
    fc.export(tmp_path / "out", tmp_path / "cloth.usda")
    stage = Usd.Stage.Open(str(tmp_path / "cloth.usda"))
    assert [p.GetName() for p in stage.GetPrimAtPath("/World").GetChildren()] == names
    text = fc.export(tmp_path / "out", tmp_path / "cloth.obj")[1].read_text()
    objects = [line[2:] for line in text.splitlines() if line[:2] == "o "]
    assert objects == [name.lower() for name in names]
    v = np.array([line.split()[1:] for line in text.splitlines() if line[:2] == "v "], float)
    faces = [line.split()[1:] for line in text.splitlines() if line[:2] == "f "]
    corners = np.array([[corner.split("/") for corner in face] for face in faces], int) - 1
    assert len(np.unique(corners[..., 0])) == len(v) == len(cloth.X)
    first = 0
    for prim, name, piece in zip(names, ["front", "back"], pieces, strict=True):
        nodes = cloth.nodes(name)
        mesh = Geom.Mesh(stage.GetPrimAtPath(f"/World/{prim}"))
        for code, x in ((0.0, system.rest().x), (12.0, state.x)):
            assert np.allclose(mesh.GetPointsAttr().Get(code), x[nodes], atol=1e-6)
        indices = np.array(mesh.GetFaceVertexIndicesAttr().Get())
        assert len(indices) == 3 * 4 * len(piece.triangles)
        assert np.array_equal(np.unique(indices), np.arange(len(nodes)))
        assert len(Geom.PrimvarsAPI(mesh).GetPrimvar("st").Get()) == len(nodes)
        assert np.allclose(v[first : first + len(nodes)], state.x[nodes], atol=1e-6)
        first += len(nodes)


def test_an_obstacle_that_moves_or_changes_has_all_times():
    same, other = np.zeros((2, 3)), np.ones((2, 3))
    assert _changes([0.0, 1.0, 2.0], [same, same.copy(), same]) == [0.0]
    assert _changes([0.0, 1.0, 2.0], [same, same, other]) == [0.0, 1.0, 2.0]


def test_normals_of_a_fold_lie_between_its_sides_by_area():
    """Two triangles that share an edge, of areas 1 and 2, at a right angle."""
    points = np.array([[0, 0, 0], [0, 1, 0], [2, 0, 0], [0, 0, -4.0], [9, 9, 9]])
    triangles = np.array([[0, 2, 1], [0, 1, 3]])  # normals z and −x … of areas 1 and 2
    normals = node_normals(points, triangles)
    assert np.allclose(normals[2], [0, 0, 1])
    assert np.allclose(abs(normals[3]), [1, 0, 0])
    assert np.allclose(normals[0], (normals[2] + 2 * normals[3]) / math.sqrt(5))
    assert np.array_equal(normals[4], [0, 0, 1])  # of no triangle


def test_texture_coordinates_keep_the_shape():
    st = texture_coordinates(np.array([[-1.0, 2.0], [3.0, 2.0], [-1.0, 4.0]]))
    assert st.tolist() == [[0, 0], [1, 0], [0, 0.5]]


def test_numbered_files_of_a_longer_run_are_not_mixed_with_a_shorter_one(run, tmp_path):
    fc.export(run, tmp_path / "a.obj")
    fc.export(run, tmp_path / "a.obj")  # the same run may be written again
    (tmp_path / "a_0004.obj").write_text("o cloth\n")
    with pytest.raises(fc.InputError, match=r"a_0004.obj: is of a run with more than 4 frames"):
        fc.export(run, tmp_path / "a.obj")
