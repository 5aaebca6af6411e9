"""Sewn edges: patch test, the cut strip that is the strip, momentum."""

from dataclasses import replace

import numpy as np
import pytest
from support.sewn_strips import SEAM, halves, in_order, shifted, whole_and_cut
from support.tiers import in_turn
from support.wrong_calls import CORNERED, DART
from support.wrong_calls import ISOTROPIC as FABRIC

import fecloth as fc


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_constant_stress_passes_edges_that_do_not_match(element):
    cloth = halves((0.06, 0.045), element=element)
    system = fc.System(cloth, FABRIC, [fc.StVK()], seams=[SEAM])
    F = np.array([[1.02, 0.01], [-0.02, 0.99], [0.0, 0.1]])
    x = cloth.X @ F.T
    followers = system.constraints.followers
    assert np.abs(followers.gap(x)).max() < 1e-15
    residual = system.constraints.reduce(system.force(system.state(x)))
    outside = np.isin(cloth.X[:, 0], (0.0, 1.0)) | np.isin(cloth.X[:, 1], (0.0, 0.25))
    size = np.abs(system.force(system.state(x))).max()
    assert np.abs(residual[~outside]).max() < 1e-11 * size


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_pulled_strip_has_its_closed_form(element):
    """F = 50 N/m along a strip with ν = 0: S₁₁ √(1 + 2 E₁₁) = F, E₁₁ = S₁₁/Y, at all nodes."""
    fabric = replace(FABRIC, poisson_ratio=0.0)
    cloth = halves((0.06, 0.045), element=element)
    pull = fc.EdgeForce("b/right", (50.0, 0.0, 0.0))
    system = fc.System(cloth, fabric, [fc.StVK(), pull], pins=[fc.Pin("a/left")], seams=[SEAM])
    start = system.state(system.rest().x * (1.05, 1.0, 1.0))
    x = fc.equilibrium(system, start, tolerance=1e-12).x
    stretch = np.roots([0.5, 0.0, -0.5, -50.0 / 1000.0]).real.max()
    expected = np.column_stack([stretch * cloth.X[:, 0], cloth.X[:, 1], np.zeros(len(x))])
    np.testing.assert_allclose(x, expected, atol=1e-11)


def both_strips(element: str, mass: str):
    """Systems of the whole strip and of the sewn one, a start of each, and their common nodes."""
    whole, cut = whole_and_cut(element, "right")
    terms = [fc.StVK(), fc.StrainRateDamping(time=0.01), fc.Gravity((0, 0, -9.81))]
    systems = (
        fc.System(whole, FABRIC, terms, pins=["left"], mass=mass),
        fc.System(cut, FABRIC, terms, pins=["a/left"], mass=mass, seams=[SEAM]),
    )
    for system in systems:
        X = system.cloth.X
        x = np.column_stack([X, 0.05 * np.sin(3 * X[:, 0])])
        v = np.column_stack([0 * X[:, 0], X[:, 0], 0 * X[:, 0]])
        yield system, system.state(x, v), in_order(system, X)


METHODS = [
    (fc.BackwardEuler(), "lumped", 5e-3),
    (fc.BDF2(), "consistent", 5e-3),
    (fc.GeneralizedAlpha(), "lumped", 5e-3),
    (fc.Newmark(), "consistent", 5e-3),
    (fc.EnergyMomentum(), "consistent", 5e-3),
    (fc.LinearlyImplicitEuler(), "lumped", 1e-3),
    (fc.SymplecticEuler(), "lumped", 2e-6),
    (fc.CentralDifference(), "lumped", 2e-6),
]


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize(("case", "element"), in_turn(METHODS, ["P1", "P2", "P2"]), ids=str)
def test_a_cut_and_sewn_strip_moves_as_the_strip(case, element):
    (method, mass, dt), ends = case, []
    newton = {} if dt < 1e-4 else {"newton": fc.Newton(tolerance=1e-12)}
    for system, start, nodes in both_strips(element, mass):
        result = fc.run(system, method, start, dt=dt, t_end=5 * dt, **newton)
        ends.append((result.state.x[nodes], result.energies["remainder"][-1], result))
        followers = system.constraints.followers
        assert not followers.gap(result.state.x).any()
        assert not followers.gap(result.state.v).any()
    (x, remainder, _), (x_sewn, remainder_sewn, result) = ends
    np.testing.assert_allclose(x_sewn, x, rtol=0, atol=1e-10)
    assert remainder_sewn == pytest.approx(remainder, rel=1e-6, abs=1e-11)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_cut_and_sewn_strip_has_the_frequencies_of_the_strip(mass):
    frequencies = []
    for system, _, _ in both_strips("P1", mass):
        taut = system.replace(terms=[fc.StVK()])
        start = taut.state(taut.rest().x * (1.02, 1.0, 1.0))
        frequencies.append(fc.modes(taut, start, count=6).frequencies)
    np.testing.assert_allclose(frequencies[1], frequencies[0], rtol=1e-9, atol=1e-6)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_stable_step_of_a_sewn_strip_is_that_of_the_strip():
    limits = [
        [
            fc.critical_dt(system, start, "central_difference"),
            fc.stability.lanczos_estimate.estimate(system, start, fc.CentralDifference()),
        ]
        for system, start, _ in both_strips("P1", "lumped")
    ]
    np.testing.assert_allclose(limits[1], limits[0], rtol=0.02)
    assert limits[1][0] == pytest.approx(limits[0][0], rel=1e-6)


