"""Warnings of set-ups in Python; what is warned of is in `tests/messages/set_ups.txt`."""

import warnings

import numpy as np
import pytest
from support.set_ups import CLOTH, FABRIC, STIFF, dome

import fecloth as fc
from fecloth.simulation.doubts.pins import rotation_about_pins


def test_run_warns_in_python():
    system = fc.System(CLOTH, fc.Fabric(150.0, 500.0), [fc.StVK()], ["left"])
    with pytest.warns(fc.FeclothWarning, match=r"write 0\.15"):
        fc.run(system, fc.BDF2(), system.rest(), dt=0.01, t_end=0.01)
    with warnings.catch_warnings(action="error"):
        system = fc.System(CLOTH, fc.Fabric(**FABRIC), [fc.StVK()], ["left"])
        fc.run(system, fc.BDF2(), system.rest(), dt=0.01, t_end=0.01)


def test_the_free_rotation_is_rigid_and_leaves_the_pins():
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.05, pattern="cross")
    system = fc.System(cloth, fc.Fabric(**STIFF), [fc.StVK()], ["left"])
    x = dome(cloth) @ np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    motion = rotation_about_pins(system, x)
    left = cloth.nodes("left")
    axis = x[left[-1]] - x[left[0]]
    axis /= np.linalg.norm(axis)
    expected = np.cross(axis, x - x[left[0]])
    assert np.allclose(motion * np.sign(np.vdot(motion, expected)), expected, atol=1e-12)
    free = fc.System(cloth, system.fabric, [fc.StVK()])
    assert rotation_about_pins(free, x) is None
