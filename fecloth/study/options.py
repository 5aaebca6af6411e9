"""The command line that all studies share."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def arguments(description: str, argv: list[str] | None = None, **more: dict) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --scene, --fresh.

    Parameters
    ----------
    description
        The study's docstring; its first line is shown.
    more
        Further options of the study, name to keywords of `add_argument`.

    Examples
    --------
    >>> options = arguments("A study.", ["--quick"], tolerance={"type": float, "default": 0.01})
    >>> options.quick, options.jobs, options.tolerance
    (True, 1, 0.01)
    """
    script = Path(sys.argv[0])
    name = script.parent.name if script.stem == "__main__" else script.stem
    parser = argparse.ArgumentParser(description=description.strip().splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, default=Path("out") / name, metavar="DIR", help="results go here")
    add("--quick", action="store_true", help="few and small cases, under a minute")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each")
    add("--scheduler", metavar="ADDRESS", help="of a Dask cluster that runs the cases")
    add("--scene", type=Path, metavar="TOML", help="a scene of your own")
    add("--fresh", action="store_true", help="run every case again")
    for option, keywords in more.items():
        add(f"--{option.replace('_', '-')}", **keywords)
    options = parser.parse_args(argv)
    if options.jobs < 1:
        parser.error(f"--jobs {options.jobs}: must be at least 1")
    return options


def running(options: argparse.Namespace) -> dict[str, object]:
    """Those of the options that `run_cases` takes."""
    return {name: getattr(options, name) for name in ("out", "jobs", "scheduler", "fresh")}
