"""A study as a command: its options, its mistakes in a line, and the exit statuses of `run`."""

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from fecloth.errors import STOPPED, FeclothError, InputError
from fecloth.output.atomic_files import ending_of

EXTRAS = {  # package: extra of fecloth that installs it
    "matplotlib": "studies",
    "distributed": "dask",
    "mujoco": "peers",
    "pyvista": "view",
    "imageio": "view",
}


class StudyFailed(FeclothError):
    """Every case of a study failed."""


class Parser(argparse.ArgumentParser):
    """A parser of options that raises `InputError` for an invalid one."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="--help lists the options.")


def run_main(main: Callable[[], int | None]) -> NoReturn:
    """Call the main function of a study and exit: one line for a mistake instead of a traceback.

    The exit status is 0 if all is as expected, 1 if a finding lies outside its range, 2 for a
    mistake in the input, 3 if a case failed or the disk is full, 4 after Ctrl-C.
    """
    sys.exit(exit_status(main))


def exit_status(main: Callable[[], int | None]) -> int:
    """Call `main`; print its mistake or failure as one line and return the exit status."""
    try:
        return main() or 0
    except (FeclothError, OSError, MemoryError) as error:
        status, line = ending_of(error)
        print(line, file=sys.stderr)
        return status
    except KeyboardInterrupt:
        print("interrupted; run it again to go on: finished cases are stored", file=sys.stderr)
        return STOPPED


def require_packages(*names: str) -> None:
    """Raise `InputError` if a package that a study needs later is not installed."""
    for name in names:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise missing_package(name) from error


def missing_package(name: str) -> InputError:
    """Return the error that says how to install a package."""
    extra = EXTRAS.get(name)
    remedy = f"In the clone, pip install '.[{extra}]'." if extra else f"Install {name}."
    return InputError(f"the package {name}", "is not installed", "", remedy)


def parse_arguments(
    description: str, argv: list[str] | None = None, needs: Sequence[str] = (), **more: dict
) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --fresh.

    Raises `InputError` for an invalid option, or a package that is not installed.

    Parameters
    ----------
    description
        The study's docstring; --help shows its first line.
    needs
        Packages without which the study cannot end, such as "matplotlib".
    more
        Further options of the study: name, and keywords of `add_argument`.
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
