"""Transient VTKHDF: what VTK's own reader finds at every time, while a run goes on and after it."""

import sys

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.frame_arrays import fields
from fecloth.output.vtkhdf_writer import HdfFrames

h5py = pytest.importorskip("h5py")
vtk = pytest.importorskip("vtk")
from vtk.util.numpy_support import vtk_to_numpy  # noqa: E402


class Reader:
    """VTK's reader on one file."""

    def __init__(self, path):
        self.vtk = vtk.vtkHDFReader()
        self.vtk.SetFileName(str(path))
        self.vtk.UpdateInformation()
        key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
        self.times = list(self.vtk.GetOutputInformation(0).Get(key))

    def at(self, t):
        """Points, cells, and all arrays of a time."""
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


def swinging(element):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.2, element=element)
    terms = [fc.StVK(), fc.Gravity()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, pins=["left"])
    steps = fc.march(system, fc.BackwardEuler(), system.rest(), dt=0.02, t_end=0.1)
    return system, [system.rest(), *(state for state, info in steps)]


@pytest.mark.parametrize(("element", "cell"), [("P1", 5), ("P2", 22)])
def test_vtk_reads_every_value_at_every_time(element, cell, tmp_path):
    system, states = swinging(element)
    frames = HdfFrames(tmp_path / "run.vtkhdf", system.cloth, system)
    for state in states:
        frames.add(state)
    read = Reader(frames.path)
    assert read.times == [state.t for state in states] == frames.times
    for state in (*states, *states[::-1]):  # forwards and back, as one drags a slider
        points, cells, point_data, cell_data, kind = read.at(state.t)
        assert kind == cell
        assert np.array_equal(points, state.x)
        assert np.array_equal(cells, system.cloth.cells)
        for found, wanted in zip((point_data, cell_data), fields(system, state), strict=True):
            assert found.keys() == wanted.keys()
            for name, values in wanted.items():
                assert np.array_equal(found[name], values), (name, state.t)


def test_each_frame_can_be_read_before_the_next_also_under_a_lock(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    system, states = swinging("P1")
    frames = HdfFrames(tmp_path / "run.vtkhdf", system.cloth, system)
    frames.add(states[0])
    with frames.path.open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_SH)  # as HDF5 itself does for a reader
        for i, state in enumerate(states[1:], 2):
            frames.add(state)
            read = Reader(frames.path)
            assert read.times == [s.t for s in states[:i]]
            assert np.array_equal(read.at(state.t)[0], state.x)


def test_the_topology_is_shared(tmp_path):
    system, states = swinging("P1")
    frames = HdfFrames(tmp_path / "run.vtkhdf", system.cloth, system)
    for state in states:
        frames.add(state)
    n, m = len(system.cloth.X), len(system.cloth.triangles)
    with h5py.File(frames.path) as file:
        root = file["VTKHDF"]
        assert root["Connectivity"].shape == (3 * m,)
        assert root["Points"].shape == (6 * n, 3)
        assert root["CellData/quality"].shape == (m,)
        for name in ("PartOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            assert root["Steps"][name].shape[0] == 6
            assert not np.any(root["Steps"][name])


def test_a_run_goes_on_after_the_frames_it_keeps(tmp_path):
    system, states = swinging("P1")
    first = HdfFrames(tmp_path / "run.vtkhdf", system.cloth, system)
    for state in states[:5]:
        first.add(state)
    again = HdfFrames(first.path, system.cloth, system)
    again.keep(first.times[:2])
    for state in states[2:]:
        again.add(state)
    read = Reader(first.path)
    assert read.times == [state.t for state in states] == again.times
    for state in states:
        points, _, _, cell_data, _ = read.at(state.t)
        assert np.array_equal(points, state.x)
        assert np.array_equal(
            cell_data["energy_density"], fields(system, state)[1]["energy_density"]
        )
    with h5py.File(first.path) as file:
        assert len(file["VTKHDF/Points"]) == 6 * len(system.cloth.X)


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


def test_missing_h5py_is_reported_before_the_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["run", "scene.toml", "-o", "a", "--set", "output.format='vtkhdf'"]) == 2
    assert "pip install" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
