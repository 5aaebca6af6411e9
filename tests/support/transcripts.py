"""What is answered to wrong commands, calls and set-ups, as `tests/messages/*.txt` have it.

A block is a command, its answer and its status, or a call and its error or the sentences that it
returns; an empty line ends it.
Nothing but this command writes the answers anew; read their difference before you commit it:

    python tests/support/transcripts.py
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import sys
import tempfile
import warnings
from importlib import import_module
from pathlib import Path

import fecloth as fc
from fecloth.cli.main import main

FOLDER = Path(__file__).parents[1] / "messages"
NAMES = {"set_ups.txt": "support.set_ups"}
"""The modules with what the calls of a text may name; else `wrong_calls`."""


def blocks(name: str) -> list[tuple[str, str]]:
    """Each command or call of a text, and what it answers."""
    text = (FOLDER / name).read_text(encoding="utf-8")
    return [tuple(block.split("\n", 1)) for block in text.strip().split("\n\n")]


def answer(asked: str, text: str) -> str:
    """What is answered to the command or call of a text, or the words of a call's error.

    Of a command: what it says on both streams and its exit status. It is given in a folder with the
    scenes of `FOLDER`.
    """
    if asked.startswith(">>> "):
        try:
            return "\n".join(called(asked, text)) or "no warning"
        except fc.InputError as error:
            return words(error)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = main(shlex.split(asked)[2:])  # without "$ fecloth"
    return f"{said.getvalue().replace(os.getcwd(), 'FOLDER')}exit {status}"


def called(call: str, text: str) -> list[str]:
    """What a call ``>>> …`` of a text returns."""
    return eval(
        call.removeprefix(">>> "), vars(import_module(NAMES.get(text, "support.wrong_calls")))
    )


def refusal(call: str) -> fc.InputError:
    """The error that a call ``>>> …`` raises."""
    try:
        called(call, "calls.txt")
    except fc.InputError as error:
        return error
    raise AssertionError(f"{call} is not refused")


def words(error: fc.InputError) -> str:
    """The message of an error, without addresses in memory and the places of files."""
    text = re.sub("0x[0-9a-f]+", "0x…", str(error)).replace(str(FOLDER.parents[1]), "ROOT")
    text = text.replace(os.getcwd(), "FOLDER")
    return re.sub(rf"{tempfile.gettempdir()}/\w+", "FOLDER", text)


def copy_scenes() -> list[Path]:
    """Copy the scenes that commands name into the working directory."""
    return [Path(shutil.copy(scene, scene.name)) for scene in sorted(FOLDER.glob("*.toml"))]


def write(path: Path) -> None:
    """Write all answers of a text anew."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        copy_scenes()
        made = [f"{asked}\n{answer(asked, path.name)}\n" for asked, _ in blocks(path.name)]
    path.write_text("\n".join(made), encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER.parent))
    warnings.simplefilter("ignore")  # of the wrong values themselves
    for path in sorted(FOLDER.glob("*.txt")):
        write(path)
