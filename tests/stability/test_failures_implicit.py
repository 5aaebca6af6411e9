"""Where implicit steps and the models fail: the boundaries predicted, and those found."""

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, flat
from scipy.optimize import brentq

import fecloth as fc


def swing(method, dt=0.01, t_end=0.6):
    """Largest energy [J] over that at the start, of which 0.98 J can become motion."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    fabric = fc.Fabric(0.2, 1e4, 0.3, bending_rigidity=1e-5)
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    if dt is None:
        dt = 0.9 * fc.critical_dt(system, system.rest())
    marching = fc.march(system, method, system.rest(), dt, t_end, most_stretch=np.inf)
    return max(sum(system.energies(state).values()) for state, _ in marching)


GAIN = [fc.ImplicitMidpoint(), fc.Newmark(0.25, 0.5), fc.GeneralizedAlpha(0.8)]


KEEP = [fc.EnergyMomentum("exact"), fc.BackwardEuler(), fc.BDF2(), fc.GeneralizedAlpha(0.0)]


METHODS = [
    (fc.ImplicitMidpoint(), 5e-3),
    (fc.EnergyMomentum(), 5e-3),
    (fc.CentralDifference(), 1e-3),
]


THIRD = 1 / np.sqrt(3)


# --- 3, 4 and 8: a flat sheet in compression ------------------------------------------------------


def squeezed(pins):
    """A sheet compressed by 5 %, its dt = 1/λ for the least eigenvalue −λ² of M⁻¹K, that mode."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK()], pins=[pins])
    x, Z = affine(cloth, [[0.95, 0.0], [0.0, 1.0], [0.0, 0.0]]), system.admissible
    K, M = (Z.T @ A @ Z for A in (system.stiffness(system.state(x)), system.mass))
    values, modes = scipy.linalg.eigh(K.toarray(), M.toarray())
    mode = (Z @ modes[:, 0]).reshape(-1, 3)  # out of the plane
    return system, x, 1 / np.sqrt(-values[0]), mode


@pytest.fixture(scope="module")
def framed():
    """In equilibrium, unstable."""
    return squeezed("boundary")


@pytest.fixture(scope="module")
def released():
    """About to expand."""
    return squeezed("left")


def step(system, method, start, dt, definiteness="on_failure", solver="direct", tolerance=1e-6):
    newton = fc.Newton(tolerance, definiteness=definiteness)
    ((end, info),) = fc.march(system, method, start, dt, dt, solver=solver, newton=newton)
    return end, info.counts


@pytest.mark.parametrize("share", [0.9, 0.99, 0.999])
def test_linearised_step_multiplies_buckling_by_the_predicted_factor(share, framed):
    """1/(1 − λ²dt²), without bound as dt nears 1/λ."""
    system, x, boundary, mode = framed
    start, dt = system.state(x + 1e-8 * mode), share * boundary
    end, _ = step(system, fc.LinearlyImplicitEuler(), start, dt, tolerance=1e-12)
    buckled = np.vdot(system.nodal_mass[:, None] * mode, end.x - x)  # mode·M mode = 1
    assert buckled / 1e-8 == pytest.approx(1 / (1 - share**2), rel=1e-3)


def test_where_the_linearised_step_explodes_newton_cannot_raise_the_energy(framed):
    """From rest, for its end is where energy and inertia are lower than at the start."""
    system, x, boundary, mode = framed
    start, dt = system.state(x + 1e-7 * mode), np.sqrt(1 - 1e-6) * boundary
    before = sum(system.energies(start).values())
    with pytest.raises(fc.StepFailed, match="a triangle is stretched to"):
        step(system, fc.LinearlyImplicitEuler(), start, dt, tolerance=1e-12)
    solved, _ = step(system, fc.BackwardEuler(), start, dt)
    assert sum(system.energies(solved).values()) <= before


def test_the_exact_tangent_is_indefinite_from_the_predicted_step_on(released):
    system, x, boundary, _ = released
    start, method = system.state(x), fc.BackwardEuler()
    _, counts = step(system, method, start, 0.99 * boundary, "none")
    assert counts.residual <= 1e-6
    with pytest.raises(fc.StepFailed, match="not positive definite.*on_failure.*smaller dt"):
        step(system, method, start, 1.01 * boundary, "none")
    _, counts = step(system, method, start, 1.01 * boundary, "on_failure")
    assert counts.modified > 0
    assert counts.residual <= 1e-6


# --- 6: StVK in compression -----------------------------------------------------------------------


def thrust(term, load):
    """Stretch at rest under a thrust [N/m] of a strip of 1 m, all nodes kept on lines along it."""
    cloth = fc.Cloth.rectangle(1.0, 0.05, h=0.05, pattern="right")
    rails = fc.Slide(lambda X: X[:, 0] > 0.01, direction=(1.0, 0.0, 0.0))
    terms = [term, fc.PointForce("right", (-0.05 * load, 0.0, 0.0))]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.0), terms, pins=["left", rails])
    end = fc.equilibrium(system, system.rest(), load_steps=5)
    return end.x[cloth.nodes("right"), 0].mean()


def test_stvk_gives_way_beyond_one_over_root_three():
    """Its thrust Y λ (1 − λ²)/2 is largest there, and the mirror image bears the rest."""

    def too_much(stretch, load):
        return 500.0 * stretch * (1 - stretch**2) - load

    most = too_much(THIRD, 0.0)
    for share in (0.9, 0.99):
        stretch = brentq(too_much, THIRD, 1.0, args=(share * most,))
        assert thrust(fc.StVK(), share * most) == pytest.approx(stretch, rel=1e-6)
    mirrored = brentq(too_much, -2.0, -1.0, args=(1.01 * most,))
    assert thrust(fc.StVK(), 1.01 * most) < 0.9 * mirrored
    assert thrust(fc.NeoHookean(), 1.01 * most) > 0.8
    assert thrust(fc.NeoHookean(), 20 * most) > 0.2


