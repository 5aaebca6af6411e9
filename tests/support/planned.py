"""The warnings of a run before its first step, of a strip with a load or a pin that moves."""

import numpy as np

import fecloth as fc
from fecloth.simulation.doubts.before_run import OF_RUNS, find_doubts
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.resolve import choose_steps

STRIP = fc.Cloth.rectangle(1.0, 0.6, h=0.3, pattern="right")


def along_z(formula):
    return ("0", "0", formula)


def strip(load=None, motion=None):
    terms = [fc.StVK()] + ([load] if load else [])
    pins = [fc.Pin("left", motion)] if motion else []
    return fc.System(STRIP, fc.Fabric(0.2, 500.0), terms, pins)


def warnings_before(system, dt=None, t_end=1.0, method=None, state=None, ends=None, doubts=OF_RUNS):
    """The sentences about steps of dt, or about steps that `method` chooses."""
    steps = choose_steps(method or (fc.BDF2() if dt else fc.Auto()), dt)
    ends = np.array([t_end] if ends is None else ends)
    planned = PlannedRun(system, state or system.rest(), steps, ends)
    return list(map(str, find_doubts(planned, doubts)))
