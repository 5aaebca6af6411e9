"""A study's report, table and figures."""

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


def test_a_figure_has_lines_crosses_and_slopes(tmp_path):
    with harness.figure(tmp_path, "errors", "time step [s]", "error [m]") as (figure, ax):
        harness.draw_lines(ax, rows_of_two(), x="dt", y="error", by="method")
        limits = ax.get_xlim(), ax.get_ylim()
        harness.draw_slope_triangle(ax, 2)
        assert (ax.get_xlim(), ax.get_ylim()) == limits
        _, right, top = np.log10(ax.patches[0].get_xy()[:3])
        left = np.log10(ax.patches[0].get_xy()[0])
        np.testing.assert_allclose((top - right)[1] / (right - left)[0], 2, rtol=1e-12)
        first, second, *crosses = ax.lines
        assert first.get_color() != second.get_color()
        assert first.get_marker() != second.get_marker()
        assert [list(cross.get_xdata()) for cross in crosses] == [[0.4]]
        figure.canvas.draw()
    assert (tmp_path / "errors.png").read_bytes()[1:4] == b"PNG"
    assert "<svg" in (tmp_path / "errors.svg").read_text()
