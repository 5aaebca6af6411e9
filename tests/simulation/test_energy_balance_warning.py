"""What a run says of its own energy: nothing without reason, and the pins' motion where that is."""

import warnings

import numpy as np
import pytest

import fecloth as fc


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(0.6, 0.3, h=0.1, pattern="right")


def moved(cloth, motion, *terms, where="left", tension=200.0):
    return fc.System(cloth, fc.Fabric(0.2, tension, 0.3), terms, [fc.Pin(where, motion=motion)])


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
