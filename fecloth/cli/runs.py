"""The commands of a run: `run`, `check`, `view`, `render` and `export`."""

import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fecloth import errors
from fecloth.cli.options import Output, Overwrite, Reading, RunFolder, SceneFile, Texts, Threads
from fecloth.runs.interruption import set_handler

# Signals are handled before NumPy is imported: each command imports what it needs when it runs.
if TYPE_CHECKING:
    from fecloth.runs.outcome import SceneResult
    from fecloth.scene.problem import Problem
    from fecloth.scene.scene import Scene
    from fecloth.simulation.steps import StepInfo


def run(
    scene: SceneFile,
    *,
    reading: Reading,
    output: Output = None,
    overwrite: Overwrite = False,
    resume: Annotated[str | None, "go on with the run in that folder", "DIR"] = None,
    threads: Threads = None,
    watch: Annotated[bool, "follow the run in a window (with the extra [view])"] = False,
    verbose: Annotated[
        bool, "print the plan, notes, energies and all accounts, as run.log has them", "", "-v"
    ] = False,
) -> int:
    """Run a scene and leave files for ParaView.

    It runs on all processes of mpiexec if there are several. Raises `InputError` for --resume
    together with another option that names the folder, and for --watch where no window can open.
    """
    from fecloth.distributed.environment import count_processes, use_one_thread

    def run_here(make_system: Callable | None = None) -> int:
        from fecloth.system.system import System

        loaded = _load(scene, reading, threads)
        if resume and (output or overwrite):
            allowed = "needs neither -o nor --overwrite: it names the folder"
            raise errors.InputError("--resume", allowed)
        path = Path(resume or output or Path("out") / Path(scene).stem)
        outcome = _run_scene(
            loaded,
            path,
            reading.quiet,
            verbose,
            watch,
            overwrite=overwrite,
            resume=bool(resume),
            make_system=make_system or System,
        )
        return _print_outcome(outcome, reading.quiet, verbose)

    if watch:
        from fecloth.view.watch import require_display

        require_display()
    if count_processes() == 1:
        return run_here()
    use_one_thread()
    from fecloth.distributed.launch import run_on_all

    return run_on_all(run_here)


def _run_scene(
    scene: "Scene", path: Path, quiet: bool, verbose: bool, watch: bool, **how: Any
) -> "SceneResult":
    """Run a scene in this process, and print what it does; with `quiet` only warnings.

    With `verbose` the whole plan is printed, else of an explicit method its largest step alone.
    With `watch` a window follows the run. `how` are further arguments of `run_scene`.
    """
    from fecloth.cli.progress import progress, show, terminal
    from fecloth.runs.run_scene import run_scene
    from fecloth.scene.plan import describe_limit, plan
    from fecloth.simulation.doubts.doubt import NOTE, Doubt

    console = terminal()
    reports: list[Callable] = []

    def warn(doubt: Doubt) -> None:
        if verbose or doubt.kind.label != NOTE:
            show(doubt.line, console)

    def announce(problem: "Problem", why: str, doubts: list[Doubt]) -> None:
        lines = []
        if verbose and not quiet:
            lines = plan(problem, why)
        elif not quiet and problem.steps.method.traits.explicit:
            lines = describe_limit(problem)
        for line in lines:
            show(line, console)
        for doubt in doubts:
            warn(doubt)
        if watch:
            from fecloth.view.watch import watching

            draw = stack.enter_context(watching(problem.system, problem.start))
            reports.append(lambda info: draw(info.result.state))

    def report(info: "StepInfo") -> None:
        for each in reports:
            each(info)

    with ExitStack() as stack:
        reports.append(stack.enter_context(progress(console, scene, quiet)))
        return run_scene(
            scene,
            path,
            announce=announce,
            report=report,
            warn=warn,
            # Nothing is left to interrupt, and a signal must not change the exit status.
            closed=partial(set_handler, signal.SIG_IGN),
            **how,
        )


def _print_outcome(outcome: "SceneResult", quiet: bool, verbose: bool) -> int:
    """Print what a run answers, or why it ended early; return the exit status.

    With `quiet` only a failure is printed; with `verbose` also all that the run accounts for.
    """
    from fecloth.runs.outcome import (
        DONE,
        FAILED,
        cost_message,
        failure_message,
        finished_message,
        list_details,
    )

    is_done = outcome.status == DONE
    if not quiet:
        if verbose:
            print("\n".join(list_details(outcome.accounts, outcome.summary)))
        print(finished_message(outcome) if is_done else cost_message(outcome))
    if is_done:
        return 0
    print(failure_message(outcome), file=sys.stderr)
    if outcome.status == FAILED:
        return errors.FAILED
    return errors.STOPPED


