"""A motion, run with steps and with each of them halved, and the distance of both."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

import fecloth as fc

LOOKS = 8  # times at which two motions are compared


class Motion(NamedTuple):
    """Where the nodes were at the times of the comparison (LOOKS, n, 3) [m], the sizes of the
    steps [s], the run, its cost."""

    places: np.ndarray
    sizes: np.ndarray
    run: fc.Result
    cpu_seconds: float


def march(system: fc.System, start: fc.State, method: Any, dt: Any, t_end: float) -> Motion:
    """Run a motion, and keep the places at `LOOKS` equal times."""
    next(fc.march(system, method, start, dt, t_end))  # compiles what is not compiled yet
    stops, places, sizes = np.linspace(0, t_end, LOOKS + 1)[1:], {}, []

    def keep(info):
        sizes.append(info.size)
        if np.isclose(stops, info.t, rtol=1e-9, atol=0).any():
            places[info.t] = info.result.state.x

    begin = time.process_time()
    run = fc.run(system, method, start, dt, t_end, stops=stops[:-1], report=keep)
    seconds = time.process_time() - begin
    return Motion(np.array([places[t] for t in sorted(places)]), np.array(sizes), run, seconds)


def distance(system: fc.System, x: np.ndarray, y: np.ndarray) -> float:
    """The largest root mean square distance [m] over the times, weighted with the mass."""
    m = system.nodal_mass
    return float(np.sqrt(np.einsum("tni,n->t", (x - y) ** 2, m) / m.sum()).max())


def halved(system: fc.System, start: fc.State, method: Any, t_end: float) -> dict:
    """Run with chosen steps, and with each of them halved.

    The row has the error in per cent of the motion, the cost and the doubts.
    """
    coarse = march(system, start, method, None, t_end)
    halves = 0.5 * np.repeat(coarse.sizes, 2)
    fine = march(system, start, coarse.run.method.method, halves, t_end)
    size = distance(system, fine.places, start.x[None])
    return {
        "triangles": len(system.cloth.triangles),
        "dt [ms]": 1e3 * coarse.sizes.mean(),
        "error %": 100 * distance(system, coarse.places, fine.places) / size,
        "CPU s a second": coarse.cpu_seconds / t_end,
        "Newton a step": coarse.run.newton / max(coarse.run.steps, 1),
        "doubts": "; ".join(
            sorted({doubt.kind.value for doubt in coarse.run.doubts if doubt.kind.spoils})
        ),
    }
