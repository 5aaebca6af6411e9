"""A study as a command: its options, its mistakes in a line, and the exit statuses of `run`."""

import importlib

from fecloth.errors import FeclothError, InputError

EXTRAS = {  # package: extra of fecloth that installs it
    "distributed": "dask",
    "mujoco": "peers",
    "pyvista": "view",
    "imageio": "view",
}


class StudyFailed(FeclothError):
    """Every case of a study failed."""


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
    if extra:
        remedy = f"In the clone, pip install '.[{extra}]'."
    else:
        remedy = f"Install {name}."
    return InputError(f"the package {name}", "is not installed", "", remedy)
