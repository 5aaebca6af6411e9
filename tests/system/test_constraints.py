"""Pins bound to a cloth, and the projections for directions of any rank."""

import numpy as np
import pytest
from conftest import rough

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.system.constraints import Constraints, MatrixProjection


def test_groups_are_named_after_their_sets(small):
    sides = np.union1d(small.nodes("left"), small.nodes("right"))
    a, b, c = np.setdiff1d(np.arange(len(small.X)), sides)[:3]
    pins = ["left", fc.Pin([b, a]), fc.Pin("right", name="grip"), fc.Pin([c], name="grip")]
    constraints = Constraints.bind(pins, small)
    assert list(constraints.groups) == ["left", "pin1", "grip", "grip.2"]
    assert constraints.groups["pin1"][1].tolist() == [b, a]
    assert constraints.groups["grip"][1].tolist() == small.nodes("right").tolist()
    assert constraints.groups["left"][0] == fc.Pin("left")
    assert np.array_equal(constraints.nodes, np.union1d(sides, [a, b, c]))
    assert not constraints.projectors.any()


def test_a_node_of_two_pins_is_refused(small):
    corner = np.intersect1d(small.nodes("left"), small.nodes("bottom"))[0]
    with pytest.raises(fc.InputError, match=f"node {corner} is held by more than one pin"):
        Constraints.bind(["left", "bottom"], small)


def test_without_pins_all_nodes_are_free(small, rng):
    constraints = Constraints.bind([], small)
    y = rng.standard_normal((len(small.X), 3))
    assert np.array_equal(constraints.project(y.copy()), y)
    assert np.array_equal(constraints.hold(y, y + 1), y)
    assert np.array_equal(constraints.free(len(y)), np.arange(3 * len(y)))


def projectors_of(ranks, rng):
    """Orthogonal projectors onto random subspaces."""
    frames = [np.linalg.qr(rng.standard_normal((3, 3)))[0][:, :rank] for rank in ranks]
    return np.array([frame @ frame.T for frame in frames])


@pytest.fixture
def sliding(small, rng):
    """Four nodes that may move in 0, 1, 2 and 3 directions."""
    nodes = np.array([1, 2, 6, 9])
    groups = {"some": (fc.Pin(nodes), nodes)}
    return Constraints(groups, nodes, projectors_of((0, 1, 2, 3), rng))


def full(constraints, n):
    """(3n, 3n) P over all nodes."""
    P = np.eye(3 * n)
    for node, projector in zip(constraints.nodes, constraints.projectors, strict=True):
        P[3 * node : 3 * node + 3, 3 * node : 3 * node + 3] = projector
    return P


def test_projector_splits_free_and_held_parts(sliding, small, rng):
    y, target = rng.standard_normal((2, len(small.X), 3))
    P = full(sliding, len(small.X))
    rest = np.eye(len(P)) - P
    close = {"rtol": 0, "atol": 1e-14}
    expected = (P @ y.ravel()).reshape(-1, 3)
    held, kept = sliding.held_part(y), y.copy()
    np.testing.assert_allclose(held, (rest @ y.ravel()).reshape(-1, 3)[sliding.nodes], **close)
    mixed = (P @ y.ravel() + rest @ target.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(sliding.hold(y, target), mixed, **close)
    assert np.array_equal(y, kept)  # a copy; `project` works in place
    np.testing.assert_allclose(sliding.project(y), expected, **close)
    np.testing.assert_allclose(y, expected, **close)


@pytest.mark.parametrize("symmetric", [True, False])
def test_projected_matrix_is_the_dense_one(symmetric, sliding, small, rng):
    """P A P + (I − P) s with s the mean of the node's diagonal before."""
    n = len(small.X)
    pattern = BlockPattern.union(n, [small.stencil])
    A = BlockMatrix(pattern, rng.standard_normal((len(pattern.indices), 3, 3)))
    before = A.to_scipy().toarray()
    if symmetric:
        before = before + before.T
        blocks = before.reshape(n, 3, n, 3)
        A.values[:] = blocks[pattern.rows, :, pattern.indices, :]
    P, s = full(sliding, n), np.repeat(np.diag(before).reshape(-1, 3).mean(axis=1), 3)
    MatrixProjection.bind(sliding, pattern).apply(A)
    expected = P @ before @ P + (np.eye(3 * n) - P) * s[:, None]
    np.testing.assert_allclose(A.to_scipy().toarray(), expected, rtol=0, atol=1e-13)


def test_projected_tangent_of_pinned_nodes(small, isotropic, rng):
    """Rows and columns of a pinned node are s I; the free part is untouched to the last bit."""
    system = fc.System(small, isotropic, [fc.StVK()], pins=["left"])
    J = BlockMatrix.zeros(system.pattern)
    system.assemble(J, system.state(rough(small, rng)), wx=1.0, wa=3.0)
    before = J.to_scipy().toarray()
    after = system.project(J).to_scipy().toarray()
    free = system.free
    held = np.setdiff1d(np.arange(len(before)), free)
    assert np.array_equal(after[np.ix_(free, free)], before[np.ix_(free, free)])
    assert not after[np.ix_(held, free)].any()
    assert not after[np.ix_(free, held)].any()
    s = np.repeat(np.diag(before)[held].reshape(-1, 3).mean(axis=1), 3)
    np.testing.assert_allclose(after[np.ix_(held, held)], np.diag(s), rtol=1e-14)


def test_names_of_pins_are_unique(small):
    a, b, c = ([node] for node in range(3))
    pins = [fc.Pin(a, name="a"), fc.Pin(b, name="a.2"), fc.Pin(c, name="a")]
    constraints = Constraints.bind(pins, small)
    assert len(constraints.groups) == len(constraints.nodes) == 3
