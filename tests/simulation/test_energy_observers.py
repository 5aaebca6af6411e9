"""The energy balance does not depend on the observer, on a spike, or on what flows through."""

from dataclasses import replace

import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.simulation.energy_balance import Balance

FRAMES = {"20 m/s": (20.0, 0.0, 0.0), "100 m/s": (60.0, 0.0, 80.0)}
FABRIC = fc.Fabric(0.2, 500.0, 0.2)


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.6, 0.4, h=0.2, pattern="right")


def start(system, u=(0.0, 0.0, 0.0), spin=0.0):
    """Stretched and waved, with a velocity that deforms it; seen by a moving observer."""
    X, Y = system.cloth.X.T
    x = np.column_stack([1.05 * X, Y, 0.05 * np.sin(9 * X)])
    r = x - system.sums.mean(system.nodal_mass, x)
    turning = spin * np.column_stack([-r[:, 1], r[:, 0], 0 * X])
    return system.state(x, np.column_stack([X, -Y, X * Y]) + turning + u)


def opened(system, state):
    """The ledger and the balance at the start."""
    ledger = fc.Ledger.open(system, state)
    return ledger, Balance.open(system, state, ledger)


def energies_of(system, state, dt=2e-3, steps=12):
    """What a run judges by after some steps of the midpoint rule."""
    (ledger, balance), method = opened(system, state), fc.ImplicitMidpoint()
    end = state.t + steps * dt
    for new, info in fc.march(system, method, state, dt, end, newton=fc.Newton(tolerance=1e-10)):
        ledger = ledger.after(system, method, info.old, info.result)
        balance = balance.after(system, info.old, new, ledger)
    return balance.deforming, balance.moved, balance.remainder


def assert_alike(a, b):
    assert b[0] == pytest.approx(a[0], rel=1e-6)
    assert b[1] == pytest.approx(a[1], rel=1e-6)
    assert b[2] == pytest.approx(a[2], abs=1e-6 * a[1])


@pytest.mark.parametrize("u", FRAMES.values(), ids=FRAMES)
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_free_cloth_is_judged_alike_in_flight_and_in_a_fall(u, element):
    cloth = fc.Cloth.rectangle(0.6, 0.4, h=0.2, element=element)
    rest = fc.System(cloth, FABRIC, [fc.StVK()])
    at_rest = energies_of(rest, start(rest))
    assert at_rest[1] > 0.5 * at_rest[0] > 0.0
    assert_alike(at_rest, energies_of(rest, start(rest, u)))
    falling = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()])
    assert_alike(at_rest, energies_of(falling, start(falling, u)))


@pytest.mark.parametrize("u", FRAMES.values(), ids=FRAMES)
def test_ledger_is_the_same_in_a_steadily_moving_frame(u, cloth):
    terms = [fc.StVK(), fc.Gravity()]
    held = fc.System(cloth, FABRIC, terms, ["left"])
    moved = fc.System(cloth, FABRIC, terms, [fc.Pin("left", lambda t: np.array(u) * t)])
    begin = start(held)
    begin = replace(begin, v=held.constraints.project(begin.v))
    a, b = energies_of(held, begin), energies_of(moved, replace(begin, v=begin.v + u))
    assert_alike(a, b)


def test_a_spin_of_free_or_pinned_cloth_is_no_deformation(cloth):
    """Turned as a whole, by its own spin or by pins along one side."""
    free = fc.System(cloth, FABRIC, [fc.StVK()])
    rest = free.rest()
    v = np.cross([3.0, -2.0, 30.0], rest.x - [0.1, 0.7, 0.3]) + [5.0, 0.0, 0.0]
    ledger, balance = opened(free, free.state(rest.x, v))
    assert balance.deforming < 1e-12 * ledger.kinetic

    def turn(t):
        c, s = np.cos(30 * t) - 1, np.sin(30 * t)
        Y = cloth.X[cloth.nodes("left"), 1] + 0.5
        return np.column_stack([-s * Y, c * Y, 0 * Y])

    pinned = fc.System(cloth, FABRIC, [fc.StVK()], [fc.Pin("left", turn)])
    v = 30 * np.column_stack([-rest.x[:, 1] - 0.5, rest.x[:, 0], 0 * rest.x[:, 0]])
    ledger, balance = opened(pinned, pinned.state(rest.x, v))
    assert balance.deforming < 1e-9 * ledger.kinetic


def test_what_dampings_and_the_method_take_has_moved_too(cloth):
    """Beside the kinetic energy of the deformation and the changes of the terms' energies."""
    terms = [fc.StVK(), fc.Gravity(), fc.StrainRateDamping(time=0.01)]
    system = fc.System(cloth, FABRIC, terms, ["left"])
    ledger, balance = opened(system, system.rest())
    (damping,) = ledger.dissipated
    ledger = replace(ledger, t=1.0, kinetic=1.0, numerical=-0.5, dissipated={damping: 0.25})
    ledger = replace(ledger, potential={"StVK": 4.0, "Gravity": -20.0})
    rest = system.rest()
    after = balance.after(system, rest, replace(rest, t=1.0), ledger)
    assert after.moved == pytest.approx(1.0 + 4.0 + 0.5 + 0.25)
    assert after.gained == 0.25
    assert after.remainder == ledger.remainder
    fallen = replace(ledger, t=2.0, numerical=2.0, impacts=0.5)
    risen = replace(fallen, t=3.0, numerical=1.75, impacts=0.25, dissipated={damping: 0.375})
    after = after.after(system, rest, replace(rest, t=2.0), fallen)
    after = after.after(system, rest, replace(rest, t=3.0), risen)
    assert (after.lost, after.gained) == (2.75, 0.375)  # 2.75 J had gone, then 2.375 J


@pytest.mark.parametrize(
    "method",
    stories_except([fc.CentralDifference(), fc.BDF2()], fc.CentralDifference()),
    ids=str,
)
def test_the_work_of_a_load_without_energy_is_what_it_gives(method, cloth):
    """A stiff force towards z = 0: its work is the kinetic energy, and the method's share small."""
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.UserForce((0, 0, "-1e4 * z"))], ["left"])
    x = system.rest().x + np.outer(0.01 * cloth.X[:, 0], [0.0, 0.0, 1.0])
    explicit = method.traits.explicit
    dt = 0.3 * np.sqrt(0.2 / 1e4) if explicit else 1e-4
    energies = fc.run(system, method, system.state(x), dt, 0.1).energies
    kinetic = energies["kinetic"].max()
    assert abs(energies["work:UserForce"]).max() < 1.1 * kinetic
    assert abs(energies["numerical"]).max() < (1e-2 if explicit else 0.15) * kinetic


@pytest.mark.parametrize(
    ("method", "height", "width"),
    [
        (fc.Adaptive(fc.BDF2(), 1e-2), 3000.0, 0.001),
        (fc.CentralDifference(), 3000.0, 0.001),
    ],
)
def test_a_pulse_is_no_growth(method, height, width, cloth):
    """It gives momentum before it has done work, by many orders of magnitude."""
    load = fc.Pressure(f"{height} * exp(-((t - 0.02) / {width})**2)")
    system = fc.System(cloth, FABRIC, [fc.StVK(), load], ["left"])
    result = fc.run(system, method, system.rest(), t_end=0.025)
    assert result.energies["kinetic"].max() > 1e-2
    assert not [words for words in result.warnings if "energy" in words]
