"""The commands `fecloth converge`, `fecloth sweep` and `fecloth simplify`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth converge`."""
    add = parser.add_argument
    add("scene", help="a .toml file")
    text = 'what is judged, as "max tip.z" (default: the first of [interest])'
    add("--quantity", metavar="Q", help=text)
    add("--refine", choices=("h", "dt", "both"), default="h", help="what is refined (h)")
    add("--levels", type=int, default=4, metavar="N", help="from 3 to 10 (4)")
    add("--ratio", type=float, metavar="R", help="h or dt of a level over the next (2 or √2)")
    add("--grade", action="store_true", help="grade meshes at corners and pins by the space error")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")
    add_study_options(parser, "converge")


def add_study_options(
    parser: argparse.ArgumentParser, command: str, longest: float = 600.0
) -> None:
    """Add the options that all studies of a scene share; `longest` is that of a case [s]."""
    add = parser.add_argument
    add("-o", "--output", metavar="DIR", help=f"folder of the report (out/{command}/SCENE)")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each (1)")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the cases")
    limit = "longest time of a case (%(default)g s)"
    add("--time-limit", type=float, default=longest, metavar="S", help=limit)
    add("--yes", action="store_true", help="run it however long it may take")
    add("--fresh", action="store_true", help="run every case again")
    add("--trust-geo", action="store_true", help="allow all commands in a .geo file")


def run_converge(options) -> int:
    """Refine the scene, print the verdict and the table, write the report."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.converging import converge

    scene = load_scene(options.scene, options.set, trust_geo=options.trust_geo)
    folder, cache = folders(options, "converge")
    found = converge(
        scene,
        options.quantity,
        options.refine,
        options.levels,
        ratio=options.ratio,
        grade=options.grade,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.table), ""]))
    print(f"wrote {found.report(folder)}")
    failed = any(row.get("status") for row in found.table)
    return 3 if failed else 0


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add a scene, its changes, and the quantities that a study judges."""
    add = parser.add_argument
    add("scene", help="a .toml file")
    text = 'as "max tip.z"; may be repeated (default: all of [interest])'
    add("--quantity", action="append", metavar="Q", help=text)
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")


def add_tolerance(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the largest `what` of a quantity."""
    text = f"largest {what} of each quantity, as 1%% or 0.01 (1%%)"
    parser.add_argument("--tolerance", default="1%", metavar="T", help=text)


def add_sweep_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth sweep`."""
    add_scene_options(parser)
    values = "values of a key: KEY=a:b:log:n, KEY=a:b:lin:n or KEY=v1,v2; may be repeated"
    parser.add_argument("--over", action="append", required=True, metavar="KEY=VALUES", help=values)
    add_study_options(parser, "sweep")


def run_sweep(options) -> int:
    """Run the scene for all values, print the table, write the report."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.sweeps import sweep

    folder, cache = folders(options, "sweep")
    found = sweep(
        load_scene(options.scene, options.set, trust_geo=options.trust_geo),
        options.over,
        options.quantity,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, "", str(found.table), ""]))
    print(f"wrote {found.report(folder)}")
    return 3 if any(row["status"] != "ok" for row in found.table) else 0


def add_simplify_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth simplify`."""
    add_scene_options(parser)
    add_tolerance(parser, "change")
    add_study_options(parser, "simplify")


def run_simplify(options) -> int:
    """Find what the scene does not need, print it, write the report and reduced.toml."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.simplification.simplify import simplify

    folder, cache = folders(options, "simplify")
    found = simplify(
        load_scene(options.scene, options.set, trust_geo=options.trust_geo),
        options.tolerance,
        options.quantity,
        folder=folder,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.table), ""]))
    print(f"wrote {found.report(folder)} and {found.scene}")
    return 0


def folders(options, command: str) -> tuple[Path, Path]:
    """Return the folder of the report, and that under which finished cases are stored.

    Without -o all commands share one store, so that none runs what another has run.
    """
    if options.output:
        return Path(options.output), Path(options.output)
    return Path("out") / command / Path(options.scene).stem, Path("out")


def how_to_run(options, cache: Path) -> dict:
    """Return the arguments of a study that say how its cases are run."""
    from fecloth.errors import InputError
    from fecloth.study.workload import LONGEST

    if not options.time_limit > 0:
        raise InputError(f"--time-limit {options.time_limit:g}", "must be > 0 [s]")
    return {
        "cache": cache,
        "jobs": options.jobs,
        "scheduler": options.scheduler,
        "time_limit": options.time_limit,
        "most_seconds": None if options.yes else LONGEST,
        "fresh": options.fresh,
    }


def read_names(text: str) -> list[str]:
    """Return the names of a text with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]
