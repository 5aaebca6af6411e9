"""The table of commands: every study has a row, every row a function, options and help."""

import inspect
import re
from pathlib import Path

import pytest
from support.pages import read

import fecloth as fc
from fecloth.cli.commands import COMMANDS
from fecloth.cli.main import STATUS, main
from fecloth.cli.studies import SHARED
from fecloth.output.atomic_files import DiskFull, ending_of
from fecloth.study.opened import Opened
from fecloth.study.result import StudyResult, Table

STUDIES = [  # of a problem; a fit is of several
    name for name, command in COMMANDS.items() if command.is_study and name != "fit"
]


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
            *StudyResult.__subclasses__(),
            *(kind.__name__ for kind in StudyResult.__subclasses__()),  # of a postponed annotation
        }


@pytest.mark.parametrize("name", COMMANDS)
def test_every_row_has_its_function(name):
    assert callable(COMMANDS[name].load())


@pytest.mark.parametrize("name", STUDIES)
def test_own_options_are_arguments_of_the_study(name):
    """So a row needs no code of its own, and every default of the command is given."""
    own = {option.key for option in COMMANDS[name].options} - SHARED
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


GOOD, BAD = {"status": "ok"}, {"status": "failed", "cause": "it stopped"}
LATE = {"status": "time limit", "cause": "60 s"}
RESULTS = [  # the class of a result, its rows, more of it, and the exit status of its command
    (fc.study.Convergence, [{"value": 1.0}], {}, 0),
    (fc.study.Convergence, [{"value": 1.0}, BAD], {}, 3),
    (fc.study.Sweep, [GOOD], {}, 0),
    (fc.study.Sweep, [GOOD, BAD], {}, 3),
    (fc.study.Comparison, [GOOD, BAD], {}, 3),
    (fc.study.Chart, [GOOD | {"on front": True, "seconds": 1.0}, BAD], {}, 0),
    (fc.study.Chart, [GOOD | {"on front": False}], {}, 3),
    (fc.study.StabilityMap, [{"longest step": "< 1 ms"}], {"cells": Table((BAD,))}, 0),
    (fc.study.StabilityMap, [{}], {"cells": Table((LATE,))}, 3),
    (fc.study.Simplification, [GOOD, BAD], {}, 0),
    (fc.Tuned, [GOOD, BAD], {"proved": True}, 0),
    (fc.Tuned, [GOOD], {"proved": False}, 1),
]


@pytest.mark.parametrize(("kind", "rows", "more", "status"), RESULTS)
def test_a_result_has_the_exit_status_of_its_command(kind, rows, more, status):
    result = kind("strip", "a verdict", Table(tuple(rows)), **more)
    assert result.exit_status == status


def test_a_command_prints_verdict_notes_and_table():
    table = Table((GOOD,))
    noted = fc.study.Comparison("strip", "a verdict", table, remarks=("a note",))
    assert noted.summary() == f"a verdict\na note\n\n{table}\n"
    rows = {"on front": True, "seconds": 1.0}, {"on front": False, "status": "skipped"}
    chart = fc.study.Chart(
        "strip", "a verdict", Table(tuple({"status": "no"} | row for row in rows))
    )
    lines = chart.summary().splitlines()
    assert lines[0] == "a verdict"
    assert lines[-2] == "These are 1 of 2 settings: no other is as accurate"
    assert str(chart.front).splitlines() == lines[-6:-3]


def test_a_result_names_the_files_for_its_reader(tmp_path):
    page, table = tmp_path / "report.html", Table(())
    files = {
        fc.study.Sweep: ({}, ""),
        fc.study.Simplification: ({"reduced": "x = 1"}, f" and {tmp_path / 'reduced.toml'}"),
        fc.Tuned: ({"text": "x = 1"}, f" and {tmp_path / 'tuned.toml'}"),
        fc.Fit: ({}, f" and {tmp_path / 'fitted.toml'}"),
    }
    for kind, (given, words) in files.items():
        result = kind("strip", "", table, **given)
        assert result.describe_files(tmp_path, page) == f"wrote {page}{words}"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_has_its_words_and_options(name, capsys):
    command, text = COMMANDS[name], help_of(capsys, name)
    assert text.startswith(f"usage: fecloth {name} [-h]")
    assert command.words in " ".join(text.split())
    assert text.endswith(STATUS)
    shown = " ".join(text.split())
    for one in command.options:
        words = (one.keywords["help"] or "").replace("%%", "%").partition("%(")[0]
        assert " ".join(words.split()) in shown
        is_place = not one.names[0].startswith("-")
        for each in [one.keywords.get("metavar") or one.key] if is_place else one.names:
            assert re.search(rf"(^|[\s\[]){re.escape(each)}\b", text), each


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_under_the_report_is_named_and_gives_status_3(tmp_path):
    (tmp_path / "results.csv").symlink_to("/dev/full")
    rows = {"x": 1.0, "tip": 2.0, "status": "ok"}, {"x": 2.0, "tip": 3.0, "status": "ok"}
    result = fc.study.Sweep("strip", "a verdict", Table(rows), ("x",), ("tip",), ("m",))
    with pytest.raises(DiskFull, match="results.csv cannot be written: No space left") as caught:
        result.report(tmp_path)
    assert ending_of(caught.value)[0] == 3


def test_the_help_has_all_commands(capsys):
    text = help_of(capsys)
    listed = re.findall(r"^    (\w+)(?: {2,}\S|$)", text, re.MULTILINE)
    assert listed == list(COMMANDS)
    assert text.endswith(STATUS)


@pytest.mark.parametrize(("name", "seconds"), [("chart", 60), ("stability", 120), ("tune", 600)])
def test_the_help_says_the_longest_time_of_a_case(name, seconds, capsys):
    assert f"longest CPU time of a case ({seconds} s)" in " ".join(help_of(capsys, name).split())


def test_the_page_names_every_study():
    """Its table says which question each answers."""
    text = read("fecloth/study/README.md")
    for name in (*STUDIES, "modes"):
        assert re.search(rf"^\|.*\| `study\.{name}\(.*\| `fecloth {name}\b", text, re.MULTILINE)