def bag(element: str) -> fc.System:
    """Two pieces with edges that do not match, sewn along three sides."""
    a, b = (fc.Cloth.rectangle(0.5, 0.25, h=h, element=element) for h in (0.06, 0.045))
    seams = [fc.Seam(f"a.{side}", f"b.{side}") for side in ("left", "right", "bottom")]
    cloth = fc.Cloth.join([a, b], names=["a", "b"])
    return fc.System(cloth, FABRIC, [fc.StVK()], seams=seams)


@pytest.mark.parametrize(
    ("method", "element", "mass"),
    [
        (fc.ImplicitMidpoint(), "P1", "lumped"),
        (fc.ImplicitMidpoint(), "P1", "consistent"),
        (fc.ImplicitMidpoint(), "P2", "consistent"),
        (fc.CentralDifference(), "P1", "lumped"),
        (fc.CentralDifference(), "P2", "lumped"),
    ],
    ids=str,
)
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_a_thrown_bag_keeps_its_momenta(method, element, mass):
    system = bag(element).replace(mass=mass)
    cloth = system.cloth
    x = system.rest().x
    height = 0.05 * np.sin(2 * np.pi * x[:, 0]) * np.sin(4 * np.pi * x[:, 1])
    x[:, 2] = np.where(np.isin(np.arange(len(x)), cloth.nodes("a")), height, -height)
    follow = system.constraints.followers.follow
    x = follow(x)
    v = follow(np.cross([1.0, 2.0, 3.0], x) + (1.0, 0.0, 2.0))

    def momenta(state):
        p = system.mass_times(state.v)
        return np.append(p.sum(axis=0), np.cross(state.x, p).sum(axis=0))

    # of the cloth without seams, whose nodes that follow have their own mass
    p = cloth.mass(mass, system.panel.density) @ v
    np.testing.assert_allclose(momenta(system.state(x, v))[:3], p.sum(axis=0), rtol=1e-13)
    assert system.total_mass == pytest.approx(0.2 * cloth.area, rel=1e-14)
    dt = 2e-6 if isinstance(method, fc.CentralDifference) else 2e-4
    start = system.state(x, v)
    newton = {} if dt < 1e-4 else {"newton": fc.Newton(tolerance=1e-13)}
    end = fc.run(system, method, start, dt=dt, t_end=20 * dt, **newton).state
    assert np.abs(end.x - x).max() > 1e-5
    np.testing.assert_allclose(momenta(end), momenta(start), rtol=0, atol=1e-12)


def test_corners_of_four_pieces_are_one_node():
    square = fc.Cloth.rectangle(0.5, 0.5, h=0.25, pattern="right")
    names = ["a", "b", "c", "d"]
    pieces = [shifted(square, X, Y) for Y in (0.0, 0.5) for X in (0.0, 0.5)]
    cloth = fc.Cloth.join(pieces, names=names)
    seams = [
        fc.Seam("a.right", "b.left"),
        fc.Seam("c.right", "d.left"),
        fc.Seam("a.top", "c.bottom"),
        fc.Seam("b.top", "d.bottom"),
    ]
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()], pins=["a/left"], seams=seams)
    middle = np.flatnonzero((np.abs(cloth.X - 0.5) < 1e-9).all(axis=1))
    assert len(middle) == 4
    assert len(np.setdiff1d(middle, system.constraints.followers.nodes)) == 1
    # five nodes along each side of one square of 1 m
    assert len(cloth.X) - len(system.constraints.followers.nodes) == 25
    inside = system.nodal_mass[np.setdiff1d(middle, system.constraints.followers.nodes)]
    assert inside == pytest.approx(0.2 * 0.25**2)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_a_pin_on_a_node_that_follows_holds_its_leader():
    _, cut = whole_and_cut("P1", "right")
    system = fc.System(cut, FABRIC, [fc.StVK(), fc.Gravity()], pins=["b/left"], seams=[SEAM])
    assert set(system.constraints.nodes) == set(cut.nodes("a/right"))
    rest = system.rest()
    x = fc.run(system, fc.BackwardEuler(), rest, dt=0.01, t_end=0.02).state.x
    held = cut.nodes("b/left")
    np.testing.assert_array_equal(x[held], rest.x[held])


