"""The command line; each command imports what it needs when it runs."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from fecloth.runs.interruption import set_handler, stop_at_once

# Each command imports what it needs when it runs, so that --version and --help answer at once, and
# that signals are handled before NumPy is imported.
if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from fecloth.scene.expectations import Verdict
    from fecloth.scene.problem import Problem
    from fecloth.scene.scene import Scene
    from fecloth.simulation.march import StepInfo
    from fecloth.system.system import System

STATUS = """exit status:
  0  done
  1  check: a value lies outside its tolerance; tune: not proved
  2  bad input: nothing was run
  3  the simulation failed, or the disk is full; what was written up to then is readable
  4  interrupted; run goes on with --resume, a study with the same command
"""
MISSED, BAD_INPUT, SIMULATION_FAILED, STOPPED = 1, 2, 3, 4
FIELD_NAMES = (  # the keys of `frame_reader.FIELDS`, and the checker pattern
    *("larger_stretch", "smaller_stretch", "speed", "displacement"),
    *("contact_pressure", "slip", "energy_density", "error_density", "height"),
    *("quality", "larger_stress", "smaller_stress"),
    *("E11", "E22", "E12", "S11", "S22", "S12", "checks"),
)


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit status (see `STATUS`).

    Without `arguments` it takes those of the process. Then signals are ignored after the command
    until the process ends, so that they do not change its status.
    """
    before = set_handler(stop_at_once)
    try:
        return _run_command(arguments)
    except (KeyboardInterrupt, RuntimeError) as error:
        # Python 3.11 raises a RuntimeError for what ends a `__set_name__`, as in an import.
        stop = error.__cause__ if isinstance(error, RuntimeError) else error
        if not isinstance(stop, KeyboardInterrupt):
            raise
        set_handler(signal.SIG_IGN)
        with suppress(OSError):  # a closed pipe
            print(f"interrupted{f' {stop}' if stop.args else '; run it again'}", file=sys.stderr)
        return STOPPED
    finally:
        set_handler(signal.SIG_IGN)
        if arguments is not None:
            for number, handler in before.items():
                signal.signal(number, handler)


def _run_command(arguments: list[str] | None) -> int:
    """Run a command; turn lost output into a failure where the output is the result."""
    from fecloth.cli.streams import lost_output, tolerant_streams

    with tolerant_streams():
        options = _parser().parse_args(arguments)
        status = _status(options)
        set_handler(signal.SIG_IGN)
        if (why := lost_output()) and options.prints:
            print(f"failed: {why}", file=sys.stderr)
            status = status or SIMULATION_FAILED
        return status


def _status(options) -> int:
    """Run the command of the options; print its failure, if any."""
    from fecloth.errors import FeclothError, InputError
    from fecloth.output.atomic_files import DiskFull

    try:
        return options.command(options)
    except DiskFull as full:
        print(f"failed: {full}", file=sys.stderr)
        return SIMULATION_FAILED
    except InputError as mistake:
        print(f"error: {mistake}", file=sys.stderr)
        return BAD_INPUT
    except FeclothError as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return SIMULATION_FAILED
    except OSError as refusal:  # of the system, as where Numba keeps machine code
        remedy = "If a disk is full, free space; NUMBA_CACHE_DIR is where machine code is stored."
        print(f"error: {refusal}. {remedy}", file=sys.stderr)
        return BAD_INPUT
    except MemoryError as full:
        print(f"failed: memory is full ({full}). Take a coarser mesh.", file=sys.stderr)
        return SIMULATION_FAILED


