"""A study's report and table."""

import os
import sys

import numpy as np
import pytest
from support.study_rows import rows_of_two

from fecloth import study
from studies import harness


def parse(folder, *more):
    return harness.parse_arguments("Errors.", ["--out", str(folder), *more])


def test_a_report_holds_findings_tables_settings_and_versions(tmp_path, capsys):
    options = parse(tmp_path, "--quick")
    findings = [harness.Finding("order", 1.02, 0.9, 1.1), harness.Finding("error", 0.3, high=0.1)]
    table = {"Orders": [{"method": "A", "order": 1.0234567}]}
    status = harness.write_report(
        options,
        "Two methods",
        rows_of_two(),
        results=["failed"],
        tables=table,
        figures=["errors"],
        findings=findings,
        conclusion="A is better.",
        settings={"h": 0.1},
    )
    text = (tmp_path / "report.md").read_text()
    for part in (
        "# Two methods",
        "A is better.",
        "order: 1.02 in [0.9, 1.1]: met",
        "error: 0.3 <= 0.1: MISSED",
        "![errors](errors.png)",
        "| A | 1.023 |",
        "each case in `results.csv`.",
        "Settings: h 0.1.",
        f", numpy {np.__version__}, ",
        ", python ",
        ", numba ",
        ", scipy ",
        ", fecloth ",
        "Ran on: processor ",
        f", cores {os.cpu_count()}, ",
        ", memory ",
        ", commit ",
    ):
        assert part in text
    assert status == 1
    good = rows_of_two()[:-1]
    assert harness.write_report(options, "Two", good, findings=findings[:1]) == 0
    assert "error: 0.3 <= 0.1: MISSED" in capsys.readouterr().out
    head, *lines = (tmp_path / "results.csv").read_text().splitlines()
    assert head == "method,dt,error,status,cause"
    assert lines[0] == "A,0.1,0.1,ok,"


def test_the_page_beside_a_study_is_written_on_demand(tmp_path, monkeypatch):
    page, keywords = tmp_path / "study" / "errors", {"findings": [], "figures": ["errors"]}
    page.parent.mkdir()
    (tmp_path / "errors.png").write_bytes(b"a picture")
    monkeypatch.setattr(sys, "argv", ["mine.py", "--write", "--jobs", "2"])
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    harness.write_report(parse(tmp_path), "Two", rows_of_two(), page=page, **keywords)
    assert not list(page.parent.iterdir())
    harness.write_report(parse(tmp_path, "--write"), "Two", rows_of_two(), page=page, **keywords)
    assert (
        "`python mine.py --jobs 2`, each case in `errors.csv`"
        in (page.with_suffix(".md")).read_text()
    )
    assert "![errors](errors.png)" in page.with_suffix(".md").read_text()
    assert (page.parent / "errors.png").read_bytes() == b"a picture"
    assert page.with_suffix(".csv").read_text() == (tmp_path / "results.csv").read_text()


def test_a_page_counts_many_findings_and_lists_the_missed_ones(tmp_path):
    page, options = tmp_path / "page", parse(tmp_path, "--write")
    findings = [harness.Finding(f"error {n}", n, high=13.5) for n in range(harness.LISTED + 3)]
    harness.write_report(options, "Many", rows_of_two(), findings=findings, page=page)
    listed = [line for line in page.with_suffix(".md").read_text().splitlines() if "- " in line]
    assert listed[-2:] == ["- error 14: 14 <= 13.5: MISSED", "- 14 of 15 findings are met"]
    assert "- error 0: 0 <= 13.5: met" in (tmp_path / "report.md").read_text()
    harness.write_report(options, "Few", rows_of_two(), findings=findings[:12], page=page)
    assert "- error 0: 0 <= 13.5: met" in page.with_suffix(".md").read_text()


def test_a_docstring_says_what_a_study_is_about():
    text = "Is it so?\n\nWe ask it.\nTwice.\n\n    python -m studies.so [--quick]\n"
    assert harness.about(text) == ("Is it so?", "We ask it.\nTwice.")
    assert harness.about(None) == ("", "")


def test_verdicts_are_counted():
    rows = [{"kind": kind, "is": word} for kind, word in ("ax", "ay", "ax", "by")]
    assert harness.count_by(rows, "kind", "is") == [
        {"kind": "a", "x": 2, "y": 1},
        {"kind": "b", "x": "", "y": 1},
    ]


def test_a_failed_case_is_named_first_and_gives_exit_status_3(tmp_path, capsys):
    met = harness.Finding("order", 1.0, 0.9, 1.1)
    assert harness.write_report(parse(tmp_path), "Two", rows_of_two(), findings=[met]) == 3
    first = "1 of 5 cases failed:\n\n- method B, dt 0.4: failed: StepFailed: a|b\n"
    text = (tmp_path / "report.md").read_text()
    assert text.startswith(f"# Two\n\n{first}")
    assert text.index("order: 1 in") > len(first)
    assert capsys.readouterr().out.startswith(first)


def test_many_failures_are_counted(tmp_path):
    bad = [rows_of_two()[-1] | {"dt": i} for i in range(40)]
    harness.write_report(parse(tmp_path), "Two", [*rows_of_two(), *bad])
    text = (tmp_path / "report.md").read_text()
    assert text.startswith("# Two\n\n41 of 45 cases failed:")
    assert "- and 31 more\n" in text


@pytest.mark.parametrize("results", [(), ("failed",)])
def test_a_study_whose_cases_all_failed_has_no_verdict(tmp_path, results):
    """Even where failures are results of the study."""
    bad, finding = rows_of_two()[-1:], harness.Finding("largest dt", 0.0)
    keywords = {"findings": [finding], "conclusion": "B is best.", "tables": {"Best": [{"x": 0}]}}
    keywords |= {"figures": ["errors"], "results": results}
    assert harness.write_report(parse(tmp_path), "Two", bad, **keywords) == 3
    text = (tmp_path / "report.md").read_text()
    assert "1 of 1 cases failed" in text
    for verdict in ("largest dt", "is best", "Best", "errors.png"):
        assert verdict not in text


def test_a_study_stops_where_all_cases_failed(tmp_path):
    options = parse(tmp_path)
    harness.require_results(options, "Two", rows_of_two())
    assert not (tmp_path / "report.md").exists()
    with pytest.raises(study.StudyFailed, match="all 1 cases"):
        harness.require_results(options, "Two", rows_of_two()[-1:])
    assert "StepFailed: a|b" in (tmp_path / "report.md").read_text()
