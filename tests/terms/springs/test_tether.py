"""Tethers: the spring's law, and the ledger."""

import numpy as np
import pytest
from conftest import rough

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, 1000.0)


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")


def test_force_energy_and_power(cloth, rng):
    """At t = 0.5: p = (1, 0.25, sin 0.5), ṗ = (0, 1, cos 0.5)."""
    tether = fc.Tether("left", ("1", "t**2", "sin(t)"), 50.0, 2.0)
    system = fc.System(cloth, FABRIC, [tether])
    x, v, nodes = rough(cloth, rng), rng.standard_normal((len(cloth.X), 3)), cloth.nodes("left")
    p, speed = np.array([1.0, 0.25, np.sin(0.5)]), np.array([0.0, 1.0, np.cos(0.5)])
    state = system.state(x, v, 0.5)
    expected = -50.0 * (x[nodes] - p) - 2.0 * (v[nodes] - speed)
    force = system.force(state)
    np.testing.assert_allclose(force[nodes], expected, rtol=1e-12)
    assert np.abs(np.delete(force, nodes, axis=0)).max() == 0.0
    energy = system.energies(state)["Tether"]
    assert energy == pytest.approx(25.0 * np.sum((x[nodes] - p) ** 2), rel=1e-13)
    bound = system.bound[0]
    lost = 2.0 * np.sum((v[nodes] - speed) ** 2)
    assert bound.power(x, v, 0.5) == pytest.approx(lost, rel=1e-12)
    damping = -2.0 * (v[nodes] - speed)  # the ledger adds the work of the spring
    assert bound.supply(x, v, 0.5) == pytest.approx(damping.sum(axis=0) @ speed, rel=1e-12)


@pytest.mark.parametrize(
    ("method", "dt"),
    [(fc.ImplicitMidpoint(), 2e-3), (fc.BDF2(), 2e-3), (fc.CentralDifference(), 5e-4)],
)
def test_the_ledger_has_the_work_of_a_hand_that_jumps(method, dt, cloth):
    """From a rest without force each node gets ½ k d², as all of p's jump acts before it moves."""
    hand = fc.Tether([3], (*cloth.X[3], "where(t < 0.0103, 0, 0.05)"), 20.0)
    system = fc.System(cloth, FABRIC, [fc.StVK(), hand], pins=["left"])
    energies = fc.run(system, method, system.rest(), dt=dt, t_end=0.04).energies
    jump = 0.5 * 20.0 * 0.05**2
    assert energies["work:Tether"][-1] == pytest.approx(jump, rel=0.1)
    assert np.abs(energies["remainder"]).max() < 0.05 * jump
