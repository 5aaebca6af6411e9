"""Slides: projectors, the directions left, planes of symmetry; prescribed accelerations."""

import numpy as np
import pytest
from conftest import flat
from support.tiers import MASSES, in_turn, stories_except

import fecloth as fc
from fecloth.integrators import METHODS

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ALL = [method() for method in METHODS.values()]
TIGHT = fc.Newton(tolerance=1e-12)
SLOPED = np.array([1.0, -2.0, 2.0]) / 3


# --- the projector --------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [1e-200, 1.0, 3.0, 1e200])
def test_projectors(length, rng):
    d = rng.standard_normal(3)
    d /= np.linalg.norm(d)
    line = fc.Slide("left", direction=tuple(length * d)).projector
    plane = fc.Slide("left", normal=tuple(length * d)).projector
    np.testing.assert_allclose(line, np.outer(d, d), atol=1e-15)
    np.testing.assert_allclose(plane, np.eye(3) - np.outer(d, d), atol=1e-15)
    assert not fc.Pin("left").projector.any()


SHARED = [  # a second slide, and the direction that both leave free
    ({"normal": (0, 1, 0)}, (0, 0, 1)),
    ({"normal": (1, 1, 0)}, (0, 0, 1)),
    ({"normal": (0, 1, 2)}, (0, -2, 1)),
    ({"direction": (0, 0, 3)}, (0, 0, 1)),
    ({"direction": (1, 0, 1)}, (0, 0, 0)),
]


@pytest.mark.parametrize(("second", "free"), SHARED)
def test_slides_that_meet_hold_a_node_together(second, free, small):
    slides = [fc.Slide("left", normal=(1, 0, 0)), fc.Slide("bottom", **second)]
    constraints = fc.System(small, fc.Fabric(0.2, 1e3), [], slides).constraints
    corner = np.intersect1d(small.nodes("left"), small.nodes("bottom"))[0]
    line = np.array(free) / max(np.linalg.norm(free), 1)
    P = constraints.projectors[np.searchsorted(constraints.nodes, corner)]
    np.testing.assert_allclose(P, np.outer(line, line), atol=1e-15)
    for name, slide in zip(("left", "bottom"), slides, strict=True):
        others = np.setdiff1d(small.nodes(name), corner)
        own = constraints.projectors[np.searchsorted(constraints.nodes, others)]
        assert (own == slide.projector).all()


def test_each_node_has_its_own_groups_projector(small):
    """The groups stand in any order, and their nodes too."""
    first, second = small.nodes("right"), small.nodes("left")[::-1]
    slides = [fc.Slide(first, normal=(0, 0, 1)), fc.Slide(second, direction=(0, 1, 0))]
    constraints = fc.System(small, fc.Fabric(0.2, 1e3), [], slides).constraints
    for group, slide in ((first, slides[0]), (second, slides[1])):
        at = np.searchsorted(constraints.nodes, group)
        assert (constraints.projectors[at] == slide.projector).all()


@pytest.mark.parametrize(("method", "mass"), in_turn(ALL, MASSES), ids=str)
def test_prescribed_acceleration_is_that_of_the_motion(method, mass, small, isotropic):
    """A cloth moved by its edge at the acceleration that gravity has: no strain, no force.

    The free nodes fall, the pinned ones are moved along with them; a wrong acceleration at the
    pins would reach the free nodes through the consistent mass, and the reaction at once.
    """
    g, v0 = np.array([1.0, -2.0, -9.81]), np.array([0.3, 0.0, 0.1])
    # the Euler methods' own fall is ½ g t (t + dt); the motion must be theirs
    lag = 0.0 if method.traits.order == 2 else 5e-3
    pin = fc.Pin(
        "left", lambda t: v0 * t + 0.5 * g * t * (t + lag), lambda t: v0 + g * t, name="edge"
    )
    slide = fc.Slide("right", pin.motion, pin.velocity, normal=tuple(SLOPED), name="rail")
    system = fc.System(small, isotropic, [fc.StVK(), fc.Gravity(tuple(g))], [pin, slide], mass=mass)
    start = system.state(flat(small), np.tile(v0, (len(small.X), 1)))
    result = fc.run(system, method, start, 5e-3, 0.05, solver="direct", newton=TIGHT)
    np.testing.assert_allclose(result.state.v, np.tile(v0 + 0.05 * g, (len(start.x), 1)), atol=1e-9)
    weight = 0.2 * small.area * 9.81
    for group in ("edge", "rail"):
        for c in "xyz":
            assert abs(result.observed[f"reaction:{group}.{c}"][1:]).max() < 1e-8 * weight


