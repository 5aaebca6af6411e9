"""The table of runs: what a row has, and what is left of a run that failed or has no value."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from support.scene_texts import STRIP

import fecloth as fc
from fecloth.errors import InputError
from fecloth.study.problem import StudyProblem
from fecloth.study.result import Table
from fecloth.study.run_table import row_of_run, with_values
from fecloth.study.runs import Run, Runs, run_quantities

COST = {"triangles": 8, "steps": 1, "newton": 3, "cpu_seconds": 0.1}


def test_a_row_has_settings_status_results_cost_and_kinds_of_doubts():
    doubts = [fc.Doubt(kind, "words").entry() for kind in (fc.DoubtKind.TIME,) * 2]
    run = {"status": "ok", "cause": "", "doubts": doubts, "columns": {"t": [0.0]}, **COST}
    row = row_of_run(run, {"h": 0.1}, {"value": 2.0, "error": 0.1})
    assert row == {"h": 0.1, "status": "ok", "value": 2.0, "error": 0.1, **COST, "doubts": "time"}
    failed = row_of_run({"status": "failed", "cause": "a\nb"}, {"h": 0.1}, {})
    assert failed == {"h": 0.1, "status": "failed", "cause": "a"}


@pytest.mark.filterwarnings("ignore")
def test_a_run_without_a_value_says_why(tmp_path):
    path = tmp_path / "strip.toml"
    time = 'time = { method = "bdf2", dt = 0.01, t_end = 0.02 }'
    path.write_text(STRIP.replace("equilibrium = {}", time).replace("h = 0.125", "h = 0.25"))
    problem = StudyProblem.of(path)
    quantities = problem.choose_quantities(["tip.x", "period of tip.x"])
    (row,) = run_quantities([Run(problem, "")], quantities, Runs(quiet=True))
    told = with_values(row, quantities)
    assert told["status"] == "no value"
    assert "period" in told["cause"]
    assert np.isfinite(told["values"]["tip.x"])
    modes = problem.choose_quantities(["frequency(2)", "frequency(1)"])
    (row,) = run_quantities([Run(problem, "")], modes, Runs(quiet=True))
    assert with_values(row, modes)["status"] == "ok"


def test_a_table_is_a_frame_of_pandas(monkeypatch):
    """Of a package of this name: pandas itself need not be installed."""
    table = Table(({"h": 0.1, "tip.x": 1.0}, {"h": 0.05, "error": 0.1}))
    pandas = SimpleNamespace(DataFrame=lambda rows, columns: (rows, columns))
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    rows, columns = table.to_pandas()
    assert columns == ["h", "tip.x", "error"]
    assert rows == [{"h": 0.1, "tip.x": 1.0}, {"h": 0.05, "error": 0.1}]


def test_a_table_names_the_package_that_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"the package pandas: is not installed. .*to_csv"):
        Table(({"h": 0.1},)).to_pandas()
