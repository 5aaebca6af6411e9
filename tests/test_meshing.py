"""Meshes: every refusal names its offender; patterns, files and numberings keep the sheet."""

import builtins
import math
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fecloth.errors import InputError, MeshError
from fecloth.meshing import checked, disk, quality, read, rectangle, renumbered

MESHES = Path(__file__).parents[1] / "meshes"
PATTERNS = ["unstructured", "right", "cross", "equilateral"]
STRUCTURED = PATTERNS[1:]
QUAD_X = [[0.0, 0], [1, 0], [1, 1], [0, 1]]
QUAD_T = [[0, 1, 2], [0, 2, 3]]


def areas(mesh):
    a, b, c = (mesh.X[mesh.triangles[:, i]] for i in range(3))
    return 0.5 * np.cross(np.c_[b - a, 0 * a[:, 0]], np.c_[c - a, 0 * a[:, 0]])[:, 2]


def length(mesh, edges):
    return np.linalg.norm(np.diff(mesh.X[mesh.edge_sets[edges]], axis=1), axis=-1).sum()


def refused(what, *args, error=MeshError, by=checked, **kwargs):
    """Call, expect the refusal, and ask that its message holds each of the texts in ``what``."""
    with pytest.raises(error) as caught:
        by(*args, **kwargs)
    for text in what:
        assert text in str(caught.value)
    return str(caught.value)


# --- shapes


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("sides", [(1.0, 1.0, 0.1), (2.0, 0.7, 0.13), (0.3, 1.1, 0.3)])
def test_rectangle_area_and_sets(pattern, sides):
    width, height, h = sides
    mesh = rectangle(width, height, h, pattern)
    assert mesh.X.dtype == np.float64
    assert mesh.triangles.dtype == np.int32
    assert (areas(mesh) > 0).all()
    assert areas(mesh).sum() == pytest.approx(width * height, rel=1e-13)
    x, y = mesh.X.T
    expected = {"left": x == 0, "right": x == width, "bottom": y == 0, "top": y == height}
    for name, mask in expected.items():
        assert mesh.node_sets[name].tolist() == np.flatnonzero(mask).tolist()
        side = height if name in ("left", "right") else width
        assert length(mesh, name) == pytest.approx(side, rel=1e-13)
    union = np.unique(np.concatenate([mesh.node_sets[name] for name in expected]))
    assert mesh.node_sets["boundary"].tolist() == union.tolist()
    assert length(mesh, "boundary") == pytest.approx(2 * (width + height), rel=1e-13)
    corners = {tuple(p) for p in mesh.X[mesh.node_sets["corners"]]}
    assert corners == {(0, 0), (width, 0), (width, height), (0, height)}


@pytest.mark.parametrize(("pattern", "per_cell"), [("right", 2), ("cross", 4)])
def test_cells_follow_the_rounded_counts(pattern, per_cell):
    mesh = rectangle(1.0, 0.5, 0.3, pattern)  # round(3.33) by round(1.67)
    assert len(mesh.triangles) == 3 * 2 * per_cell
    assert len(rectangle(1.0, 0.01, 1.0, pattern).triangles) == per_cell


def test_right_has_one_diagonal_direction():
    mesh = rectangle(1.0, 1.0, 0.25, "right")
    steps = np.concatenate([mesh.X[np.roll(mesh.triangles, -k, 1)[:, 0]] for k in range(3)])
    steps = np.concatenate([mesh.X[mesh.triangles[:, (k + 1) % 3]] for k in range(3)]) - steps
    diagonal = steps[(steps != 0).all(axis=1)]
    assert (diagonal[:, 0] * diagonal[:, 1] > 0).all()


def test_equilateral_is_equilateral_inside_when_the_sides_fit():
    h, rows = 0.1, 7
    mesh = rectangle(1.0, rows * h * math.sqrt(0.75), h, "equilateral")
    q = quality(mesh.X, mesh.triangles)
    assert np.count_nonzero(q > 1 - 1e-12) == rows * (2 * 10 - 1)
    assert np.count_nonzero(q < 0.9) == 2 * rows  # half triangles, one at each end of a row


