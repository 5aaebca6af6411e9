"""Multigrid: a definite preconditioner on every mesh, the true solution, and few iterations."""

import tracemalloc

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from support.matrices import difference, load, reference, relative, sheet
from support.tiers import stories_except

import fecloth as fc
from fecloth.compiled.team import ALONE, Team
from fecloth.linalg import aggregation
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.multigrid import ITERATIONS_PER_REBUILD, Multigrid, cycle
from fecloth.linalg.pcg import PCG, invert_diagonal
from fecloth.scene.plan import MULTIGRID_PER_BLOCK, MULTIGRID_PER_NODE

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
PINS = [
    ["left"],
    ["left", fc.Slide("right", normal=(1.0, 2.0, 3.0))],
    [fc.Slide("boundary", normal=(0, 0, 1))],
]


def cloth_system(h=0.17, pattern="unstructured", element="P1", bending=None, pins=("left",)):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern, element=element)
    terms = [fc.StVK(), fc.Gravity(), *([bending] if bending else [])]
    return fc.System(cloth, FABRIC, terms, list(pins))


def folded(system):
    """A state that is bent, stretched by 2 % in one direction and compressed in the other."""
    X, Y = system.cloth.X.T
    x = np.column_stack([1.02 * X, 0.97 * Y + 0.05 * np.sin(5 * X), 0.1 * np.sin(4 * X) * Y])
    return system.state(x)


def stretched(system):
    """A bent state whose exact tangent is definite."""
    X, Y = system.cloth.X.T
    return system.state(np.column_stack([1.1 * X, 1.1 * Y, 0.1 * np.sin(4 * X) * Y]))


STATES = [pytest.param(folded, True, id="clamped"), pytest.param(stretched, False, id="exact")]


def tangent(system, state, dt=5e-3, definite=True, team=ALONE):
    """M/dt + dt K, projected: the matrix of backward Euler."""
    A = BlockMatrix.zeros(system.pattern, team)
    system.assemble(A, state, wx=dt, wa=1 / dt, definite=definite)
    return system.project(A)


def prepared(A, x=None):
    solver = Multigrid()
    if x is not None:
        solver.begin(1.0, 1.0, x)
    solver.prepare(A)
    return solver


def preconditioner(solver):
    """The dense matrix of one cycle."""
    n = len(solver._inverse)
    columns = [cycle(solver._levels, e.reshape(n, 3)).ravel().copy() for e in np.eye(3 * n)]
    return np.array(columns).T


def check_definite(M):
    assert abs(M - M.T).max() < 1e-12 * abs(M).max()
    assert np.linalg.eigvalsh(0.5 * (M + M.T))[0] > 0


MESHES = [
    *((pattern, "P1", None) for pattern in ("unstructured", "right", "cross", "equilateral")),
    *((pattern, "P1", fc.HingeBending()) for pattern in ("unstructured", "right", "cross")),
    ("unstructured", "P1", fc.PlateBending()),
    ("unstructured", "P2", None),
    ("right", "P2", fc.PlateBending()),
]


@pytest.mark.parametrize(("shape", "definite"), STATES)
@pytest.mark.parametrize(("pattern", "element", "bending"), MESHES)
def test_a_cycle_is_symmetric_and_positive_definite(pattern, element, bending, shape, definite):
    system = cloth_system(0.3 if element == "P2" else 0.17, pattern, element, bending)
    state = shape(system)
    solver = prepared(tangent(system, state, definite=definite), state.x)
    assert len(solver._levels) >= 2
    check_definite(preconditioner(solver))


@pytest.fixture
def small_loops_shared(monkeypatch):
    """Loops over 20 nodes and more are shared: several levels of a small mesh."""
    monkeypatch.setattr("fecloth.compiled.team.SMALLEST_SHARED_LOOP", 20)
    monkeypatch.setattr("fecloth.linalg.multigrid.SMALLEST_SHARED_LOOP", 20)


@pytest.mark.parametrize(("pattern", "element", "bending"), MESHES[::9])
def test_threads_do_not_change_a_bit(pattern, element, bending, small_loops_shared):
    system = cloth_system(0.1 if element == "P2" else 0.05, pattern, element, bending)
    state, results = folded(system), []
    b = system.constraints.project(system.force(state))
    for threads in (1, 2, 3):
        team = Team(threads)
        solver = prepared(tangent(system, state, team=team), state.x)
        first, info = solver.solve(b, rtol=1e-4)
        solver.prepare(tangent(system, system.rest(), team=team))  # with the same coarse matrices
        second, after = solver.solve(b, rtol=1e-4, guess=first)
        levels = [array for each in solver._levels for array in (each.A.values, each.P.data)]
        counts = np.array([info.iterations, info.residual, after.iterations, after.residual])
        results.append([*levels, first, second, counts])
        assert team.used == threads
    assert sum(len(level.inverse) >= 20 for level in solver._levels) >= 2
    for other in results[1:]:
        for part, same in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(part, same)


@pytest.mark.parametrize(("shape", "definite"), STATES)
@pytest.mark.parametrize("pins", PINS)
def test_solution_is_that_of_a_direct_solver(pins, shape, definite):
    system = cloth_system(0.1, bending=fc.HingeBending(), pins=pins)
    state = shape(system)
    A, b = tangent(system, state, definite=definite), system.force(state)
    b = system.constraints.project(b)
    x, info = prepared(A, state.x).solve(b, rtol=1e-11)
    assert info.residual <= 1e-11
    assert difference(x, reference(A, b)) < 1e-8
    held = system.constraints.held_part(x)
    assert abs(held).max() < 1e-12 * abs(x).max()


