"""Frames as meshio, VTK and ParaView read them, and what a killed run leaves behind."""

from __future__ import annotations

import errno
import json
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.output.atomic_files import append_in_place
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Series
from fecloth.output.frames import Frames, read_frame, write_vtk
from fecloth.verify import trial_states

SHAPE = {"E11", "E22", "E12", "principal_stretches", "warp", "weft", "strain_tensor", "quality"}
KINEMATIC = SHAPE | {"region"}


@pytest.fixture(scope="module")
def system():
    cloth = fc.Cloth.rectangle(0.6, 0.4, h=0.1, pattern="equilateral")
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=900.0, poisson_ratio=0.3)
    return fc.System(cloth, fabric, [fc.StVK(), fc.TensorCondition(50.0), fc.Gravity()])


@pytest.fixture(scope="module")
def states(system):
    rng = np.random.default_rng(3)
    start = system.rest()
    return [
        system.state(start.x + 0.01 * rng.standard_normal(start.x.shape), rng.random(start.x.shape))
        for _ in range(3)
    ]


def stored(name, values):
    """What a frame holds of an array: float64 of the state, float32 of what is only drawn."""
    return values if name == "velocity" or values.dtype != float else values.astype(np.float32)


def at(state, t):
    return replace(state, t=t)


def listed(pvd):
    """(time, file) of a .pvd."""
    entries = ET.parse(pvd).getroot().iter("DataSet")
    return [(float(e.get("timestep")), pvd.parent / e.get("file")) for e in entries]


# --- what a frame shows ---------------------------------------------------------------------------


