"""Messages of wrong arguments and set-ups: what is answered to calls and commands, word by word."""

from pathlib import Path

import pytest
from support import transcripts


@pytest.mark.parametrize(("call", "expected"), transcripts.blocks("calls.txt"))
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of the wrong values themselves
def test_wrong_arguments_are_answered_as_written(call, expected, tmp_path, monkeypatch):
    """A message says what is wrong, its place, and what is allowed or how to mend it."""
    monkeypatch.chdir(tmp_path)
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
    assert transcripts.answer(command, "mistakes.txt") == expected
    assert sorted(Path().rglob("*")) == scenes


@pytest.mark.parametrize(("call", "expected"), transcripts.blocks("files.txt"))
def test_a_file_of_a_mesh_is_read_or_refused_as_written(call, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert transcripts.answer(call, "files.txt") == expected


@pytest.mark.parametrize(("call", "expected"), transcripts.blocks("set_ups.txt"))
def test_a_set_up_that_cannot_be_meant_is_warned_of_and_its_remedy_ends_the_warning(call, expected):
    """Below a wrong set-up is the right one; those without a warning have a reason for none."""
    assert transcripts.answer(call, "set_ups.txt") == expected