def test_gmsh_meshes_are_good_deterministic_and_of_size_h():
    mesh, again = rectangle(1, 1, 0.05), rectangle(1, 1, 0.05)
    assert np.array_equal(mesh.X, again.X)
    assert np.array_equal(mesh.triangles, again.triangles)
    assert quality(mesh.X, mesh.triangles).mean() > 0.98
    edge = math.sqrt(4 / math.sqrt(3) / len(mesh.triangles))
    assert edge == pytest.approx(0.05, rel=0.1)


def test_disk():
    mesh = disk(0.5, 0.05)
    rim = mesh.node_sets["boundary"]
    assert np.hypot(*mesh.X[rim].T) == pytest.approx(0.5, abs=1e-12)
    assert length(mesh, "boundary") == pytest.approx(math.pi, rel=2e-3)
    assert areas(mesh).sum() == pytest.approx(math.pi / 4, rel=4e-3)


@pytest.mark.parametrize("value", [0, -0.1, math.nan, math.inf, "0.1", None, True])
def test_bad_lengths_are_refused(value):
    for name, call in {
        "width": lambda: rectangle(value, 1, 0.1),
        "height": lambda: rectangle(1, value, 0.1),
        "h": lambda: rectangle(1, 1, value, "right"),
        "radius": lambda: disk(value, 0.1),
    }.items():
        refused([f"{name} = {value!r}", "> 0"], error=InputError, by=call)


def test_h_out_of_range_and_unknown_pattern():
    refused(["h = 3 m", "at most 2 m"], 2, 1, 3, error=InputError, by=rectangle)
    refused(["h = 0.6 m", "at most 0.5 m"], 0.5, 0.6, error=InputError, by=disk)
    refused(["triangles", "at least"], 1, 1, 1e-6, error=InputError, by=rectangle)
    what = ["pattern = 'Rihgt'", "equilateral", "Did you mean 'right'?"]
    refused(what, 1, 1, 0.1, "Rihgt", error=InputError, by=rectangle)


# --- refusals


def test_arrays_of_the_wrong_shape_or_type():
    refused(["shape (4,)"], [0, 1, 2, 3], QUAD_T)
    refused(["float64", "integers"], QUAD_X, np.array(QUAD_T, dtype=float))
    refused(["shape (1, 4)"], QUAD_X, [[0, 1, 2, 3]])
    refused(["no triangles", "sheet.x"], QUAD_X, np.empty((0, 3), int), where="sheet.x")
    refused(["no arrays"], [["a", "b"]], QUAD_T)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_non_finite_coordinates(bad):
    X = np.array(QUAD_X)
    X[2, 1] = bad
    refused(["1 nodes with non-finite", "node 2", "f.msh"], X, QUAD_T, where="f.msh")


def test_vertex_out_of_range_repeated_or_unused():
    refused(["triangle 1 (nodes 0, 2, 4)", "0 to 3"], QUAD_X, [[0, 1, 2], [0, 2, 4]])
    refused(["triangle 0 (nodes -1, 1, 2)"], QUAD_X, [[-1, 1, 2], [0, 2, 3]])
    refused(["repeated vertex", "triangle 1 (nodes 0, 2, 2)"], QUAD_X, [[0, 1, 2], [0, 2, 2]])
    refused(["1 nodes used by no triangle", "node 4"], [*QUAD_X, [2, 2]], QUAD_T)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_zero_area_is_relative(scale):
    X = scale * np.array([[0, 0], [1, 0], [2, 1e-14], [1, 1]])
    what = ["1 zero-area", "triangle 1 (nodes 0, 1, 2)", "1e-12"]
    refused(what, X, [[1, 3, 0], [0, 1, 2]])
    thin = scale * np.array([[0, 0], [1, 0], [2, 1e-10], [1, 1]])
    assert len(checked(thin, [[0, 1, 3], [1, 2, 3]]).X) == 4