def test_three_triangles_are_sewn_to_a_cone():
    angle = np.radians([0.0, 30.0, 60.0, 90.0])
    X = np.vstack([(0.0, 0.0), np.column_stack([np.cos(angle), np.sin(angle)])])
    cloth = fc.Cloth(X, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]]))
    system = fc.System(
        cloth, FABRIC, [fc.StVK()], seams=[fc.Seam(np.array([0, 1]), np.array([0, 4]))]
    )
    assert len(system.free) == 3 * 4


def body_force(X: np.ndarray) -> np.ndarray:
    """−div P (n, 2) of `smooth`, for StVK with ν = 0 and Y = 1000 N/m, by differences [N/m²]."""
    step = 1e-4

    def stress(X):
        F = np.stack(
            [(smooth(X + d) - smooth(X - d)) / (2 * step) for d in step * np.eye(2)], axis=-1
        )
        E = (np.swapaxes(F, 1, 2) @ F - np.eye(2)) / 2
        return F @ (1000.0 * E)

    return -sum(
        (stress(X + d) - stress(X - d))[..., k] / (2 * step) for k, d in enumerate(step * np.eye(2))
    )


def smooth(X: np.ndarray) -> np.ndarray:
    """A deformation (n, 2) of the strip that varies along the seam and across it."""
    wave = 0.02 * np.sin(np.pi * X[:, 0]) * np.sin(4 * np.pi * X[:, 1] + 0.5)
    return X + np.column_stack([0.5 * wave, wave])


@pytest.mark.parametrize(("element", "order"), [("P1", 2.0), ("P2", 2.5)])
def test_errors_beside_a_seam_that_does_not_match_have_order_2(element, order):
    """A known deformation in the plane, under the body force that belongs to it."""
    errors = []
    for n in (8, 16):
        sizes = 0.5 / n, 0.5 / (3 * n // 2 - 1)
        cloth = halves(sizes, element=element, pattern="right")
        X = cloth.X
        exact = np.column_stack([smooth(X), 0 * X[:, 0]])
        border = np.isin(X[:, 0], (0.0, 1.0)) | np.isin(X[:, 1], (0.0, 0.25))
        load = np.column_stack([body_force(X), 0 * X[:, 0]])
        system = fc.System(
            cloth,
            replace(FABRIC, poisson_ratio=0.0),
            [fc.StVK(), fc.UserForce(lambda x, v, t, load=load: load)],
            pins=[
                fc.Pin(np.flatnonzero(border)),
                fc.Slide(np.flatnonzero(~border), normal=(0, 0, 1)),
            ],
            seams=[SEAM],
        )
        x = fc.equilibrium(system, system.state(exact), tolerance=1e-10).x
        errors.append(np.sqrt(np.mean(np.sum((x - exact) ** 2, axis=1))))
    assert np.log2(errors[0] / errors[1]) > order - 0.2


def test_edges_that_meet_are_sewn_from_where_they_meet():
    """As the two sides of a dart; and around a corner where too few triangles are left out."""
    seam = fc.Seam("left", "right", reverse=True, close=1.0)
    system = fc.System(DART, FABRIC, [fc.StVK()], seams=[seam])
    assert len(system.constraints.followers.nodes) == 1
    for other, reverse in (("bottom", False), ("top", True)):
        corner = np.intersect1d(CORNERED.nodes("left"), CORNERED.nodes(other))
        edges = (np.setdiff1d(CORNERED.nodes(side), corner) for side in ("left", other))
        fc.System(CORNERED, FABRIC, [fc.StVK()], seams=[fc.Seam(*edges, reverse)])


def test_a_pin_on_both_edges_of_a_seam_holds_one():
    free = [
        fc.System(halves(), FABRIC, [fc.StVK()], pins=pins, seams=[SEAM]).free
        for pins in (["a/right", "b/left"], ["a/right"])
    ]
    assert len(free[0]) == len(free[1])


def test_seams_may_follow_seams():
    """Four pieces, each sewn to the next one along the same edge: all follow the first."""
    cloth = fc.Cloth.join([fc.Cloth.rectangle(0.5, 0.25, h=0.25 / n) for n in (4, 5, 6, 7)], "abcd")
    seams = [fc.Seam(f"{first}.left", f"{second}.left") for first, second in ("ab", "bc", "cd")]
    system = fc.System(cloth, FABRIC, [fc.StVK()], seams=seams)
    followers = system.constraints.followers
    leaders = followers.T[followers.nodes].indices
    assert set(leaders) <= set(cloth.nodes("a/left"))
    assert np.abs(followers.gap(system.rest().x @ np.diag([1.1, 0.9, 1.0]))).max() < 1e-15
