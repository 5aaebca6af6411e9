"""One set-up of the catalogue: its true error in time, and what its run warned of."""

from __future__ import annotations

import math
import warnings

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import FeclothError
from fecloth.linalg.reductions import rms
from studies.evidence.trust.setups import Run, Setup, build

FRAMES = 20  # times at which the error is taken, evenly spaced
FEWEST = 100  # steps of the first refinement, at least
AGREE = 0.02  # difference of two successive refinements of a set-up that counts


def judge(motion: str, method: str, dt: float | None, frame: str, most: int) -> dict:
    """Return the error in time of a set-up and the warnings of its run.

    Parameters
    ----------
    motion, method, dt, frame
        As in `Setup`.
    most
        Steps of the finest refinement, at most.
    """
    setup = Setup(motion, method, dt, frame)
    run = build(setup)
    times = frame_times(run)
    result, x = march_through(run, times)
    told = result.warnings if result else ("the run failed",)
    reported = getattr(result, "time_error", math.nan) if result else math.nan
    row = {"warnings": "; ".join(told), "warned": bool(told), "reported": reported}
    steps = result.steps if result else len(times)
    reference, apart, refinement = refined(setup, times, steps, most)
    row |= {"steps": steps, "refinement": refinement, "apart": apart, "counts": apart < AGREE}
    error = error_in_time(run, x, reference) if result and apart < AGREE else math.nan
    return row | {"failed": result is None, "error": error}


def frame_times(run: Run) -> np.ndarray:
    """Return the times of the frames: ends of steps of the run, so that no step is shortened."""
    begin, length = run.state.t, run.t_end - run.state.t
    if run.dt is None:
        return begin + length * np.arange(1, FRAMES + 1) / FRAMES
    steps = round(length / run.dt)
    every = math.ceil(steps / FRAMES)
    return begin + run.dt * np.arange(every, steps + 1, every)


def march_through(run: Run, times: np.ndarray):
    """Return the result, None for a failure, and the positions (frames, n, 3) at the times."""
    found: list[np.ndarray] = []

    def keep(info) -> None:
        study.check_time_limit()
        while len(found) < len(times) and info.t > times[len(found)] - 1e-6 * info.dt:
            found.append(info.result.state.x)

    stops = tuple(times) if run.dt is None else ()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fc.FeclothWarning)
            result = fc.run(
                run.system, run.method, run.state, run.dt, run.t_end, stops=stops, report=keep
            )
    except study.TimeLimit:
        raise
    except FeclothError:
        return None, np.empty(0)
    return result, np.array(found)


def refined(setup: Setup, times: np.ndarray, steps: int, most: int):
    """Return the positions of the finest rerun, how far it is from the one before, its factor.

    The step is halved until two successive reruns agree, or would take more than `most` steps.
    """
    factor = max(2, 2 ** math.ceil(math.log2(FEWEST / steps)))
    before, apart = None, math.inf
    while True:
        run = build(setup, factor)
        result, x = march_through(run, times)
        if result is not None and before is not None:
            apart = error_in_time(run, before, x)
        if apart < AGREE or 2 * factor * steps > most:
            return x, apart, factor
        before, factor = (x if result is not None else None), 2 * factor


def error_in_time(run: Run, x: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest rms error over the frames over the largest rms displacement.

    Both are weighted by mass.
    """
    mass = run.system.diagonal_mass
    errors = [rms(mass, a - b) for a, b in zip(x, reference, strict=True)]
    return max(errors) / max(rms(mass, b - run.state.x) for b in reference)