def test_zero_area_sliver_just_above_the_limit_passes():
    assert checked([[0, 0], [1, 0], [0.5, 3e-12]], [[0, 1, 2]]).triangles.tolist() == [[0, 1, 2]]


def test_coincident_nodes():
    X = [*QUAD_X, [0, 0], [1, 1]]
    what = ["2 nodes coincident", "node 4", "node 5", "Merge"]
    refused(what, X, [[0, 1, 2], [4, 5, 3]])
    refused(["node 4"], [*QUAD_X, [-0.0, 0]], [[0, 1, 2], [4, 2, 3]])


def test_orientation():
    good = checked(QUAD_X, QUAD_T)
    assert good.triangles.tolist() == QUAD_T
    turned = checked(QUAD_X, [[2, 1, 0], [3, 2, 0]])
    assert (areas(turned) > 0).all()
    mesh = rectangle(1, 1, 0.25, "right")
    t = mesh.triangles.copy()
    t[[3, 8]] = t[[3, 8]][:, [0, 2, 1]]
    text = ", ".join(map(str, t[3]))
    refused(["2 inverted triangles", f"triangle 3 (nodes {text})", "triangle 8"], mesh.X, t)
    refused(["2 inverted triangles", "triangle 3"], mesh.X, t[:, [0, 2, 1]])


def test_only_five_offenders_are_listed():
    mesh = rectangle(1, 1, 0.1, "right")
    t = mesh.triangles.copy()
    t[:7] = t[:7, [0, 2, 1]]
    text = refused(["7 inverted triangles", "triangle 4 ", ", ..."], mesh.X, t)
    assert "triangle 5 " not in text


def test_duplicate_triangles():
    refused(["1 duplicate triangles", "triangle 2 (nodes 2, 0, 1)"], QUAD_X, [*QUAD_T, [2, 0, 1]])


def test_edge_of_three_triangles_and_overlap():
    X = [*QUAD_X, [0.2, 0.9]]
    refused(["shared by more than two", "edge 0-2"], X, [*QUAD_T, [0, 2, 4]])
    refused(["same side", "edge 0-1"], [[0, 0], [1, 0], [0, 1], [1, 1]], [[0, 1, 2], [0, 1, 3]])


def test_unconnected_triangles():
    X = [*QUAD_X, [2, 0], [3, 0], [2, 1]]
    refused(["1 triangles not connected", "triangle 2 (nodes 4, 5, 6)"], X, [*QUAD_T, [4, 5, 6]])
    by_a_node = [*QUAD_X, [2, 1], [2, 2]]
    refused(["triangle 2 (nodes 2, 4, 5)", "2 pieces"], by_a_node, [*QUAD_T, [2, 4, 5]])


def test_sets_are_checked():
    def with_nodes(s):
        return checked(QUAD_X, QUAD_T, node_sets={"hem": s})

    def with_edges(s):
        return checked(QUAD_X, QUAD_T, edge_sets={"hem": s})

    refused(["'hem' is empty"], [], by=with_nodes)
    refused(["'hem' is empty"], np.empty((0, 2), int), by=with_edges)
    refused(["'hem'", "out of range", "4", "0 to 3"], [0, 4], by=with_nodes)
    refused(["'hem'", "out of range", "-1"], [[0, -1]], by=with_edges)
    refused(["'hem'", "float64"], [0.0, 1.0], by=with_nodes)
    refused(["'hem'", "bool"], [True, False, True, True], by=with_nodes)
    refused(["'hem'", "(1, 3)"], [[0, 1, 2]], by=with_edges)
    refused(["'hem'", "no edge of a triangle", "edge 1-3"], [[0, 1], [3, 1]], by=with_edges)


