"""A study's report and table."""

import os
import sys

import numpy as np
import pytest
from support.study_rows import rows_of_two

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


def test_a_failed_case_is_named_first_and_gives_exit_status_3(tmp_path, capsys):
    met = harness.Finding("order", 1.0, 0.9, 1.1)
    assert harness.write_report(parse(tmp_path), "Two", rows_of_two(), findings=[met]) == 3
    first = "1 of 5 cases failed:\n\n- method B, dt 0.4: failed: StepFailed: a|b\n"
    text = (tmp_path / "report.md").read_text()
    assert text.startswith(f"# Two\n\n{first}")
    assert text.index("order: 1 in") > len(first)
    assert capsys.readouterr().out.startswith(first)


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
