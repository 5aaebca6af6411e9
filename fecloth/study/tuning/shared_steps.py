"""The steps that the runs on all meshes share: as short as the finer meshes need."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter

from fecloth.integrators import METHODS
from fecloth.study.tuning.choices import COSTLY, Bench, Choice, Trial
from fecloth.study.tuning.space_errors import SpaceErrors
from fecloth.study.tuning.time_errors import TimeErrors, order_of

CALM = 0.2  # part of the tolerance that the steps of the runs on all meshes may take
MORE = 2.0  # times the error in time on the coarse mesh: what a finer mesh may have
HALVINGS = 4  # of the steps, at most


def prefer(trials: Sequence[Trial], by: Sequence[Callable[[Trial], bool]]) -> list[Trial]:
    """Return the trials that keep the rules, the first rule first."""
    # A rule that none of the trials left keeps is passed over.
    for rule in by:
        trials = list(filter(rule, trials)) or trials
    return list(trials)


def shared_run(bench: Bench, times: TimeErrors, tolerance: float) -> Trial:
    """Return the run whose steps all meshes take.

    Methods that damp the shortest waves are preferred: the others keep the waves that each
    finer mesh adds and that their steps do not resolve. So are implicit methods, because
    explicit ones lump the mass of P2. Of runs whose error in time is small beside the
    tolerance the cheapest is taken; if there is none, the most accurate.
    """
    error = partial(_error_in_time, bench, times)

    def damps_short_waves(trial: Trial) -> bool:
        method = METHODS.get(trial.choice.method)
        return method is None or method().traits.at_infinity != 1

    def is_calm(trial: Trial) -> bool:
        return error(trial) <= CALM * tolerance

    def fits_all_meshes(choice: Choice) -> bool:  # not half of a limit, which the mesh changes
        return not choice.rtol and not (choice.is_explicit and choice.steps)

    able = [trial for trial in times.trials if trial.is_ok and fits_all_meshes(trial.choice)]
    rules = [
        damps_short_waves,
        lambda trial: error(trial) <= tolerance,
        lambda trial: error(trial) <= tolerance and not trial.choice.is_explicit,
        is_calm,
    ]
    preferred = prefer(able, by=rules)
    return min(preferred, key=attrgetter("seconds") if is_calm(preferred[0]) else error)


def _error_in_time(bench: Bench, times: TimeErrors, trial: Trial) -> float:
    return float((bench.distance(times.reference, trial) + times.error).max())


def shorten_steps(bench: Bench, times: TimeErrors, coarse: Trial, tolerance: float) -> Trial:
    """Halve the steps of the coarse run until they serve on a mesh with half of h, too.

    Where there are too few, Newton's iteration lands on another solution there, and the meshes
    would disagree. Return the run on the coarse mesh with these steps.
    """
    if not coarse.choice.steps or coarse.choice.is_explicit or coarse.choice.h is None:
        return coarse
    known = _error_in_time(bench, times, coarse)
    choice = coarse.choice.with_half_of_h()
    finer = bench.run([choice])
    for _ in range(HALVINGS):
        if finer[-1].is_ok and finer[-1].seconds > COSTLY / 2:
            break
        choice = choice.with_half_of_dt()
        finer += bench.run([choice])
        if error_of_steps(bench, *finer[-2:]) <= max(CALM * tolerance, MORE * known):
            break
        (shorter,) = bench.run([coarse.choice.with_half_of_dt()])
        if not shorter.is_ok:
            break
        coarse, known = shorter, known / 2 ** order_of(coarse.choice.method)
    return coarse


def error_of_steps(bench: Bench, trial: Trial, shorter: Trial) -> float:
    """Return the error in time of a run from a run with half of dt; infinite if one failed."""
    if not (trial.is_ok and shorter.is_ok):
        return math.inf
    rest = 1 - 2.0 ** -order_of(trial.choice.method)
    return float(bench.distance(shorter, trial).max()) / rest


def blame_steps(bench: Bench, space: SpaceErrors, tolerance: float) -> bool:
    """Return whether the steps are why meshes disagree."""
    # The finest runs of the two meshes that disagree are repeated with half of dt.
    rivals = [space.rival] if space.rival else space.meshes
    others = [mesh.trials[-1] for mesh in rivals if mesh.trials[-1] is not space.reference]
    for run in [space.reference, *others[:1]]:
        if run.choice.steps and not run.choice.is_explicit and 2 * run.seconds <= COSTLY:
            (shorter,) = bench.run([run.choice.with_half_of_dt()])
            if error_of_steps(bench, run, shorter) > MORE * CALM * tolerance:
                return True
    return False