def _parser() -> argparse.ArgumentParser:
    import argparse

    from fecloth import __version__
    from fecloth.cli.charting import add_chart_options
    from fecloth.cli.comparing import add_compare_options
    from fecloth.cli.stability import add_stability_options
    from fecloth.cli.studies import add_options, add_simplify_options, add_sweep_options
    from fecloth.cli.suggesting_parser import SuggestingParser
    from fecloth.cli.tuning import add_tune_options

    parser = SuggestingParser(
        prog="fecloth",
        description="A continuum cloth solver.",
        epilog=STATUS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"fecloth {__version__}")
    commands = parser.add_subparsers(required=True, title="commands", metavar="COMMAND")

    sub = _command(commands, "run", _run, "run a scene and leave files for ParaView")
    sub.add_argument("scene", help="a .toml file")
    _scene_options(sub)
    sub.add_argument("-o", "--output", metavar="DIR", help="folder to write (default: out/SCENE)")
    sub.add_argument("--overwrite", action="store_true", help="replace the run in that folder")
    sub.add_argument("--resume", metavar="DIR", help="go on with the run in that folder")
    _threads_option(sub)

    sub = _command(commands, "view", _view, "make view.html of a run and open it in the browser")
    sub.add_argument("folder", metavar="DIR", help="folder of a run")
    sub.add_argument("--no-open", action="store_true", help="only write the page")

    sub = _command(commands, "render", _render, "draw a run as a movie or a picture")
    sub.add_argument("folder", metavar="DIR", help="folder of a run")
    sub.add_argument("-o", "--output", metavar="FILE", required=True, help=".mp4, .gif or .png")
    sub.add_argument("--field", default="larger_stretch", help=f"one of {', '.join(FIELD_NAMES)}")
    sub.add_argument("--size", metavar="WxH", default="1280x720", help="pixels (1280x720)")
    sub.add_argument("--fps", type=float, help="frames a second (default: as the cloth moved)")
    sub.add_argument("--time", type=float, metavar="T", help="of a .png [s] (default: the last)")

    sub = _command(commands, "check", _check, "run scenes and verify their [expect] tables")
    sub.add_argument("scenes", nargs="+", metavar="scene", help="a .toml file")
    _scene_options(sub)
    _threads_option(sub)

    sub = _command(commands, "converge", _converge, "refine a scene: value, uncertainty, order")
    add_options(sub)

    words = "compare models, or two scenes, beside the error of each"
    sub = _command(commands, "compare", _compare, words)
    add_compare_options(sub)

    sub = _command(commands, "sweep", _sweep, "run a scene for several values of a key")
    add_sweep_options(sub)

    sub = _command(commands, "chart", _chart, "errors of other settings over CPU seconds")
    add_chart_options(sub)

    words = "find the steps at which each method fails, over the values of a key"
    sub = _command(commands, "stability", _stability, words)
    add_stability_options(sub)

    words = "find what a scene does not need, and write it without"
    sub = _command(commands, "simplify", _simplify, words)
    add_simplify_options(sub)

    words = "find the cheapest setting that meets a tolerance, and prove its error"
    sub = _command(commands, "tune", _tune, words)
    add_tune_options(sub)

    sub = _command(commands, "modes", _modes, "print the natural frequencies of a scene [Hz]")
    sub.add_argument("scene", help="a .toml file")
    sub.add_argument("-n", "--count", type=int, default=6, help="number of frequencies (6)")
    sub.add_argument("-o", "--output", metavar="DIR", help="folder of report, picture and shapes")
    _scene_options(sub)

    sub = _command(commands, "mesh", _mesh, "mesh and describe a cloth; write it with -o")
    sub.add_argument("path", help="a .geo, .msh or other mesh file, or a scene")
    sub.add_argument("--h", type=float, metavar="SIZE", help="edge length of a .geo file [m]")
    sub.add_argument("-o", "--output", metavar="FILE", help="e.g. cloth.vtu, for ParaView")
    _mesh_options(sub)

    sub = _command(commands, "info", _info, "versions; with a scene, what it would do")
    sub.add_argument("scene", nargs="?", help="a .toml file")
    sub.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    _mesh_options(sub)
    help_ = "memory of each process, if N of them share the cloth by mpiexec"
    sub.add_argument("--ranks", type=int, metavar="N", help=help_)
    sub.add_argument("--fabrics", action="store_true", help="the published fabrics, with sources")
    sub.add_argument("--schema", action="store_true", help="the JSON schema of scene files")
    terms = "the terms of a scene; with a name, what that term takes"
    sub.add_argument("--terms", nargs="?", const="", metavar="NAME", help=terms)
    return parser


def _command(commands, name: str, function: Callable, words: str) -> argparse.ArgumentParser:
    import argparse

    parser = commands.add_parser(
        name,
        help=words,
        description=words,
        epilog=STATUS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(
        command=function,
        prints=function not in (_run, _view, _render, _check),
    )
    return parser


def _mesh_options(parser: argparse.ArgumentParser) -> None:
    help_ = "allow all commands in a .geo file, also those that run programs and write files"
    parser.add_argument("--trust-geo", action="store_true", help=help_)
    help_ = "seconds after which the meshing of a file is stopped (300)"
    parser.add_argument("--mesh-time", type=float, default=300.0, metavar="SECONDS", help=help_)


def _meshing(options) -> dict:
    """Return the arguments of `load_scene` from the options of `_mesh_options`."""
    return {"trust_geo": options.trust_geo, "mesh_time": options.mesh_time}


def _threads_option(parser: argparse.ArgumentParser) -> None:
    help_ = 'threads that share the loops, or "auto": all or one, whichever is faster (auto)'
    parser.add_argument("--threads", metavar="N", help=help_)


def _changes(options) -> list[str]:
    """Return the values that replace those of the scene, as --set has them."""
    threads = getattr(options, "threads", None)
    return options.set if threads is None else [*options.set, f"solver.threads={threads}"]


def _scene_options(parser: argparse.ArgumentParser) -> None:
    _mesh_options(parser)
    help_ = "replace a value of the scene, as in --set time.dt=0.005; may be repeated"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=help_)
    parser.add_argument(
        "--quiet", action="store_true", help="print warnings, mistakes and failures only"
    )


