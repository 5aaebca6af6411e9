"""A study's report and table."""

import os

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
        "StepFailed: a\\|b |",
        "- h: 0.1",
        "- quick: True",
        f"- numpy: {np.__version__}",
        "- python: ",
        "- numba: ",
        "- scipy: ",
        "- fecloth: ",
        "- processor: ",
        f"- cores: {os.cpu_count()}",
        "- memory: ",
        "- commit: ",
    ):
        assert part in text
    assert status == 1
    good = rows_of_two()[:-1]
    assert harness.write_report(options, "Two", good, findings=findings[:1]) == 0
    assert "error: 0.3 <= 0.1: MISSED" in capsys.readouterr().out
    head, *lines = (tmp_path / "results.csv").read_text().splitlines()
    assert head == "method,dt,error,status,cause"
    assert lines[0] == "A,0.1,0.1,ok,"


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
