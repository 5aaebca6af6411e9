"""Small files as other programs write them: what is read of each, or why it is refused.

The files are written here by hand, as Gmsh, Blender, CLO, ParaView, MeshLab and Git LFS write
them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import meshio
import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError, MeshError
from fecloth.mesh.cells import split_quadrilaterals
from fecloth.mesh.read import read_surface

# --- the files ------------------------------------------------------------------------------------

SQUARE_V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
SQUARE_VT = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
TENT_V = "v 0 0 0\nv 0.9 0 0.3\nv 1.8 0 0\nv 0 1 0\nv 0.9 1 0.3\nv 1.8 1 0\n"
TENT_VT = "vt 0 0\nvt 0.95 0\nvt 1.9 0\nvt 0 1\nvt 0.95 1\nvt 1.9 1\n"
TENT_F = "f 1/1 2/2 5/5 4/4\nf 2/2 3/3 6/6 5/5\n"
TWO_SQUARES = """
Point(1) = {0, 0, 0, 1}; Point(2) = {1, 0, 0, 1}; Point(3) = {2, 0, 0, 1};
Point(4) = {2, 1, 0, 1}; Point(5) = {1, 1, 0, 1}; Point(6) = {0, 1, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5};
Line(5) = {5, 6}; Line(6) = {6, 1}; Line(7) = {2, 5};
Curve Loop(1) = {1, 7, 5, 6}; Plane Surface(1) = {1};
Curve Loop(2) = {7, -4, -3, -2}; Plane Surface(2) = {2};
Physical Surface("a") = {1}; Physical Surface("b") = {2};
"""
MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
{names}
$EndPhysicalNames
$Nodes
{nodes}
$EndNodes
$Elements
{elements}
$EndElements
"""
MSH_NODES = "4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0"
TWO_SIDES_MSH = MSH.format(
    names='2\n2 1 "a"\n2 2 "b"',
    nodes="6\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 2 0 0\n6 2 1 0",
    elements="4\n1 2 2 1 1 1 2 3\n2 2 2 1 1 1 3 4\n3 2 2 2 2 2 3 5\n4 2 2 2 2 5 3 6",
)
CURVE_MSH = MSH.format(
    names='1\n1 1 "left"', nodes="2\n1 0 0 0\n2 1 0 0", elements="1\n1 1 2 1 1 1 2"
)
QUAD_MSH = MSH.format(names='1\n2 1 "a"', nodes=MSH_NODES, elements="1\n1 3 2 1 1 1 2 3 4")
TETRA_MSH = MSH.format(
    names='1\n3 1 "a"',
    nodes="4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 1",
    elements="1\n1 4 2 1 1 1 2 3 4",
)


def order_2(bulge: float) -> str:
    """Two triangles of Gmsh's order 2; the middle of the lower edge is lower by `bulge`."""
    nodes = "9\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n"
    nodes += f"5 .5 {-bulge} 0\n6 1 .5 0\n7 .5 .5 0\n8 .5 1 0\n9 0 .5 0"
    names = '2\n2 1 "a"\n1 2 "low"'
    elements = "3\n1 8 2 2 1 1 2 5\n2 9 2 1 1 1 2 3 5 6 7\n3 9 2 1 1 1 3 4 7 8 9"
    return MSH.format(names=names, nodes=nodes, elements=elements)