def test_sets_are_sorted_unique_and_boundary_is_added():
    mesh = checked(QUAD_X, QUAD_T, {"a": [3, 0, 3]}, {"hem": [[1, 0], [0, 1]]})
    assert mesh.node_sets["a"].tolist() == [0, 3]
    assert mesh.edge_sets["hem"].tolist() == [[0, 1]]
    assert mesh.node_sets["hem"].tolist() == [0, 1]
    assert mesh.edge_sets["boundary"].tolist() == [[0, 1], [0, 3], [1, 2], [2, 3]]
    own = checked(QUAD_X, QUAD_T, {"boundary": [2]})
    assert own.node_sets["boundary"].tolist() == [2]
    assert "boundary" not in own.edge_sets


def test_the_arrays_given_are_not_shared():
    X, t = np.array(QUAD_X), np.array(QUAD_T, dtype=np.int32)
    mesh = checked(X, t)
    X[:], t[:] = 7, 7
    assert mesh.X.max() == 1
    assert mesh.triangles.max() == 3


# --- planes


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
def test_coordinate_planes_keep_their_two_coordinates(axes):
    mesh = rectangle(1, 0.5, 0.25, "right")
    xyz = np.full((len(mesh.X), 3), 3.25)
    xyz[:, axes] = mesh.X
    assert np.array_equal(checked(xyz, mesh.triangles).X, mesh.X)


unit = st.floats(-1, 1).map(lambda v: round(v, 6))


@settings(max_examples=40, deadline=None)
@given(st.tuples(unit, unit, unit), hnp.arrays(float, 3, elements=unit))
def test_a_rotated_plane_keeps_all_lengths(vector, shift):
    mesh = rectangle(1, 0.5, 0.25, "cross")
    xyz = np.c_[mesh.X, 0 * mesh.X[:, 0]] @ rotation(vector).T + shift
    flat = checked(xyz, mesh.triangles)
    assert areas(flat) == pytest.approx(areas(mesh), rel=1e-9)
    edges = mesh.edge_sets["boundary"]
    lengths = [np.linalg.norm(m.X[edges[:, 0]] - m.X[edges[:, 1]], axis=1) for m in (mesh, flat)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)


def rotation(v):
    angle = np.linalg.norm(v)
    if angle == 0:
        return np.eye(3)
    x, y, z = np.array(v) / angle * math.sin(angle / 2)
    w = math.cos(angle / 2)
    q = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * q + 2 * q @ q


def test_first_axis_of_a_tilted_plane_is_the_projection_of_x():
    c = math.sqrt(0.5)
    about_x = np.array([[1, 0, 0], [0, c, -c], [0, c, c]])  # x stays x
    about_y = np.array([[c, 0, c], [0, 1, 0], [-c, 0, c]])  # x is shortened, y stays y
    X = np.array(QUAD_X)
    flat = np.c_[X, np.zeros(4)]
    np.testing.assert_allclose(checked(flat @ about_x.T, QUAD_T).X, X, atol=1e-12)
    np.testing.assert_allclose(checked(flat @ about_y.T, QUAD_T).X, X, atol=1e-12)


def test_planes_nearly_xz_and_yz_are_seen_as_those():
    u, v = np.array(QUAD_X).T
    for xyz in ((u, 1e-7 * v, v), (1e-7 * v, u, v), (1e-7 * u, u, v)):
        np.testing.assert_allclose(checked(np.stack(xyz, 1), QUAD_T).X, QUAD_X, atol=1e-6)


def test_off_plane_distance_is_named():
    mesh = rectangle(1, 1, 0.25, "right")
    xyz = np.c_[mesh.X, 0 * mesh.X[:, 0]] @ rotation((0.4, 0.2, 0.1)).T
    checked(xyz + 1e-10 * np.sin(37 * xyz), mesh.triangles)
    bump = xyz.copy()
    bump[12] += 0.02 * rotation((0.4, 0.2, 0.1))[:, 2]
    refused(["0.019", "off the plane", "1e-9", "flat"], bump, mesh.triangles, where="s.vtu")


# --- files


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


