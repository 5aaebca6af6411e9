"""The table of commands: every study has a row, every row a function, options and help."""

import inspect
import re

import pytest
from support.pages import read

import fecloth as fc
from fecloth.cli.commands import COMMANDS
from fecloth.cli.main import STATUS, main
from fecloth.cli.studies import SHARED
from fecloth.study.opened import Opened
from fecloth.study.result import StudyResult

STUDIES = [name for name, command in COMMANDS.items() if command.is_study]


def help_of(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main([*words, "--help"])
    assert stop.value.code == 0
    return capsys.readouterr().out


def methods_of_the_front():
    """The studies that are methods of what `fc.study.of` returns."""
    own = vars(fc.study.Study)
    return {name for name in own if callable(own[name]) and not name.startswith("_")}


def test_every_study_has_a_row_and_a_method():
    assert set(STUDIES) == methods_of_the_front() - {"modes"}
    assert "modes" in COMMANDS
    public = [*vars(fc.study), *fc.study.__all__]
    for name in STUDIES:
        function = COMMANDS[name].load()
        assert function is getattr(fc if name == "tune" else fc.study, name)
        assert name == "tune" or name in public
        assert inspect.signature(function).return_annotation in {
            kind.__name__ for kind in StudyResult.__subclasses__()
        }


@pytest.mark.parametrize("name", COMMANDS)
def test_every_row_has_its_function(name):
    assert callable(COMMANDS[name].load())


@pytest.mark.parametrize("name", STUDIES)
def test_own_options_are_arguments_of_the_study(name):
    """So a row needs no code of its own, and every default of the command is given."""
    own = {one.key for one in COMMANDS[name].options} - SHARED
    parameters = inspect.signature(COMMANDS[name].load()).parameters
    assert own <= parameters.keys()
    required = {
        key for key, one in parameters.items() if one.default is one.empty and key != "shared"
    }
    assert required <= own | {"problem"}


def test_shared_options_are_arguments_of_the_front():
    front = inspect.signature(Opened.of).parameters
    same = {"jobs", "scheduler", "time_limit", "fresh"}
    assert same <= SHARED & front.keys()
    assert SHARED - same == {"scene", "set", "output", "yes", "trust_geo"}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_has_its_words_and_options(name, capsys):
    command, text = COMMANDS[name], help_of(capsys, name)
    assert text.startswith(f"usage: fecloth {name} [-h]")
    assert command.words in " ".join(text.split())
    assert text.endswith(STATUS)
    shown = " ".join(text.split())
    for one in command.options:
        assert one.names[-1] in text
        words = (one.keywords["help"] or "").replace("%%", "%").partition("%(")[0]
        assert " ".join(words.split()) in shown
        for each in one.names:
            assert re.search(rf"(^|[\s\[]){re.escape(each)}\b", text), each


def test_the_help_has_all_commands(capsys):
    text = help_of(capsys)
    listed = re.findall(r"^    (\w+)(?: {2,}\S|$)", text, re.MULTILINE)
    assert listed == list(COMMANDS)
    assert text.endswith(STATUS)


@pytest.mark.parametrize(("name", "seconds"), [("chart", 60), ("stability", 120), ("tune", 600)])
def test_the_help_says_the_longest_time_of_a_case(name, seconds, capsys):
    assert f"longest time of a case ({seconds} s)" in help_of(capsys, name)


def test_the_page_names_every_study():
    """Its table says which question each answers."""
    text = read("fecloth/README.md")
    for name in (*STUDIES, "modes"):
        assert re.search(rf"^\|.*\| `study\.{name}\(.*\| `fecloth {name}\b", text, re.MULTILINE)
