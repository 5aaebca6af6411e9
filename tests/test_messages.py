"""Messages of wrong arguments: calls and commands, and what they answer, word by word."""

from pathlib import Path

import pytest
from support import transcripts


@pytest.mark.parametrize(("call", "expected"), transcripts.blocks("calls.txt"))
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of the wrong values themselves
def test_wrong_arguments_are_answered_as_written(call, expected):
    """A message says what is wrong, its place, and what is allowed or how to mend it."""
    refused = transcripts.refusal(call)
    assert transcripts.words(refused) == expected
    for error in (refused, *refused.also):
        assert error.what
        assert error.allowed or error.remedy or not error.where


@pytest.mark.parametrize(("command", "expected"), transcripts.blocks("mistakes.txt"))
def test_mistakes_are_answered_as_written_and_leave_no_files(
    command, expected, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    scenes = transcripts.copy_scenes()
    assert transcripts.answer(command) == expected
    assert sorted(Path().rglob("*")) == scenes
