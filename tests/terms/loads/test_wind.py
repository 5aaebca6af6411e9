"""Drag in moving air: a sheet that hangs in it."""

import numpy as np
import pytest
from scipy.optimize import brentq

import fecloth as fc

LAWS = ("linear", "quadratic")


# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

G, RHO = 9.81, 0.2


def test_hanging_sheet_in_the_wind_has_the_angle_of_the_formula(orthotropic):
    """k u² cos²θ = ρ g sin θ everywhere: a plane at the angle θ from the vertical."""
    cloth = fc.Cloth.rectangle(0.5, 0.5, h=0.125, pattern="right")
    fabric = fc.Fabric(RHO, 20000.0)
    k, speed = 0.7, 2.0
    terms = [fc.StVK(), fc.Gravity(), fc.Wind((0.0, speed, 0.0), k)]
    system = fc.System(cloth, fabric, terms, ["top"])
    theta = brentq(lambda a: k * (speed * np.cos(a)) ** 2 - RHO * G * np.sin(a), 0, 1.5)
    assert 0.5 < theta < 1.0
    x = np.zeros((len(cloth.X), 3))
    x[:, 0] = cloth.X[:, 0]
    depth = 0.5 - cloth.X[:, 1]
    x[:, 1], x[:, 2] = depth * np.sin(0.3), -depth * np.cos(0.3)  # from another angle
    result = fc.run(
        system,
        fc.BackwardEuler(),
        system.state(x),
        0.25,
        10.0,
        solver="direct",
        newton=fc.Newton(tolerance=1e-9),
    )
    bottom = result.state.x[cloth.nodes("bottom")]
    assert result.energies["kinetic"][-1] < 1e-10
    # the strain ρ g L/Y = 5e-5 turns the force on the area by as much
    np.testing.assert_allclose(np.arctan2(bottom[:, 1], -bottom[:, 2]), theta, atol=1e-4)


@pytest.mark.stories
@pytest.mark.parametrize("law", LAWS)
def test_free_cloth_reaches_the_velocity_of_the_wind(law, sheet, isotropic):
    """|v − u| = |u| e^(−k t/ρ), or |u| / (1 + k |u| t/ρ), for wind normal to the cloth."""
    k, speed, t = 0.7, 4.0, 1.0
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.Wind((0.0, 0.0, speed), k, law=law)])
    left = speed * (np.exp(-k * t / RHO) if law == "linear" else 1 / (1 + k * speed * t / RHO))
    newton = fc.Newton(tolerance=1e-10)
    result = fc.run(
        system, fc.ImplicitMidpoint(), system.rest(), 0.005, t, solver="direct", newton=newton
    )
    np.testing.assert_allclose(speed - result.state.v[:, 2], left, rtol=2e-3)
    kinetic = 0.5 * RHO * 0.6 * (speed - left) ** 2
    assert result.energies["kinetic"][-1] == pytest.approx(kinetic, rel=1e-3)
    work, lost = (result.energies[f"{name}:Wind"][-1] for name in ("work", "dissipated"))
    assert work == pytest.approx(speed * RHO * 0.6 * (speed - left), rel=1e-3)  # u · momentum
    assert work - lost == pytest.approx(kinetic, rel=1e-3)