# --- run ------------------------------------------------------------------------------------------


def _run(options) -> int:
    from fecloth.distributed.environment import count_processes, use_one_thread

    if count_processes() == 1:
        return _run_one(options)
    use_one_thread()
    from fecloth.distributed.launch import run_on_all

    return run_on_all(lambda make_system: _run_one(options, make_system))


def _run_one(options, make_system: Callable[..., System] | None = None) -> int:
    """Run a scene in this process, or with a system whose terms several share."""
    from functools import partial
    from pathlib import Path

    from fecloth.cli.describe import sources
    from fecloth.cli.progress import progress, terminal
    from fecloth.errors import InputError
    from fecloth.runs.outcome import DONE, FAILED, failure_message, finished_message, ledger_text
    from fecloth.runs.run_scene import run_scene
    from fecloth.scene.plan import plan
    from fecloth.scene.scene import load_scene
    from fecloth.system.system import System

    scene = load_scene(options.scene, _changes(options), **_meshing(options))
    if options.resume and (options.output or options.overwrite):
        raise InputError("--resume", "needs neither -o nor --overwrite: it names the folder")
    path = Path(options.resume or options.output or Path("out") / Path(options.scene).stem)
    console = terminal(options.quiet)

    def warn(words: str) -> None:
        loud = terminal(quiet=False) if options.quiet else console
        loud.print(f"warning: {words}", soft_wrap=True)

    def announce(problem: Problem, why: str, warnings: list[str]) -> None:
        lines = [*sources(problem.system.fabric), *plan(problem, why)]
        console.print("\n".join(lines), soft_wrap=True)
        for words in warnings:
            warn(words)

    with progress(console, scene.schedule.t_end, scene.schedule.unit) as report:
        resume = bool(options.resume)
        run_ = scene, path, options.overwrite, announce, report, resume, warn
        closed = partial(set_handler, signal.SIG_IGN)
        outcome = run_scene(*run_, closed=closed, make_system=make_system or System)
    if not options.quiet:
        print(ledger_text(outcome.ledger, outcome.summary["unit"]))
        print(finished_message(outcome))
    if outcome.status == DONE:
        return 0
    print(failure_message(outcome), file=sys.stderr)
    return SIMULATION_FAILED if outcome.status == FAILED else STOPPED


# --- view, render ---------------------------------------------------------------------------------


def _view(options) -> int:
    import webbrowser

    from fecloth.view.web_page import write_view

    file = write_view(options.folder)
    print(f"wrote {file}")
    if not options.no_open:
        webbrowser.open(file.resolve().as_uri())
    return 0


def _render(options) -> int:
    from fecloth.errors import InputError
    from fecloth.view.render import render

    try:
        width, height = map(int, options.size.split("x"))
    except ValueError as error:
        raise InputError(f"--size {options.size}", "must be like 1280x720") from error
    chosen = options.field, (width, height), options.fps, options.time
    file = render(options.folder, options.output, *chosen)
    print(f"wrote {file}{_describe_frame_time(options) if file.suffix == '.png' else ''}")
    return 0


def _describe_frame_time(options) -> str:
    """Return the time of the frame that a picture shows, or its part of the loads, in words."""
    import math

    from fecloth.output.frame_reader import Series
    from fecloth.runs.outcome import place_in_words
    from fecloth.view.web_page import unit_of

    series, time = Series.open(options.folder), options.time
    t, unit = series.times[series.at(time)], unit_of(series.folder)
    exact = time is None or math.isclose(t, time, rel_tol=1e-9, abs_tol=1e-12)
    next_to = "" if exact else f", of the frame next to {time:g}{unit}"
    return f": {place_in_words(t, unit)}{next_to}"


# --- check ----------------------------------------------------------------------------------------


def _check(options) -> int:
    from fecloth.cli.progress import progress, terminal
    from fecloth.scene.scene import load_scene

    console, passed = terminal(options.quiet), True
    for path in options.scenes:
        scene = load_scene(path, _changes(options), **_meshing(options))
        scene.require_expectations()
        with progress(console, scene.schedule.t_end, scene.schedule.unit) as report:
            verdicts = _compare_with_expectations(scene, report)
        for verdict in verdicts:
            if not (options.quiet and verdict.passed):
                print(f"{path}: {verdict}")
            passed &= verdict.passed
    return 0 if passed else MISSED


