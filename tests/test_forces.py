"""Mass damping, point forces and forces of the user's own."""

import numpy as np
import pytest
from conftest import rough

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.verify import check_term, observed_order

TIGHT = fc.Newton(tolerance=1e-12)


# --- mass damping ---------------------------------------------------------------------------------


def test_mass_damping_is_minus_rate_times_the_momentum(sheet, isotropic, rng):
    check_term(fc.MassDamping(3.0))
    system = fc.System(sheet, isotropic, [fc.MassDamping(3.0)])
    x, v = rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))
    force = system.force(system.state(x, v))
    np.testing.assert_allclose(force, -3.0 * system.mass.dot(v.ravel()).reshape(-1, 3), rtol=1e-12)
    assert system.bound[0].power(x, v, 0.0) == pytest.approx(-np.vdot(force, v), rel=1e-13)
    assert system.rate_bounds() == pytest.approx((0.0, 3.0), rel=1e-12)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_free_cloth_loses_its_momentum_by_each_methods_own_factor(method, mass, sheet, isotropic):
    """e^(−α t): (1 − α dt/2)/(1 + α dt/2) a step by midpoint, 1/(1 + α dt) by the Euler methods."""
    rate, dt, v = 3.0, 0.02, np.array([1.0, -2.0, 0.5])
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.MassDamping(rate)], mass=mass)
    start = system.state(system.rest().x, np.tile(v, (len(sheet.X), 1)))
    result = fc.run(system, method(), start, dt, 0.2, solver="direct", newton=TIGHT)
    midpoint = method is fc.ImplicitMidpoint
    factor = (1 - rate * dt / 2) / (1 + rate * dt / 2) if midpoint else 1 / (1 + rate * dt)
    np.testing.assert_allclose(
        result.state.v, np.tile(factor**10 * v, (len(sheet.X), 1)), rtol=1e-8
    )
    assert factor**10 == pytest.approx(np.exp(-rate * 0.2), rel=1e-3 if midpoint else 0.03)
    lost = result.energies["dissipated:MassDamping"][-1] + result.energies["numerical"][-1]
    kinetic = result.energies["kinetic"]
    assert lost == pytest.approx(kinetic[0] - kinetic[-1], rel=1e-10)


def test_a_mode_decays_at_half_the_rate(isotropic):
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


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_what_is_no_rate(rate):
    with pytest.raises(fc.InputError, match="MassDamping: rate = .*: must be finite and > 0"):
        fc.MassDamping(rate)
