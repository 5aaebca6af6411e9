"""Pins bound to a cloth, and the projections for directions of any rank."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import rough

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.simulation.probes import _held_forces
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


def test_pins_that_agree_may_meet(small):
    sides = np.union1d(small.nodes("left"), small.nodes("bottom"))
    slides = [fc.Slide(side, normal=(0, 0, sign)) for side, sign in (("left", 1), ("bottom", -2))]
    lifted = [fc.Pin(side, ["0", "0", "t * X"]) for side in ("left", "bottom")]
    for pins in (["left", "bottom"], slides, lifted):
        constraints = Constraints.bind(pins, small)
        assert np.array_equal(constraints.nodes, sides)
        assert constraints.groups["bottom"][1].tolist() == small.nodes("bottom").tolist()
    x = np.zeros((len(small.X), 3))
    end, v = constraints.target(0.5, 0.25, x)  # no node is moved twice
    expected = np.where(np.isin(np.arange(len(x)), sides), small.X[:, 0], 0.0)
    np.testing.assert_allclose(end[:, 2], 0.25 * expected, atol=1e-15)
    np.testing.assert_allclose(v[:, 2], expected, atol=1e-15)


@pytest.mark.parametrize(
    "other",
    [
        fc.Pin("bottom", ["0", "0", "t"]),
        fc.Pin("bottom", rotate=fc.Rotation((0, 0, 0), (1, 0, 0), "t")),
    ],
)
def test_pins_that_differ_meet_where_one_is_left_out(other, small):
    corner = np.intersect1d(small.nodes("left"), small.nodes("bottom"))[0]
    apart = Constraints.bind([fc.Pin("left", without="bottom"), other], small)
    assert np.array_equal(np.sort(apart.groups["bottom"][1]), np.sort(small.nodes("bottom")))
    assert corner not in apart.groups["left"][1]
    kept = Constraints.bind(["left", replace(other, without="left")], small)
    assert corner in kept.groups["left"][1]
    assert corner not in kept.groups["bottom"][1]
    assert len(kept.nodes) == len(apart.nodes)


def test_rows_of_a_motion_are_of_the_nodes_that_are_left(small):
    left = np.setdiff1d(small.nodes("left"), small.nodes("bottom"))
    rows = lambda t: np.outer(np.arange(len(left)), [0.0, 0.0, t])  # noqa: E731
    constraints = Constraints.bind([fc.Pin("left", rows, without="bottom"), "bottom"], small)
    x, _ = constraints.target(0.0, 1.0, np.zeros((len(small.X), 3)))
    assert x[left, 2].tolist() == list(range(len(left)))


def test_reactions_of_pins_that_meet_hold_the_whole_load(small, isotropic):
    terms = [fc.StVK(), fc.Gravity((1.0, 2.0, 0.0))]
    slides = [fc.Slide("left", normal=(1, 0, 0)), fc.Slide("bottom", normal=(0, 1, 0))]
    load = -0.2 * 0.12 * np.array([1.0, 2, 0])
    for pins in (["left", "bottom"], ["left", fc.Pin("bottom", without="left")], slides):
        system = fc.System(small, isotropic, terms, pins)
        rest = fc.equilibrium(system, system.rest())
        forces = _held_forces(system, -system.force(rest))
        np.testing.assert_allclose(sum(forces.values()), load, rtol=1e-9)
        assert forces["left"][0] < -1e-3
    np.testing.assert_allclose(forces["left"], [load[0], 0, 0], rtol=1e-9)  # of the slides


def test_the_reaction_of_a_clamp_is_the_weight():
    cloth = fc.Cloth.rectangle(1.0, 0.25, h=0.125, pattern="right")
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=0.01)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    rest = fc.equilibrium(system, system.rest())
    reaction = _held_forces(system, -system.force(rest))["left"]
    np.testing.assert_allclose(reaction, [0, 0, 0.05 * 9.81], atol=1e-6)


def test_clamps_that_meet_hold_each_edge_once(small):
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    apart = [fc.Pin("boundary", clamp=True)]
    meeting = [fc.Pin("boundary", clamp=True), fc.Pin("left", clamp=True), "top"]
    one, other = (fc.System(small, fabric, terms, pins) for pins in (apart, meeting))
    x = rough(small, np.random.default_rng(2))
    assert np.array_equal(one.force(one.state(x)), other.force(other.state(x)))


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
