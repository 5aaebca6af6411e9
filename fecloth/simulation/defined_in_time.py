"""Refusal of loads and motions that have no value at a time of the run, before its first step."""

import numpy as np

from fecloth.errors import InputError, errors_of
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.signals import FORMULAS, FUNCTIONS, Signal
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.step_times import step_times

TIMES_OF_CHOSEN_STEPS = 1000  # even times of a run whose steps are not known


def refuse_undefined(run: PlannedRun) -> None:
    """Raise `InputError` for a motion or a load that is not finite at a time of a run.

    The message names it, and the time. Only functions of time alone are evaluated: where the
    cloth will be is not known.
    """
    times = _times(run)
    for signal in run.signals:
        if signal.effort in (FORMULAS, FUNCTIONS):
            some = times[:: 1 + len(times) // signal.effort.even]
            with errors_of("", f"{signal.name}: "):
                _evaluate(signal, some)


def _times(run: PlannedRun) -> np.ndarray:
    """Return the ends of the steps, or even times if the steps are still to be chosen [s]."""
    start = run.state.t
    if isinstance(run.steps, LoadSteps) or run.steps.dt is None:
        return np.linspace(start, run.t_end, 1 + TIMES_OF_CHOSEN_STEPS)
    stops = run.ends[:-1].tolist()
    return np.append(start, step_times(start, run.steps.dt, run.t_end, stops))


def _evaluate(signal: Signal, times: np.ndarray) -> None:
    """Evaluate a signal at times; raise `InputError` if it is not finite at one of them."""
    try:
        signal.values(times)
    except InputError:
        raise
    except Exception:  # a mistake in a function of the user, which the run shows where it occurs
        return
