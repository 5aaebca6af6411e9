"""Command line that all studies share."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def parse_arguments(
    description: str, argv: list[str] | None = None, **more: dict
) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --scene, --fresh.

    Parameters
    ----------
    description
        The study's docstring; --help shows its first line.
    more
        Further options of the study: name, and keywords of `add_argument`.

    Examples
    --------
    >>> tolerance = {"type": float, "default": 0.01}
    >>> options = parse_arguments("A study.", ["--quick"], tolerance=tolerance)
    >>> options.quick, options.jobs, options.tolerance
    (True, 1, 0.01)
    """
    script = Path(sys.argv[0])
    name = script.parent.name if script.stem == "__main__" else script.stem
    parser = argparse.ArgumentParser(description=description.strip().splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, default=Path("out") / name, metavar="DIR", help="folder of the results")
    add("--quick", action="store_true", help="few and small cases, under a minute")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the cases")
    add("--scene", type=Path, metavar="TOML", help="your own scene")
    add("--fresh", action="store_true", help="run every case again")
    for option, keywords in more.items():
        add(f"--{option.replace('_', '-')}", **keywords)
    options = parser.parse_args(argv)
    if options.jobs < 1:
        parser.error(f"--jobs {options.jobs}: must be at least 1")
    return options


def run_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options that `run_cases` takes."""
    return {name: getattr(options, name) for name in ("out", "jobs", "scheduler", "fresh")}