def test_points_and_surfaces_become_node_sets():
    flag = read(MESHES / "flag.geo", h=0.2)
    assert flag.X[flag.node_sets["hoist_top"]].tolist() == [[0, 1]]
    assert flag.X[flag.node_sets["hoist_bottom"]].tolist() == [[0, 0]]
    assert flag.node_sets["sheet"].tolist() == list(range(len(flag.X)))
    assert "sheet" not in flag.edge_sets
    disk_file = read(MESHES / "disk.geo", h=0.2)
    assert disk_file.X[disk_file.node_sets["centre"]].tolist() == [[0, 0]]


def test_graded_grows_by_ten():
    mesh = read(MESHES / "graded.geo", h=0.01)
    size = np.sqrt(areas(mesh))
    middle = np.linalg.norm(mesh.X[mesh.triangles].mean(axis=1), axis=1)
    assert 6 < size[middle > 1.2].mean() / size[middle < 0.05].mean() < 14


@pytest.mark.parametrize("name", ["square", "flag", "graded"])
def test_h_sets_the_size(name):
    sizes = (0.016, 0.008) if name == "graded" else (0.08, 0.04)
    coarse, fine = (read(MESHES / f"{name}.geo", h=h) for h in sizes)
    assert 3 < len(fine.triangles) / len(coarse.triangles) < 5


def geo(tmp_path, old="", new="", extra=""):
    text = (MESHES / "square.geo").read_text()
    assert old in text
    path = tmp_path / "s.geo"
    path.write_text(text.replace(old, new) + extra)
    return path


def test_h_without_a_constant_bounds_all_sizes(tmp_path):
    header = 'DefineConstant[ h = {0.05, Min 0.0005, Max 1, Name "Parameters/h"} ];'
    path = geo(tmp_path, header, "h = 0.3;")
    own, fine, coarse = read(path), read(path, h=0.1), read(path, h=0.5)
    assert len(coarse.triangles) < len(own.triangles) < len(fine.triangles)
    assert math.sqrt(4 / math.sqrt(3) / len(fine.triangles)) == pytest.approx(0.1, rel=0.1)
    plain = geo(tmp_path, header, "DefineConstant[ h = 0.3 ];")
    assert len(read(plain, h=0.1).triangles) == len(fine.triangles)


def test_bad_h_for_a_file():
    square = MESHES / "square.geo"
    refused(["h = 2 m", "at most 1 m", "square.geo"], square, h=2.0, by=read, error=InputError)
    refused(["h = -1"], square, h=-1, by=read, error=InputError)
    msh = MESHES / "square_22.msh"
    refused(["h = 0.1", "only a .geo", "square_22.msh"], msh, h=0.1, by=read, error=InputError)


def test_groups_unnamed_empty_unknown_and_shared(tmp_path):
    extra = (
        'Physical Curve(77) = {1, 2};\nPhysical Point(78) = {3};\nPhysical Surface("b") = {1};\n'
    )
    mesh = read(geo(tmp_path, extra=extra))
    assert length(mesh, "curve_77") == pytest.approx(2)
    assert mesh.X[mesh.node_sets["point_78"]].tolist() == [[1, 1]]
    assert len(mesh.node_sets["b"]) == len(mesh.X)
    empty = geo(tmp_path, extra='Physical Curve("ghost") = {};\n')
    refused(["curve group 'ghost' is empty", "s.geo"], empty, by=read)
    refused(["'lost' is empty"], geo(tmp_path, extra='Physical Point("lost") = {99};\n'), by=read)


def test_a_file_may_define_its_own_boundary(tmp_path):
    mesh = read(geo(tmp_path, '"left"', '"boundary"'))
    assert length(mesh, "boundary") == pytest.approx(1)


def test_construction_points_and_curves_are_dropped_unless_named(tmp_path):
    extra = "Point(9) = {3, 3, 1, h};\nPoint(10) = {4, 3, 1, h};\nLine(9) = {9, 10};\n"
    mesh = read(geo(tmp_path, extra=extra))
    assert mesh.X.max() == 1
    named = geo(tmp_path, extra=extra + 'Physical Point("far") = {9};\n')
    refused(["'far' names 1 nodes outside all triangles"], named, by=read)


