"""Command line that all studies share."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.study.command import Parser, require_packages


def parse_arguments(
    description: str, argv: list[str] | None = None, needs: Sequence[str] = (), **more: dict
) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --fresh.

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
        For an invalid option, or a package that is not installed.

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
    options.out = options.out or _default_folder()
    require_packages(*needs, *(["distributed"] if options.scheduler else []))
    return options


def _make_parser(description: str, more: dict[str, dict]) -> Parser:
    parser = Parser(description=description.strip().splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="folder of the results (out/STUDY)")
    add("--quick", action="store_true", help="few and small cases, below a minute of CPU time")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the cases")
    add("--fresh", action="store_true", help="run every case again")
    for option, keywords in more.items():
        add(f"--{option.replace('_', '-')}", **keywords)
    return parser


def _default_folder() -> Path:
    """Return out/STUDY."""
    script = Path(sys.argv[0])
    return Path("out") / (script.parent.name if script.stem == "__main__" else script.stem)


def run_options(options: argparse.Namespace, alone: bool = False) -> dict[str, Any]:
    """Return the options that `run_cases` takes.

    With `alone` the cases run one after another in this process, whatever --jobs and --scheduler
    are, so that their seconds can be compared.
    """
    chosen = {name: getattr(options, name) for name in ("out", "jobs", "scheduler", "fresh")}
    return chosen | {"jobs": 1, "scheduler": None} if alone else chosen