def test_uniform_stretch_has_its_closed_form(system):
    F = np.array([[1.1, 0.25], [-0.1, 0.9], [0.2, 0.3]])
    _, cells = fields(system, system.state(system.cloth.X @ F.T))
    C = F.T @ F - np.eye(2)
    E = C / 2
    Y, nu, k = 900.0, 0.3, 50.0
    S = Y / (1 - nu**2) * ((1 - nu) * E + nu * np.trace(E) * np.eye(2)) + 2 * k * C
    W = Y / (2 * (1 - nu**2)) * ((1 - nu) * np.sum(E * E) + nu * np.trace(E) ** 2)
    W += k / 2 * np.sum(C * C)
    expected = {
        "E11": E[0, 0],
        "E22": E[1, 1],
        "E12": E[0, 1],
        "principal_stretches": np.linalg.svd(F)[1][::-1],
        "S11": S[0, 0],
        "S22": S[1, 1],
        "S12": S[0, 1],
        "energy_density": W,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(cells[name], np.broadcast_to(value, cells[name].shape), 1e-11)
    cauchy = F @ S @ F.T / np.sqrt(np.linalg.det(F.T @ F))
    turned = np.linalg.svd(F, full_matrices=False)
    R = turned[0] @ turned[2]
    stresses = np.linalg.eigvalsh(R.T @ cauchy @ R)
    np.testing.assert_allclose(cells["principal_stresses"][0], stresses, 1e-11)
    for name, tensor in (("stress_tensor", cauchy), ("strain_tensor", R @ E @ R.T)):
        size = np.abs(tensor).max()
        np.testing.assert_allclose(cells[name][0].reshape(3, 3), tensor, atol=1e-6 * size)
    norm = np.linalg.norm(cells["strain_tensor"], axis=1)
    np.testing.assert_allclose(norm, np.linalg.norm(E), 1e-6)


def test_held_counts_the_directions_that_pins_hold():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    pins = ["left", fc.Slide("right", direction=(1, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], pins)
    held = fields(system, system.rest())[0]["held"]
    for name, count in (("left", 3), ("right", 2)):
        assert (held[cloth.nodes(name)] == count).all()
    assert held.sum() == 5 * len(cloth.nodes("left"))


def test_a_collapsed_triangle_has_finite_arrays(system):
    state = system.state(np.zeros_like(system.rest().x))
    for arrays in fields(system, state):
        assert all(np.isfinite(values).all() for values in arrays.values())


def test_cell_data_belongs_to_its_triangle(system):
    """One node moved: only the triangles around it are strained; and W adds up to the energy."""
    node = len(system.cloth.X) // 2
    x = system.rest().x
    x[node, 0] += 0.01
    points, cells = fields(system, system.state(x))
    around = (system.cloth.triangles == node).any(axis=1)
    for name in ("strain_tensor", "stress_tensor"):
        np.testing.assert_array_equal(np.abs(cells[name]).max(axis=1) > 1e-12, around)
    energies = system.energies(system.state(x))
    stored = system.cloth.weights.sum(axis=1) @ cells["energy_density"]
    assert stored == pytest.approx(energies["StVK"] + energies["TensorCondition"], rel=1e-12)
    moved = np.zeros_like(x)
    moved[node, 0] = 0.01
    np.testing.assert_allclose(points["displacement"], moved, atol=1e-15)
    np.testing.assert_array_equal(cells["quality"], system.cloth.quality)


def test_without_a_membrane_there_is_no_stress(system):
    bare = fc.System(system.cloth, system.fabric, [fc.Gravity()])
    assert set(fields(bare, bare.rest())[1]) == KINEMATIC


def test_the_triangles_of_several_pieces_have_its_number(system):
    both = fc.Cloth.join([system.cloth, system.cloth], names=["front", "back"])
    _, cells = fields(system.replace(cloth=both), system.replace(cloth=both).rest())
    assert (np.flatnonzero(cells["piece"] == 1) == both.region("back")).all()
    assert set(np.unique(cells["piece"])) == {0, 1}


# --- read back ------------------------------------------------------------------------------------


def test_a_frame_is_written_in_no_more_than_copies(system, states, tmp_path):
    """No array is compressed, and what does not belong to the state has 4 bytes a number."""
    file = write_vtk(tmp_path / "a", system.cloth, states[0], system).with_name("a_000000.vtu")
    points, cells = fields(system, states[0])
    numbers = sum(data.size for data in (*points.values(), *cells.values()) if data.itemsize > 1)
    n, m = len(system.cloth.X), len(system.cloth.triangles)
    beside = n * (24 + 12 + 1) + m * (3 + 1) * 4 + m  # float64 of the state, held, triangles
    blocks = 6 + len(points) + len(cells)  # each begins with the number of its bytes
    text = file.read_bytes()
    head = text.index(b"_", text.index(b"<AppendedData")) + 1
    tail = len(b"\n</AppendedData>\n</VTKFile>\n")
    assert len(text) - head - tail == 4 * numbers + beside + 8 * (blocks - 1) + 8


def test_vtk_reads_the_same_numbers_names_and_times(system, states, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    times = [0.0, 0.1, 0.30000000000000004]
    series = [at(state, t) for state, t in zip(states, times, strict=True)]
    pvd = write_vtk(tmp_path / "swing", system.cloth, series, system)
    reader = pyvista.PVDReader(pvd)
    assert reader.time_values == times
    reader.set_active_time_point(2)
    grid = reader.read()[0]
    points, cells = fields(system, states[2])
    np.testing.assert_array_equal(grid.points, states[2].x)
    np.testing.assert_array_equal(grid.cells.reshape(-1, 4)[:, 1:], system.cloth.triangles)
    assert set(grid.celltypes) == {pyvista.CellType.TRIANGLE}
    for name, value in points.items():
        np.testing.assert_array_equal(grid.point_data[name], stored(name, value))
    for name, value in cells.items():
        np.testing.assert_array_equal(grid.cell_data[name], stored(name, value))
    assert grid.field_data["TimeValue"].tolist() == [times[2]]
    strain = grid.GetCellData().GetArray("strain_tensor")
    assert [strain.GetComponentName(i) for i in range(3)] == ["XX", "XY", "XZ"]


def test_lists_name_every_frame_at_its_time(system, states, tmp_path):
    times = [0.25, 1 / 3, 2.0]
    series = (at(state, t) for state, t in zip(states, times, strict=True))  # streamed
    pvd = write_vtk(tmp_path / "out" / 'a "b" & c', system.cloth, series)
    files = [tmp_path / "out" / f'a "b" & c_00000{i}.vtu' for i in range(3)]
    assert listed(pvd) == list(zip(times, files, strict=True))
    assert all(file.is_file() for file in files)
    text = json.loads((tmp_path / "out" / 'a "b" & c.vtu.series').read_text())
    assert text == {
        "file-series-version": "1.0",
        "files": [{"name": f.name, "time": t} for f, t in zip(files, times, strict=True)],
    }
    assert set(meshio.read(files[0]).cell_data) == SHAPE  # no system, no stress
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_frame_read_back_is_the_state(element, tmp_path):
    """And meshio reads its positions, cells and energy; triangles of P2 are quadratic ones."""
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.1, element=element)
    system = fc.System(cloth, fc.Fabric(0.15, 2000.0), [fc.StVK()])
    _, x, v = trial_states(cloth)[0]
    state = system.state(x, v, t=0.1 + 0.2)
    file = Frames(tmp_path / "a", cloth, system).add(state)
    back = read_frame(file, cloth)
    assert back.t == state.t
    np.testing.assert_array_equal(back.x, state.x)
    np.testing.assert_array_equal(back.v, state.v)
    back.x[0] = 0.0  # its own writable arrays
    mesh = meshio.read(file)
    kind = {"P1": "triangle", "P2": "triangle6"}[element]
    assert np.array_equal(mesh.cells_dict[kind], cloth.cells)
    assert np.array_equal(mesh.points, state.x)
    energy = mesh.cell_data["energy_density"][0] @ cloth.weights.sum(axis=1)
    assert energy == pytest.approx(system.energies(state)["StVK"], rel=1e-7)


def test_a_frame_of_something_else_is_refused(system, states, tmp_path):
    cloth = system.cloth
    file = Frames(tmp_path / "a", cloth).add(states[0])
    with pytest.raises(InputError, match=f"{len(cloth.X)} nodes: the cloth has 9"):
        read_frame(file, fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right"))
    flipped = fc.Cloth.from_arrays(cloth.X, cloth.triangles[::-1], renumber=False)
    with pytest.raises(InputError, match="join other nodes"):
        read_frame(file, flipped)
    plain, text = tmp_path / "plain.vtu", file.read_bytes()
    meshio.write(plain, meshio.Mesh(states[0].x, [("triangle", cloth.triangles)]))
    with pytest.raises(InputError, match="no velocity"):
        read_frame(plain, cloth)
    plain.write_bytes(text.replace(b"TimeValue", b"Time"))
    with pytest.raises(InputError, match="no TimeValue"):
        read_frame(plain, cloth)
    plain.write_bytes(text[: len(text) // 2])
    with pytest.raises(InputError, match=r"plain.vtu: cannot be read"):
        read_frame(plain, cloth)


# --- disk full ------------------------------------------------------------------------------------


def test_a_full_disk_names_the_file_and_keeps_the_old_one(system, states, tmp_path, monkeypatch):
    frames = Frames(tmp_path / "a", system.cloth)
    frames.add(states[0])

    def full(path, data):
        with path.open("wb") as stream:
            stream.write(data[:10])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError) as failed:
        frames.add(states[1])
    assert str(failed.value) == (
        f"{tmp_path / 'frames' / 'frame_000001.vtu'} cannot be written: No space left on device. "
        "Free space or choose another folder."
    )
    monkeypatch.undo()
    assert not list(tmp_path.rglob("*.part"))
    assert len(listed(tmp_path / "a.pvd")) == len(frames.times) == 1


def test_a_list_grows_in_place(system, states, tmp_path):
    frames = Frames(tmp_path / "run", system.cloth, system)
    frames.add(states[0])
    lists = [tmp_path / "run.pvd", tmp_path / "run.vtu.series"]
    begun = [file.stat().st_ino for file in lists]
    for state in states[1:]:
        frames.add(state)
    assert [file.stat().st_ino for file in lists] == begun


def test_a_list_that_cannot_grow_keeps_its_end(tmp_path):
    resource = pytest.importorskip("resource")
    file = tmp_path / "list"
    file.write_bytes(b"one two END")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (14, limits[1]))
    try:
        with pytest.raises(InputError, match="list cannot be written"):
            append_in_place(file, b"three four END", 3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert file.read_bytes() == b"one two END"


@pytest.mark.filterwarnings("ignore:The default value of `algorithm`")
def test_vtk_finds_the_curved_area(tmp_path):
    """VTK uses its own shape functions; a wrong order of the nodes would change the area."""
    pyvista = pytest.importorskip("pyvista")
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="cross", element="P2")
    x = np.column_stack([cloth.X, 0.2 * cloth.X[:, 0] ** 2])
    fc.write_vtk(tmp_path / "b", cloth, fc.State(0.0, x, 0 * x))
    grid = pyvista.read(tmp_path / "b_000000.vtu")
    assert set(grid.celltypes) == {22}
    surface = grid.extract_surface(nonlinear_subdivision=4)
    np.testing.assert_allclose(surface.points[:, 2], 0.2 * surface.points[:, 0] ** 2, atol=1e-6)
    arc = 0.5 * np.sqrt(1.16) + np.arcsinh(0.4) / 0.8  # ∫ √(1 + (0.4 x)²) dx
    assert surface.area == pytest.approx(arc, rel=1e-4)


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"files": [{"time": 1.0}]}', '{"files": 3}'])
def test_a_damaged_list_of_frames_is_named(tmp_path, damage):
    (tmp_path / "run.vtu.series").write_text(damage)
    with pytest.raises(InputError, match=r"run\.vtu\.series: cannot be read"):
        Series.open(tmp_path)
