"""Mistakes in the options of every study: one line, exit status 2, before the first case."""

import importlib
import sys
from pathlib import Path

import pytest

from fecloth import study
from studies.harness import exit_status

ROOT = Path(__file__).parents[2]
FILES = [
    file.relative_to(ROOT)
    for file in sorted((ROOT / "studies").rglob("*.py"))
    if '__name__ == "__main__"' in file.read_text(encoding="utf-8") and "examples" not in file.parts
]
WITH_REPORT = ("convergence", "models", "stability")


def module_of(file: Path) -> str:
    return ".".join(file.with_suffix("").parts)


def fails_with(main, arguments, capsys, monkeypatch) -> str:
    """Return the only line that a study prints, with exit status 2."""
    monkeypatch.setattr(sys, "argv", ["studies/mine/__main__.py", *map(str, arguments)])
    assert exit_status(main) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def refuse_cases(*_, **__):
    raise AssertionError("a case was started")


@pytest.fixture(autouse=True)
def _nothing_is_run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, "run_cases", refuse_cases)


@pytest.mark.stories
@pytest.mark.parametrize("file", FILES, ids=module_of)
def test_an_unknown_option_is_one_line(file, capsys, monkeypatch):
    assert "harness.run_main(main)" in (ROOT / file).read_text(encoding="utf-8")
    main = importlib.import_module(module_of(file)).main
    line = fails_with(main, ["--nonsense", "."], capsys, monkeypatch)
    assert "unrecognized arguments: --nonsense" in line


def test_mujoco_is_missed_before_the_first_case(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    main = importlib.import_module("studies.work_precision.__main__").main
    assert "'.[peers]'" in fails_with(main, ["--peers"], capsys, monkeypatch)


@pytest.mark.stories
@pytest.mark.parametrize("name", WITH_REPORT)
def test_a_study_whose_cases_all_fail_has_no_verdict(name, monkeypatch, tmp_path):
    """As with workers that cannot import a module: exit status 3, and the failures are named."""
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    failure = {"status": "error", "cause": "ModuleNotFoundError: No module named 'harness'"}
    monkeypatch.setattr("fecloth.study.status.attempt", lambda *_: failure)
    main = importlib.import_module(f"studies.{name}.__main__").main
    monkeypatch.setattr(sys, "argv", ["studies/mine/__main__.py", "--quick"])
    assert exit_status(main) == 3
    (report,) = (tmp_path / "out" / "mine").rglob("report.md")
    text = report.read_text(encoding="utf-8")
    assert "cases failed:\n\n- " in text
    assert "No module named 'harness'" in text
    for verdict in ("holds the longest step", "has the same limit", ": met", ".png"):
        assert verdict not in text
