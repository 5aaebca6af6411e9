"""The reference solutions against their own equations and against other discretisations."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize

from studies.references.closed_forms import (
    hanging_strip,
    hanging_strip_mean,
    hanging_strip_tip,
    strip_wave,
    strip_wave_frequency,
)
from studies.references.elastica import heavy_elastica
from studies.references.falling_disk import trampoline

GRAVITY = 9.81
DISK = {"radius": 0.5, "tensile_stiffness": 1000.0, "poisson_ratio": 0.3, "areal_density": 0.2}

# length, tensile_stiffness, areal_density: strain at the clamp about 2e-6, 2 %, 55 %, 250 %
STRIPS = [(1.0, 1e6, 0.2), (2.0, 200.0, 0.2), (1.0, 1.5, 0.2), (3.0, 0.3, 0.2)]


def _relative(value, reference):
    return np.max(np.abs(value - reference)) / np.max(np.abs(reference))


@pytest.mark.parametrize("strip", STRIPS)
def test_hanging_strip_satisfies_its_balance(strip):
    length, stiffness, density = strip
    X = np.linspace(0.02, 0.98, 25) * length
    step = 1e-3 * length
    ends = [hanging_strip(X + k * step, *strip, GRAVITY) for k in (-2, -1, 1, 2)]
    stretch = 1 + (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
    force = 0.5 * stiffness * stretch * (stretch**2 - 1)
    assert _relative(force, density * GRAVITY * (length - X)) < 1e-7
    assert hanging_strip(0.0, *strip) == 0.0


@pytest.mark.parametrize("strip", STRIPS)
def test_hanging_strip_tip_and_mean_against_quadrature(strip):
    length, stiffness, density = strip

    def strain(X):
        load = 2 * density * GRAVITY * (length - X) / stiffness
        return brentq(lambda e: e * (1 + e) * (2 + e) - load, 0, load + 1, xtol=1e-15)

    tip, _ = quad(strain, 0, length, epsabs=0, epsrel=1e-10)
    # by definition, on the displacement, unlike the closed form
    mean, _ = quad(lambda X: hanging_strip(X, *strip, GRAVITY), 0, length, epsabs=0, epsrel=1e-10)
    assert hanging_strip_tip(*strip, GRAVITY) == pytest.approx(tip, rel=1e-8)
    assert hanging_strip_mean(*strip, GRAVITY) == pytest.approx(mean / length, rel=1e-12)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_strip_wave_solves_the_wave_equation(mode):
    length, stiffness, density, amplitude = 2.0, 80.0, 0.2, 1e-3
    period = 2 * np.pi / strip_wave_frequency(length, stiffness, density, mode)
    X, t = np.meshgrid(np.linspace(0.1, 1.9, 8), np.linspace(0.1, 1.2, 7) * period)

    def u(X, t):
        return strip_wave(X, t, length, stiffness, density, amplitude, mode)

    dX, dt = 1e-3 * length, 1e-3 * period
    inertia = density * (u(X, t + dt) - 2 * u(X, t) + u(X, t - dt)) / dt**2
    force = stiffness * (u(X + dX, t) - 2 * u(X, t) + u(X - dX, t)) / dX**2
    assert _relative(inertia, force) < 2e-5
    assert u(0.0, 0.3) == 0.0
    assert u(length, 0.0) == pytest.approx(amplitude * (-1) ** (mode - 1), rel=1e-12)
    assert abs(u(length, 0.0) - u(length - dX, 0.0)) < 1e-4 * amplitude  # free end: u_X = 0
    assert u(length, dt) == pytest.approx(u(length, -dt))  # starts at rest


@pytest.fixture(scope="module")
def times():
    return np.linspace(0.0025, 0.2, 80)


@pytest.fixture(scope="module")
def meshes(times):
    return {n: trampoline(times, elements=n, **DISK) for n in (50, 100, 200, 400, 800)}


@pytest.mark.stories
def test_trampoline_mean_deflection_converges(meshes):
    means = [run.mean_deflection for run in meshes.values()]
    peak = means[-1].max()
    changes = [np.abs(fine - coarse).max() / peak for coarse, fine in pairwise(means)]
    order = np.log2(changes[0] / changes[-1]) / (len(changes) - 1)
    # The focused front leaves kinks behind, so the order is that of a kinked solution, not 2.
    assert 1.0 < order < 2.5
    # At order 1 the default mesh is off by at most twice its change under refinement.
    assert 2 * changes[-1] < 1e-4


@pytest.mark.parametrize(("courant", "bound"), [(0.5, 1e-6), (0.25, 2.5e-7)])
def test_trampoline_keeps_its_energy(times, courant, bound):
    run = trampoline(times, elements=200, courant=courant, **DISK)
    area = np.pi * DISK["radius"] ** 2
    work = DISK["areal_density"] * GRAVITY * area * run.mean_deflection
    assert _relative(run.kinetic_energy + run.elastic_energy, work) < bound


@pytest.mark.stories
def test_trampoline_centre_falls_freely_until_the_front_arrives(meshes, times):
    run = meshes[400]
    fall = 0.5 * GRAVITY * times**2
    before = times <= 0.112
    assert np.abs(run.centre / fall - 1)[before].max() < 1e-6
    after = (times > 0.12) & (times < 0.2)
    assert (run.centre < 0.9 * fall)[after].all()
    assert (run.least_stress[before] >= 0).all()


def test_trampoline_layer_at_the_rim_grows_like_t_to_the_five_thirds():
    # Before its longitudinal waves have crossed the disk, 2 a/c = 13 ms, the layer that the rim
    # holds back, of width d, is pulled by N ~ ρ c d/dt (w_x² d), w_x ~ g t²/d, and grows with
    # √(N/ρ): d³ ~ g² c t⁵, and the mean falls short of g t²/2 by the fraction ~ d/a.
    t = np.array([0.006, 0.01])
    lag = 1 - trampoline(t, elements=1600, **DISK).mean_deflection / (0.5 * GRAVITY * t**2)
    assert np.log(lag[1] / lag[0]) / np.log(t[1] / t[0]) == pytest.approx(5 / 3, abs=0.03)


@pytest.mark.parametrize(("gamma", "softness"), [(5.0, 0.05), (20.0, 0.2)])
def test_elastica_that_stretches_is_the_limit_of_a_chain(gamma, softness):
    """Links with the energy Y E²/2, hinges with θ²/(2 l): the least potential, in units of B/L."""
    links = 200
    l, Y = 1 / links, gamma / softness
    beyond = 1 - (np.arange(links) + 0.5) * l
    gaps = np.r_[l / 2, np.full(links - 1, l)]  # the first hinge is that of the clamp

    def potential(unknowns):
        angle, stretch = unknowns.reshape(2, -1)
        strain, bend = (stretch**2 - 1) / 2, np.diff(angle, prepend=0.0)
        load = gamma * l * beyond
        value = np.sum(Y * l * strain**2 + bend**2 / gaps) / 2 - load @ (stretch * np.sin(angle))
        moment = np.append(bend / gaps, 0.0)
        by_angle = moment[:-1] - moment[1:] - load * stretch * np.cos(angle)
        return value, np.r_[by_angle, Y * l * strain * stretch - load * np.sin(angle)]

    start = np.r_[np.zeros(links), np.ones(links)]
    options = {"maxiter": 20_000, "maxfun": 40_000, "ftol": 1e-15, "gtol": 1e-9}
    result = minimize(potential, start, jac=True, method="L-BFGS-B", options=options)
    angle, stretch = result.x.reshape(2, -1)
    end = l * np.sum(stretch * np.cos(angle)), l * np.sum(stretch * np.sin(angle))
    _, reach, drop = heavy_elastica(gamma, softness=softness)
    assert (reach[-1], drop[-1]) == pytest.approx(end, abs=1e-4)
    assert abs(drop[-1] - heavy_elastica(gamma)[2][-1]) > 5e-3