POLYDATA = """# vtk DataFile Version 4.2
a sheet
ASCII
DATASET POLYDATA
POINTS 6 float
0 0 0 1 0 0 1 1 0
0 1 0 2 0 0 2 1 0
POLYGONS 3 13
3 0 1 2
3 0 2 3
4 1 4 5 2
POINT_DATA 6
NORMALS Normals float
0 0 1 0 0 1 0 0 1
0 0 1 0 0 1 0 0 1
"""
PENTAGON = POLYDATA.replace(
    "POLYGONS 3 13\n3 0 1 2\n3 0 2 3\n4 1 4 5 2", "POLYGONS 1 6\n5 0 1 4 5 3"
)
VTP = """<?xml version="1.0"?>
<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian">
<PolyData><Piece NumberOfPoints="4" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0"
 NumberOfPolys="2"><Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">
0 0 0 1 0 0 1 1 0 0 1 0 </DataArray></Points><Polys>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 0 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3 6</DataArray></Polys></Piece></PolyData>
</VTKFile>
"""
LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2146\nsize 12345678\n"
SPLIT = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 4 5 6\n"
NEARLY = SPLIT.replace("v 0 0 0\nv 1 1 0\nv 0 1", "v 0.0000003 0 0\nv 1 1 0\nv 0 1")
HANGING = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .5 0\nf 1 2 3\nf 1 5 4\nf 5 3 4\n"


