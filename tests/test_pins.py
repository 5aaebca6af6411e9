"""Pins in a run, their prescribed motion, and the projections for directions of any rank."""

import numpy as np
import pytest
from conftest import flat, rough

import fecloth as fc
from fecloth.blocks import BlockMatrix, BlockPattern
from fecloth.integrators import METHODS
from fecloth.pins import Constraints, MatrixProjection

ALL = [method() for method in METHODS.values()]


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1)


def end_of_run(cloth, fabric, pins, method=ALL[0], t=0.0, **options):
    """State after four steps of 5 ms from `t`, with gravity and a start out of the plane."""
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=pins, **options)
    start = system.state(flat(cloth) + [0.0, 0.0, 0.7], np.full((len(cloth.X), 3), 0.1), t)
    return start, fc.run(system, method, start, 5e-3, t + 0.02, solver="direct").state


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("method", ALL, ids=lambda m: type(m).__name__)
def test_a_fixed_pin_stays_to_the_last_bit(method, mass, small, isotropic):
    start, end = end_of_run(small, isotropic, ["left", fc.Pin([3])], method, mass=mass)
    held = np.union1d(small.nodes("left"), [3])
    others = np.setdiff1d(np.arange(len(small.X)), held)
    assert np.array_equal(end.x[held], start.x[held])
    assert not end.v[held].any()
    assert abs(end.x - start.x)[others].max(axis=1).min() > 1e-5


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("method", ALL, ids=lambda m: type(m).__name__)
def test_a_moved_pin_is_where_its_motion_says(method, mass, small, isotropic):
    """Only the changes of the motion count, from the run's own start time."""

    def motion(t):
        return np.array([np.sin(9 * t), 5.0, 0.3 * t])

    def velocity(t):
        return np.array([9 * np.cos(9 * t), 0.0, 0.3])

    pins = [fc.Pin("left", motion, velocity)]
    start, end = end_of_run(small, isotropic, pins, method, t=0.3, mass=mass)
    held = small.nodes("left")
    expected = start.x[held] + motion(0.32) - motion(0.3)
    np.testing.assert_allclose(end.x[held], expected, rtol=0, atol=4e-15)
    assert np.array_equal(end.v[held], np.tile(velocity(0.32), (len(held), 1)))


def test_a_motion_for_each_node_of_a_set(small, isotropic):
    """(k, 3), in the order of the set's nodes: the edge turns about its lower end."""
    left = small.nodes("left")
    height = small.X[left, 1]

    def turn(t):
        zero = np.zeros_like(height)
        return np.column_stack([zero, height * np.cos(t), height * np.sin(t)])

    start, end = end_of_run(small, isotropic, [fc.Pin(left, turn)])
    expected = start.x[left] + turn(0.02) - turn(0.0)
    np.testing.assert_allclose(end.x[left], expected, rtol=0, atol=1e-15)
    speed = np.column_stack([0 * height, -height * np.sin(0.02), height * np.cos(0.02)])
    np.testing.assert_allclose(end.v[left], speed, atol=1e-10)


def test_velocity_by_central_difference_or_as_given():
    """The difference over ± 1e-5 s errs by 1e-10/6 of the third derivative."""
    pin = fc.Pin("left", lambda t: [np.sin(7 * t), t**2, 2.0])
    for t in (0.0, 0.4, 3.0):
        assert pin.speed(t) == pytest.approx([7 * np.cos(7 * t), 2 * t, 0.0], abs=7**3 * 1e-10)
        assert pin.displacement(t) == pytest.approx([np.sin(7 * t), t**2, 2.0], abs=1e-15)
    told = fc.Pin("left", lambda t: [t, 0.0, 0.0], velocity=lambda t: [1.0, 0.0, t])
    assert told.speed(0.5).tolist() == [1.0, 0.0, 0.5]
    assert not fc.Pin("left").speed(1.0).any()
    assert not fc.Pin("left").displacement(1.0).any()


@pytest.mark.parametrize("value", [[1.0, 2.0], 3.0, [0.0, np.nan, 0.0], np.zeros((1, 1, 3))])
@pytest.mark.parametrize("name", ["motion", "velocity"])
def test_a_motion_that_gives_no_three_finite_numbers(name, value):
    functions = {"motion": lambda t: np.zeros(3)} | {name: lambda t: value}
    pin = fc.Pin("left", **functions)
    with pytest.raises(fc.InputError, match=rf"Pin\('left'\): {name}\(0.5\) = .*: must be three"):
        pin.displacement(0.5) + pin.speed(0.5)


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


def test_no_pins_hold_nothing(small, rng):
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
    held, kept = sliding.held(y), y.copy()
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


def test_no_name_is_given_twice(small):
    a, b, c = ([node] for node in range(3))
    pins = [fc.Pin(a, name="a"), fc.Pin(b, name="a.2"), fc.Pin(c, name="a")]
    constraints = Constraints.bind(pins, small)
    assert len(constraints.groups) == len(constraints.nodes) == 3


def test_a_motion_for_each_node_follows_the_given_order(small):
    motion = {5: [1.0, 0.0, 0.0], 2: [0.0, 2.0, 0.0]}
    pin = fc.Pin([5, 2], motion=lambda t: t * np.array([motion[5], motion[2]]))
    x, v = Constraints.bind([pin], small).target(0.0, 1.0, flat(small))
    for node, way in motion.items():
        assert x[node] - flat(small)[node] == pytest.approx(way)
        assert v[node] == pytest.approx(way)


def test_motions_that_cannot_be_bound(small):
    with pytest.raises(fc.InputError, match="velocity without a motion"):
        fc.Pin("left", velocity=lambda t: [0.0, 0.0, 0.0])
    with pytest.raises(
        fc.InputError, match=r"motion of shape \(2, 3\): must be \(3,\) or \(3, 3\)"
    ):
        Constraints.bind([fc.Pin([1, 2, 3], motion=lambda t: np.zeros((2, 3)))], small)


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.BDF2()], ids=repr)
def test_a_motion_is_asked_for_from_the_start_on(method, small, isotropic):
    """One that has no value before, as √t³; its difference does not reach back either."""
    asked = []

    def motion(t):
        asked.append(t)
        return [0.0, 0.0, (t - 0.5) ** 1.5]  # complex before t = 0.5

    pins = [fc.Pin("left", lambda t: motion(0.5 + t))]
    system = fc.System(small, isotropic, [fc.StVK()], pins)
    end = fc.run(system, method, system.rest(), 1e-6, 5e-6).state  # less than the difference
    assert min(asked) >= 0.5
    left = small.nodes("left")
    assert end.x[left, 2] == pytest.approx(5e-6**1.5)
    far = fc.Pin("left", lambda t: [t**1.5, t**2, 0.0])
    assert far.speed(1.0, since=1.0) == pytest.approx([1.5, 2.0, 0.0], abs=1e-9)


def test_a_motion_that_is_no_motion_says_why():
    for motion, words in ((lambda t: (0, 0, "a"), "could not convert"), (lambda: 0, "argument")):
        with pytest.raises(fc.InputError, match=rf"Pin\('left'\): motion\(0.5\): .*{words}"):
            fc.Pin("left", motion).displacement(0.5)
