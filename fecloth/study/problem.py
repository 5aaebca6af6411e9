"""What a study refines: a scene, or a user's function of h and dt."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.scene.scene import Scene, load_scene
from fecloth.simulation.probes import Probe
from fecloth.study.function_problem import FunctionProblem
from fecloth.study.scene_problem import SceneProblem
from fecloth.study.setups import accepted

Problem = SceneProblem | FunctionProblem


def open_problem(
    problem: Any,
    h: float | None = None,
    dt: float | None = None,
    t_end: float | None = None,
    probes: Sequence[Probe] = (),
    settings: Mapping[str, object] | None = None,
) -> Problem:
    """Return the problem of a scene, its path, or a function.

    The other arguments are for a function, see `fecloth.study.of`. Raise `InputError` for any
    of them beside a scene, for an argument that the function does not take, and for what is
    neither a scene nor a function.
    """
    if isinstance(problem, Scene | str | Path):
        named = {"h": h, "dt": dt, "t_end": t_end, "probes": probes or None, **(settings or {})}
        given_names = [name for name, value in named.items() if value is not None]
        if given_names:
            what = f"{given_names[0]} = …"
            remedy = "Change the scene."
            raise InputError(what, "is for a function's problem", "problem", remedy)
        scene = problem if isinstance(problem, Scene) else load_scene(problem)
        file = Path(scene.source.partition(" with ")[0])  # "drape.toml with fabric.density=0.2"
        return SceneProblem(scene, name=scene.title or file.stem, source=file.name)
    if not callable(problem):
        allowed = "must be a scene, its path, or a function of h and dt"
        raise InputError(f"problem = {problem!r}", allowed)
    accepted(problem, settings or {})  # refuses what the function does not take
    return FunctionProblem(problem, h, dt, t_end, placed=tuple(probes), settings=settings or {})
