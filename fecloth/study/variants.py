"""A problem with other values of its keys, and those combinations that it refuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.probes import Probe
from fecloth.study.change import Change, describe_values
from fecloth.study.levels import FIRST, Level
from fecloth.study.problems import Problem, SceneProblem, open_problem
from fecloth.study.workload import Workload


def open_first(
    problem: Any,
    ranges: Mapping[str, Sequence],
    sizes: Mapping[str, float | None],
    t_end: float | None,
    probes: Sequence[Probe],
    settings: Mapping[str, object],
) -> Problem:
    """Return the problem to vary; a function's has the first value of each key.

    `sizes` are its h and dt.
    """
    given = dict(settings)
    if not isinstance(problem, Scene | str | Path):
        sizes = {key: ranges[key][0] if key in ranges else value for key, value in sizes.items()}
        given |= {key: values[0] for key, values in ranges.items() if key not in sizes}
    return open_problem(problem, sizes["h"], sizes["dt"], t_end, probes, given)


def make_variants(
    opened: Problem, combinations: Sequence[dict], build: bool = False
) -> tuple[list, list]:
    """Return the problem with each combination of values, and the refused ones with the reason.

    With `build` their meshes and systems are made, too, which may refuse more. The first refusal is
    raised if nothing is left, as for a key that does not exist.
    """
    made, refused = [], []
    for values in combinations:
        try:
            variant = opened.changed(Change.of(values))
            if build:
                _ = variant.first
            made.append((values, variant))
        except InputError as error:
            refused.append((values, error))
    if not made:
        raise refused[0][1]
    return made, refused


def size_of(opened: Problem, variant: Problem) -> Workload:
    """Predict the size of a variant without its mesh; of a function's, from that of `opened`."""
    if isinstance(variant, SceneProblem) or isinstance(opened, SceneProblem):
        return variant.workload(FIRST)
    pairs = (opened.h, variant.h), (opened.dt, variant.dt)
    h, dt = (before / now if before and now else 1.0 for before, now in pairs)
    return opened.workload(Level(h, dt))


def describe_failure(status: str, cause: object) -> dict[str, object]:
    """Return the cells of a row that has no value."""
    return {"status": status, "cause": str(cause).splitlines()[0] if str(cause) else ""}


def name_variant(values: Mapping[str, object]) -> str:
    """Return a short name: words stand for themselves, numbers with their key.

    Examples
    --------
    >>> name_variant({"terms.0.type": "Springs", "cloth.h": 0.1})
    'Springs, h = 0.1'
    >>> name_variant({"terms.0": {"type": "Springs", "kind": "van_gelder"}})
    'Springs (kind = van_gelder)'
    """
    return ", ".join(_name_value(key, value) for key, value in values.items())


def _name_value(key: str, value: object) -> str:
    if isinstance(value, Mapping):
        more = describe_values({k: v for k, v in value.items() if k != "type"})
        return f"{value.get('type', key)}{f' ({more})' if more else ''}"
    return value if isinstance(value, str) else f"{key.rpartition('.')[2]} = {value}"
