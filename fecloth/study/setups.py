"""What a study runs: the objects of a scene, or those that a user's function returns."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.nonlinear.options import Newton
from fecloth.runs.warm_up import compile_kernels
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.probes import Probe
from fecloth.simulation.resolve import choose_steps
from fecloth.study.scene_text import scene_of
from fecloth.system.state import State
from fecloth.system.system import System

RETURNS = "must return cloth, system, method and start"


@dataclass(frozen=True, eq=False)
class Setup:
    """A system with its start and how it is solved; an equilibrium without `t_end`."""

    system: System
    start: State
    steps: Any = None
    t_end: float | None = None
    newton: Newton | None = None
    linear: str = "auto"
    probes: tuple[Probe, ...] = ()

    @property
    def cloth(self) -> Cloth:
        return self.system.cloth

    @property
    def is_static(self) -> bool:
        """Whether the result is an equilibrium."""
        return self.t_end is None or isinstance(self.steps, LoadSteps)

    @property
    def is_explicit(self) -> bool:
        """Whether its steps solve no equations."""
        return not self.is_static and self.steps.traits.explicit


def setup_of_scene(text: str, trust_geo: bool = False) -> Setup:
    """Return the setup of a scene's text, with what it needs compiled."""
    built = scene_of(text, trust_geo).build()
    compile_kernels(built)
    run = built.system, built.state, built.steps, built.t_end, built.newton, built.linear
    return Setup(*run, built.probes)


def setup_of_function(
    function: Callable,
    settings: Mapping[str, object],
    dt: float | None,
    t_end: float | None,
    probes: tuple[Probe, ...] = (),
    sharper: float | None = 1.0,
) -> Setup:
    """Call the user's function with the settings that it takes and return its setup."""
    name = getattr(function, "__name__", "problem")
    if "grading" in settings:  # from JSON
        entries: Any = settings["grading"]
        settings = {**settings, "grading": [Grading(**one) for one in entries]}
    returned = function(**accepted(function, settings))
    if not (isinstance(returned, tuple | list) and len(returned) == 4):
        raise InputError(f"the function {name}", RETURNS, "problem")
    _, system, method, start = returned
    if not (isinstance(system, System) and isinstance(start, State)):
        raise InputError(f"the function {name}", RETURNS, "problem")
    newton = Newton()
    if sharper is not None:  # "auto" may leave more than levels differ by
        newton = Newton(tolerance=newton.residual / sharper)
    steps = None
    if t_end is not None:
        steps = choose_steps(method, dt if not method.traits.chooses_dt else None, {})
    return Setup(system, start, steps, t_end, newton, probes=tuple(probes))


def accepted(function: Callable, settings: Mapping[str, object]) -> dict[str, object]:
    """Return the settings that a function takes; h and dt may be left out by it."""
    parameters = inspect.signature(function).parameters
    if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters.values()):
        return dict(settings)
    unknown = sorted(set(settings) - set(parameters) - {"h", "dt"})
    if unknown:
        what = f"{unknown[0]} = {settings[unknown[0]]!r}"
        allowed = f"the function takes {', '.join(parameters) or 'nothing'}"
        raise InputError(what, allowed, "problem")
    return {key: value for key, value in settings.items() if key in parameters}