def check(
    scenes: Annotated[list[str], "a .toml file", "scene"],
    *,
    reading: Reading,
    threads: Threads = None,
) -> int:
    """Run scenes and verify their [expect] tables.

    Return 0 if all expectations are met, else the status `errors.MISSED`. With --quiet only the
    expectations that are not met are printed. Raises `SceneError` for a scene without expectations.
    """
    from fecloth.cli.progress import progress, terminal
    from fecloth.scene.probe_tables import check

    passed = True
    for path in scenes:
        scene = _load(path, reading, threads)
        scene.require_expectations()
        problem, solver = scene.build().choose()
        with progress(terminal(), scene, reading.quiet) as report:
            result = problem.run(solver, report)
        for words in result.warnings:
            print(f"warning: {words}", file=sys.stderr)
        unit = scene.schedule.unit
        for verdict in check(scene.expect, result.times, result.observed, result.energies, unit):
            if not (reading.quiet and verdict.passed):
                print(f"{path}: {verdict}")
            passed &= verdict.passed
    if passed:
        return 0
    return errors.MISSED


def view(
    folder: RunFolder,
    *,
    field: Annotated[
        Texts, "as for render; may be repeated (default: stretches, velocity and so on)", "NAME"
    ] = None,
    no_open: Annotated[bool, "only write the page"] = False,
) -> int:
    """Make view.html of a run and open it in the browser."""
    import webbrowser

    from fecloth.view.web_page import write_view

    file = write_view(folder, field or ())
    print(f"wrote {file}")
    if not no_open:
        webbrowser.open(file.resolve().as_uri())
    return 0


def render(
    folder: RunFolder,
    *,
    output: Annotated[str, ".mp4, .gif or .png", "FILE", "-o"],
    field: Annotated[
        str,
        "an array of the frames, as displacement or region; or larger_stretch, smaller_stretch, "
        "larger_stress, smaller_stress, stress.xx, stress.yy, stress.xy, height, checks",
    ] = "larger_stretch",
    size: Annotated[str, "pixels (1280x720)", "WxH"] = "1280x720",
    fps: Annotated[float | None, "frames a second (default: as the cloth moved)"] = None,
    time: Annotated[float | None, "of a .png [s] (default: the last)", "T"] = None,
) -> int:
    """Draw a run as a movie or a picture.

    Raises `InputError` for a size that is not two whole numbers.
    """
    from fecloth.view.render import render

    try:
        width, height = map(int, size.split("x"))
    except ValueError as error:
        raise errors.InputError(f"--size {size}", "must be like 1280x720") from error
    file = render(folder, output, field=field, size=(width, height), fps=fps, time=time)
    words = _describe_frame_time(folder, time) if file.suffix == ".png" else ""
    print(f"wrote {file}{words}")
    return 0


def export(
    folder: RunFolder,
    *,
    output: Annotated[str, ".usda, or .obj for a file a frame", "FILE", "-o"],
    fps: Annotated[float | None, "frames a second: 24 of .usda, those of the run of .obj"] = None,
) -> int:
    """Write a run for Blender and other programs that render."""
    from fecloth.view.export import export

    files = export(folder, output, fps)
    to_last = f" to {files[-1].name}" if len(files) > 1 else ""
    print(f"wrote {files[0]}{to_last}")
    return 0


def _describe_frame_time(folder: str, time: float | None) -> str:
    """Return the time of the frame shown, as a text that begins with a colon.

    In a static run it is the part of the loads. If there is no frame at the `time` asked for, the
    text names that time, too.
    """
    import math

    from fecloth.output.frame_reader import Series
    from fecloth.runs.outcome import place_in_words
    from fecloth.view.web_page import unit_of

    series = Series.open(folder)
    t = series.times[series.at(time)]
    unit = unit_of(series.folder)
    words = f": {place_in_words(t, unit)}"
    if time is None or math.isclose(t, time, rel_tol=1e-9, abs_tol=1e-12):
        return words
    return f"{words}, of the frame next to {time:g}{unit}"


def _load(path: str, reading: Reading, threads: str | None) -> "Scene":
    changes = list(reading.set_ or ())
    if threads is not None:
        changes.append(f"solver.threads={threads}")
    scene = reading.load(path, changes)
    if scene.uncertain:
        _refuse_unknown_inputs(scene)
    return scene


def _refuse_unknown_inputs(scene: "Scene") -> None:
    """Raise `SceneError` for an entry of [uncertain] that `fecloth budget` would refuse."""
    from fecloth.scene.error_words import errors_at
    from fecloth.study.budgeting.inputs import read_inputs
    from fecloth.study.problem import StudyProblem

    with errors_at("uncertain", scene.source):
        read_inputs(StudyProblem.of(scene), scene.uncertain)
