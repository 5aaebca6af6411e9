"""A study's report and table."""

import os

import numpy as np
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
    right = rows_of_two()[:-1]
    assert harness.write_report(options, "Two", right, findings=findings[:1]) == 0
    assert "error: 0.3 <= 0.1: MISSED" in capsys.readouterr().out
    head, *lines = (tmp_path / "results.csv").read_text().splitlines()
    assert head == "method,dt,error,status,cause"
    assert lines[0] == "A,0.1,0.1,ok,"
