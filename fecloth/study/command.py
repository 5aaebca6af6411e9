"""Run a study as a command: one line for a mistake, and the exit statuses of `fecloth run`."""

import argparse
import importlib
import sys
from collections.abc import Callable
from typing import NoReturn

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
    """Raise `InputError` if a package that a study needs later is not installed.

    Examples
    --------
    >>> require_packages("numpy")
    """
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
