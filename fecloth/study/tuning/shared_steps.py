"""The steps that the runs on all meshes share: as short as the finer meshes need."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter

from fecloth.integrators import METHODS
from fecloth.study.tuning.choices import (
    COSTLY_SECONDS,
    COUNTING_SHARE,
    HALVINGS,
    Bench,
    Choice,
    Trial,
)
from fecloth.study.tuning.space_errors import SpaceErrors
from fecloth.study.tuning.time_errors import TimeErrors, order_of

# Error in time on half of h over the error on the coarse mesh, above which steps are too long.
# The middle of 1 to 4: with the shorter waves of a finer mesh it grows with up to h^-2.
GROWTH_ON_HALF_OF_H = 2.0


def prefer(trials: Sequence[Trial], by: Sequence[Callable[[Trial], bool]]) -> list[Trial]:
    """Return the trials that keep the rules, the first rule first.

    A rule that none of the trials left keeps is passed over.
    """
    for rule in by:
        trials = list(filter(rule, trials)) or trials
    return list(trials)


def shared_run(bench: Bench, times: TimeErrors, tolerance: float) -> Trial:
    """Return the run on the coarse mesh whose method and steps all meshes will have.

    Methods that damp the shortest waves are preferred: the others keep the waves that each
    finer mesh adds and that their steps do not resolve. Next, runs whose error in time is within
    the tolerance are preferred, and among these implicit ones, because explicit methods lump the
    mass of P2. Of runs whose error in time is below a quarter of the tolerance the cheapest is
    returned; if there is none, the most accurate run.
    """
    error = partial(_error_in_time, bench, times)

    def damps_short_waves(trial: Trial) -> bool:
        method = METHODS.get(trial.choice.method)
        return method is None or method().traits.at_infinity != 1

    def is_accurate(trial: Trial) -> bool:
        return error(trial) <= tolerance

    def is_accurate_and_implicit(trial: Trial) -> bool:
        return is_accurate(trial) and not trial.choice.is_explicit

    def is_more_than_accurate(trial: Trial) -> bool:
        return error(trial) <= COUNTING_SHARE * tolerance

    able = [trial for trial in times.trials if trial.is_ok and _fits_all_meshes(trial.choice)]
    rules = [damps_short_waves, is_accurate, is_accurate_and_implicit, is_more_than_accurate]
    preferred = prefer(able, by=rules)
    if is_more_than_accurate(preferred[0]):
        return min(preferred, key=attrgetter("seconds"))
    return min(preferred, key=error)


def _fits_all_meshes(choice: Choice) -> bool:
    """Whether all meshes can take the steps: not half of a limit, which the mesh changes."""
    return not choice.rtol and not (choice.is_explicit and choice.steps)


def _error_in_time(bench: Bench, times: TimeErrors, trial: Trial) -> float:
    """Return the largest error in time that a run on the coarse mesh may have."""
    return float((bench.distance(times.reference, trial) + times.error).max())


def shorten_steps(bench: Bench, times: TimeErrors, coarse: Trial, tolerance: float) -> Trial:
    """Halve dt of the coarse run until it is short enough on a mesh with half of h, too.

    With steps that are too long, Newton's iteration may land on another solution on the finer
    mesh, and the meshes would disagree. dt is short enough if halving it on the finer mesh shows
    an error in time of at most a quarter of the tolerance, or of `GROWTH_ON_HALF_OF_H` times the
    error on the coarse mesh.

    Return the run on the coarse mesh with this dt: `coarse` itself if it has no equal steps to
    choose or no h. The halving also ends where a run would be costly or fails.
    """
    if not coarse.choice.steps or coarse.choice.is_explicit or coarse.choice.h is None:
        return coarse
    error_on_coarse = _error_in_time(bench, times, coarse)
    choice = coarse.choice.with_half_of_h()
    on_half_of_h = bench.run([choice])
    for _ in range(HALVINGS):
        if on_half_of_h[-1].is_ok and 2 * on_half_of_h[-1].seconds > COSTLY_SECONDS:
            break
        choice = choice.with_half_of_dt()
        on_half_of_h += bench.run([choice])
        longer, shorter = on_half_of_h[-2:]
        allowed = max(COUNTING_SHARE * tolerance, GROWTH_ON_HALF_OF_H * error_on_coarse)
        if error_of_steps(bench, longer, shorter) <= allowed:
            break
        (coarse_with_half_of_dt,) = bench.run([coarse.choice.with_half_of_dt()])
        if not coarse_with_half_of_dt.is_ok:
            break
        coarse = coarse_with_half_of_dt
        error_on_coarse /= 2 ** order_of(coarse.choice.method)  # error ~ dt^order
    return coarse


def error_of_steps(bench: Bench, trial: Trial, shorter: Trial) -> float:
    """Return the error in time of a run from a run with half of dt; infinite if one failed."""
    if not (trial.is_ok and shorter.is_ok):
        return math.inf
    part_that_half_of_dt_shows = 1 - 2.0 ** -order_of(trial.choice.method)
    return float(bench.distance(shorter, trial).max()) / part_that_half_of_dt_shows


def blame_steps(bench: Bench, space: SpaceErrors, tolerance: float) -> bool:
    """Return whether the steps are why meshes disagree.

    The best known run, and the finest run of the mesh that disagrees with it, are repeated with
    half of dt. The steps are to blame if this shows an error in time of more than half of the
    tolerance. A run whose repetition would be costly is left out.
    """
    rivals = [space.rival] if space.rival else space.meshes
    others = [mesh.trials[-1] for mesh in rivals if mesh.trials[-1] is not space.reference]
    allowed = GROWTH_ON_HALF_OF_H * COUNTING_SHARE * tolerance
    for run in [space.reference, *others[:1]]:
        is_short = 2 * run.seconds <= COSTLY_SECONDS
        if run.choice.steps and not run.choice.is_explicit and is_short:
            (shorter,) = bench.run([run.choice.with_half_of_dt()])
            if error_of_steps(bench, run, shorter) > allowed:
                return True
    return False
