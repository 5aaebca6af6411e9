"""Mass damping, point forces and user-defined forces."""

import numpy as np
import pytest
from conftest import rough
from support.tiers import MASSES

import fecloth as fc
from fecloth.stability.critical_step import rate_bounds
from fecloth.verify import check_term, observed_order

TIGHT = fc.Newton(tolerance=1e-12)


# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


# --- point forces ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("where", "at"),
    [
        ("right", None),
        ([3, 7, 11], None),
        (lambda X: X[:, 1] > 0.5, None),
        ((0.33, 0.21), [0.33, 0.21]),
    ],
)
def test_point_force_resultant_is_the_force(where, at, sheet, isotropic, rng):
    F = np.array([1.0, -2.0, 0.5])
    check_term(fc.PointForce("left", tuple(F)), tangents=("x", "v"))
    system = fc.System(sheet, isotropic, [fc.PointForce(where, tuple(F))])
    state = system.state(system.rest().x, rng.standard_normal((len(sheet.X), 3)))
    force = system.force(state)
    np.testing.assert_allclose(force.sum(axis=0), F, rtol=1e-13)
    loaded = np.flatnonzero(force.any(axis=1))
    if at is None:
        assert loaded.tolist() == np.sort(sheet.nodes(where)).tolist()
        np.testing.assert_allclose(force[loaded], np.tile(F / len(loaded), (len(loaded), 1)))
    else:
        assert len(loaded) == 3
        moment = np.cross([*at, 0.0], F)
        np.testing.assert_allclose(np.cross(state.x, force).sum(axis=0), moment, rtol=1e-12)
    power = system.bound[0].supply(state.x, state.v, 0.0)
    assert power == pytest.approx(np.vdot(force, state.v), rel=1e-12)


# --- forces of the user's own ---------------------------------------------------------------------


def spring(x, v, t):
    """A force towards the axis z, with a swirl and nonlinear damping."""
    swirl = np.cross([0.0, 0.0, 1.5], x)
    return -3.0 * x * (1 + np.sum(x**2, axis=1))[:, None] + swirl - 0.2 * v * abs(v) * (1 + t)


def slopes(x, v, t):
    r2 = np.sum(x**2, axis=1)[:, None, None]
    turn = np.array([[0.0, -1.5, 0.0], [1.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    of_x = -3.0 * (np.eye(3) * (1 + r2) + 2 * x[:, :, None] * x[:, None, :]) + turn
    return of_x, -0.4 * (1 + t) * abs(v)[:, :, None] * np.eye(3)


WRITTEN = (
    "-3 * x * (1 + x**2 + y**2 + z**2) - 1.5 * y - 0.2 * vx * abs(vx) * (1 + t)",
    "-3 * y * (1 + x**2 + y**2 + z**2) + 1.5 * x - 0.2 * vy * abs(vy) * (1 + t)",
    "-3 * z * (1 + x**2 + y**2 + z**2) - 0.2 * vz * abs(vz) * (1 + t)",
)


@pytest.mark.parametrize(
    "arguments",
    [{"force": spring}, {"force": spring, "derivatives": slopes}, {"force": WRITTEN}],
    ids=["differences", "derivatives", "formulas"],
)
@pytest.mark.parametrize("per", ["area", "mass", "node"])
def test_user_force_is_the_function_times_the_amount(per, arguments, sheet, isotropic, rng):
    system = fc.System(sheet, isotropic, [fc.UserForce(**arguments, per=per, tangent="exact")])
    amount = {"area": sheet.load(), "mass": 0.2 * sheet.load(), "node": np.ones(len(sheet.X))}[per]
    state = system.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)), t=0.7)
    expected = amount[:, None] * spring(state.x, state.v, 0.7)
    force = system.force(state)
    np.testing.assert_allclose(force, expected, rtol=1e-12, atol=1e-15)
    power = system.bound[0].supply(state.x, state.v, 0.7)
    assert power == pytest.approx(np.vdot(force, state.v), rel=1e-12)
    for operator, exact in zip(
        (system.stiffness, system.damping), slopes(state.x, state.v, 0.7), strict=True
    ):
        blocks = operator(state).toarray().reshape(len(amount), 3, len(amount), 3)
        got = np.einsum("aiaj->aij", blocks)
        expected = -amount[:, None, None] * exact
        np.testing.assert_allclose(got, expected, atol=1e-8 * abs(expected).max())
        assert np.count_nonzero(blocks) == np.count_nonzero(got)


def test_the_symmetric_tangent_of_a_user_force_is_the_half_of_both(sheet, isotropic, rng):
    exact, plain = (
        fc.System(sheet, isotropic, [fc.UserForce(lambda x, v, t: -spring(x, v, t), tangent=kind)])
        for kind in ("exact", "symmetric")
    )
    state = exact.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)))
    K = exact.stiffness(state).toarray()
    assert (exact.symmetric, plain.symmetric) == (False, True)
    assert abs(K - K.T).max() > 0.1 * abs(K).max()
    np.testing.assert_allclose(plain.stiffness(state).toarray(), (K + K.T) / 2, atol=1e-12)


