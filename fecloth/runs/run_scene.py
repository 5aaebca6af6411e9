"""One run of a scene into a folder, which can be read at any moment and however the run ends.

scene.resolved.toml   the scene with all defaults and overrides
run.pvd, run.vtu.series, frames/*.vtu   for ParaView; or all in one, run.vtkhdf
steps.csv      number, time, size, iterations, residual and energy drift of every step
energies.csv   the ledger at every step
observed.csv   probes, mean displacement, sag, area and reactions at every step
restart/*.npz  from which the run goes on, as `restart` describes
strains.csv    extremes of the principal stretches at every frame
report.html    what the run did, on a page for a browser
summary.json   sizes, counts, seconds by phase, memory, versions, how it ended
run.log        the same in words, with the time of day
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from fecloth.errors import InputError
from fecloth.nonlinear.options import Solver
from fecloth.output.atomic_files import locked, writing
from fecloth.runs import restart as restarts
from fecloth.runs.folder import RunFolder, removed_on_failure
from fecloth.runs.interruption import interruptible
from fecloth.runs.outcome import DONE, FAILED, INTERRUPTED, Outcome, count_sizes
from fecloth.runs.recorder import Recorder
from fecloth.runs.restart import Restart
from fecloth.runs.stopwatch import Watch
from fecloth.runs.warm_up import compile_kernels
from fecloth.scene.problem import Problem
from fecloth.scene.run_warnings import find_warnings
from fecloth.scene.scene import Scene
from fecloth.simulation.march import StepInfo
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.record_steps import trial_recorder
from fecloth.simulation.resolve import resolve


def run_scene(
    scene: Scene,
    path: str | Path,
    overwrite: bool = False,
    announce: Callable[[Problem, str, list[str]], None] = lambda problem, why, told: None,
    report: Callable[[StepInfo], None] = lambda info: None,
    resume: bool = False,
    warn: Callable[[str], None] = lambda words: None,
) -> Outcome:
    """Mesh, compile, march and write.

    Parameters
    ----------
    path, overwrite
        The folder; one that is not empty is refused unless `overwrite` is set.
    announce
        Called with the problem, the choice of the solver, and what is to be doubted, before the
        first step.
    report
        Called after every step.
    resume
        Go on with the run in that folder from its last restart file; what it wrote after that is
        taken away.
    warn
        Called at the first step at which the energy balance no longer closes, with words.

    Raises
    ------
    SceneError, InputError
        Before anything is written. Afterwards a failure is an `Outcome`.
    """
    path = Path(path)
    with ExitStack() as held:
        if path.is_dir():
            held.enter_context(locked(path))
        return _run_scene(scene, path, overwrite, announce, report, resume, warn, held)


def _run_scene(scene, path, overwrite, announce, report, resume, warn, held: ExitStack) -> Outcome:
    watch, held_before = Watch(), path.is_dir()
    if not resume:
        RunFolder.refuse(path, overwrite)
    found = restarts.find(path) if resume else None
    with watch.phase("mesh"):
        cloth = scene.mesh()
    with watch.phase("bind"):
        problem = scene.build(cloth)
        start = restarts.digest(cloth, problem.state)
    if found:
        restarts.refuse_another(found, scene.to_toml(), start, path)
    with watch.phase("compile"):
        compile_kernels(problem)
    with watch.phase("choose"):
        problem, solver, why = resolve_scene(_with_earlier_method(problem, found))
    told = find_warnings(problem)
    announce(problem, why, told)
    with interruptible() as interrupted:
        if not held_before:
            with writing(path):
                path.mkdir(parents=True, exist_ok=True)
            held.enter_context(locked(path))
        folder = (
            RunFolder.reopen(path, found.tables) if found else RunFolder.create(path, overwrite)
        )
        with nullcontext() if found else removed_on_failure(path, made=not held_before):
            _write_head(folder, scene, problem, why, told)
            recorder = Recorder(folder, problem, watch, solver, scene.to_toml(), start, found)
        error = recorder.march(report, warn, interrupted)
        stopped = INTERRUPTED if recorder.state.t < problem.t_end else DONE
        return recorder.close(FAILED if error else stopped, why, error)


def _write_head(folder, scene, problem, why, told: list[str]) -> None:
    """The scene, and the first lines of the log."""
    folder.text("scene.resolved.toml", scene.to_toml())
    folder.log(f"process {os.getpid()} on {platform.node()}; fecloth {version('fecloth')}")
    folder.log(f"{_sizes(problem)}; solver {why}")
    for line in (problem.note, *(f"warning: {doubt}" for doubt in told)):
        if line:
            folder.log(line)


def resolve_scene(problem: Problem) -> tuple[Problem, Solver, str]:
    """The problem with the method that takes the steps, its solver, and why those."""
    record = trial_recorder(problem.system, problem.ledger, problem.observer)
    run_ = problem.system, problem.method, problem.state, problem.dt, problem.t_end
    method, solver, why = resolve(*run_, problem.linear, problem.newton, record)
    return replace(problem, method=method), solver, why


def _with_earlier_method(problem: Problem, found: Restart | None) -> Problem:
    """With the method that an earlier part of the run has settled on."""
    if not found or not isinstance(problem.method, Auto):
        return problem
    for method in problem.method.candidates:
        if str(method) == found.method:
            return replace(problem, method=method)
    raise InputError(f"the run went by {found.method}", "is none of Auto's methods")


def _sizes(problem: Problem) -> str:
    sizes = count_sizes(problem.system)
    terms = ", ".join(problem.system.names) or "no terms"
    return f"{sizes['nodes']} nodes, {sizes['triangles']} triangles; {terms}"
