"""`chart`: what each accuracy of a problem costs, over mesh, element, model, method and step."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fecloth import validation
from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.fronts.front import SECONDS, USUAL_AXES, Plan, run_front
from fecloth.study.fronts.limit import LEAST_LEVELS
from fecloth.study.fronts.result import NAMED_ERRORS, Front
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import refuse_methods
from fecloth.study.runs import print_doubts, refuse_huge

LONGEST_CASE = 60.0  # usual limit of the CPU time of a setting [s]


def chart(
    problem: Scene | str | Path | Callable | Opened,
    quantity: str | Callable[[Any], float] | Quantity | None = None,
    methods: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    models: Sequence[str] | None = None,
    *,
    meshes: int = 2,
    levels: int = 3,
    seconds: float = SECONDS,
    **shared: Any,
) -> Front:
    """Run a problem with other methods, elements, models, meshes and steps, and rank them.

    It is the `front` of the problem down to an error of 0.1 %, drawn. The error of a setting is
    its distance to the limit of this very problem; the limit has an uncertainty, below which an
    error means nothing. The front holds the settings that no other beats in both error and CPU
    seconds. The verdict names the cheapest setting for errors of 10, 1 and 0.1 %.

    Settings run in the order of their cost, from meshes on that are coarser than the problem's
    own. Explicit methods take 0.9 of their stable step; the method "auto" chooses its steps by
    tolerances rtol. A combination that the problem refuses, a run that fails and a case above
    `time_limit` are rows with that status.

    Parameters
    ----------
    problem, quantity
        As for `of` and `converge`.
    methods, elements, models
        Names as in a scene, such as "bdf2", "P2", "NeoHookean"; by default the scene's own
        with the usual others, P1 and P2, and its own model. Of a function's problem they are
        values of its arguments `method`, `element` and `model`.
    meshes
        The finest h is the problem's own one, divided by 2 so many times less one.
    levels
        Least number of levels of the limit, from 3; h and dt are halved from level to level.
    seconds
        Longest CPU time of all runs together [s].
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.

    Raises
    ------
    InputError
        For an unknown name, a quantity that no run in time has, or one of size zero.
    StudyFailed
        If no run on a coarse mesh reaches its end.
    """
    study = open_study(problem, shared)
    validation.whole("meshes", meshes, 1, "chart", most=4)
    validation.whole("levels", levels, LEAST_LEVELS, "chart", most=10)
    validation.number("seconds", seconds, 0.0, "chart")
    opened = study.problem
    runs = study.runs(LONGEST_CASE)
    refuse_huge(opened, runs)
    refuse_methods(opened, methods, "chart")
    chosen = opened.choose_quantity(quantity)
    if chosen.how == "mode":
        raise InputError(f"{chosen}", "has no method and no step: take converge", "chart")
    axes: dict[str, list | None] = dict.fromkeys(USUAL_AXES)
    for name, given in (("method", methods), ("element", elements), ("model", models)):
        if given:
            axes[name] = list(given)
    plan = Plan(
        problem=opened,
        quantities=(chosen,),
        axes=axes,
        tolerance=NAMED_ERRORS[-1] / 100,
        seconds=seconds,
        runs=runs,
        study="chart",
        levels=levels,
        finest=None if opened.h is None else opened.h / 2 ** (meshes - 1),
    )
    doubts = print_doubts(opened)
    others: tuple[str, ...] = ()
    if quantity is None:
        others = tuple(q.text for q in opened.quantities if q.text != chosen.text)
    return replace(run_front(plan), doubts=doubts, others=others)
