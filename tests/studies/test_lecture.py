"""The lecture: each page runs, its check can be trusted, and it is short enough for a slide."""

import ast
import re
import time

import pytest
from support.lecture import answer, cells, code_lines, markdown
from support.pages import ROOT

from studies.lecture.__main__ import PAGES, run_page

EACH = pytest.mark.parametrize("page", PAGES)


@pytest.mark.stories
@EACH
def test_a_page_runs_and_its_check_holds(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    start = time.process_time()
    figure = run_page(page)["fig"]
    print(f"{page}: {time.process_time() - start:.2f} CPU s")
    assert not list(tmp_path.iterdir())  # it writes nothing
    for ax in figure.axes:
        assert ax.get_xlabel() or ax.get_ylabel() or not ax.axison


@EACH
def test_a_page_has_the_form_of_a_slide(page):
    first, *_ = parts = cells(PAGES[page])
    kind, text = first
    assert kind == "markdown"
    assert re.match(r"# \w", text)
    assert len(markdown(PAGES[page]).split()) <= 130
    code = [text for kind, text in parts if kind == "code"]
    assert 5 <= code_lines(code) <= 14
    assert sum("fig" in text and "plt." in text for text in code) == 1
    for text in code:  # the notebook shows the figure, and no value beside it
        last = ast.parse(text).body[-1]
        assert not isinstance(last, ast.Expr) or ast.unparse(last).startswith("print(")
    checks = [node for text in code for node in ast.walk(ast.parse(text))]
    assert any(isinstance(node, ast.Assert) for node in checks)


@EACH
def test_a_closing_question_has_a_folded_answer_below_it(page):
    asks = markdown(PAGES[page]).rstrip().endswith("?")
    assert bool(answer(PAGES[page])) == asks
    assert len(answer(PAGES[page]).split()) <= 60


def test_the_page_lists_each_slide_once():
    text = (ROOT / "studies" / "lecture" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(\d\d)\]\((\w+)\.py\) \|", text, re.MULTILINE)
    assert rows == [(page[:2], page) for page in PAGES]
    assert len(text.replace("|", " ").split()) <= 250


def test_a_failed_check_is_named(tmp_path, monkeypatch, capsys):
    from studies.lecture import __main__ as lecture

    page = tmp_path / "99_wrong.py"
    page.write_text("x = 1\nassert x == 2\n", encoding="utf-8")
    monkeypatch.setitem(lecture.PAGES, page.stem, page)
    monkeypatch.setattr("sys.argv", ["lecture", "99", "-o", str(tmp_path / "out")])
    assert lecture.main() == 1
    assert "check failed in line 2" in capsys.readouterr().out