# --- 9: springs -----------------------------------------------------------------------------------


def pushed(term, force):
    """Height of an equilateral triangle's apex, pushed towards the held base by `force` [N]."""
    corners = [[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(0.75)]]
    cloth = fc.Cloth.from_arrays(corners, [[0, 1, 2]], {"base": [0, 1], "apex": [2]})
    rail = fc.Slide("apex", direction=(0.0, 1.0, 0.0))
    terms = [term, fc.PointForce("apex", (0.0, -force, 0.0))]
    fabric = fc.Fabric(0.2, 200 * THIRD, 1 / 3)  # that of springs of 100 N/m
    system = fc.System(cloth, fabric, terms, pins=["base", rail])
    end = fc.equilibrium(system, system.rest(), load_steps=10)
    return end.x[cloth.nodes("apex"), 1].mean()


@pytest.mark.stories
def test_springs_are_pushed_through():
    """A truss of two bars; its force 2 k (L₀/L − 1) y is largest at L = (L₀ b²)^(1/3)."""
    length = 0.25 ** (1 / 3)
    height = np.sqrt(length**2 - 0.25)
    most = 2 * 100.0 * (1 / length - 1) * height
    springs = fc.Springs(stiffness=100.0)
    assert pushed(springs, 0.98 * most) > height
    assert pushed(springs, 1.02 * most) < -1.0
    assert pushed(fc.NeoHookean(), 5 * most) > 0.1
    # StVK, its width held: Y/(1 − ν²) λ (1 − λ²)/2 on half the base, and still less
    modulus = 200 * THIRD / (1 - 1 / 9)
    less = 0.5 * modulus * THIRD * (1 - THIRD**2) / 2
    assert less < 0.3 * most
    assert pushed(fc.StVK(), 0.98 * less) > THIRD * np.sqrt(0.75)
    assert pushed(fc.StVK(), 1.02 * less) < -0.5


# --- 11: hinge bending near a fold ----------------------------------------------------------------

B, RADIUS = 1e-3, np.sqrt(0.5)  # of a hinge over the diagonal of a square: k = 2 B


def hinge(term):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right")
    flap = np.flatnonzero((cloth.X[:, 0] > 0.5) & (cloth.X[:, 1] < 0.5))
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=B)
    held = fc.Pin(lambda X: (X[:, 0] < 0.5) | (X[:, 1] > 0.5))
    return fc.System(cloth, fabric, [fc.StVK(), term], pins=[held]), flap[0]


def folded(system, node, angle, rate=0.0):
    out, up = np.array([1.0, -1.0, 0.0]) / np.sqrt(2), np.array([0.0, 0.0, 1.0])
    x, v = flat(system.cloth), np.zeros((4, 3))
    x[node] = [0.5, 0.5, 0.0] + RADIUS * (np.cos(angle) * out + np.sin(angle) * up)
    v[node] = rate * RADIUS * (np.cos(angle) * up - np.sin(angle) * out)
    return system.state(x, v)


@pytest.mark.parametrize(
    ("term", "moment"),
    [(fc.HingeBending(), 2 * B * np.pi), (fc.QuadraticBending(), 0.0)],
    ids=["angle", "quadratic"],
)
def test_the_moment_jumps_where_the_angle_does(term, moment):
    """From k π to −k π, at the fold itself; the quadratic form has 2 k sin²(θ/2), and no jump."""
    system, node = hinge(term)
    for angle, sign in ((np.pi - 1e-7, 1), (np.pi + 1e-7, -1)):
        ahead = folded(system, node, angle, rate=1.0).v[node]  # ∂x/∂θ
        force = system.force(folded(system, node, angle))
        assert np.isfinite(force).all()
        assert force[node] @ ahead == pytest.approx(-sign * moment, abs=1e-8)


@pytest.mark.stories
@pytest.mark.parametrize("method", GAIN, ids=repr)
def test_these_make_energy_where_the_waves_are_not_resolved(method):
    assert swing(method) > 0.1


@pytest.mark.stories
@pytest.mark.parametrize("method", KEEP, ids=repr)
def test_these_make_none_there(method):
    assert swing(method) < 1e-5


@pytest.mark.stories
def test_the_midpoint_rule_makes_none_below_the_explicit_limit():
    assert swing(fc.ImplicitMidpoint(), None, 0.1) < 1e-4


@pytest.mark.stories
@pytest.mark.parametrize(("method", "dt"), METHODS, ids=repr)
def test_it_goes_through_where_its_energy_suffices(method, dt):
    """½ I ω² against ½ k (π² − θ₀²); all stays finite, and the energy is that of the start."""
    system, node = hinge(fc.HingeBending())
    inertia = system.nodal_mass[node] * RADIUS**2
    enough = np.sqrt(2 * B * (np.pi**2 - 3.0**2) / inertia)
    for share, through in ((0.97, False), (1.03, True)):
        start = folded(system, node, 3.0, share * enough)
        states = [state for state, _ in fc.march(system, method, start, dt, 1.2)]
        assert (states[-1].x[node, 2] < 0) == through
        energies = [sum(system.energies(state).values()) for state in [start, *states]]
        assert np.ptp(energies) < 1e-3 * energies[0]
