"""What a run says of its own energy: nothing without reason, and the pins' motion where that is."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.energy_balance import Balance


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(0.6, 0.3, h=0.1, pattern="right")


def moved(cloth, motion, *terms, where="left", tension=200.0):
    return fc.System(cloth, fc.Fabric(0.2, tension, 0.3), terms, [fc.Pin(where, motion=motion)])


def is_off(system, ledger):
    """Whether the balance of a run is doubted that ends with this ledger, without deformation."""
    return Balance(0.0, 0.0, remainder=ledger.remainder).is_off(system, ledger)


def test_a_motion_that_jumps_is_named_and_no_smaller_dt(small):
    system = moved(small, lambda t: (-1.0 if t > 0.0512 else 0.0, 0.0, 0.0), fc.StVK())
    with pytest.raises(fc.StepFailed, match="motion of the pin 'left' jumps") as failed:
        fc.run(system, fc.BDF2(), system.rest(), 5e-3, 0.2, most_stretch=2.0)
    assert "smaller dt" not in str(failed.value)


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


def test_term_without_energy_or_work_causes_no_warning(small):
    """A user's force without a potential, as the remainder is all that it does."""
    system = moved(small, None, fc.StVK())
    ledger = replace(fc.Ledger.open(system, system.rest()), t=1.0, kinetic=1.0)
    assert is_off(system, ledger)
    assert not is_off(system, replace(ledger, silent=True))
    grown = Balance(0.0, 1.0).describe_growth
    assert grown(system, ledger, 4.0)
    assert not grown(system, replace(ledger, silent=True), 4.0)
