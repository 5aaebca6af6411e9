"""The commands: each study has one, and each has its options and its help."""

import inspect
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.commands import commands_of
from support.pages import read

import fecloth as fc
from fecloth.cli.commands import COMMANDS
from fecloth.cli.main import STATUS, _parser, main
from fecloth.cli.study_command import Running
from fecloth.output.atomic_files import DiskFull, ending_of
from fecloth.study.opened import Opened
from fecloth.study.result import StudyResult, Table

NAMES = [command.__name__ for command in COMMANDS]
PARSERS = commands_of(_parser())
STUDIES = [  # of a problem; a fit is of several
    command.__name__
    for command in COMMANDS
    if "running" in inspect.signature(command).parameters and command.__name__ != "fit"
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


def test_every_study_has_a_command_and_a_method():
    assert set(STUDIES) == methods_of_the_front() - {"modes"}
    assert "modes" in NAMES
    for name in [*STUDIES, "fit"]:
        function = getattr(fc if name == "tune" else fc.study, name)
        assert inspect.signature(function).return_annotation in {
            *StudyResult.__subclasses__(),
            *(kind.__name__ for kind in StudyResult.__subclasses__()),  # of a postponed annotation
        }


@pytest.mark.parametrize("name", STUDIES)
def test_a_command_asks_its_study_with_all_options(name, monkeypatch):
    """The value of each option reaches the argument of the study that has its name."""
    command = next(command for command in COMMANDS if command.__name__ == name)
    options = [
        parameter.name
        for parameter in inspect.signature(command).parameters.values()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]
    values = {key: f"value of {key}" for key in options}
    arguments = inspect.signature(getattr(fc.study.Study, name)).bind
    opened = SimpleNamespace(**{name: partial(arguments, None)})
    values["running"] = SimpleNamespace(open=lambda changes, *scenes: opened)
    asked = command.__wrapped__("a.toml", **{key: values[key] for key in options}).arguments
    own = {key: values[key] for key in options if key not in ("set_", "running")}
    if name == "sensitivity":
        own["parameters"] = own.pop("parameter")
    assert {key: value for key, value in asked.items() if value is not None} == own


def test_how_cases_run_are_arguments_of_the_front():
    front = inspect.signature(Opened.of).parameters
    assert Running().how().keys() | {"most_seconds"} <= front.keys()
    assert Running(yes=True).how()["most_seconds"] is None
    assert "most_seconds" not in Running().how()


GOOD, BAD = {"status": "ok"}, {"status": "failed", "cause": "it stopped"}
LATE = {"status": "time limit", "cause": "60 s"}
RESULTS = [  # the class of a result, its rows, more of it, and the exit status of its command
    (fc.study.Convergence, [{"value": 1.0}], {}, 0),
    (fc.study.Convergence, [{"value": 1.0}, BAD], {}, 3),
    (fc.study.Sweep, [GOOD], {}, 0),
    (fc.study.Sweep, [GOOD, BAD], {}, 3),
    (fc.study.Comparison, [GOOD, BAD], {}, 3),
    (fc.study.Front, [GOOD | {"on front": True, "seconds": 1.0}, BAD], {}, 0),
    (fc.study.Front, [GOOD | {"on front": False}], {}, 3),
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
    chart = fc.study.Front(
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


@pytest.mark.parametrize("name", NAMES)
def test_the_help_of_a_command_has_its_words_and_options(name, capsys):
    text = help_of(capsys, name)
    shown = " ".join(text.split())
    assert text.startswith(f"usage: fecloth {name} [-h]")
    assert PARSERS[name].description in shown
    assert text.endswith(STATUS)
    for action in PARSERS[name]._actions:
        words = action.help.replace("%%", "%").partition("%(")[0]
        assert " ".join(words.split()) in shown
        for each in action.option_strings or [action.metavar or action.dest]:
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
    assert listed == NAMES
    assert text.endswith(STATUS)


@pytest.mark.parametrize(("name", "seconds"), [("chart", 60), ("stability", 120), ("tune", 600)])
def test_the_help_says_the_longest_time_of_a_case(name, seconds, capsys):
    assert f"longest CPU time of a case ({seconds} s)" in " ".join(help_of(capsys, name).split())


def test_the_page_names_every_study():
    """Its table says which question each answers."""
    text = read("fecloth/study/README.md")
    for name in (*STUDIES, "modes"):
        assert re.search(rf"^\|.*\| `study\.{name}\(.*\| `fecloth {name}\b", text, re.MULTILINE)