def test_geo_that_gmsh_refuses_or_half_reads(tmp_path):
    refused(["cannot read", "s.geo"], geo(tmp_path, extra="Point(9) = {0, 0;\n"), by=read)
    extra = 'Physical Point("a") = {1}; Physical Point("b") = {2};'
    refused(["last line", "new line"], geo(tmp_path, extra=extra), by=read)
    refused(["Triangle 6"], geo(tmp_path, extra="Mesh.ElementOrder = 2;\n"), by=read)
    refused(["Quadrilateral 4"], geo(tmp_path, extra="Recombine Surface {1};\n"), by=read)


def test_both_msh_versions_agree():
    a, b = read(MESHES / "square_22.msh"), read(MESHES / "square_41.msh")
    assert np.array_equal(a.X, b.X)
    assert np.array_equal(a.triangles, b.triangles)
    for x, y in ((a.node_sets, b.node_sets), (a.edge_sets, b.edge_sets)):
        assert sorted(x) == sorted(y)
        assert all(np.array_equal(x[name], y[name]) for name in x)
    assert a.node_sets.keys() >= {"left", "right", "top", "bottom", "corners", "sheet", "boundary"}


MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 5 "hem"
2 6 "sheet"
$EndPhysicalNames
$Nodes
5
10 0 0 0
20 1 0 0
30 1 1 0
40 0 1 0
50 7 7 7
$EndNodes
$Elements
3
1 1 2 5 1 10 20
7 2 2 6 1 10 20 30
9 2 2 6 1 10 30 40
$EndElements
"""


def test_messages_use_the_numbers_of_the_file(tmp_path):
    path = tmp_path / "s.msh"
    path.write_text(MSH)
    mesh = read(path)
    assert mesh.X.tolist() == QUAD_X  # node 50 belongs to no element
    assert mesh.edge_sets["hem"].tolist() == [[0, 1]]
    path.write_text(MSH.replace("10 30 40\n$End", "10 40 30\n$End"))
    refused(["1 inverted triangles", "triangle 9 (nodes 10, 40, 30)", "s.msh"], path, by=read)
    path.write_text(MSH.replace('2\n1 5 "hem"', '3\n1 5 "hem"\n1 8 "ghost"'))
    refused(["'ghost' is empty"], path, by=read)
    path.write_text(MSH.replace("10 30 40\n$End", "10 30 99\n$End"))
    refused(["cannot read", "99"], path, by=read)


def test_repeated_triangles_of_a_surface_in_two_groups(tmp_path):
    two = MSH.replace('2\n1 5 "hem"', '3\n2 7 "again"\n1 5 "hem"').replace("\n3\n1 1", "\n5\n1 1")
    copies = "11 2 2 7 1 10 20 30\n12 2 2 7 1 10 30 40\n$EndElements"
    path = tmp_path / "two.msh"
    path.write_text(two.replace("$EndElements", copies))
    mesh = read(path)
    assert len(mesh.triangles) == 2
    assert mesh.node_sets["again"].tolist() == mesh.node_sets["sheet"].tolist() == [0, 1, 2, 3]
    same = two.replace("\n5\n1 1", "\n4\n1 1").replace('3\n2 7 "again"\n', "2\n")
    path.write_text(same.replace("$EndElements", "11 2 2 6 1 10 20 30\n$EndElements"))
    refused(["1 duplicate triangles", "triangle 11 (nodes 10, 20, 30)"], path, by=read)


def saved(tmp_path, name, cells, points=None, **extra):
    path = tmp_path / name
    points = np.array(QUAD_X if points is None else points, dtype=float)
    if points.shape[1] == 2:
        points = np.c_[points, 0 * points[:, 0]]
    meshio.Mesh(points, cells, **extra).write(path)
    return path


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".obj", ".ply", ".off", ".inp"])
def test_round_trip_through_meshio(tmp_path, suffix):
    mesh = rectangle(1.0, 0.5, 0.2)
    back = read(saved(tmp_path, f"s{suffix}", [("triangle", mesh.triangles)], mesh.X))
    np.testing.assert_allclose(back.X, mesh.X, atol=1e-6 if suffix == ".ply" else 1e-12)
    assert np.array_equal(back.triangles, mesh.triangles)
    assert np.array_equal(back.edge_sets["boundary"], mesh.edge_sets["boundary"])


def test_stl_shares_nodes_again(tmp_path):
    mesh = rectangle(1.0, 0.5, 0.25, "cross")
    back = read(saved(tmp_path, "s.stl", [("triangle", mesh.triangles)], mesh.X))
    assert len(back.X) == len(mesh.X)
    assert areas(back).sum() == pytest.approx(0.5)


def test_meshio_sets_through_a_file(tmp_path):
    cells = [("line", [[0, 1], [1, 2]]), ("triangle", QUAD_T)]
    sets = {"cell_sets": {"half": [[], [1]], "side": [[1], []]}, "point_sets": {"pin": [3]}}
    mesh = read(saved(tmp_path, "s.inp", cells, **sets))
    assert mesh.node_sets["pin"].tolist() == [3]
    assert mesh.node_sets["half"].tolist() == [0, 2, 3]
    assert mesh.edge_sets["side"].tolist() == [[1, 2]]
    assert mesh.node_sets["boundary"].tolist() == [0, 1, 2, 3]


def test_meshio_names_in_field_data():
    cells = [("line", [[0, 1], [1, 2]]), ("triangle", QUAD_T)]
    named = meshio.Mesh(
        np.array(QUAD_X),
        cells,
        cell_sets={"half": [[], [1]], "side": [[1], []], "none": [[], []]},
        cell_data={"gmsh:physical": [[5, 6], [5, 5]]},
        field_data={"hem": np.array([5, 1]), "sheet": np.array([5, 2])},
        point_sets={"pin": [3]},
    )
    from fecloth.meshread import _meshio_sets

    nodes, edges = _meshio_sets(named, "s")
    assert {name: np.unique(np.concatenate(v)).tolist() for name, v in nodes.items() if v} == {
        "half": [0, 2, 3],
        "side": [1, 2],
        "hem": [0, 1],
        "sheet": [0, 1, 2, 3],
        "pin": [3],
    }
    assert nodes["none"] == []
    assert [edges[name][0].tolist() for name in ("side", "hem")] == [[[1, 2]], [[0, 1]]]


def test_cells_that_are_not_triangles(tmp_path):
    quad = saved(tmp_path, "q.vtu", [("quad", [[0, 1, 2, 3]])])
    refused(["1 quad", "3-node triangles", "q.vtu"], quad, by=read)
    lines = saved(tmp_path, "l.vtu", [("line", [[0, 1]])])
    refused(["no triangles"], lines, by=read)


def test_stray_nodes_of_other_formats(tmp_path):
    X = [*QUAD_X, [5, 5]]
    stray = saved(tmp_path, "s.vtu", [("triangle", QUAD_T)], X)
    refused(["1 nodes used by no triangle", "node 4"], stray, by=read)
    vertex = saved(tmp_path, "v.vtu", [("vertex", [[4]]), ("triangle", QUAD_T)], X)
    assert len(read(vertex).X) == 4


def test_files_that_cannot_be_read(tmp_path):
    refused(["no such file", "nothing.msh"], tmp_path / "nothing.msh", by=read)
    odd = tmp_path / "sheet.docx"
    odd.write_text("x")
    refused(["unknown suffix '.docx'", ".vtu"], odd, by=read)
    for name in ("broken.vtu", "broken.obj", "broken.stl", "broken.vtk"):
        path = tmp_path / name
        path.write_text("rubbish")
        refused([name], path, by=read)


# --- Gmsh sessions


def test_an_open_session_is_left_as_it_was():
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("fecloth")
        gmsh.model.geo.addPoint(1, 2, 3)
        gmsh.model.geo.synchronize()
        gmsh.model.add("another")
        gmsh.model.setCurrent("fecloth")
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        gmsh.option.setNumber("Mesh.MeshSizeFactor", 3)
        gmsh.parser.setNumber("h", [0.7])
        gmsh.onelab.setNumber("Parameters/h", [0.7])
        inside = read(MESHES / "square.geo", h=0.1), disk(1.0, 0.3)
        refused(["h = 2 m"], MESHES / "square.geo", h=2, by=read, error=InputError)
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "fecloth"
        assert gmsh.model.list().count("fecloth") == 1
        assert not any(name.startswith("fecloth_") for name in gmsh.model.list())
        assert gmsh.model.getEntities() == [(0, 1)]
        assert gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert gmsh.option.getNumber("Mesh.MeshSizeFactor") == 3
        assert gmsh.parser.getNumber("h") == [0.7]
        assert gmsh.onelab.getNumber("Parameters/h") == [0.7]
    finally:
        gmsh.finalize()
    alone = read(MESHES / "square.geo", h=0.1), disk(1.0, 0.3)
    assert not gmsh.isInitialized()
    assert all(np.array_equal(a.X, b.X) for a, b in zip(inside, alone, strict=True))


def test_missing_system_libraries_are_named(monkeypatch):
    real = builtins.__import__

    def broken(name, *args, **kwargs):
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", broken)
    refused(["libGLU.so.1", "libglu1-mesa", "libxft2", "apt-get"], 1, 1, 0.5, by=rectangle)


# --- numbering and quality


def shuffled(mesh, seed):
    rng = np.random.default_rng(seed)
    old = rng.permutation(len(mesh.X))
    new = np.argsort(old)
    t = new[mesh.triangles][rng.permutation(len(mesh.triangles))]
    nodes = {name: new[s] for name, s in mesh.node_sets.items()}
    edges = {name: new[s] for name, s in mesh.edge_sets.items()}
    return checked(mesh.X[old], t, nodes, edges)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(STRUCTURED), st.integers(0, 2**32 - 1))
def test_renumbered_is_a_permutation_that_keeps_the_mesh(pattern, seed):
    mesh = shuffled(rectangle(1.0, 0.7, 0.2, pattern), seed)
    new, nodes, triangles = renumbered(mesh)
    assert sorted(nodes) == list(range(len(mesh.X)))
    assert sorted(triangles) == list(range(len(mesh.triangles)))
    assert np.array_equal(new.X, mesh.X[nodes])
    assert np.array_equal(nodes[new.triangles], mesh.triangles[triangles])
    assert (np.diff(new.triangles.min(axis=1)) >= 0).all()
    for name, members in mesh.node_sets.items():
        assert (np.diff(new.node_sets[name]) > 0).all()
        assert sorted(nodes[new.node_sets[name]]) == members.tolist()
    for name, pairs in mesh.edge_sets.items():
        back = {frozenset(p) for p in nodes[new.edge_sets[name]].tolist()}
        assert back == {frozenset(p) for p in pairs.tolist()}
    again = checked(new.X, new.triangles, new.node_sets, new.edge_sets)
    assert np.array_equal(again.triangles, new.triangles)


def test_renumbered_narrows_the_band():
    mesh = rectangle(1, 1, 0.03)
    band = [np.ptp(m.triangles, axis=1).max() for m in (mesh, renumbered(mesh)[0])]
    assert band[1] < 0.1 * band[0]
    assert band[1] < 3 * math.sqrt(len(mesh.X))


def test_quality_of_known_triangles():
    X = np.array([[0, 0], [1, 0], [0, 1], [0.5, math.sqrt(0.75)]])
    q = quality(X, np.array([[0, 1, 3], [0, 1, 2], [0, 2, 1]]))
    assert q == pytest.approx([1, math.sqrt(0.75), -math.sqrt(0.75)])
