"""A problem with other values of its keys, and those combinations that it refuses."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from fecloth.errors import InputError
from fecloth.scene.overrides import override
from fecloth.scene.toml_text import to_toml
from fecloth.study.levels import Level
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.scene_text import scene_of

FIRST = Level()


def make_variants(opened: Problem, combinations: Sequence[dict]) -> tuple[list, list]:
    """Return the problem with each combination of values, and the refused ones with the reason.

    The first refusal is raised if nothing is left, as for a key that does not exist.
    """
    made, refused = [], []
    for values in combinations:
        try:
            variant = change_problem(opened, values)
            variant.workload(FIRST)
            made.append((values, variant))
        except InputError as error:
            refused.append((values, error))
    if not made:
        raise refused[0][1]
    return made, refused


def change_problem(opened: Problem, values: Mapping[str, object]) -> Problem:
    """Return the problem with these values."""
    if isinstance(opened, FunctionProblem):
        sizes: dict[str, Any] = {key: values[key] for key in ("h", "dt") if key in values}
        rest = {key: value for key, value in values.items() if key not in sizes}
        return replace(opened, settings={**opened.settings, **rest}, **sizes)
    texts = [f"{key}={value}" for key, value in values.items()]
    try:
        data = override(tomllib.loads(opened.scene.to_toml()), texts)
        return SceneProblem(scene_of(to_toml(data)), opened.name)
    except InputError as error:
        where = f"{opened.name} with {', '.join(texts)}"
        raise InputError(error.what, error.allowed, where, error.remedy) from None


def describe_values(values: Mapping[str, object]) -> str:
    """Return "key = value, key = value"."""
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def describe_failure(status: str, cause: object) -> dict[str, object]:
    """Return the cells of a row that has no value."""
    return {"status": status, "cause": str(cause).splitlines()[0] if str(cause) else ""}
