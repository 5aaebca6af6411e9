"""The spectral radius of every registered method's own step, against textbook formulas."""

import numpy as np
import pytest
from support.one_step import generalized_alpha, newmark

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.stability.amplification_matrix import amplification

OMEGA_DT = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 1.9, 3.0, 10.0, 30.0, 100.0])
ALL = {**METHODS, **EXPLICIT}


def rates(w, z):
    """λ dt of the oscillator, (2,)."""
    root = np.sqrt(complex(z**2 - 1))
    return w * np.array([-z + root, -z - root])


def bdf2(w, z):
    """(3/2 − λ dt) μ² − 2 μ + ½ = 0."""
    root = np.sqrt(1 + 2 * rates(w, z))
    return np.concatenate([(2 + root), (2 - root)]) / np.tile(3 - 2 * rates(w, z), 2)


def midpoint(w, z):
    return (1 + rates(w, z) / 2) / (1 - rates(w, z) / 2)


def roots_of(step):
    """At dt = 1 s and a mass of 1 kg."""
    return lambda w, z: np.linalg.eigvals(step(w**2, 2 * z * w, 1.0, 1.0))


ROOTS = {  # by the name of a method, or by the method with its parameters
    "backward_euler": lambda w, z: 1 / (1 - rates(w, z)),
    "linearly_implicit_euler": lambda w, z: 1 / (1 - rates(w, z)),
    "implicit_midpoint": midpoint,
    "energy_momentum": midpoint,
    "newmark": midpoint,
    "generalized_alpha": roots_of(generalized_alpha(0.5)),
    "bdf2": bdf2,
    "forward_euler": lambda w, z: 1 + rates(w, z),
    "symplectic_euler": lambda w, z: np.roots([1, w**2 + 2 * z * w - 2, 1 - 2 * z * w]),
    # x'' by differences of x, and the force at v + dt a = x − x₋ + dt²/2 a₋
    "central_difference": lambda w, z: np.roots([1, w**2 + 3 * z * w - 2, 1 - 4 * z * w, z * w]),
    fc.GeneralizedAlpha(0.0): roots_of(generalized_alpha(0.0)),
    fc.GeneralizedAlpha(0.8): roots_of(generalized_alpha(0.8)),
    fc.GeneralizedAlpha(1.0): roots_of(generalized_alpha(1.0)),
    fc.Newmark(0.36, 0.7): roots_of(newmark(0.36, 0.7)),
    fc.Newmark(0.1, 0.5): roots_of(newmark(0.1, 0.5)),
}


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("method", ROOTS, ids=repr)
def test_every_method_meets_its_closed_form(method, zeta):
    computed = amplification(method, OMEGA_DT, zeta)
    roots = [np.atleast_1d(ROOTS[method](w, zeta)) for w in OMEGA_DT]
    expected = np.array([abs(r).max() for r in roots])
    # where two eigenvalues meet, round-off enters by its root: √2e-16 = 1.5e-8
    limit = np.where([two_meet(r) for r in roots], 3e-7, 1e-8) * (1 + expected)
    assert (abs(computed - expected) < limit).all()


def two_meet(roots):
    return (abs(roots[:, None] - roots) + np.eye(len(roots))).min() < 1e-6


def test_no_method_is_left_out():
    assert set(ALL) <= set(ROOTS)


@pytest.mark.parametrize("method", [*ALL, fc.Newmark(0.1, 0.5), fc.Newmark(0.2, 0.6)], ids=repr)
@pytest.mark.parametrize("zeta", [0.05, 0.3])
def test_growth_begins_at_the_limit_that_the_method_states(method, zeta):
    """The limit is that of `critical_dt` on the oscillator; A-stable methods never grow."""
    corner = fc.Cloth.from_arrays(np.eye(3)[:, 1:], [[0, 1, 2]])
    omega = 3.0
    fabric = fc.Fabric(3 / corner.area, 1.0)  # 1 kg a node
    spring = fc.Tether([0, 1, 2], (0, 0, 0), omega**2, 2 * zeta * omega)
    system = fc.System(corner, fabric, [spring])
    limit = omega * fc.critical_dt(system, system.rest(), method)
    if np.isinf(limit):
        assert amplification(method, OMEGA_DT, zeta).max() < 1
    else:
        below, above = amplification(method, limit * np.array([1 - 1e-5, 1 + 1e-5]), zeta)
        assert below < 1 < above


def test_numbers_and_arrays():
    number = fc.stability.amplification(fc.BackwardEuler, 1.0)
    assert isinstance(number, float)
    many = amplification(fc.BackwardEuler(), [1.0, 2.0], [[0.0], [0.1], [0.2]])
    assert many.shape == (3, 2)
    assert many[0, 0] == number


@pytest.mark.parametrize(
    "method", [*METHODS.values(), lambda: fc.GeneralizedAlpha(0.2), lambda: fc.Newmark(0.36, 0.7)]
)
def test_waves_far_beyond_the_step_fade_as_the_traits_say(method):
    computed = amplification(method(), [1e4], 0.0)[0]  # round-off enters by its root where two meet
    assert computed == pytest.approx(method().traits.at_infinity, abs=1e-2)