def test_mass_damping_is_consistent_on_quadratic_triangles(quadratic, isotropic, rng):
    """d = −α M v, also at the corners."""
    rate = 3.0
    damping = fc.MassDamping(rate)
    cloth, system = quadratic, fc.System(quadratic, isotropic, [damping])
    v = rng.standard_normal((len(cloth.X), 3))
    state = system.state(system.rest().x, v)
    M = system.mass.toarray()
    expected, D = -rate * M @ v.ravel(), system.damping(state).toarray()
    np.testing.assert_allclose(
        system.force(state).ravel(), expected, atol=1e-12 * abs(expected).max()
    )
    np.testing.assert_allclose(D, rate * M, atol=1e-12 * D.max())
    power = rate * v.ravel() @ M @ v.ravel()
    assert system.bound[0].power(state.x, v, 0.0) == pytest.approx(power, rel=1e-12)
    stiffness, bound = rate_bounds(system)
    assert stiffness == 0.0
    assert rate <= bound < 6 * rate


@pytest.mark.parametrize(
    ("method", "factor"), [(fc.BackwardEuler(), 1 / 1.06), (fc.ImplicitMidpoint(), 0.97 / 1.03)]
)
@pytest.mark.parametrize("mass", MASSES)
def test_mass_damping_takes_a_part_of_the_momentum_in_each_step(method, factor, mass, sheet):
    """Of e^(−α t): (1 − α dt/2)/(1 + α dt/2) for midpoint, 1/(1 + α dt) for Euler, α dt = 0.06."""
    rate, dt, v = 3.0, 0.02, np.array([1.0, -2.0, 0.5])
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    system = fc.System(sheet, fabric, [fc.StVK(), fc.MassDamping(rate)], mass=mass)
    start = system.state(system.rest().x, np.tile(v, (len(sheet.X), 1)))
    result = fc.run(system, method, start, dt, 0.2, solver="direct", newton=TIGHT)
    left = np.tile(factor**10 * v, (len(sheet.X), 1))
    np.testing.assert_allclose(result.state.v, left, rtol=1e-8)
    lost = result.energies["dissipated:MassDamping"][-1] + result.energies["numerical"][-1]
    kinetic = result.energies["kinetic"]
    assert lost == pytest.approx(kinetic[0] - kinetic[-1], rel=1e-10)


@pytest.mark.stories
def test_mass_damping_mode_decays_at_half_the_rate(isotropic):
    """A stretched strip's longitudinal mode: envelope e^(−α t/2), frequency √(ω² − α²/4)."""
    cloth = fc.Cloth.rectangle(1.0, 0.1, h=0.1, pattern="right")
    every = lambda X: (X[:, 0] > 1e-9) & (X[:, 0] < 1 - 1e-9)  # noqa: E731
    rate, fabric = 20.0, fc.Fabric(0.2, 1000.0, 0.0)
    pins = ["left", "right", fc.Slide(every, direction=(1, 0, 0))]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.MassDamping(rate)], pins)
    K, Z = system.stiffness(system.rest()), system.admissible
    M = (Z.T @ system.mass @ Z).toarray()
    values, vectors = np.linalg.eig(np.linalg.solve(M, (Z.T @ K @ Z).toarray()))
    lowest = np.argmin(values.real)
    omega, mode = np.sqrt(values.real[lowest]), (Z @ vectors.real[:, lowest]).reshape(-1, 3)
    damped = np.sqrt(omega**2 - rate**2 / 4)
    t = 4.25 * np.pi / damped  # over two periods, to where an error of the phase shows
    amplitude = 1e-6 / abs(mode).max()
    start = system.state(system.rest().x + amplitude * mode, -rate / 2 * amplitude * mode)
    errors = []
    for steps in (40, 80):
        end = fc.run(
            system, fc.ImplicitMidpoint(), start, t / steps, t, solver="direct", newton=TIGHT
        ).state
        left = np.vdot(end.x - system.rest().x, mode) / np.vdot(mode, mode) / amplitude
        errors.append(abs(left - np.exp(-rate * t / 2) * np.cos(damped * t)))
    assert errors[-1] < 0.02
    assert observed_order([2, 1], errors) == pytest.approx(2.0, abs=0.15)


@pytest.mark.stories
def test_user_force_harmonic_well_moves_all_nodes_equally(sheet, isotropic):
    """g = −ω² (x − X) per mass: x − X = u cos ωt for a cloth without strain."""
    omega, u = 5.0, np.array([0.1, -0.2, 0.3])
    parts = tuple(f"-25 * ({c} - {o})" for c, o in zip("xyz", ("X", "Y", "0"), strict=True))
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.UserForce(parts, per="mass")])
    assert rate_bounds(system)[0] >= omega**2
    start = system.state(system.rest().x + u)
    errors = []
    for dt in (0.02, 0.01):
        end = fc.run(
            system, fc.ImplicitMidpoint(), start, dt, 0.4, solver="direct", newton=TIGHT
        ).state
        moved = end.x - system.rest().x
        assert np.ptp(moved, axis=0).max() < 1e-9
        errors.append(np.linalg.norm(moved[0] - u * np.cos(omega * 0.4)))
    assert errors[-1] < 1e-3
    assert observed_order([2, 1], errors) == pytest.approx(2.0, abs=0.15)
