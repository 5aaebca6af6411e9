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
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from fecloth.errors import FeclothError, InputError
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.context import SolverContext
from fecloth.output.atomic_files import alone, writing
from fecloth.output.frames import fields
from fecloth.runs import restart as restarts
from fecloth.runs.folder import RunFolder, begun
from fecloth.runs.outcome import DONE, FAILED, INTERRUPTED, Outcome, sizes_of
from fecloth.runs.recorder import Recorder
from fecloth.runs.restart import Restart
from fecloth.runs.stopwatch import Watch
from fecloth.scene.problem import Built
from fecloth.scene.run_warnings import doubts
from fecloth.scene.scene import Scene
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.march import StepInfo
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.probes import Observer
from fecloth.simulation.resolve import settled
from fecloth.simulation.run import run
from fecloth.system.system import System


def run_scene(
    scene: Scene,
    path: str | Path,
    overwrite: bool = False,
    announce: Callable[[Built, str, list[str]], None] = lambda built, why, told: None,
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
        Called with what was built, the choice of the solver, and what is to be doubted, before the
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
            held.enter_context(alone(path))
        return _run_scene(scene, path, overwrite, announce, report, resume, warn, held)


def _run_scene(scene, path, overwrite, announce, report, resume, warn, held: ExitStack) -> Outcome:
    watch, held_before = Watch(), path.is_dir()
    if not resume:
        RunFolder.refuse(path, overwrite)
    found = restarts.find(path) if resume else None
    with watch.phase("mesh"):
        cloth = scene.mesh()
    with watch.phase("bind"):
        built = scene.build(cloth)
        start = restarts.digest(cloth, built.state)
    if found:
        restarts.refuse_another(found, scene.to_toml(), start, path)
    with watch.phase("compile"):
        compile_kernels(built)
    with watch.phase("choose"):
        built, solver, why = settled_scene(_chosen(built, found))
    told = doubts(built)
    announce(built, why, told)
    with _interruptible() as interrupted:
        if not held_before:
            with writing(path):
                path.mkdir(parents=True, exist_ok=True)
            held.enter_context(alone(path))
        folder = (
            RunFolder.opened(path, found.tables) if found else RunFolder.create(path, overwrite)
        )
        with nullcontext() if found else begun(path, made=not held_before):
            _head(folder, scene, built, why, told)
            recorder = Recorder(folder, built, watch, solver, scene.to_toml(), start, found)
        error = recorder.marched(report, warn, interrupted)
        stopped = INTERRUPTED if recorder.state.t < built.t_end else DONE
        return recorder.close(FAILED if error else stopped, why, error)


def _head(folder, scene, built, why, told: list[str]) -> None:
    """The scene, and the first lines of the log."""
    folder.text("scene.resolved.toml", scene.to_toml())
    folder.log(f"process {os.getpid()} on {platform.node()}; fecloth {version('fecloth')}")
    folder.log(f"{_sizes(built)}; solver {why}")
    for line in (built.note, *(f"warning: {doubt}" for doubt in told)):
        if line:
            folder.log(line)


def settled_scene(built: Built) -> tuple[Built, SolverContext, str]:
    """What was built with the method that takes the steps, its solver, and why those."""
    ledger = Ledger.open(built.system, built.state)
    observer = Observer.bind(built.system, built.state, built.probes)

    def record(one, old, step):
        return ledger.after(built.system, one, old, step).row(), observer.row(old, step)

    run_ = built.system, built.method, built.state, built.dt, built.t_end
    method, solver, why = settled(*run_, built.linear, built.newton, record)
    return replace(built, method=method), solver, why


def _chosen(built: Built, found: Restart | None) -> Built:
    """With the method that an earlier part of the run has settled on."""
    if not found or not isinstance(built.method, Auto):
        return built
    for method in built.method.candidates:
        if str(method) == found.method:
            return replace(built, method=method)
    raise InputError(f"the run went by {found.method}", "is none of Auto's methods")


def compile_kernels(built: Built) -> None:
    """Compile what the run will call, on two triangles, so that no step pays for it.

    Compiled code is kept on disk: a second run only loads it.
    """
    whole, halves = built.system, {"lower": [0], "upper": [1]}
    corners, triangles = [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)]
    sets, element = {"left": [0, 3]}, whole.cloth.element
    cloth = Cloth.from_arrays(corners, triangles, sets, regions=halves, element=element)
    fabric, *others = whole.panel.fabrics  # constants by triangle are an array of another layout
    fabric = {"lower": fabric, "upper": others[0]} if others else fabric
    # SuperLU compiles what PARDISO needs too, and does not load the MKL, which may not be needed
    for linear in ("pcg", "superlu") if built.linear == "auto" else (built.linear,):
        with suppress(FeclothError), warnings.catch_warnings(action="ignore"):
            # what fails there, or is doubted, says nothing about the scene
            system = System(cloth, fabric, whole.terms, ["left"], whole.mass_kind)
            start = system.state(1.01 * system.rest().x)
            fields(system, start)
            run(system, built.method, start, built.dt, built.dt or 1e-4, solver=linear)


def _sizes(built: Built) -> str:
    sizes = sizes_of(built.system)
    terms = ", ".join(built.system.names) or "no terms"
    return f"{sizes['nodes']} nodes, {sizes['triangles']} triangles; {terms}"


@contextmanager
def _interruptible() -> Iterator[threading.Event]:
    """Ctrl-C sets the event: a run stops between two steps; a second one at once.

    So do SIGTERM and, where it is not ignored (nohup), the end of the terminal.
    """
    asked = threading.Event()

    def ask(number, frame):
        if asked.is_set():
            raise KeyboardInterrupt("at once; --resume goes on from what it left")
        asked.set()

    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    hangup = getattr(signal, "SIGHUP", None)
    if hangup and signal.getsignal(hangup) != signal.SIG_IGN:
        numbers.append(hangup)
    before = {number: signal.signal(number, ask) for number in numbers}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
