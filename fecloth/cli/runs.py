"""The commands of a run: `run`, `check`, `view`, `render` and `export`."""

from __future__ import annotations

import signal
import sys
from argparse import Namespace
from typing import TYPE_CHECKING

from fecloth import errors
from fecloth.cli.commands import reading
from fecloth.runs.interruption import set_handler

# Signals are handled before NumPy is imported: each command imports what it needs when it runs.
if TYPE_CHECKING:
    from collections.abc import Callable

    from fecloth.runs.outcome import SceneResult
    from fecloth.scene.probe_tables import Verdict
    from fecloth.scene.problem import Problem
    from fecloth.scene.scene import Scene
    from fecloth.simulation.steps import StepInfo
    from fecloth.system.system import System


def run(options: Namespace) -> int:
    """Run a scene, on all processes of mpiexec if there are several."""
    from fecloth.distributed.environment import count_processes, use_one_thread

    if count_processes() == 1:
        return _run_one(options)
    use_one_thread()
    from fecloth.distributed.launch import run_on_all

    return run_on_all(lambda make_system: _run_one(options, make_system))


def _run_one(options: Namespace, make_system: Callable[..., System] | None = None) -> int:
    """Run a scene in this process, print what it does, and return the exit status.

    `make_system` makes the part of the system that this process has, if there are several. With
    --quiet only warnings and failures are printed. Raises `InputError` for --resume together
    with another option that names the folder.
    """
    from functools import partial
    from pathlib import Path

    from fecloth.cli.describe import sources
    from fecloth.cli.progress import progress, terminal
    from fecloth.errors import InputError
    from fecloth.runs.run_scene import run_scene
    from fecloth.scene.plan import plan
    from fecloth.system.system import System

    scene = _load(options.scene, options)
    if options.resume and (options.output or options.overwrite):
        raise InputError("--resume", "needs neither -o nor --overwrite: it names the folder")
    path = Path(options.resume or options.output or Path("out") / Path(options.scene).stem)
    console = terminal(options.quiet)

    def warn(words: str) -> None:
        if options.quiet:  # `console` prints nothing
            terminal(quiet=False).print(f"warning: {words}", soft_wrap=True)
        else:
            console.print(f"warning: {words}", soft_wrap=True)

    def announce(problem: Problem, why: str, warnings: list[str]) -> None:
        lines = [*sources(problem.system.fabric), *plan(problem, why)]
        console.print("\n".join(lines), soft_wrap=True)
        for words in warnings:
            warn(words)

    with progress(console, scene.schedule.t_end, scene.schedule.unit) as report:
        outcome = run_scene(
            scene,
            path,
            overwrite=options.overwrite,
            announce=announce,
            report=report,
            resume=bool(options.resume),
            warn=warn,
            # Nothing is left to interrupt, and a signal must not change the exit status.
            closed=partial(set_handler, signal.SIG_IGN),
            make_system=make_system or System,
        )
    return _print_outcome(outcome, options.quiet)


def _print_outcome(outcome: SceneResult, quiet: bool) -> int:
    """Print the ledger and how the run ended; return the exit status.

    With `quiet` only a failure is printed.
    """
    from fecloth.runs.outcome import DONE, FAILED, failure_message, finished_message, ledger_text

    if not quiet:
        print(ledger_text(outcome.ledger, outcome.summary["unit"]))
        print(finished_message(outcome))
    if outcome.status == DONE:
        return 0
    print(failure_message(outcome), file=sys.stderr)
    if outcome.status == FAILED:
        return errors.FAILED
    return errors.STOPPED


def check(options: Namespace) -> int:
    """Run scenes in memory, and print for each expectation whether it is met.

    Return 0 if all are met, else the status `errors.MISSED`. With --quiet only the
    expectations that are not met are printed. Raises `SceneError` for a scene without expectations.
    """
    from fecloth.cli.progress import progress, terminal

    console = terminal(options.quiet)
    passed = True
    for path in options.scenes:
        scene = _load(path, options)
        scene.require_expectations()
        with progress(console, scene.schedule.t_end, scene.schedule.unit) as report:
            verdicts = _compare_with_expectations(scene, report)
        for verdict in verdicts:
            if not (options.quiet and verdict.passed):
                print(f"{path}: {verdict}")
            passed &= verdict.passed
    if passed:
        return 0
    return errors.MISSED


def _compare_with_expectations(scene: Scene, report: Callable[[StepInfo], None]) -> list[Verdict]:
    """Run a scene in memory, print its warnings, and return a verdict on each expectation."""
    from fecloth.scene.probe_tables import check

    problem, solver = scene.build().choose()
    result = problem.run(solver, report)
    for words in result.warnings:
        print(f"warning: {words}", file=sys.stderr)
    unit = scene.schedule.unit
    return check(scene.expect, result.times, result.observed, result.energies, unit)


def view(options: Namespace) -> int:
    """Write the page of a run, and open it."""
    import webbrowser

    from fecloth.view.web_page import write_view

    file = write_view(options.folder)
    print(f"wrote {file}")
    if not options.no_open:
        webbrowser.open(file.resolve().as_uri())
    return 0


def render(options: Namespace) -> int:
    """Draw a run as a movie or a picture, print where it is, and return the exit status 0.

    Raises `InputError` for a size that is not two whole numbers.
    """
    from fecloth.errors import InputError
    from fecloth.view import render

    try:
        width, height = map(int, options.size.split("x"))
    except ValueError as error:
        raise InputError(f"--size {options.size}", "must be like 1280x720") from error
    file = render.render(
        options.folder,
        options.output,
        field=options.field,
        size=(width, height),
        fps=options.fps,
        time=options.time,
    )
    time = _describe_frame_time(options) if file.suffix == ".png" else ""
    print(f"wrote {file}{time}")
    return 0


def export(options: Namespace) -> int:
    """Write a run for Blender and other programs."""
    from fecloth.view.export import export

    files = export(options.folder, options.output, options.fps)
    to_last = f" to {files[-1].name}" if len(files) > 1 else ""
    print(f"wrote {files[0]}{to_last}")
    return 0


def _describe_frame_time(options: Namespace) -> str:
    """Return the time of the frame shown, as a text that begins with a colon.

    In a static run it is the part of the loads. If there is no frame at the time asked for, the
    text names that time, too.
    """
    import math

    from fecloth.output.frame_reader import Series
    from fecloth.runs.outcome import place_in_words
    from fecloth.view.web_page import unit_of

    series = Series.open(options.folder)
    time_asked_for = options.time
    t = series.times[series.at(time_asked_for)]
    unit = unit_of(series.folder)
    words = f": {place_in_words(t, unit)}"
    if time_asked_for is None or math.isclose(t, time_asked_for, rel_tol=1e-9, abs_tol=1e-12):
        return words
    return f"{words}, of the frame next to {time_asked_for:g}{unit}"


def _load(path: str, options: Namespace) -> Scene:
    from fecloth.scene.scene import load_scene

    if options.threads is None:
        threads = []
    else:
        threads = [f"solver.threads={options.threads}"]
    return load_scene(path, [*options.set, *threads], **reading(options))
