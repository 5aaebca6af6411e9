"""The ledger's columns follow the motion: second order with every method of second order.

A damped sheet whose left side is carried to and fro, against Runge–Kutta of order 8 on the same
forces, which sums the powers as further unknowns.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.verify import observed_order

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

SECOND = [m for m in (t() for t in (METHODS | EXPLICIT).values()) if m.traits.order == 2]
TIGHT = fc.Newton(tolerance=1e-11)
RATE, HIGH, T_END = 20.0, 0.05, 0.1
UP = np.array([0.0, 0.0, 1.0])


def motion(t):
    return HIGH * np.sin(RATE * t) ** 2 * UP


def velocity(t):
    return HIGH * RATE * np.sin(2 * RATE * t) * UP


def acceleration(t):
    return 2 * HIGH * RATE**2 * np.cos(2 * RATE * t) * UP


@pytest.fixture(scope="module")
def carried():
    """The system, and (3,) functions of t: pins, dissipated and numerical as they should be."""
    cloth = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
    terms = [fc.StVK(), fc.StrainRateDamping(time=0.005)]
    pin = fc.Pin("left", motion=motion, velocity=velocity)
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), terms, [pin])
    left, rest = cloth.nodes("left"), system.rest()
    mass, damping, n = system.nodal_mass[:, None], system.bound[1], rest.x.size

    def rate(t, y):
        x, v = y[: 2 * n].reshape(2, -1, 3)
        f = system.force(fc.State(t, x, v))
        a = f / mass
        a[left] = acceleration(t)
        pull = (mass * a - f)[left].sum(axis=0)
        return np.concatenate([v.ravel(), a.ravel(), [pull @ velocity(t), damping.power(x, v, t)]])

    start = np.concatenate([rest.x.ravel(), np.zeros(n + 2)])
    result = solve_ivp(rate, (0, T_END), start, "DOP853", rtol=1e-9, atol=1e-11, dense_output=True)
    return system, lambda t: np.vstack([result.sol(t)[2 * n :], np.zeros_like(t)])


def errors_of(carried, method, dt):
    """(3,) largest errors of the columns [J] in 0 ≤ t ≤ T_END."""
    system, exact = carried
    run = fc.run(system, method, system.rest(), dt, T_END, solver="direct", newton=TIGHT)
    columns = [run.energies[k] for k in ("pins", "dissipated:StrainRateDamping", "numerical")]
    return abs(np.array(columns) - exact(run.times)).max(axis=1)


@pytest.mark.stories
@pytest.mark.parametrize("method", SECOND, ids=lambda m: type(m).__name__)
def test_the_columns_are_of_second_order_where_pins_are_moved(method, carried, record_property):
    shorter = {"CentralDifference": (2e-4, 1e-4), "BDF2": (1e-3, 5e-4)}
    sizes = shorter.get(type(method).__name__, (2e-3, 1e-3))
    errors = np.array([errors_of(carried, method, dt) for dt in sizes])
    record_property("errors", errors.tolist())
    print(f"{type(method).__name__}: pins, dissipated, numerical {errors[0]}, {errors[1]} J")
    for name, of_one in zip(("pins", "dissipated", "numerical"), errors.T, strict=True):
        if of_one.max() > 1e-13:
            assert observed_order(np.array(sizes), of_one)[0] > 1.8, name
        else:
            assert name == "numerical"
    assert errors[-1].max() < 0.02 * carried[1](np.array([T_END]))[1, 0]
