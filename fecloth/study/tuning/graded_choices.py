"""Meshes that are graded where the error in space is large, as further choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fecloth.errors import InputError
from fecloth.study.graded_meshes import choose_gradings
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.trials import Trial

LEAST_SAVED = 0.4  # share of the triangles, for a family of meshes to be tried


def graded_choices(opened: Problem, trials: Sequence[Trial]) -> list[Choice]:
    """Return the choices of the first trial of each element, with gradings that save triangles.

    There are none for explicit steps, which the smallest edge limits, for functions, for scenes
    with their own gradings, and where the error in space has no estimate or is too even.
    """
    first: dict[str, Trial] = {}
    for trial in trials:
        if trial.is_ok and not trial.choice.is_explicit and trial.choice.h:
            first.setdefault(trial.choice.element, trial)
    if isinstance(opened, FunctionProblem) or opened.scene.cloth.grading:
        return []
    choices = []
    for trial in first.values():
        try:
            choices += _graded(trial)
        except InputError:  # no estimate of the error, or a shape that takes no grading
            continue
    return choices


def _graded(trial: Trial) -> list[Choice]:
    """Return the choice of a trial with its gradings, if there are any."""
    choice = trial.choice
    assert choice.h is not None
    setup = trial.row["point"].problem.first
    x = setup.start.x + np.array(trial.row["displacement"])
    end = replace(setup.start, x=x, v=np.array(trial.row["velocity"]))
    gradings = choose_gradings(setup, end, choice.h, LEAST_SAVED)
    pattern = "unstructured" if choice.pattern else ""
    return [replace(choice, pattern=pattern, grading=gradings)] if gradings else []
