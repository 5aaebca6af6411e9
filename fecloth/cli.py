"""The command line: fecloth run | check | mesh | info."""

from __future__ import annotations

import argparse
import sys
import time

from rich.console import Console
from rich.progress import Progress

from . import linear
from .cloth import Cloth
from .errors import FeclothError, InputError, StepFailed
from .march import march, run, solver_for
from .output import Frames
from .record import Ledger, Observer
from .runfolder import RunFolder, peak_memory, versions
from .scene import check, load

DONE, BAD_INPUT, FAILED, INTERRUPTED = 0, 2, 3, 4


def main(arguments: list[str] | None = None) -> int:
    """Run a command; the exit status is 0 done, 2 bad input, 3 failed, 4 interrupted."""
    options = _parser().parse_args(arguments)
    console = Console(stderr=True, quiet=getattr(options, "quiet", False))
    try:
        return options.command(options, console)
    except StepFailed as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return FAILED
    except InputError as mistake:
        print(f"error: {mistake}", file=sys.stderr)
        return BAD_INPUT
    except FeclothError as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _parser():
    parser = argparse.ArgumentParser(prog="fecloth", description="A continuum cloth solver.")
    commands = parser.add_subparsers(required=True)
    for name, command in (("run", _run), ("check", _check)):
        sub = commands.add_parser(name)
        sub.set_defaults(command=command)
        sub.add_argument("scene")
        sub.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
        sub.add_argument("--quiet", action="store_true")
        if name == "run":
            sub.add_argument("-o", "--output", default="out", metavar="DIR")
            sub.add_argument("--overwrite", action="store_true")
    sub = commands.add_parser("mesh")
    sub.set_defaults(command=_mesh)
    sub.add_argument("path")
    sub.add_argument("--h", type=float)
    commands.add_parser("info").set_defaults(command=_info)
    return parser


def _run(options, console) -> int:
    begin = time.perf_counter()
    scene = load(options.scene, options.set)
    built = scene.build()
    folder = RunFolder.create(options.output, options.overwrite)
    folder.text("scene.resolved.toml", scene.to_toml())
    system, state = built.system, built.state
    solver, why = solver_for(system, built.method, built.dt, built.linear, built.newton)
    console.print(f"{len(system.cloth.triangles)} triangles, solver {why}")
    frames = Frames(folder.path / "run", system.cloth, system)
    ledger, observer = Ledger.open(system, state), Observer.bind(system, state, built.probes)
    tables = {name: folder.table(f"{name}.csv") for name in ("steps", "energies", "observed")}
    seconds = {"build": time.perf_counter() - begin, "output": 0.0}
    summary = {"solver": why, "triangles": len(system.cloth.triangles), "steps": 0}
    summary |= {"nodes": len(system.cloth.X), "newton": 0, "linear": 0, "status": "done"}
    tables["energies"].add(ledger.row())
    tables["observed"].add(observer.row(None, None))
    frames.add(state)
    status, error = DONE, None
    try:
        with Progress(console=console) as progress:
            bar = progress.add_task("t = 0 s", total=built.t_end)
            steps = march(system, built.method, state, built.dt, built.t_end, solver=solver)
            for state, info in steps:
                seconds.setdefault("to_first_step", time.perf_counter() - begin)
                ledger = ledger.after(system, built.method, info.old, info.result)
                counts = info.counts
                summary["steps"] = info.step
                summary["newton"] += counts.newton
                summary["linear"] += counts.linear
                for key, value in counts.seconds.items():
                    seconds[key] = seconds.get(key, 0.0) + value
                row = {"step": info.step, "t": info.t, "dt": info.dt, "newton": counts.newton}
                row |= {"linear": counts.linear, "residual": counts.residual}
                tables["steps"].add(row)
                tables["energies"].add(ledger.row())
                tables["observed"].add(observer.row(info.old, info.result))
                if info.step % built.frame_steps == 0 or info.t >= built.t_end:
                    start = time.perf_counter()
                    frames.add(state)
                    seconds["output"] += time.perf_counter() - start
                text = f"t = {info.t:.4g} s, step {info.step}, Newton {counts.newton}"
                progress.update(bar, completed=info.t, description=text)
    except StepFailed as failure:
        status, error, summary["status"] = FAILED, failure, "failed"
        if failure.state.t > frames.times[-1]:
            frames.add(failure.state)
    except KeyboardInterrupt:
        status, summary["status"] = INTERRUPTED, "interrupted"
        if state.t > frames.times[-1]:
            frames.add(state)
        print(f"interrupted; {folder.path} is readable up to t = {state.t:g} s", file=sys.stderr)
    seconds["total"] = time.perf_counter() - begin
    summary |= {"seconds": seconds, "peak_memory_MB": peak_memory(), "versions": versions()}
    folder.summary(summary)
    if error is not None:
        print(f"failed: {error}", file=sys.stderr)
    console.print(f"wrote {folder.path}/run.pvd")
    return status


def _check(options, console) -> int:
    scene = load(options.scene, options.set)
    built = scene.build()
    arguments = {"probes": built.probes, "solver": built.linear, "newton": built.newton}
    result = run(built.system, built.method, built.state, built.dt, built.t_end, **arguments)
    verdicts = check(scene, result.times, result.observed, result.energies)
    for verdict in verdicts:
        print(verdict)
    return DONE if all(verdict.passed for verdict in verdicts) else 1


def _mesh(options, console) -> int:
    cloth = Cloth.read(options.path, options.h)
    print(f"{len(cloth.X)} nodes, {len(cloth.triangles)} triangles, area {cloth.area:.6g} m²")
    print(f"quality {cloth.quality.min():.3f} to {cloth.quality.max():.3f}")
    for name, nodes in sorted(cloth.node_sets.items()):
        print(f"  {name}: {len(nodes)} nodes")
    return DONE


def _info(options, console) -> int:
    for name, version in versions().items():
        print(f"{name}: {version}")
    print(f"direct solver: {linear.direct().name}")
    return DONE
