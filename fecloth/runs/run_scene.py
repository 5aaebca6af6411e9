"""A scene run into a folder, which is readable at any moment, however the run ends.

The page fecloth/runs/README.md lists its files.
"""

import os
import platform
from collections.abc import Callable
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path

from fecloth.errors import InputError
from fecloth.output.atomic_files import lock_folder, writing
from fecloth.runs import restart as restarts
from fecloth.runs.environment import Watch
from fecloth.runs.first_calls import compile_kernels
from fecloth.runs.folder import RunFolder, remove_on_failure
from fecloth.runs.interruption import interruptible
from fecloth.runs.outcome import DONE, FAILED, INTERRUPTED, SceneResult
from fecloth.runs.recorder import Recorder
from fecloth.runs.restart import Restart
from fecloth.scene.plan import plan
from fecloth.scene.problem import Problem
from fecloth.scene.scene import Scene
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.steps import StepInfo
from fecloth.system.system import System


def run_scene(
    scene: Scene,
    path: str | Path,
    overwrite: bool = False,
    announce: Callable[[Problem, str, list[Doubt]], None] = lambda problem, why, doubts: None,
    report: Callable[[StepInfo], None] = lambda info: None,
    resume: bool = False,
    warn: Callable[[Doubt], None] = lambda doubt: None,
    closed: Callable[[], object] = lambda: None,
    make_system: Callable[..., System] = System,
) -> SceneResult:
    """Mesh, compile, march and write; return a `Result` with the status and folder of the run.

    Parameters
    ----------
    path, overwrite
        The folder; one that is not empty is refused unless `overwrite` is set.
    announce
        Called before the first step with the problem, the choice of the solver, and the
        doubts about the set-up.
    report
        Called after every step.
    resume
        Continue the run in that folder from its last restart file; what it wrote later is
        removed.
    warn
        Called with each `Doubt` that arises during the run and at its end, notes too.
    closed
        Called when all files are written, before signals are handled as before the run.
    make_system
        Takes the arguments of `System`.

    Raises
    ------
    SceneError, InputError
        Before anything is written. Afterwards a failure is in the `error` of the result.
    """
    path = Path(path)
    with ExitStack() as locks:
        if path.is_dir():
            locks.enter_context(lock_folder(path))
        return _run_scene(
            scene,
            path,
            overwrite,
            resume,
            announce=announce,
            report=report,
            warn=warn,
            closed=closed,
            locks=locks,
            make_system=make_system,
        )


def _run_scene(
    scene: Scene,
    path: Path,
    overwrite: bool,
    resume: bool,
    *,
    announce: Callable[[Problem, str, list[Doubt]], None],
    report: Callable[[StepInfo], None],
    warn: Callable[[Doubt], None],
    closed: Callable[[], object],
    locks: ExitStack,
    make_system: Callable[..., System],
) -> SceneResult:
    """Run a scene as `run_scene` does, in a folder that is locked if it exists.

    A folder that does not exist is made only when all checks have passed. Then it is locked,
    too, until `locks` is closed.
    """
    watch = Watch()
    existed = path.is_dir()
    if not resume:
        RunFolder.refuse(path, overwrite)  # at once, not after the mesh is made
    earlier = restarts.find(path) if resume else None
    with watch.phase("mesh"):
        cloth = scene.mesh()
    with watch.phase("bind"):
        problem = scene.build(cloth, make_system)
        start = restarts.digest(cloth, problem.start)
    if earlier:
        restarts.refuse_another(earlier, scene.to_toml(), start, path)
    with watch.phase("compile"):
        compile_kernels(problem)
    with watch.phase("choose"):
        problem, (solver, why) = _with_earlier_method(problem, earlier).choose()
    doubts = problem.doubts()
    announce(problem, why, doubts)
    with interruptible() as interrupted:
        if not existed:
            with writing(path):
                path.mkdir(parents=True, exist_ok=True)
            locks.enter_context(lock_folder(path))
        # Within this block an error leaves no files of a new run.
        with ExitStack() as clean_up:
            if earlier:
                folder = RunFolder(path)
            else:
                folder = RunFolder.create(path, overwrite)
                clean_up.enter_context(remove_on_failure(path, is_new=not existed))
            resolved = scene.resolved(problem.steps, solver.linear)
            folder.text("scene.resolved.toml", resolved.to_toml())
            folder.log(f"process {os.getpid()} on {platform.node()}; fecloth {version('fecloth')}")
            for line in (*plan(problem, why), *(doubt.line for doubt in doubts)):
                folder.log(line)
            recorder = Recorder(
                folder,
                problem,
                watch,
                solver,
                scene=scene.to_toml(),
                start=start,
                earlier=earlier,
                doubts_before_run=doubts,
                refining=scene.refining,
            )
        error = recorder.march(report, warn, interrupted)
        if error:
            status = FAILED
        elif recorder.progress.state.t < problem.t_end:
            status = INTERRUPTED
        else:
            status = DONE
        outcome = recorder.close(status, why, error, warn)
        closed()
        return outcome


def _with_earlier_method(problem: Problem, earlier: Restart | None) -> Problem:
    """Return the problem with the method that `Auto` chose when the run began."""
    if not earlier or not isinstance(problem.steps, Auto):
        return problem
    for steps in problem.steps.candidates(problem.system):
        if str(steps) == earlier.method:
            return problem.taking(steps)
    raise InputError(f"the run used {earlier.method}", "is none of Auto's methods")
