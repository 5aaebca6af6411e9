"""P2 without bending, against closed forms: the catenary, and the waves of a taut strip.

On the flat strip both strains have the same linear forces, because the interpolated one keeps the
mean of E in a triangle.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

import fecloth as fc

STIFFNESS, DENSITY = 1000.0, 0.2  # N/m, kg/m²
SPAN, WIDTH, STRETCH = 0.8, 0.25, 1.01
STRAINS = "interpolated", "pointwise"


def strip(h, strain, stiffness, *terms):
    cloth = fc.Cloth.rectangle(1.0, WIDTH, h, pattern="right", element="P2")
    fabric, membrane = fc.Fabric(DENSITY, stiffness, 0.0), fc.StVK(strain=strain)
    return fc.System(cloth, fabric, [membrane, *terms], ["left", "right"], threads=1)


def slack(h, strain, stiffness=100 * STIFFNESS):
    """Relative error of the sag; the search begins at the catenary."""
    a = brentq(lambda a: np.sinh(a) / a - 1 / SPAN, 1e-3, 5.0)
    c = SPAN / (2 * a)
    system = strip(h, strain, stiffness, fc.Gravity())
    s, Y = system.cloth.X.T - [[0.5], [0.0]]
    z = np.hypot(c, s) - np.hypot(c, 0.5)
    start = system.state(np.column_stack([c * np.arcsinh(s / c) + SPAN / 2, Y, z]))
    x = fc.equilibrium(system, start).x
    middle = system.cloth.interpolator(np.array([[0.5, WIDTH / 2]])) @ x
    return -middle[0, 2] / (c * (np.cosh(a) - 1)) - 1


def taut(h, strain):
    """Relative error of the second frequency across, c/L with c² = Y E/ρ."""
    system = strip(h, strain, STIFFNESS)
    X, Y = system.cloth.X.T
    modes = fc.modes(system, system.state(np.column_stack([STRETCH * X, Y, 0 * X])), count=12)
    exact = np.sqrt(STIFFNESS * 0.5 * (STRETCH**2 - 1) / DENSITY)
    return min(np.array(modes.frequencies) / exact - 1, key=abs)


@pytest.mark.parametrize("strain", STRAINS)
def test_frequencies_of_a_taut_strip_converge_with_order_4(strain):
    coarse, fine = (taut(h, strain) for h in (1 / 4, 1 / 8))
    assert 1.7e-3 < coarse < 2.5e-3
    assert 10 < coarse / fine < 16
    assert fine == pytest.approx(taut(1 / 8, "pointwise"), rel=1e-6)


def test_a_slack_strip_locks_with_the_pointwise_strain_only():
    locked, free = (slack(1 / 4, strain) for strain in ("pointwise", "interpolated"))
    assert 0.03 < locked < 0.04
    assert abs(free) < 5e-4
    assert slack(1 / 4, "interpolated", 1e7) == pytest.approx(free, abs=1e-4)
    assert 3.5 < locked / slack(1 / 8, "pointwise") < 4.5
