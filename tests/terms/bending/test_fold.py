"""A fold closes under a force: the measure μ keeps it open, however large the force."""

import numpy as np
import pytest
from scipy.optimize import brentq

import fecloth as fc

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def fold(force, stiffness=1e7):
    """Two triangles of a square; the node opposite to the diagonal is pushed across it."""
    cloth = fc.Cloth.from_arrays(CORNERS, [[0, 1, 2], [0, 2, 3]], renumber=False)
    fabric = fc.Fabric(1.0, stiffness, bending_rigidity=1.0)
    terms = [fc.StVK(), fc.PlateBending(), fc.PointForce([3], (force, -force, 0.0))]
    return fc.System(cloth, fabric, terms, [fc.Pin([0, 1, 2])])


def turned(system, angle):
    """The state with the free triangle turned about the diagonal."""
    x = system.rest().x
    out, up = np.sqrt(0.5) * np.cos(angle), np.sqrt(0.5) * np.sin(angle)
    x[3] = (0.5 - out * np.sqrt(0.5), 0.5 + out * np.sqrt(0.5), up)
    return system.state(x)


def test_angle_balances_the_force_and_stays_below_a_full_fold():
    """½ k μ² and the arm √½ of the force √2 P give k μ dμ/dθ = P sin θ."""
    k = 2 * fold(1.0).energies(turned(fold(1.0), 1.0))["PlateBending"]  # from θ = 1
    angles = []
    for force in (3.0, 30.0, 300.0, 3000.0):
        system = fold(force)
        folded = fc.equilibrium(system, turned(system, 2.0), tolerance=1e-8)
        angles.append(fc.hinge_angles(system.cloth, folded.x)[0])

        def moment(theta, force=force):
            t = np.tan(theta - np.pi / 2)
            return k * (np.pi / 2 + t) * (1 + t * t) - force * np.sin(theta)

        assert angles[-1] == pytest.approx(brentq(moment, np.pi / 2, np.pi - 1e-3), abs=2e-3)
        assert folded.iterations < 80
    assert np.all(np.diff([0.0, *angles, np.pi]) > 0)


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.BackwardEuler()])
def test_a_fold_thrown_shut_springs_back(method):
    """The speed closes it to some 175°; no step is longer than what is left of the gap."""
    system = fold(0.0, stiffness=1e5)
    start = turned(system, 1.0)
    v = np.zeros((4, 3))
    v[3] = 30.0 * np.array([np.sin(1.0) / np.sqrt(2), -np.sin(1.0) / np.sqrt(2), np.cos(1.0)])
    dt = 0.5 * fc.critical_dt(system, start) if isinstance(method, fc.CentralDifference) else 1e-3
    angles = []
    for state, _ in fc.march(system, method, fc.State(0.0, start.x, v), dt, 0.1):
        angles += [fc.hinge_angles(system.cloth, state.x)[0]]
    assert np.degrees(max(angles)) > 165
    assert np.abs(np.diff(angles)).max() < 1.0  # an angle that passes π jumps by 2 π
    assert angles[-1] < 2.0
