"""Set-ups that `tests/messages/set_ups.txt` names, and what is said of them before a run."""

import numpy as np
from support.linear_term import LinearMembrane as LinearMembrane
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation.doubts.before_run import OF_RUNS
from fecloth.simulation.doubts.course import find_flat_start
from fecloth.simulation.doubts.pins import find_free_fall, find_free_turn
from fecloth.simulation.doubts.terms import find_unused_bending

CLOTH = fc.Cloth.rectangle(0.3, 0.2, h=0.05, pattern="right")
FABRIC = {"areal_density": 0.2, "tensile_stiffness": 500.0, "poisson_ratio": 0.0}
STIFF = FABRIC | {"bending_rigidity": 2e-4}
BASE = {"terms": (fc.StVK(), fc.Gravity()), "pins": (fc.Pin("left"),), "fabric": FABRIC}
BENT = BASE | {"terms": (fc.StVK(), fc.HingeBending(), fc.Gravity()), "fabric": STIFF}
SHEET = BASE | {"fabric": STIFF | {"bending_poisson_ratio": 0.3}}
BIAS = BASE | {"fabric": STIFF | {"bending_rigidity": (1e-4, 4e-4), "bias_rigidity": 5e-4}}
DAMPED = BASE | {"fabric": STIFF, "pins": (fc.Pin("left", clamp=True),)}
DAMPING = fc.BendingDamping(0.01, law=fc.PlateBending())
UP = (0, 0, 1)
INSIDE = int(np.argmin(np.linalg.norm(CLOTH.X - 0.1, axis=1)))


def told(set_up=BASE, **changes) -> list[str]:
    """The warnings of a set-up with these changes."""
    return find(**set_up | changes)


def find(terms, pins, fabric, cloth=CLOTH, start=None, dt=0.01, doubts=(*OF_RUNS, find_free_turn)):
    system = fc.System(cloth, fc.Fabric(**fabric), terms, pins)
    state = system.state(start(cloth)) if start else system.rest()
    return warnings_before(system, dt, max(1.0, 2 * dt), state=state, doubts=doubts)


def dome(cloth):
    wave = np.sin(np.pi * cloth.X[:, 0] / 0.3) * np.sin(np.pi * cloth.X[:, 1] / 0.2)
    return np.column_stack([cloth.X, 0.1 * wave])


def terms(*given):
    return BASE | {"terms": given}


def pin(*given, **more):
    return BASE | {"pins": (fc.Pin(*given, **more),)}


def slide(motion, **more):
    return BASE | {"pins": (fc.Slide("left", motion, **more),)}


def gas(pressure):
    return terms(fc.StVK(), fc.Gas(pressure, volume=0.0024)) | {"start": dome}


def within(x, y):
    return lambda X: (X[:, 0] < x) & (X[:, 1] < y)


def rubs(*bending):
    """A set-up with friction inside the fabric beside a bending term."""
    fabric = STIFF | {"bending_rigidity": 1e-6, "bending_hysteresis": 1e-5}
    return terms(fc.StVK(), *bending, fc.BendingFriction(), fc.Gravity()) | {"fabric": fabric}


def falls(*given, pins=()):
    """What is noted of a cloth that may fall freely."""
    return told(terms=given, pins=pins, fabric=STIFF, doubts=[find_free_fall])


def unused(*given, **constants):
    """What is noted of the constants of bending of a sheet with these terms."""
    fabric = FABRIC | constants
    return told(terms=(fc.StVK(), *given), fabric=fabric, doubts=[find_unused_bending])


def in_plane(*loads, z=0.0, height=0.0):
    """What is noted of a plate that starts in the plane at z, or with waves."""
    terms = (fc.StVK(), fc.HingeBending(), *loads)

    def start(cloth):
        return np.column_stack([cloth.X, z + height * np.sin(30 * cloth.X[:, 0])])

    return told(terms=terms, fabric=STIFF, start=start, doubts=[find_flat_start])


class Own(fc.StVK):
    """A term of a user, which may use any constant."""


def error_in_space(*given, height=0.02):
    """What is said of the error in space of a sheet with waves of this height."""
    system = fc.System(CLOTH, fc.Fabric(**STIFF), given)
    X, Y = CLOTH.X.T
    wave = height * np.sin(30 * X + 1) * np.cos(20 * Y)
    state = system.state(np.column_stack([CLOTH.X * (1.0 + height), wave]))
    return [str(fc.space_error(system, state))]