# --- the degrees of freedom left ------------------------------------------------------------------


def test_free_dofs_with_slides_along_the_axes(small, isotropic):
    slides = [fc.Slide([4], direction=(0, 3, 0)), fc.Slide([2], normal=(0, 0, -1)), fc.Pin([7])]
    system = fc.System(small, isotropic, [fc.StVK()], slides)
    held = {3 * 4, 3 * 4 + 2, 3 * 2 + 2, 21, 22, 23}
    assert set(system.free.tolist()) == set(range(3 * len(small.X))) - held
    Z = system.admissible.toarray()
    assert system.constraints.count_free(len(small.X)) == Z.shape[1]
    assert set(np.flatnonzero(Z.any(axis=1)).tolist()) == set(system.free.tolist())
    np.testing.assert_allclose(Z.T @ Z, np.eye(len(system.free)), atol=1e-15)


# --- in a scene -----------------------------------------------------------------------------------

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }]
time = { method = "implicit_midpoint", dt = 0.01, t_end = 0.1 }
[[pins]]
where = "left"
normal = [1, 0, 0]
[[pins]]
inside = "X > 0.99"
direction = [0, 1, 0.5]
motion = ["0.1 * t", "0", "0"]
name = "rail"
"""


def test_slides_of_a_scene(tmp_path):
    from fecloth.scene.scene import load_scene

    (path := tmp_path / "scene.toml").write_text(SCENE)
    scene = load_scene(path)
    groups = scene.build().system.constraints.groups
    assert groups["left"][0] == fc.Slide("left", normal=(1.0, 0.0, 0.0))
    rail, _ = groups["rail"]
    assert isinstance(rail, fc.Slide)
    assert (rail.direction, rail.normal) == ((0.0, 1.0, 0.5), None)
    assert rail.motion(2.0) == pytest.approx([0.2, 0.0, 0.0])
    (again := tmp_path / "again.toml").write_text(scene.to_toml())
    assert load_scene(again) == scene


# --- planes of symmetry ---------------------------------------------------------------------------

SHEET = fc.Fabric.sheet(E=1e9, nu=0.3, thickness=1e-3, rho=1e3)
SYMMETRY = [
    fc.Slide("right", normal=(1, 0, 0), clamp=True),
    fc.Slide("top", normal=(0, 1, 0), clamp=True),
]


def middle_of_plate(side, n, pins):
    """How far the middle of a clamped square plate of 1 m sinks; it is the corner of a quarter."""
    cloth = fc.Cloth.rectangle(side, side, h=side / n, pattern="cross")
    system = fc.System(
        cloth, SHEET, [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -1e-4))], pins
    )
    x = fc.equilibrium(system, system.rest()).x
    return x[np.flatnonzero((abs(cloth.X - 0.5) < 1e-9).all(axis=1)), 2]


def test_a_quarter_by_symmetry_bends_as_the_whole_plate():
    """0.00126 q a⁴/D: Timoshenko and Woinowsky-Krieger (1959), table 35."""
    edges = [fc.Pin("left", clamp=True), fc.Pin("bottom", clamp=True)]
    whole = middle_of_plate(1.0, 24, [fc.Pin("boundary", clamp=True)])
    quarter = middle_of_plate(0.5, 12, [*edges, *SYMMETRY])
    D = 1e9 * 1e-9 / (12 * (1 - 0.3**2))
    assert quarter == pytest.approx(whole, rel=2e-3)
    assert quarter == pytest.approx(-0.00126 * 1e-4 / D, rel=0.02)


def test_the_plane_of_a_clamp_goes_along_with_the_edge(rng):
    """Shifts and turns in the plane of symmetry change no angle, and the moment is a couple."""
    cloth = fc.Cloth.rectangle(0.5, 0.5, h=0.125)
    system = fc.System(cloth, SHEET, [fc.PlateBending()], SYMMETRY[:1])
    x = system.rest().x + 0.02 * rng.standard_normal((len(cloth.X), 3))
    x[cloth.nodes("right"), 0] = 0.5
    c, s = np.cos(0.7), np.sin(0.7)
    moved = x @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + (0.0, 3.0, -2.0)
    energy, other = (system.energies(system.state(y))["PlateBending"] for y in (x, moved))
    assert other == pytest.approx(energy, rel=1e-6)
    f = system.force(system.state(x))
    np.testing.assert_allclose(f.sum(axis=0), 0.0, atol=1e-7 * np.abs(f).max())


def test_a_guided_end_keeps_its_slope():
    """q L³/(12 B) under a load q along the end, which slides across: a quarter of a free end."""
    cloth = fc.Cloth.rectangle(1.0, 0.1, h=0.025, pattern="right")
    fabric = fc.Fabric(0.2, 1e4, bending_rigidity=0.01)
    guide = fc.Slide("right", direction=(0, 0, 1), clamp=True)
    terms = [fc.StVK(), fc.PlateBending(), fc.EdgeForce("right", (0, 0, 1e-6))]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True), guide])
    x = fc.equilibrium(system, system.rest()).x
    assert x[cloth.nodes("right"), 2] == pytest.approx(1e-6 / (12 * 0.01), rel=2e-3)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("solver", stories_except(["direct", "pcg", "multigrid"], "pcg"))
def test_uniaxial_tension_between_two_slides(solver, turned, small, isotropic, rng):
    """The sides contract freely: E22 = −ν E11, and the force is Y E11 λ times the width.

    Backward Euler at 0.02 s takes 4/5 of the slowest mode at each of 30 steps after the pull.
    """
    turn = np.eye(3)
    if turned:
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    axis, across, normal = turn
    corner = np.argmin(np.abs(small.X).sum(axis=1))
    left = np.setdiff1d(small.nodes("left"), corner)
    inside = np.setdiff1d(np.arange(len(small.X)), [*left, corner, *small.nodes("right")])
    pull = 0.05
    pins = [
        fc.Pin([corner], name="corner"),
        fc.Slide(left, direction=tuple(across), name="left"),
        fc.Slide("right", lambda t: pull * min(t, 0.4) / 0.4 * axis, direction=tuple(across)),
        fc.Slide(inside, normal=tuple(normal)),
    ]
    system = fc.System(small, isotropic, [fc.StVK()], pins)
    start = system.state(flat(small) @ turn)
    newton = fc.Newton(tolerance=1e-10)
    result = fc.run(system, fc.BackwardEuler(), start, 0.02, 1.0, solver=solver, newton=newton)
    stretch = 1 + pull / 0.4
    strain = (stretch**2 - 1) / 2
    thin = np.sqrt(1 - 2 * 0.3 * strain)
    expected = (flat(small) * [stretch, thin, 0.0]) @ turn
    np.testing.assert_allclose(result.state.x, expected, atol=1e-8)
    reaction = np.array([result.observed[f"reaction:right.{c}"][-1] for c in "xyz"])
    force = 1000.0 * strain * stretch * 0.3
    np.testing.assert_allclose(reaction, force * axis, atol=1e-6 * force)


def test_pressure_is_symmetric_where_the_edge_slides_in_one_plane(isotropic, rng):
    cloth = fc.Cloth.disk(0.5, h=0.15)
    inner = np.setdiff1d(np.arange(len(cloth.X)), cloth.nodes("boundary"))
    x = flat(cloth)
    x[inner] += 0.05 * rng.standard_normal((len(inner), 3))
    for pins, symmetric in (([fc.Slide("boundary", normal=(0, 0, 1))], True), ([], False)):
        system = fc.System(cloth, isotropic, [fc.Pressure(50.0, tangent="exact")], pins)
        K, Z = system.stiffness(system.state(x)), system.admissible
        K = (Z.T @ K @ Z).toarray()
        gap = abs(K - K.T).max() / abs(K).max()
        assert (gap < 1e-14) if symmetric else (gap > 0.1)
