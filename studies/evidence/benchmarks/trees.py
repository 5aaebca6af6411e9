"""The fecloth of another commit or folder, and processes that run programs with it."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import fecloth
from fecloth.errors import InputError

OWN = Path(fecloth.__file__).resolve().parents[1]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


def git(*arguments: str) -> bytes:
    """Return the output of a git command in this tree; empty if it fails."""
    command = ["git", "-C", str(OWN), *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return done.stdout if done.returncode == 0 else b""


def tree_of(text: str) -> Path:
    """Return a folder that holds `fecloth/`: the text is its path, or a commit of this repository.

    The files of a commit are kept under ``out/trees`` for the next call.

    Raises
    ------
    InputError
        If the text is neither.
    """
    if (Path(text) / "fecloth" / "__init__.py").is_file():
        return Path(text).resolve()
    commit = git("rev-parse", "--verify", "--quiet", f"{text}^{{commit}}").decode().strip()
    if not commit:
        allowed = "must be a commit, or a folder that holds fecloth/"
        raise InputError(f"--against {text}", allowed, "benchmarks", "See: git log --oneline")
    folder = OWN / "out" / "trees" / commit[:12]
    if not folder.exists():
        files = io.BytesIO(git("archive", commit))
        with tarfile.open(fileobj=files) as archive:
            archive.extractall(folder, filter="data")
    return folder


class Child:
    """A process that runs a program with the fecloth of a folder, on one thread.

    The program imports it as ``fc``, prints ``fc.__file__``, and then answers each line of its
    input with a line. All lines but the first are JSON.

    Raises
    ------
    InputError
        If the program uses the fecloth of another folder.
    """

    def __init__(self, tree: Path, program: str):
        environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)}
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        command = [sys.executable, "-c", program]
        self.process = subprocess.Popen(command, cwd=tree, env=environment, **pipes)
        file = self.process.stdout.readline().strip()
        if not file or not Path(file).is_relative_to(tree):
            self.process.kill()
            allowed = "must be a folder with a fecloth that can be imported"
            raise InputError(f"tree {tree}", allowed, "benchmarks")

    def ask(self, question: object) -> Any:
        """Return the answer to a question.

        Raises
        ------
        InputError
            If the program has ended.
        """
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise InputError(f"{question}", "ended the process of the other tree", "benchmarks")
        return json.loads(answer)

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.stdin.close()
        self.process.wait()
