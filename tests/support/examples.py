"""The files of studies/examples: what each defines, and what it prints."""

import contextlib
import functools
import io
from pathlib import Path
from types import SimpleNamespace

FOLDER = Path(__file__).parents[2] / "studies" / "examples"
FILES = sorted(FOLDER.glob("[!_]*.py"))


@functools.cache
def example(name):
    """What a file defines, as attributes, and the text `printed`."""
    path, printed = FOLDER / f"{name}.py", io.StringIO()
    names = {"__name__": "__main__"}
    with contextlib.redirect_stdout(printed):
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), names)
    return SimpleNamespace(**names, printed=printed.getvalue())
