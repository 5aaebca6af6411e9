"""Rectangles and disks: patterns, sizes, quality; renumbering."""

import math

import numpy as np
import pytest
from support.drawn import drawn
from support.meshed import PATTERNS, STRUCTURED, areas, length

from fecloth.mesh.flat_mesh import FlatMesh, quality
from fecloth.mesh.generate import disk, rectangle
from fecloth.mesh.numbering import renumber_mesh


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


def shuffled(mesh, seed):
    rng = np.random.default_rng(seed)
    old = rng.permutation(len(mesh.X))
    new = np.argsort(old)
    t = new[mesh.triangles][rng.permutation(len(mesh.triangles))]
    sets = ({k: new[s] for k, s in each.items()} for each in (mesh.node_sets, mesh.edge_sets))
    return FlatMesh.from_arrays(mesh.X[old], t, *sets)


@drawn(lambda st: [st.sampled_from(STRUCTURED), st.integers(0, 2**32 - 1)], max_examples=20)
def test_renumber_mesh_is_a_permutation_of_the_same_mesh(pattern, seed):
    mesh = shuffled(rectangle(1.0, 0.7, 0.2, pattern), seed)
    new, nodes, triangles = renumber_mesh(mesh)
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
    again = FlatMesh.from_arrays(new.X, new.triangles, new.node_sets, new.edge_sets)
    assert np.array_equal(again.triangles, new.triangles)


def test_renumber_mesh_reduces_the_bandwidth():
    mesh = rectangle(1, 1, 0.03)
    band = [np.ptp(m.triangles, axis=1).max() for m in (mesh, renumber_mesh(mesh)[0])]
    assert band[1] < 0.1 * band[0]
    assert band[1] < 3 * math.sqrt(len(mesh.X))


def test_quality_of_known_triangles():
    X = np.array([[0, 0], [1, 0], [0, 1], [0.5, math.sqrt(0.75)]])
    q = quality(X, np.array([[0, 1, 3], [0, 1, 2], [0, 2, 1]]))
    assert q == pytest.approx([1, math.sqrt(0.75), -math.sqrt(0.75)])