def _compare_with_expectations(scene: Scene, report: Callable[[StepInfo], None]) -> list[Verdict]:
    from fecloth.runs.run_scene import resolve_scene
    from fecloth.scene.expectations import check
    from fecloth.simulation.run import collect

    problem, solver, why = resolve_scene(scene.build())
    start = problem.system, problem.method, problem.ledger, problem.observer
    result = collect(problem.march(solver), *start, why, report=report)
    for words in result.warnings:
        print(f"warning: {words}", file=sys.stderr)
    unit = scene.schedule.unit
    return check(scene.expect, result.times, result.observed, result.energies, unit)


# --- studies --------------------------------------------------------------------------------------


def _converge(options) -> int:
    from fecloth.cli.studies import run_converge
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_converge(options)


def _compare(options) -> int:
    from fecloth.cli.comparing import run_compare
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_compare(options)


def _sweep(options) -> int:
    from fecloth.cli.studies import run_sweep
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_sweep(options)


def _chart(options) -> int:
    from fecloth.cli.charting import run_chart
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_chart(options)


def _stability(options) -> int:
    from fecloth.cli.stability import run_stability
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_stability(options)


def _simplify(options) -> int:
    from fecloth.cli.studies import run_simplify
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_simplify(options)


def _tune(options) -> int:
    from fecloth.cli.tuning import run_tune
    from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

    return run_tune(options)


# --- modes ----------------------------------------------------------------------------------------


def _modes(options) -> int:
    from fecloth.cli.modes import print_modes
    from fecloth.scene.scene import load_scene

    scene = load_scene(options.scene, options.set, **_meshing(options))
    return print_modes(scene, options.count, options.output, options.quiet)


# --- mesh -----------------------------------------------------------------------------------------


def _mesh(options) -> int:
    from pathlib import Path

    from fecloth.cli.describe import describe_cloth
    from fecloth.errors import InputError
    from fecloth.mesh.cloth import Cloth
    from fecloth.output.frames import write_mesh
    from fecloth.scene.scene import load_scene

    is_scene = Path(options.path).suffix == ".toml"
    if is_scene and options.h:
        raise InputError("--h", "is for mesh files", options.path, "Change cloth.h in the scene.")
    if is_scene:
        cloth = load_scene(options.path, **_meshing(options)).mesh()
    else:
        reading = options.trust_geo, options.mesh_time
        cloth = Cloth.read(options.path, options.h, "P1", *reading)
    print("\n".join(describe_cloth(cloth)))
    if options.output:
        path = Path(options.output)
        write_mesh(path, cloth)
        print(f"wrote {path}")
    return 0


# --- info -----------------------------------------------------------------------------------------


def _info(options) -> int:
    lines = _info_lines(options)
    print("\n".join(lines))
    return 0


def _info_lines(options) -> list[str]:
    """What `info` prints for these options."""
    if options.fabrics:
        from fecloth.cli.fabric_list import list_fabrics

        return list_fabrics()
    if options.schema:
        from fecloth.scene.json_schema import json_schema

        return [json_schema()]
    if options.terms is not None:
        from fecloth.cli.term_help import describe_terms

        return describe_terms(options.terms)
    return _plan(options) if options.scene else _versions()


def _plan(options) -> list[str]:
    """What a scene would do, and what may disappoint."""
    from fecloth import validation
    from fecloth.cli.describe import describe_cloth, sources
    from fecloth.runs.run_scene import resolve_scene
    from fecloth.scene.plan import memory_of_each, plan
    from fecloth.scene.scene import load_scene

    problem, _, why = resolve_scene(
        load_scene(options.scene, options.set, **_meshing(options)).build()
    )
    _, *mesh = describe_cloth(problem.cloth)  # the plan begins with the sizes
    lines = [*plan(problem, why), *mesh, *sources(problem.system.fabric)]
    if options.ranks is not None:
        validation.number("ranks", options.ranks, 0.0, "info")
        each = memory_of_each(problem.system, options.ranks)
        lines.append(f"on {options.ranks} processes (mpiexec): about {each:.0f} MB each")
    return lines + [f"warning: {words}" for words in problem.warnings()]


def _versions() -> list[str]:
    """The versions of the packages, and the machine."""
    import os

    from fecloth.linalg import select
    from fecloth.runs.environment import versions

    lines = [f"{name}: {number}" for name, number in versions().items()]
    return [*lines, f"processors: {os.cpu_count()}", f"direct solver: {select.direct().name}"]