def iterations(solver, A, b):
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-6)
    assert relative(A, x, b) <= 1e-6
    return info.iterations


def test_iterations_hardly_grow_with_the_mesh():
    """PCG's iterations double with the nodes in each direction; multigrid's grow as its root."""
    counts = []
    for h in (0.04, 0.02):
        system = cloth_system(h, bending=fc.HingeBending())
        state = folded(system)
        A, b = tangent(system, state), system.constraints.project(system.force(state))
        solver = Multigrid()
        solver.begin(1.0, 1.0, state.x)
        counts.append((iterations(PCG(), A, b), iterations(solver, A, b)))
    (plain, few), (plain_finer, few_finer) = counts
    assert plain_finer > 1.7 * plain
    assert few_finer / few < np.sqrt(plain_finer / plain)
    assert few_finer < 0.15 * plain_finer


@pytest.mark.parametrize("turned", [False, True])
def test_coarse_levels_represent_rigid_motions(turned):
    """They do where these take no energy: on an unstretched free cloth, in any place."""
    system = cloth_system(0.1, bending=fc.HingeBending(), pins=())
    x = system.rest().x
    if turned:
        x = x @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    A = BlockMatrix.zeros(system.pattern)
    system.assemble(A, system.state(x), wx=1.0)
    A.values[A.pattern.diagonal] += 1e-9 * np.eye(3)  # flat cloth without stress: singular blocks
    solver = prepared(A, x)
    coarse = dense_prolongator(solver._levels[0])
    assert coarse.shape[1] < len(coarse) / 2
    for spin in np.eye(3):
        turning = np.cross(spin, x) + 0.3
        fitted, *_ = np.linalg.lstsq(coarse, turning.ravel())
        assert difference((coarse @ fitted).reshape(x.shape), turning) < 1e-6


def dense_prolongator(level):
    P = level.P.toarray().reshape(len(level.inverse), 3, -1)
    return P[level.grid.order.places].reshape(3 * len(P), -1)


def test_prolongator_and_coarse_matrix_are_the_products():
    A = sheet(m=9, pinned=[0, 1, 2])
    pattern, rng = A.pattern, np.random.default_rng(2)
    of_node = aggregation.aggregate(pattern.indptr, pattern.indices)
    T = rng.normal(size=(6, len(pattern), 3))
    T[2, of_node == 1] = T[:, :3] = 0.0  # a motion without size, and pinned nodes
    inverse = np.empty((len(pattern), 6))
    invert_diagonal(A, inverse, "test")
    P = aggregation.prolongator(A, inverse, of_node, T)
    dense, tentative = A.to_scipy().toarray(), np.zeros((len(pattern), 3, of_node.max() + 1, 6))
    tentative[np.arange(len(pattern)), :, of_node] = T.transpose(1, 2, 0)
    tentative = tentative.reshape(len(dense), -1)
    D = scipy.linalg.block_diag(*A.values[pattern.diagonal])
    expected = tentative - 0.6 * np.linalg.solve(D, dense @ tentative)
    np.testing.assert_allclose(P.toarray(), expected, atol=1e-13 * abs(expected).max())
    coarse = aggregation.coarse_matrix(A, P, aggregation.coarse_pattern(pattern, of_node))
    expected = expected.T @ dense @ expected
    empty = expected.diagonal() == 0.0
    assert empty.any()
    expected[empty, empty] = 1.0
    np.testing.assert_allclose(coarse.to_scipy().toarray(), expected, atol=1e-12 * expected.max())


def test_coarse_matrices_are_kept_until_their_age_costs_as_much_as_new_ones():
    system = cloth_system(0.05, bending=fc.HingeBending())
    state = folded(system)
    b = system.constraints.project(system.force(state))
    near, far = (tangent(system, state, dt) for dt in (1e-3, 0.05))
    solver, kept, counts = Multigrid(), [], []
    for A in (near, near, far, far, far):
        solver.begin(1.0, 1.0, state.x)
        counts.append(iterations(solver, A, b))
        kept.append(solver._levels[1])
    assert kept[0] is kept[1] is kept[2]
    assert counts[2] >= counts[0] + ITERATIONS_PER_REBUILD
    assert kept[3] is not kept[2]
    assert kept[4] is kept[3]
    assert counts[3] < counts[2]


@pytest.mark.parametrize(
    "bending", stories_except([None, fc.HingeBending(), fc.PlateBending()], None)
)
def test_memory_is_about_as_planned(bending):
    system = cloth_system(0.02, bending=bending)
    state = folded(system)
    A, b = tangent(system, state), system.force(state)
    prepared(A, state.x).solve(b, rtol=0.1)  # compiles
    tracemalloc.start()
    prepared(A, state.x).solve(b, rtol=0.1)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    planned = MULTIGRID_PER_NODE * len(state.x) + MULTIGRID_PER_BLOCK * len(A.values)
    assert peak == pytest.approx(planned, rel=0.12)
    assert peak < 2500 * len(system.cloth.triangles)


def test_parts_that_are_not_coupled():
    """Two sheets: the coarsest level has an aggregate of each."""
    part = sheet(m=5).to_scipy()
    A = scipy.sparse.block_diag([part, 3.0 * part]).tobsr((3, 3))
    A.sort_indices()
    A = BlockMatrix(BlockPattern(A.indptr, A.indices), A.data)
    solver, b = prepared(A), load(A)
    x, _ = solver.solve(b, rtol=1e-11)
    assert difference(x, reference(A, b)) < 1e-8
    assert len(solver._levels[-1].inverse) == 4