def turned(points, decimals=None) -> np.ndarray:
    """The points in another plane, far from every coordinate plane, with so many decimals."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    x = np.c_[points, np.zeros(len(points))] @ turn + [0.3, -0.2, 0.7]
    return x if decimals is None else np.round(x, decimals)


GRID = np.array([[x, y] for y in (0.0, 0.15, 0.3) for x in (0.0, 0.1, 0.3)])
GRID_T = np.array(
    [t for i in (0, 1, 3, 4) for t in ([i, i + 1, i + 4], [i, i + 4, i + 3])], dtype=np.int64
)


def by_meshio(points, cells="triangle", connectivity=GRID_T) -> Callable[[Path], None]:
    return lambda path: meshio.Mesh(points, [(cells, connectivity)]).write(path)


TILTED = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in turned(GRID))
TILTED += "".join(f"f {a} {b} {c}\n" for a, b, c in GRID_T + 1)


@dataclass
class Case:
    """A file, the arguments, and what is read: nodes, triangles, area, element, notes, sets."""

    name: str
    file: str | Callable[[Path], None]
    nodes: int
    triangles: int
    area: float
    given: dict = field(default_factory=dict)
    element: str = "P1"
    note: str = ""
    lengths: dict[str, float] = field(default_factory=dict)
    regions: dict[str, int] = field(default_factory=dict)


VT = {"reference": "vt"}
READ = {
    "a clockwise curve loop in a .geo": Case(
        "two.geo", TWO_SQUARES, 8, 8, 2.0, note="4 of 8 triangles turned", regions={"a": 4, "b": 4}
    ),
    "two surfaces that face apart in a .msh": Case(
        "two.msh", TWO_SIDES_MSH, 6, 4, 2.0, note="2 of 4 triangles turned", regions={"b": 2}
    ),
    "five vt for four v": Case(
        "cut.obj",
        SQUARE_V + SQUARE_VT + "vt 0.3 0.2\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4\n",
        *(4, 2, 1.0),
        note="vt not used",
    ),
    "vt of each corner": Case(
        "corners.obj",
        SQUARE_V + 2 * SQUARE_VT + "f 1/1/1 2/2/1 3/3/1\nf 1/5/1 3/7/1 4/8/1\n",
        *(4, 2, 1.0),
        note="vt is the flat cloth",
    ),
    "vt of the lengths of v, cut in two": Case(
        "islands.obj",
        SQUARE_V + SQUARE_VT + "vt 5 0\nvt 6 1\nvt 5 1\nf 1/1 2/2 3/3\nf 1/5 3/6 4/7\n",
        *(4, 2, 1.0),
        note="vt not used: it is cut",
    ),
    "vt of the lengths of v, folded": Case(
        "folded.obj",
        SQUARE_V + SQUARE_VT + "f 1/1 2/2 3/3\nf 1/1 3/3 4/2\n",
        *(4, 2, 1.0),
        note="vt not used: it is cut or overlaps",
    ),
    "vt that is a little shorter than v": Case(
        "shorter.obj",
        SQUARE_V + SQUARE_VT.replace("1", "0.9") + "f 1/1 2/2 3/3 4/4\n",
        *(4, 2, 0.81),
        note="vt is the flat cloth",
    ),
    "a tent whose vt has the lengths": Case(
        "tent.obj",
        TENT_V + TENT_VT + TENT_F,
        6,
        4,
        1.9,
        note="vt is the flat cloth, and v the start",
    ),
    "a tent whose vt is asked for": Case(
        "atlas.obj",
        TENT_V
        + TENT_VT.replace("0.95", ".25").replace("1.9", ".5").replace(" 1\n", " .5\n")
        + TENT_F,
        *(6, 4, 1.0),
        given={"reference": "vt", "scale": 2.0},
        note="vt is the flat cloth, and v the start",
    ),
    "quadrilaterals with all kinds of words": Case(
        "words.obj",
        "# Blender\nmtllib a.mtl\no Plane\nv 9 9 9\n"
        + SQUARE_V.replace(" 0\n", " 0 0.8 0.8 0.8\n")
        + "vn 0 0 1\ns off\nusemtl m\nf 2//1 3//1 \\\n 4//1 5//1\nl 2 1\n",
        *(4, 2, 1.0),
        note="1 node of no face left out",
    ),
    "a tilted sheet with six decimals": Case("tilt.obj", TILTED, 9, 8, 0.09, note="moved into it"),
    "a tilted sheet in float32, .stl": Case(
        "tilt.stl", by_meshio(turned(GRID).astype(np.float32)), 9, 8, 0.09, note="moved into it"
    ),
    "order 2 with straight edges": Case(
        "two.msh", order_2(0.0), 9, 2, 1.0, element="P2", note="P2", lengths={"low": 1.0}
    ),
    "order 2 with a curved edge": Case(
        "two.msh", order_2(0.01), 4, 2, 1.0, note="curved, by up to 0.01 m", lengths={"low": 1.0}
    ),
    "order 2 in a .vtu": Case(
        "two.vtu",
        by_meshio(
            np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0]]),
            "triangle6",
            np.arange(6)[None],
        ),
        *(6, 1, 0.5),
        element="P2",
    ),
    "order 2 and recombination set in a .geo": Case(
        "set.geo",
        TWO_SQUARES + "Mesh.ElementOrder = 2; Mesh.RecombineAll = 1;\n",
        *(8, 8, 2.0),
    ),
    "a recombined surface in a .geo": Case(
        "quad.geo",
        TWO_SQUARES
        + "Transfinite Curve{1:7} = 2; Transfinite Surface{1, 2}; Recombine Surface{1};\n",
        *(6, 4, 2.0),
        note="1 cell of type Quadrilateral 4 split",
        regions={"a": 2, "b": 2},
    ),
    "quadrilaterals in a .msh": Case("q.msh", QUAD_MSH, 4, 2, 1.0, regions={"a": 2}),
    "a .vtp": Case("sheet.vtp", VTP, 4, 2, 1.0),
    "a legacy .vtk with polygons and normals": Case(
        "sheet.vtk", POLYDATA, 6, 4, 2.0, note="1 cell"
    ),
    "split vertices": Case(
        "split.obj", SPLIT, 4, 2, 1.0, given={"merge": True}, note="2 nodes merged"
    ),
    "vertices that nearly coincide": Case(
        "split.obj", NEARLY, 4, 2, 1.0, given={"merge": True}, note="2 nodes merged"
    ),
}

REFUSED = {
    "a texture of other lengths on a tent": (
        "atlas.obj",
        TENT_V + TENT_VT.replace("1.9", "0.4") + TENT_F,
        {},
        ["away from the plane", "vt not used", 'reference = "vt"', "scale"],
    ),
    "a tent without vt": (
        "tent.obj",
        TENT_V + "f 1 2 5 4\nf 2 3 6 5\n",
        {},
        ["away from the plane"],
    ),
    "vt in two pieces": (
        "pieces.obj",
        TENT_V + TENT_VT + "vt 3 0\nvt 3 1\nf 1/1 2/2 5/5 4/4\nf 2/7 3/3 6/6 5/8\n",
        VT,
        ["2 separate pieces"],
    ),
    "a face of five corners": (
        "five.obj",
        SQUARE_V + "f 1 2 3 4 1\n",
        {},
        ["line 5", "three or four"],
    ),
    "a number that is too large": ("far.obj", SQUARE_V + "f 1 2 9\n", {}, ["node 9", "4"]),
    "an .obj without faces": ("none.obj", SQUARE_V, {}, ["no triangles"]),
    "a bump": (
        "bump.vtu",
        by_meshio(np.c_[GRID, 1e-5 * (GRID[:, 0] == 0.1)] @ np.linalg.qr(np.eye(3) + 0.3)[0]),
        {},
        ["away from the plane"],
    ),
    "only a curve is physical": (
        "curve.msh",
        CURVE_MSH,
        {},
        ["1 Line 2", "add a Physical Surface", "Mesh.SaveAll"],
    ),
    "a .geo without a surface": (
        "line.geo",
        TWO_SQUARES.split("Curve Loop")[0],
        {},
        ["Plane Surface"],
    ),
    "tetrahedra": ("solid.msh", TETRA_MSH, {}, ["1 Tetrahedron 4", "flat sheet"]),
    "a pentagon": ("five.vtk", PENTAGON, {}, ["1 POLYGON of 5 nodes"]),
    "a text of Git LFS": ("large.obj", LFS, {}, ["Git LFS", "git lfs pull"]),
    "split vertices, not merged": ("split.obj", SPLIT, {}, ["node 4", "merge = true"]),
    "a vertex in the middle of an edge": ("hang.obj", HANGING, {}, ["node 5", "middle of an edge"]),
}


def written(folder: Path, name: str, file) -> Path:
    path = folder / name
    if callable(file):
        file(path)
    else:
        path.write_text(file)
    return path


@pytest.mark.parametrize("case", READ.values(), ids=READ)
def test_what_is_read(tmp_path, case):
    if case.name.endswith((".vtp", ".vtk")):
        pytest.importorskip("pyvista")
    cloth = fc.Cloth.read(written(tmp_path, case.name, case.file), **case.given)
    assert (len(cloth.X), len(cloth.triangles), cloth.element) == (
        case.nodes,
        case.triangles,
        case.element,
    )
    assert cloth.area == pytest.approx(case.area, rel=1e-5)
    assert case.note in "; ".join(cloth.notes)
    for name, expected in case.lengths.items():
        ends = cloth.X[cloth.edge_sets[name]]
        assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(expected)
    for name, count in case.regions.items():
        assert len(cloth.triangle_sets[name]) == count


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_what_is_refused(tmp_path, case):
    name, file, given, words = case
    if name.endswith(".vtk"):
        pytest.importorskip("pyvista")
    with pytest.raises(InputError) as caught:
        fc.Cloth.read(written(tmp_path, name, file), **given)
    assert name in str(caught.value)
    for word in words:
        assert word in str(caught.value)


# --- .obj: the flat cloth and its start -----------------------------------------------------------


def test_vt_is_the_cloth_and_v_its_start(tmp_path):
    cloth = fc.Cloth.read(written(tmp_path, "tent.obj", TENT_V + TENT_VT + TENT_F))
    v, vt = (
        np.loadtxt(text.splitlines(), usecols=c)
        for text, c in ((TENT_V, (1, 2, 3)), (TENT_VT, (1, 2)))
    )
    assert np.array_equal(cloth.X, vt[cloth.source_nodes])
    assert np.array_equal(cloth.start, v[cloth.source_nodes])
    quadratic = fc.Cloth.read(tmp_path / "tent.obj", element="P2")
    edges = quadratic.cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    middle = quadratic.cells[:, 3:].ravel()
    for values in (quadratic.X, quadratic.start):
        assert np.allclose(values[middle], values[edges].mean(axis=1))


@pytest.mark.parametrize(
    ("stretch", "agrees"), [(1.15, True), (1.25, False), (0.87, True), (0.8, False)]
)
def test_edges_within_20_percent_agree(tmp_path, stretch, agrees):
    """One edge of the flat cloth is longer or shorter than in space; the others are equal."""
    vt = TENT_VT.replace("vt 0 1\n", f"vt 0 {stretch:g}\n").replace(" 0.95 ", " 0.948683 ")
    vt = vt.replace(" 1.9 ", " 1.897367 ")
    path = written(
        tmp_path, "tent.obj", TENT_V + vt + "f 1/1 2/2 4/4\nf 2/2 3/3 5/5\nf 2/2 5/5 4/4\n"
    )
    if agrees:
        assert fc.Cloth.read(path).X[:, 1].max() == pytest.approx(max(1.0, stretch))
    else:
        with pytest.raises(MeshError, match="vt not used"):
            fc.Cloth.read(path)


def test_a_scale_is_of_the_file_or_with_the_reference_vt_of_vt_alone(tmp_path):
    path = written(tmp_path, "tent.obj", TENT_V + TENT_VT + TENT_F)
    in_mm, by_itself = fc.Cloth.read(path, scale=1e-3), fc.Cloth.read(path)
    assert np.allclose(in_mm.X, 1e-3 * by_itself.X, atol=0)
    assert np.allclose(in_mm.start, 1e-3 * by_itself.start, atol=0)
    asked = fc.Cloth.read(path, reference="vt", scale=0.9)
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
    cloth = fc.Cloth.read(written(tmp_path, "tube.obj", "\n".join(lines) + "\n"))
    assert len(cloth.X) == 18
    assert cloth.area == pytest.approx(8 * side * 0.5)
    assert np.linalg.norm(cloth.start[:, :2], axis=1) == pytest.approx(np.ones(18))
    assert "2 nodes added where the texture is cut" in cloth.notes[-1]
    nodes, triangles = read_surface(tmp_path / "tube.obj")  # as an obstacle it is closed
    assert (len(nodes), len(triangles)) == (16, 16)


# --- quadrilaterals -------------------------------------------------------------------------------


def test_quadrilaterals_are_split_along_the_better_diagonal():
    kite = np.array([[0.0, 0], [1, -0.2], [3, 0], [1, 0.2]])
    dart = np.array([[0.0, 0], [2, 1], [0.5, 1], [0, 4]])  # reentrant at node 2
    for points, diagonal in ((kite, {1, 3}), (dart, {0, 2}), (dart[[3, 2, 1, 0]], {1, 3})):
        for flip in (1, -1):
            xyz = turned(points * [flip, 1])
            a, b = split_quadrilaterals(xyz, np.arange(4)[None]).tolist()
            assert set(a) & set(b) == diagonal


# --- frames of a run ------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("suffix", [".vtu", ".vtkhdf"])
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
    written(tmp_path, "tent.obj", TENT_V + TENT_VT + TENT_F)
    path = written(tmp_path, "scene.toml", SCENE.format(keys="", start=""))
    problem = fc.load_scene(path).build()
    assert problem.start.x[:, 2].max() == pytest.approx(1.3)
    assert any("vt is the flat cloth" in note for note in problem.notes())
    path.write_text(SCENE.format(keys='reference = "vt"\nscale = 2.0', start='plane = "xz"'))
    problem = fc.load_scene(path).build()
    assert np.ptp(problem.start.x, axis=0) == pytest.approx([3.8, 0.0, 2.0])
    path.write_text(SCENE.format(keys='reference = "v"', start=""))
    with pytest.raises(InputError, match="away from the plane"):
        fc.load_scene(path).build()
