"""What a run says of its own energy: nothing without reason, and the pins' motion where that is."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.doubts.jumps import find_jumping_motions
from fecloth.simulation.energy_balance import Balance

BUMP = np.pi / 20


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(0.6, 0.3, h=0.1, pattern="right")


def moved(cloth, motion, *terms, where="left", tension=200.0):
    return fc.System(cloth, fc.Fabric(0.2, tension, 0.3), terms, [fc.Pin(where, motion=motion)])


def is_off(system, ledger):
    """Whether the balance of a run is doubted that ends with this ledger, without deformation."""
    return Balance(0.0, 0.0, remainder=ledger.remainder).is_off(system, ledger)


def bump(t):
    """Up and down again by 5 cm, after 0.1 s."""
    return [0.0, 0.0, 0.05 * np.sin(20 * (t - 0.1)) ** 2 if 0.1 < t < 0.1 + BUMP else 0.0]


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.BDF2(), fc.GeneralizedAlpha()], ids=str)
def test_energy_of_a_sheet_moved_by_its_pins_is_accounted_for(method, small):
    """The pins give and take back: what is left moves the hanging sheet, a step of 5 ms apart."""
    terms = [fc.StVK(), fc.StrainRateDamping(time=0.005), fc.Gravity()]
    system = moved(small, bump, *terms, where="top")
    start = fc.equilibrium(system, system.rest())
    shares, ledger = [], fc.Ledger.open(system, start)
    balance = Balance.open(system, start, ledger)
    for state, info in fc.march(system, method, start, 5e-3, 0.4, solver="direct"):
        ledger = ledger.after(system, method, info.old, info.result)
        balance = balance.after(system, info.old, state, ledger)
        shares.append((ledger.kinetic, balance.deforming, balance.supplied))
    most = max(kinetic for kinetic, *_ in shares)
    assert most > 0.01
    assert all(moving < 1.2 * supplied + 1e-3 * most for _, moving, supplied in shares)


@pytest.mark.stories
@pytest.mark.parametrize("terms", [[fc.StVK()], [fc.StVK(), fc.StrainRateDamping(time=0.005)]])
@pytest.mark.parametrize("where", ["left", "boundary"])
def test_sheets_that_are_shaken_without_end_are_not_stopped(where, terms, small):
    system = moved(small, lambda t: (0, 0, 0.05 * np.sin(20 * t) ** 2), *terms, where=where)
    result = fc.run(system, fc.BDF2(), system.rest(), 4e-3, 0.6, most_growth=1.5)
    assert result.times[-1] == 0.6
    assert not any("balance" in words for words in result.warnings)


def test_a_motion_that_jumps_is_named_and_no_smaller_dt(small):
    system = moved(small, lambda t: (-1.0 if t > 0.0512 else 0.0, 0.0, 0.0), fc.StVK())
    with pytest.raises(fc.StepFailed, match="motion of the pin 'left' jumps") as failed:
        fc.run(system, fc.BDF2(), system.rest(), 5e-3, 0.2, most_stretch=2.0)
    assert "smaller dt" not in str(failed.value)


def test_a_fast_motion_and_a_kink_are_no_jumps(small):
    for motion in (lambda t: np.sin(60 * t) + 3.0 * t, lambda t: max(0.0, t - 0.09)):
        system = moved(small, lambda t, z=motion: (0.0, 0.0, z(t)), fc.StVK())
        assert find_jumping_motions(system, system.rest(), 0.1) == ()


def test_energy_balance_that_does_not_close_warns_in_python(small):
    """The midpoint rule without damping on a sheet that folds, in steps that are far too long."""
    system = moved(small, None, fc.StVK(), fc.Gravity(), tension=2e4)
    run = system, fc.ImplicitMidpoint(), system.rest()
    with pytest.warns(fc.FeclothWarning, match="energy balance is off"):
        result = fc.run(*run, 0.02, 0.6, most_growth=np.inf)
    assert result.doubts[0].kind is fc.DoubtKind.MOTION
    with warnings.catch_warnings(action="error"):
        assert fc.run(*run, 5e-4, 0.02).doubts == ()


def test_round_off_causes_no_energy_warning(small):
    """2e-27 J of a sheet that hangs at rest are those of its last digits; 2e-12 J are not."""
    system = moved(small, None, fc.StVK(), fc.Gravity())
    opened = fc.Ledger.open(system, system.rest())
    for off, told in ((2e-27, False), (2e-12, True)):
        assert is_off(system, replace(opened, t=1.0, kinetic=off)) == told
    assert not is_off(system, opened)


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.ImplicitMidpoint(), fc.BDF2()], ids=str)
def test_stiff_sheet_at_rest_neither_fails_nor_warns(method, small):
    """Round-off rings in it, unlike anything that has been given."""
    fabric = fc.Fabric(0.2, 5e4, 0.3, bending_rigidity=1e-5)
    system = fc.System(small, fabric, [fc.StVK(), fc.HingeBending()], ["left"])
    result = fc.run(system, method, system.rest(), 1e-3, 0.3)
    assert result.energies["kinetic"].max() < 1e-20
    assert result.doubts == ()


def test_term_without_energy_or_work_causes_no_warning(small):
    """A user's force without a potential, as the remainder is all that it does."""
    system = moved(small, None, fc.StVK())
    ledger = replace(fc.Ledger.open(system, system.rest()), t=1.0, kinetic=1.0)
    assert is_off(system, ledger)
    assert not is_off(system, replace(ledger, silent=True))
    grown = Balance(0.0, 1.0).describe_growth
    assert grown(system, ledger, 4.0)
    assert not grown(system, replace(ledger, silent=True), 4.0)
