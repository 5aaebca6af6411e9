"""Why no setting can be proved, in words."""

from __future__ import annotations

import math

from fecloth.study.tolerance import in_percent
from fecloth.study.tuning.prediction import Prediction
from fecloth.study.tuning.search import EXTRAPOLATED, MARGIN, Goal
from fecloth.study.tuning.space_errors import SpaceErrors
from fecloth.study.tuning.trials import Bench
from fecloth.study.workload import in_words


def obstacle_of(
    bench: Bench, space: SpaceErrors, prediction: Prediction, goal: Goal, most: float | None
) -> str:
    """Return why no setting can be proved; "" if one may be. `most` is the longest run [s]."""
    if space.reference.choice.h is None:
        return (
            "the mesh has no h, so it is not refined, and its error in space counts as 100 %; "
            "a .geo file with h in [cloth] can be refined"
        )
    if space.stalls(bench, goal.scale):
        return f"finer meshes do not come closer to each other{_obstacles(space)}"
    candidates = goal.candidates(prediction)
    if not candidates:
        return _why_none(space, prediction, goal)
    first, known = candidates[0], float(space.error.max())
    if first.seconds > (most or math.inf):
        return f"{first.choice} should meet it, in about {in_words(first.seconds)}: too long"
    if known > goal.tolerance and first.edges > EXTRAPOLATED * first.mesh.errors.x[-1]:
        return (
            f"the best meshes that were run still differ by {in_percent(known)}; {first.choice} "
            f"may meet it, in about {in_words(first.seconds)}"
        )
    return ""


def _why_none(space: SpaceErrors, prediction: Prediction, goal: Goal) -> str:
    """Return why no setting is predicted to meet the goal: its time, the solver or the mesh."""
    if math.isfinite(goal.budget):
        return f"no setting is predicted to take less than {goal.budget:g} s"
    allowed = MARGIN * goal.tolerance
    if prediction.other > allowed:
        left = in_percent(prediction.other)
        return f"the tolerance of the solver and changed terms alone make an error of {left}"
    best = min(space.meshes, key=lambda one: float(one.errors.y[-1].max()))
    last, order = best.errors.y[-1], best.errors.order
    if last.max() <= allowed:
        return "the error in time of all methods is predicted to be larger"
    finer = float(((last / allowed) ** (1 / order)).max())
    return (
        f"it needs a mesh about {finer:.2g} times finer than {best.trials[-1].choice}, the finest "
        f"that the time of the search allows{_obstacles(space)}"
    )


def _obstacles(space: SpaceErrors) -> str:
    """Return what may keep the scene from converging."""
    found = list(space.reference.row["obstacles"])
    return f": {'; '.join(found)}" if found else ""
