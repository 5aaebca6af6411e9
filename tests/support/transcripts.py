"""Commands with what they answer and their exit status, as `tests/messages/*.txt` have them.

A block is a command, its answer and its status; an empty line ends it. Nothing but this command
writes the answers anew; read their difference before you commit it:

    python tests/support/transcripts.py
"""

import contextlib
import io
import os
import shlex
import shutil
import tempfile
from pathlib import Path

from fecloth.cli.main import main

FOLDER = Path(__file__).parents[1] / "messages"


def blocks(name: str) -> list[tuple[str, str]]:
    """Each command of a transcript, and its answer with the exit status."""
    text = (FOLDER / name).read_text(encoding="utf-8")
    return [tuple(block.split("\n", 1)) for block in text.strip().split("\n\n")]


def answer(command: str) -> str:
    """What a command says on both streams, and its exit status; called in the folder of a scene."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = main(shlex.split(command)[2:])  # without "$ fecloth"
    words = said.getvalue().replace(os.getcwd(), "FOLDER")
    return f"{words}exit {status}"


def write(name: str) -> None:
    """Write all answers of a transcript anew."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        shutil.copy(FOLDER / "scene.toml", "scene.toml")
        made = [f"{command}\n{answer(command)}\n" for command, _ in blocks(name)]
    (FOLDER / name).write_text("\n".join(made), encoding="utf-8")


if __name__ == "__main__":
    for path in sorted(FOLDER.glob("*.txt")):
        write(path.name)
