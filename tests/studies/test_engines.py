"""The known values of `fecloth bench` against other ways to them, and fecloth on its cases."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from fecloth.bench.cases import CASES
from fecloth.bench.runner import load_adapter, run_level
from studies.engines import __main__ as engines
from studies.engines import references

G = 9.81
RESTING = {"cantilever": 0.01, "catenary": 1e-3, "elastica": 0.01, "hanging": 0.005, "shear": 1e-9}
MOVING = {"flight": 1e-4, "string": 1e-3, "trampoline": 0.01, "wave": 0.03}


def known(name):
    said = CASES[name]["reference"]
    return said["value"], said["uncertainty"]


# --- the files state what the script computes


# the trampoline is a time integration
STORIES = {"trampoline": pytest.mark.stories}


@pytest.mark.parametrize("name", [pytest.param(n, marks=STORIES.get(n, ())) for n in CASES])
def test_files_state_the_values_of_the_script(name):
    said = CASES[name]
    value, uncertainty = references.CASES[name](said)
    scale = said["reference"]["scale"]
    # the elastica is solved to 1e-9
    assert np.allclose(value, said["reference"]["value"], rtol=0, atol=1e-8 * scale)
    assert uncertainty == pytest.approx(said["reference"]["uncertainty"], rel=1e-3, abs=1e-15)
    assert scale == pytest.approx(max(np.abs(value).max(), 0.0) or scale)


def test_measured_values_are_those_of_the_publications():
    # extension of the last point, and what the force of the first point stands for
    slack = 0.1476 / (12.1663 - 0.1476)
    assert known("nylon")[0] == pytest.approx(4.0404e-3 * (1 + slack), rel=1e-12)
    assert known("drape")[0] == 49.8
    assert known("drape")[1] == pytest.approx(math.hypot(2.4, 3.6), abs=0.05)
    assert known("knit") == pytest.approx((1.284e-3, 0.555e-3), abs=1e-6)


# --- the same numbers by other ways


def test_cantilever_by_twice_the_double_integral_of_its_moment():
    B, rho, L = 0.04, 0.2, 0.1
    sag = quad(lambda X: (L - X) * rho * G * (L - X) ** 2 / (2 * B), 0, L)[0]
    assert known("cantilever")[0] == pytest.approx(-sag, rel=1e-9)


def test_catenary_by_integration_of_its_balance():
    """From the middle to one end: dx = cos θ (1 + T/Y) ds, dz = sin θ (1 + T/Y) ds."""
    Y, w, L = 2000.0, 0.2 * G, 1.0

    def half(H, part):
        def slope(s):
            T = math.hypot(H, w * s)
            return (H if part == 0 else w * s) / T * (1 + T / Y)

        return quad(slope, 0, L / 2, epsabs=1e-13)[0]

    H = brentq(lambda H: half(H, 0) - 0.4 * L, 0.01, 10, xtol=1e-13)
    assert known("catenary")[0] == pytest.approx(-half(H, 1), rel=1e-9)


def test_string_by_a_chain_of_masses():
    """The lowest eigenvalue of masses on taut links of N = Y λ (λ² − 1)/2, extrapolated."""
    Y, rho, L, stretch = 1000.0, 0.2, 1.0, 1.001
    N = Y * stretch * (stretch**2 - 1) / 2

    def period(n):
        link = L / n
        stiffness = N / (stretch * link)  # across, of a link of length λ l with the force N
        matrix = 2 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)
        lowest = np.linalg.eigvalsh(stiffness / (rho * link) * matrix)[0]
        return 2 * np.pi / math.sqrt(lowest)

    value, uncertainty = known("string")
    assert value == pytest.approx((4 * period(40) - period(20)) / 3, rel=1e-6)
    linear = 2 * L * math.sqrt(rho * stretch / (Y * (stretch - 1)))
    assert uncertainty == pytest.approx(linear - value)


def test_wave_by_the_eigenmodes_of_the_strip():
    """u = Σ (a_k cos ω_k t + b_k sin ω_k t/ω_k) sin(k X), k = (2 i − 1) π/(2 L)."""
    c, A, L = math.sqrt(1000.0 / 0.2), 3e-5, 1.0
    X = np.linspace(0, L, 4001)
    pulse = A * np.exp(-(((X - 0.4) / 0.1) ** 2))
    speed = c * 200 * (X - 0.4) * pulse
    k = (2 * np.arange(1, 61) - 1) * np.pi / (2 * L)
    shapes = np.sin(np.outer(k, X))
    a, b = (2 / L * np.trapezoid(shapes * f, X, axis=1) for f in (pulse, speed))
    t = np.array(CASES["wave"]["times"])[:, None]
    end = (a * np.cos(c * k * t) + b / (c * k) * np.sin(c * k * t)) @ np.sin(k * L)
    assert np.abs(end - known("wave")[0]).max() < 1e-5 * 2 * A


def test_flight_by_the_modes_of_a_spinning_disk():
    """Rings from rest under ω² r; what they turn less and swing is below the uncertainty."""
    rho, Y, nu, omega, a, n = 0.2, 1000.0, 0.3, 2 * math.pi, 0.1, 60
    h, plane = a / n, Y / (1 - nu**2)
    r = h * (np.arange(n) + 1)
    middle = r - h / 2
    radial = (np.eye(n) - np.eye(n, k=-1)) / h
    hoop = (np.eye(n) + np.eye(n, k=-1)) / 2 / middle[:, None]
    area = (middle * h)[:, None]
    K = plane * (radial.T @ (area * (radial + nu * hoop)) + hoop.T @ (area * (hoop + nu * radial)))
    mass = rho * r * h
    mass[-1] /= 2
    root = np.sqrt(mass)
    square, modes = np.linalg.eigh(K / np.outer(root, root))
    t = np.linspace(0, 0.5, 5001)
    swing = (1 - np.cos(np.sqrt(square)[:, None] * t)) / square[:, None]
    u = (modes @ (swing * (modes.T @ (root * omega**2 * r))[:, None])) / root[:, None]
    turned = omega * 2 * (mass * r) @ u / (mass @ r**2)  # of the speed that the inertia takes
    late = a * np.trapezoid(turned, t)
    largest = math.hypot(late, np.abs(u[-1]).max())
    assert 0.7 * known("flight")[1] < largest < known("flight")[1]


# --- fecloth on the cases


@pytest.fixture(scope="module")
def fecloth():
    return load_adapter(f"{engines.HERE / 'fecloth_p1.py'}:run")


@pytest.mark.stories
@pytest.mark.parametrize("name", RESTING | MOVING)
def test_fecloth_is_right_on_a_coarse_mesh(name, fecloth):
    rows = [run_level(fecloth, CASES[name], level) for level in (0, 1)]
    errors = [row["error"] for row in rows]
    at_most = (RESTING | MOVING)[name]
    floor = max(rows[0]["uncertainty"], 1e-9)
    assert errors[1] < at_most
    assert errors[1] < max(0.4 * errors[0], floor)


@pytest.mark.stories
@pytest.mark.parametrize("name", ["knit", "nylon"])
def test_fecloth_meets_no_measurement_better_than_its_law(name, fecloth):
    """The meshes agree with each other far better than with what was measured."""
    errors = [run_level(fecloth, CASES[name], level)["error"] for level in (0, 1)]
    assert abs(errors[1] - errors[0]) < 0.1 * errors[1]
