"""Options of a study, and each mistake in them as one line."""

import errno
import sys

import pytest

from fecloth.errors import FeclothError, InputError
from fecloth.output.atomic_files import DiskFull
from studies import harness
from studies.harness import exit_status


def parse(*arguments):
    return harness.parse_arguments("A study.", [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--jobs", "0"], "--jobs 0: must be at least 1"),
        (["--jobs", "two"], "invalid int value"),
        (["--nonsense"], "unrecognized arguments: --nonsense"),
        (["--scheduler", "tcp://localhost:1"], r"distributed: is not installed.*\.\[dask\]"),
    ],
)
def test_a_mistake_is_one_line_and_exit_status_2(capsys, monkeypatch, arguments, words):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert exit_status(lambda: parse(*arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    with pytest.raises(InputError, match=words):
        parse(*arguments)


def test_a_missing_package_is_noticed_with_the_options(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(InputError, match=r"pyvista: is not installed.*\.\[view\]"):
        harness.parse_arguments("A study.", [], needs=["pyvista"])


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (None, 0, ""),
        (InputError("h = 0", "must be > 0"), 2, "error: h = 0: must be > 0"),
        (FeclothError("the iteration stopped"), 3, "failed: the iteration stopped"),
        (DiskFull("out/report.md", "no space"), 3, "failed: out/report.md"),
        (KeyboardInterrupt(), 4, "interrupted"),
        (PermissionError(13, "not allowed"), 2, "error: [Errno 13] not allowed"),
        (OSError(errno.ENOSPC, "no space"), 3, "failed: [Errno 28] no space. Free space"),
        (MemoryError(), 3, "failed: memory is full"),
    ],
)
def test_exit_statuses_are_those_of_the_command_line(capsys, error, status, words):
    def main():
        if error:
            raise error

    assert exit_status(main) == status
    assert capsys.readouterr().err.startswith(words)


def test_the_results_go_to_the_folder_of_the_study(monkeypatch):
    for script in ("studies/mine/__main__.py", "mine.py"):
        monkeypatch.setattr(sys, "argv", [script])
        assert parse().out.as_posix() == "out/mine"
    assert parse("--out", "here").out.as_posix() == "here"
