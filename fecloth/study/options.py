"""Command line that all studies share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.scene.scene import load_scene
from fecloth.study.command import Parser, require_packages
from fecloth.study.reports import scene_of_report

TIME_LIMIT = 600.0  # s, of a case of the user's scene


def parse_arguments(
    description: str, argv: list[str] | None = None, needs: Sequence[str] = (), **more: dict
) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --scene, --time-limit, --yes, --fresh.

    The results go to out/STUDY, and with --scene to out/STUDY/SCENE.

    Parameters
    ----------
    description
        The study's docstring; --help shows its first line.
    needs
        Packages without which the study cannot end, such as "matplotlib".
    more
        Further options of the study: name, and keywords of `add_argument`.

    Raises
    ------
    InputError
        For an invalid option, a scene with a mistake, a package that is not installed, or a folder
        with the report of another scene.

    Examples
    --------
    >>> tolerance = {"type": float, "default": 0.01}
    >>> options = parse_arguments("A study.", ["--quick"], tolerance=tolerance)
    >>> options.quick, options.jobs, options.tolerance
    (True, 1, 0.01)
    """
    options = _make_parser(description, more).parse_args(argv)
    if options.jobs < 1:
        raise InputError(f"--jobs {options.jobs}", "must be at least 1")
    if not options.time_limit > 0:
        raise InputError(f"--time-limit {options.time_limit:g}", "must be > 0 [s]")
    if options.scene:
        load_scene(options.scene)
    options.out = options.out or _default_folder(options.scene)
    _check_folder(options)
    require_packages(*needs, *(["distributed"] if options.scheduler else []))
    return options


def _make_parser(description: str, more: dict[str, dict]) -> Parser:
    parser = Parser(description=description.strip().splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="folder of the results (out/STUDY[/SCENE])")
    add("--quick", action="store_true", help="few and small cases, below a minute of CPU time")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the cases")
    add("--scene", type=Path, metavar="TOML", help="your own scene")
    limit = "longest time of a case of your scene (%(default)g s)"
    add("--time-limit", type=float, default=TIME_LIMIT, metavar="S", help=limit)
    add("--yes", action="store_true", help="run your scene however long it may take")
    add("--fresh", action="store_true", help="run every case again")
    for option, keywords in more.items():
        add(f"--{option.replace('_', '-')}", **keywords)
    return parser


def _default_folder(scene: Path | None) -> Path:
    """Return out/STUDY, and for a user's scene a folder of its own in it."""
    script = Path(sys.argv[0])
    folder = Path("out") / (script.parent.name if script.stem == "__main__" else script.stem)
    return folder / scene.stem if scene else folder


def _check_folder(options: argparse.Namespace) -> None:
    """Raise `InputError` if the folder has the report of another scene, or of no scene."""
    report = options.out / "report.md"
    if not report.exists():
        return
    other, own = scene_of_report(report), str(options.scene)
    if Path(other).resolve() != Path(own).resolve():
        what = f"{report} is the report of {'no scene' if other == 'None' else other}"
        raise InputError(what, "would be overwritten", "", "Name another folder with --out.")


def run_options(options: argparse.Namespace, alone: bool = False) -> dict[str, Any]:
    """Return the options that `run_cases` takes.

    With `alone` the cases run one after another in this process, whatever --jobs and --scheduler
    are, so that their seconds can be compared.
    """
    chosen = {name: getattr(options, name) for name in ("out", "jobs", "scheduler", "fresh")}
    return chosen | {"jobs": 1, "scheduler": None} if alone else chosen
