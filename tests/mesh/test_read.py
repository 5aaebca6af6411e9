"""Mesh files: groups and sets, sizes, numbers, and rejected files."""

import math
import os

import meshio
import numpy as np
import pytest
from support.meshed import MESHES, QUAD_T, QUAD_X, areas, length, rejects
from support.tiers import stories_except
from support.wrong_calls import FILES

from fecloth.errors import MeshError
from fecloth.mesh.flat_mesh import quality
from fecloth.mesh.generate import rectangle
from fecloth.mesh.read import read, read_surface


@pytest.mark.parametrize(
    ("name", "groups", "area"),
    [
        ("square", {"left": 1, "right": 1, "top": 1, "bottom": 1}, 1.0),
        ("disk", {"rim": math.pi}, math.pi / 4),
        ("flag", {"hoist": 1, "top": 1.5, "bottom": 1.5, "fly": 2 * math.hypot(0.5, 0.2)}, 1.4),
        ("panel", {"hem": 0.5, "cuffs": 0.44, "neck": 0.14 * math.pi}, None),
        ("graded", {"left": 1, "right": 1, "top": 1, "bottom": 1}, 1.0),
    ],
)
def test_committed_geometries(name, groups, area):
    mesh = read(MESHES / f"{name}.geo")
    for group, expected in groups.items():
        assert length(mesh, group) == pytest.approx(expected, rel=0.02)
        assert set(mesh.node_sets[group]) == set(mesh.edge_sets[group].ravel())
    if name == "panel":
        area = 0.5 * 0.48 + 0.8 * 0.22 - math.pi * 0.07**2
    assert areas(mesh).sum() == pytest.approx(area, rel=0.01)
    assert quality(mesh.X, mesh.triangles).min() > 0.5


def geo(tmp_path, old="", new="", extra=""):
    text = (MESHES / "square.geo").read_text()
    assert old in text
    path = tmp_path / "s.geo"
    path.write_text(text.replace(old, new) + extra)
    return path


@pytest.mark.stories
def test_h_without_a_constant_bounds_all_sizes(tmp_path):
    header = 'DefineConstant[ h = {0.05, Min 0.0005, Max 1, Name "Parameters/h"} ];'
    path = geo(tmp_path, header, "h = 0.3;")
    own, fine, coarse = read(path), read(path, h=0.1), read(path, h=0.5)
    assert len(coarse.triangles) < len(own.triangles) < len(fine.triangles)
    assert math.sqrt(4 / math.sqrt(3) / len(fine.triangles)) == pytest.approx(0.1, rel=0.1)
    plain = geo(tmp_path, header, "DefineConstant[ h = 0.3 ];")
    assert len(read(plain, h=0.1).triangles) == len(fine.triangles)


def test_groups_without_name_and_shared_groups(tmp_path):
    extra = (
        'Physical Curve(77) = {1, 2};\nPhysical Point(78) = {3};\nPhysical Surface("b") = {1};\n'
    )
    mesh = read(geo(tmp_path, extra=extra))
    assert length(mesh, "curve_77") == pytest.approx(2)
    assert mesh.X[mesh.node_sets["point_78"]].tolist() == [[1, 1]]
    assert len(mesh.node_sets["b"]) == len(mesh.X)


def test_construction_points_and_curves_are_dropped(tmp_path):
    extra = "Point(9) = {3, 3, 1, h};\nPoint(10) = {4, 3, 1, h};\nLine(9) = {9, 10};\n"
    assert read(geo(tmp_path, extra=extra)).X.max() == 1


def test_geo_file_with_errors_is_rejected(tmp_path):
    rejects(["cannot read", "s.geo"], geo(tmp_path, extra="Point(9) = {0, 0} {};\n"), by=read)
    extra = 'Physical Point("a") = {1}; Physical Point("b") = {2};'
    assert {"a", "b"} <= read(geo(tmp_path, extra=extra)).node_sets.keys()


