"""The drift that a method states is that of its own step on an oscillator."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.stability.amplification_matrix import step_matrix

CASES = {name: method() for name, method in {**METHODS, **EXPLICIT}.items()}
CASES |= {f"rho = {rho}": fc.GeneralizedAlpha(rho) for rho in (0.0, 0.3, 0.8, 1.0)}
CASES |= {f"beta = {beta}": fc.Newmark(beta) for beta in (0.26, 0.15, 0.4)}
CASES |= {f"gamma = {gamma}": fc.Newmark(0.5, gamma) for gamma in (0.6, 0.9)}


def drift(method, omega_dt):
    """|log λ / (i ω dt) − 1| of the eigenvalue λ that stands for the oscillator."""
    values = np.linalg.eigvals(step_matrix(method, omega_dt, 0.0))
    value = values[np.argmin(abs(values - np.exp(1j * omega_dt)))]
    return abs(np.log(value) / (1j * omega_dt) - 1)


@pytest.mark.parametrize("name", CASES)
def test_drift_of_a_method_matches_its_claim(name):
    method, omega_dt = CASES[name], 0.02
    order, constant = method.traits.drift
    assert drift(method, omega_dt) / omega_dt**order == pytest.approx(constant, rel=0.01)
