"""Transient VTKHDF: what VTK's own reader finds at every time after a run."""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from support.rundirs import hdf_values, written
from support.swinging import swinging
from support.tiers import stories_except

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.atomic_files import DiskFull
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Series
from fecloth.output.frames import Frames, write_vtk
from fecloth.output.vtkhdf_writer import gather
from fecloth.runs import run_files
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

is_missing = find_spec("h5py") is None or find_spec("vtk") is None
pytestmark = pytest.mark.skipif(is_missing, reason="needs the extras [hdf] and [view]")


class Reader:
    """VTK's reader on one file."""

    def __init__(self, path):
        import vtk

        self.vtk = vtk.vtkHDFReader()
        self.vtk.SetFileName(str(path))
        self.vtk.UpdateInformation()
        key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
        self.times = list(self.vtk.GetOutputInformation(0).Get(key))

    def at(self, t):
        """Points, cells, and all arrays of a time."""
        from vtk.util.numpy_support import vtk_to_numpy

        self.vtk.UpdateTimeStep(t)
        grid = self.vtk.GetOutput()
        arrays = [
            {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)).copy() for i in range(len_)}
            for data in (grid.GetPointData(), grid.GetCellData())
            for len_ in [data.GetNumberOfArrays()]
        ]
        points = vtk_to_numpy(grid.GetPoints().GetData()).copy()
        cells = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).copy()
        return points, cells.reshape(grid.GetNumberOfCells(), -1), *arrays, grid.GetCellType(0)


def gathered(folder, system, states):
    """The states in one file, written as frames first."""
    write_vtk(folder / "run", system.cloth, states, system)
    return gather(Series.open(folder), folder / "run.vtkhdf")


@pytest.mark.parametrize(("element", "cell"), [("P1", 5), ("P2", 22)])
def test_vtk_reads_every_value_at_every_time(element, cell, tmp_path):
    system, states = swinging(element, h=0.2, dt=0.02, t_end=0.1)
    read = Reader(gathered(tmp_path, system, states))
    assert read.times == [state.t for state in states]
    for state in (*states, *states[::-1]):  # forwards and back, as one drags a slider
        points, cells, point_data, cell_data, kind = read.at(state.t)
        assert kind == cell
        assert np.array_equal(points, state.x)
        assert np.array_equal(cells, system.cloth.cells)
        for result, wanted in zip((point_data, cell_data), fields(system, state), strict=True):
            assert result.keys() == wanted.keys()
            for name, values in wanted.items():
                stored = values if name == "velocity" else values.astype(result[name].dtype)
                assert np.array_equal(result[name], stored), (name, state.t)
                assert result[name].dtype.itemsize <= (8 if name == "velocity" else 4)


def test_the_topology_is_shared(tmp_path):
    system, states = swinging(h=0.2, dt=0.02, t_end=0.1)
    file = gathered(tmp_path, system, states)
    n, m = len(system.cloth.X), len(system.cloth.triangles)
    h5py = pytest.importorskip("h5py")
    with h5py.File(file) as file:
        root = file["VTKHDF"]
        assert root["Connectivity"].shape == (3 * m,)
        assert root["Points"].shape == (6 * n, 3)
        assert root["CellData/quality"].shape == (m,)
        for name in ("PartOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            assert root["Steps"][name].shape[0] == 6
            assert not np.any(root["Steps"][name])


SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.05 }
output = { every_steps = 1 }
"""


def test_a_scene_writes_either_format_with_the_same_numbers(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["run", "scene.toml", "-o", "a", "--quiet"]) == 0
    hdf = ["--set", "output.format='vtkhdf'"]
    assert main(["run", "scene.toml", "-o", "b", *hdf]) == 0
    assert "open b/run.vtkhdf" in capsys.readouterr().out
    read = Reader("b/run.vtkhdf")
    assert len(read.times) == 6
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25)
    for i, t in enumerate(read.times):
        state = fc.read_frame(f"a/frames/frame_{i:06d}.vtu", cloth)
        points, _, point_data, *_ = read.at(t)
        assert state.t == t
        assert np.array_equal(points, state.x)
        assert np.array_equal(point_data["velocity"], state.v)
    assert not list((tmp_path / "b").glob("frames/*"))
    assert main(["run", "scene.toml", "-o", "b", "--overwrite", "--quiet"]) == 0
    assert not (tmp_path / "b" / "run.vtkhdf").exists()


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return load_scene("scene.toml", ["output.format='vtkhdf'", "output.restart_steps=2"])


@pytest.mark.stories
def test_a_full_disk_at_the_end_leaves_the_frames_and_the_run_goes_on(scene, monkeypatch):
    def refuse(*_):
        raise DiskFull("out/run.vtkhdf cannot be written: no space")

    with monkeypatch.context() as patched:
        patched.setattr(run_files, "gather", refuse)
        outcome = run_scene(scene, "out")
    assert outcome.status == "failed"
    assert "no space" in str(outcome.error)
    assert outcome.summary["open"] == "run.pvd"
    assert len(Series.open("out").times) == 6
    assert run_scene(scene, "out", resume=True).summary["open"] == "run.vtkhdf"
    assert Reader("out/run.vtkhdf").times == pytest.approx([0.01 * i for i in range(6)])


def killed_after(count, call, counts=lambda *given: True):
    """A call that ends the process in place of the one after the first `count` that count."""
    left = [None] * count

    def killed(*given, **more):
        if counts(*given):
            if not left:
                raise KeyboardInterrupt
            left.pop()
        return call(*given, **more)

    return killed


def is_of_frames(path):
    return path.suffix in (".pvd", ".series", ".vtu")


@pytest.mark.parametrize("count", stories_except([0, 1, 2, 4], 2))
def test_a_run_that_is_killed_while_it_removes_its_frames_is_whole(scene, monkeypatch, count):
    """Lists and frames, `count` of which are removed before the process ends."""
    run_scene(scene, "whole")
    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", killed_after(count, Path.unlink, is_of_frames))
        with pytest.raises(KeyboardInterrupt):
            run_scene(scene, "out")
    assert len(Reader("out/run.vtkhdf").times) == 6
    goes_on(scene)


@pytest.mark.parametrize("count", stories_except([0, 2, 5], 2))
def test_a_run_that_is_killed_while_it_scatters_its_frames_goes_on(scene, monkeypatch, count):
    """Each frame and the two lists are one file each; then the gathered file is still whole."""
    run_scene(scene, "whole")
    run_scene(scene, "out")
    with monkeypatch.context() as patched:
        patched.setattr(Frames, "add", killed_after(count, Frames.add))
        with pytest.raises(KeyboardInterrupt):
            run_scene(scene, "out", resume=True)
    goes_on(scene)


def goes_on(scene):
    assert len(Series.open("out").times) == 6
    assert run_scene(scene, "out", resume=True).status == "done"
    assert written("out") == written("whole")


@pytest.mark.stories
def test_a_whole_run_goes_on_beyond_its_end(scene):
    keys = ["output.format='vtkhdf'", "output.restart_steps=2"]
    run_scene(scene, "out")
    assert not Path("out/run.pvd").exists()
    for folder, resume in (("out", True), ("whole", False)):
        longer = load_scene("scene.toml", [*keys, "time.t_end=0.08"])
        run_scene(longer, folder, resume=resume)
    assert len(Reader("out/run.vtkhdf").times) == 9
    assert hdf_values("out/run.vtkhdf") == hdf_values("whole/run.vtkhdf")


def test_missing_h5py_is_reported_before_the_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["run", "scene.toml", "-o", "a", "--set", "output.format='vtkhdf'"]) == 2
    assert "pip install" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