def test_both_msh_versions_agree():
    a, b = read(MESHES / "square_22.msh"), read(MESHES / "square_41.msh")
    assert np.array_equal(a.X, b.X)
    assert np.array_equal(a.triangles, b.triangles)
    for x, y in ((a.node_sets, b.node_sets), (a.edge_sets, b.edge_sets)):
        assert sorted(x) == sorted(y)
        assert all(np.array_equal(x[name], y[name]) for name in x)
    assert a.node_sets.keys() >= {"left", "right", "top", "bottom", "corners", "sheet", "boundary"}


def test_a_file_with_its_own_numbers_of_nodes_and_elements():
    """Node 50 belongs to no element."""
    mesh = read(FILES / "own_numbers.msh")
    assert mesh.X.tolist() == QUAD_X
    assert mesh.edge_sets["hem"].tolist() == [[0, 1]]


def test_repeated_triangles_of_a_surface_in_two_groups(tmp_path):
    text = (FILES / "own_numbers.msh").read_text()
    two = text.replace('2\n1 5 "hem"', '3\n2 7 "again"\n1 5 "hem"').replace("\n3\n1 1", "\n5\n1 1")
    copies = "11 2 2 7 1 10 20 30\n12 2 2 7 1 10 30 40\n$EndElements"
    (path := tmp_path / "two.msh").write_text(two.replace("$EndElements", copies))
    mesh = read(path)
    assert len(mesh.triangles) == 2
    assert mesh.node_sets["again"].tolist() == mesh.node_sets["sheet"].tolist() == [0, 1, 2, 3]


def saved(tmp_path, name, cells, points=None, **extra):
    path = tmp_path / name
    points = np.array(QUAD_X if points is None else points, dtype=float)
    if points.shape[1] == 2:
        points = np.c_[points, 0 * points[:, 0]]
    meshio.Mesh(points, cells, **extra).write(path)
    return path


@pytest.mark.parametrize(
    "suffix", stories_except([".vtu", ".vtk", ".obj", ".ply", ".off", ".inp"], ".vtu", ".obj")
)
def test_round_trip_through_meshio(tmp_path, suffix):
    mesh = rectangle(1.0, 0.5, 0.2)
    back = read(saved(tmp_path, f"s{suffix}", [("triangle", mesh.triangles)], mesh.X))
    np.testing.assert_allclose(back.X, mesh.X, atol=1e-6 if suffix == ".ply" else 1e-12)
    assert np.array_equal(back.triangles, mesh.triangles)
    assert np.array_equal(back.edge_sets["boundary"], mesh.edge_sets["boundary"])


def test_meshio_sets_through_a_file(tmp_path):
    cells = [("line", [[0, 1], [1, 2]]), ("triangle", QUAD_T)]
    sets = {"cell_sets": {"half": [[], [1]], "side": [[1], []]}, "point_sets": {"pin": [3]}}
    mesh = read(saved(tmp_path, "s.inp", cells, **sets))
    assert mesh.node_sets["pin"].tolist() == [3]
    assert mesh.node_sets["half"].tolist() == [0, 2, 3]
    assert mesh.edge_sets["side"].tolist() == [[1, 2]]
    assert mesh.node_sets["boundary"].tolist() == [0, 1, 2, 3]


def test_an_unknown_suffix_is_refused_with_those_that_are_known(tmp_path):
    odd = tmp_path / "sheet.docx"
    odd.write_text("x")
    rejects(["unknown suffix '.docx'", ".vtu"], odd, by=read)


@pytest.mark.parametrize("suffix", stories_except([".vtu", ".vtk"], ".vtu"))
def test_a_broken_file_is_refused_by_its_name(tmp_path, suffix):
    path = tmp_path / f"broken{suffix}"
    path.write_text("rubbish")
    rejects([path.name], path, by=read)


@pytest.mark.skipif(not hasattr(os, "sysconf"), reason="limits of processes are of POSIX")
@pytest.mark.parametrize("reader", [read, read_surface])
def test_a_file_that_takes_the_memory_is_refused(tmp_path, reader):
    """A file of 100 characters that announces points for three quarters of the memory."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    head = "# vtk DataFile Version 4.2\nsheet\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
    (tmp_path / "sheet.vtk").write_text(f"{head}POINTS {int(0.75 * memory / 24)} double\n")
    with pytest.raises(MeshError, match=r"sheet\.vtk: the file takes too much memory: must fit"):
        reader(tmp_path / "sheet.vtk")
