"""Drag: the force on a plate, and its terminal speed."""

import numpy as np
import pytest
from conftest import affine

import fecloth as fc
from fecloth.verify import observed_order

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

LAWS = ("linear", "quadratic")
TIGHT = fc.Newton(tolerance=1e-12)
G, RHO = 9.81, 0.2


def square(w, law):
    """|w| w or w."""
    return np.linalg.norm(w) * w if law == "quadratic" else w


# --- force and tangents ---------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("pattern", ["unstructured", "cross"])
def test_a_plate_that_moves_without_turning(pattern, law, isotropic):
    """The force is the closed form for the deformed area, and acts at the centre."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.17, pattern=pattern)
    F = np.array([[1.1, 0.3], [0.0, 0.9], [0.2, -0.4]])
    area = 0.6 * np.cross(F[:, 0], F[:, 1])
    size = np.linalg.norm(area)
    n, v, u = area / size, np.array([1.0, -2.0, 3.0]), np.array([4.0, 0.5, 0.0])
    for term, w in ((fc.Drag(0.7, 0.2, law), v), (fc.Wind(tuple(u), 0.7, 0.2, law), v - u)):
        across = np.dot(w, n) * n
        expected = -size * (0.7 * square(across, law) + 0.2 * square(w - across, law))
        system = fc.System(cloth, isotropic, [term])
        x = affine(cloth, F)
        force = system.force(system.state(x, np.tile(v, (len(x), 1))))
        np.testing.assert_allclose(force.sum(axis=0), expected, rtol=1e-12)
        moment = np.cross(F @ [0.5, 0.3], expected)
        np.testing.assert_allclose(np.cross(x, force).sum(axis=0), moment, rtol=1e-11)


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.stories
@pytest.mark.parametrize("law", LAWS)
def test_fall_of_a_level_plate_to_its_terminal_velocity(law, sheet, isotropic):
    """ρ v′ = ρ g − k vᵖ: v = v∞ tanh(g t/v∞) with v∞ = √(ρ g/k), or v∞ (1 − e^(−k t/ρ))."""
    k = 0.7
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.Drag(k, 0.1, law), fc.Gravity()])
    limit = np.sqrt(RHO * G / k) if law == "quadratic" else RHO * G / k
    errors = []
    for dt in (0.02, 0.01):
        end = fc.run(
            system, fc.ImplicitMidpoint(), system.rest(), dt, 0.2, solver="direct", newton=TIGHT
        ).state
        exact = limit * (
            np.tanh(G * 0.2 / limit) if law == "quadratic" else -np.expm1(-k / RHO * 0.2)
        )
        assert np.ptp(end.v, axis=0).max() < 1e-10  # it stays a plate
        errors.append(abs(end.v[0, 2] + exact))
    assert errors[-1] < 1e-3 * limit
    assert observed_order([2, 1], errors) == pytest.approx(2.0, abs=0.15)
    end = fc.run(system, fc.BackwardEuler(), system.rest(), 0.1, 8.0, solver="direct", newton=TIGHT)
    np.testing.assert_allclose(end.state.v[:, 2], -limit, rtol=1e-8)
