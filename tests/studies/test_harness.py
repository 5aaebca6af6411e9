"""The studies' common part: cases are kept, failures are rows, reports say all."""

import doctest
import importlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from fecloth import study as harness
from fecloth.errors import InputError, SolveFailed, StepFailed
from fecloth.study.cases import Case

STUDIES = Path(__file__).parents[2] / "studies"


def square(x: float, log: str) -> dict:
    with open(log, "a") as stream:
        stream.write(f"{x:g}\n")
    if Path(log).with_suffix(".stop").exists() and x == 2.0:
        raise KeyboardInterrupt
    return {"square": np.float64(x * x), "path": np.arange(2) * x}


def troubled(how: str) -> dict:
    if how == "step":
        raise StepFailed("not finite", step=3, t=0.1, dt=0.01, remedy="Take a smaller dt.")
    if how == "solve":
        raise SolveFailed("missed", 1e-2, 1e-6)
    if how == "input":
        fc.Fabric(areal_density=-1.0, tensile_stiffness=1.0)
    if how == "memory":
        raise MemoryError
    if how == "bug":
        raise TypeError("odd")
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "slow":
        time.sleep(60)
    if how == "ticking":
        while True:
            harness.tick()
    return {"value": 1.0}


def environment(name: str) -> dict:
    import numba

    return {"threads": os.environ.get(name, ""), "numba": numba.config.NUMBA_NUM_THREADS}


def cases(log):
    return [{"x": float(x), "log": str(log)} for x in (3, 1, 2, 4)]


def test_cases_are_run_once(tmp_path):
    log = tmp_path / "log"
    first = harness.run_cases(cases(log), square, tmp_path)
    again = harness.run_cases(cases(log), square, tmp_path)
    assert log.read_text().split() == ["3", "1", "2", "4"]
    assert first[2]["square"] == 4.0
    assert [row["square"] for row in again] == [9.0, 1.0, 4.0, 16.0]
    assert again[3]["path"] == [0.0, 4.0]
    assert {row["status"] for row in again} == {"ok"}
    harness.run_cases(cases(log)[:1], square, tmp_path, fresh=True)
    assert log.read_text().split()[4:] == ["3"]


def test_interrupted_study_goes_on(tmp_path):
    log = tmp_path / "log"
    log.with_suffix(".stop").touch()
    with pytest.raises(KeyboardInterrupt):
        harness.run_cases(cases(log), square, tmp_path)
    log.with_suffix(".stop").unlink()
    rows = harness.run_cases(cases(log), square, tmp_path)
    assert log.read_text().split() == ["3", "1", "2", "2", "4"]
    assert [row["square"] for row in rows] == [9.0, 1.0, 4.0, 16.0]


STUDY = """
import sys, time
import harness

def slow(x: int, log: str) -> dict:
    with open(log, "a") as stream:
        stream.write(f"{x}\\n")
    if x == 2 and len(sys.argv) > 2:
        time.sleep(60)
    return {"double": 2 * x}

if __name__ == "__main__":
    out = sys.argv[1]
    rows = harness.run_cases([{"x": i, "log": out + "/log"} for i in range(4)], slow, out)
    print([row["double"] for row in rows])
"""


@pytest.mark.skipif(os.name != "posix", reason="kills")
def test_killed_study_goes_on(tmp_path):
    (tmp_path / "study.py").write_text(STUDY)
    command = [sys.executable, str(tmp_path / "study.py"), str(tmp_path)]
    options = {"env": os.environ | {"PYTHONPATH": str(STUDIES)}, "text": True}
    killed = subprocess.Popen([*command, "sleep"], **options)
    log, end = tmp_path / "log", time.monotonic() + 60
    while "2" not in (log.read_text() if log.exists() else ""):
        assert killed.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    done = subprocess.run(command, capture_output=True, check=True, **options)
    assert done.stdout.strip() == "[0, 2, 4, 6]"
    assert log.read_text().split() == ["0", "1", "2", "2", "3"]


@pytest.mark.parametrize(
    ("how", "status", "cause"),
    [
        ("step", "failed", "StepFailed: step 3 from t = 0.1 s"),
        ("solve", "failed", "SolveFailed: missed"),
        ("input", "refused", "areal_density"),
        ("memory", "memory", ""),
        ("bug", "error", "TypeError: odd"),
        ("ticking", "time limit", "more than 0.05 s"),
    ],
)
def test_failure_is_a_row(tmp_path, how, status, cause):
    rows = harness.run_cases([{"how": how}, {"how": "no"}], troubled, tmp_path, time_limit=0.05)
    assert rows[0]["status"] == status
    assert cause in rows[0]["cause"]
    assert rows[0]["how"] == how
    assert (rows[1]["status"], rows[1]["value"]) == ("ok", 1.0)


def test_what_may_go_otherwise_is_run_again(tmp_path):
    def kept(how):
        return (tmp_path / "cache" / f"{Case.of(troubled, {'how': how}).key}.json").exists()

    hows = ("step", "input", "memory", "bug")
    harness.run_cases([{"how": how} for how in hows], troubled, tmp_path)
    assert [kept(how) for how in hows] == [True, True, False, False]


def test_time_limit_is_kept_until_it_is_raised(tmp_path):
    def seconds(limit):
        begin = time.perf_counter()
        harness.run_cases([{"how": "ticking"}], troubled, tmp_path, time_limit=limit)
        return time.perf_counter() - begin

    assert seconds(0.3) >= 0.3
    assert seconds(0.2) < 0.2
    assert seconds(0.4) >= 0.4


def test_key_depends_on_all(tmp_path):
    key = Case.of(troubled, {"how": "no", "dt": 0.1}).key
    assert Case.of(troubled, {"dt": 0.1, "how": "no"}).key == key
    others = [
        Case.of(troubled, {"how": "no", "dt": 0.1000000001}),
        Case.of(troubled, {"how": "no"}),
        Case.of(square, {"how": "no", "dt": 0.1}),
        Case(
            {"how": "no", "dt": 0.1}, Case.of(troubled, {}).file, "troubled", source="another text"
        ),
    ]
    assert len({key, *(case.key for case in others)}) == 5


def test_source_is_that_of_imports_and_scenes_too(tmp_path):
    from fecloth.study.cases import source_of

    study, beside = tmp_path / "study.py", tmp_path / "beside.py"
    study.write_text("def f():\n    from beside import g\n")
    hashes = []
    for text in ("g = 1", "g = 2"):
        beside.write_text(text)
        source_of.cache_clear()
        hashes.append(source_of(study))
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "swing.toml").write_text("dt = 0.1")
    source_of.cache_clear()
    assert len({*hashes, source_of(study)}) == 3


def test_settings_and_functions_that_do_not_work(tmp_path):
    with pytest.raises(InputError, match="JSON-able"):
        harness.run_cases([{"how": object()}], troubled, tmp_path)
    with pytest.raises(InputError, match="no tuples"):
        harness.run_cases([{"how": (1, 2)}], troubled, tmp_path)
    with pytest.raises(InputError, match="module-level"):
        harness.run_cases([{"how": "no"}], lambda how: {}, tmp_path)
    with pytest.raises(InputError, match="returned how: a setting"):
        harness.run_cases([{"how": "no"}], echo, tmp_path)


def echo(how: str) -> dict:
    return {"how": how}


def test_processes_do_the_same(tmp_path):
    log = tmp_path / "log"
    one = harness.run_cases(cases(log), square, tmp_path / "one")
    two = harness.run_cases(cases(log), square, tmp_path / "two", jobs=2)
    assert [row["square"] for row in one] == [row["square"] for row in two]
    assert harness.run_cases(cases(log), square, tmp_path / "two") == harness.run_cases(
        cases(log), square, tmp_path / "one"
    )
    assert sorted(log.read_text().split()) == sorted(2 * ["3", "1", "2", "4"])


def test_late_and_killed_processes_are_replaced(tmp_path):
    hows = ("slow", "killed", "step", "no")
    begin = time.perf_counter()
    rows = harness.run_cases(
        [{"how": how} for how in hows], troubled, tmp_path, jobs=2, time_limit=0.5
    )
    assert [row["status"] for row in rows] == ["time limit", "killed", "failed", "ok"]
    assert "code -9" in rows[1]["cause"]
    assert time.perf_counter() - begin < 50


def test_a_process_has_one_thread(tmp_path):
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    before = dict(os.environ)
    rows = harness.run_cases([{"name": n} for n in names], environment, tmp_path, jobs=2)
    assert [(row["threads"], row["numba"]) for row in rows] == 4 * [("1", 1)]
    assert dict(os.environ) == before


def test_a_cluster_does_the_same(tmp_path):
    distributed = pytest.importorskip("distributed")
    local = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    hows = ({"how": how} for how in ("step", "no", "ticking"))
    with distributed.LocalCluster(**local) as cluster:
        rows = harness.run_cases(
            hows, troubled, tmp_path, scheduler=cluster.scheduler_address, time_limit=0.5
        )
    assert [row["status"] for row in rows] == ["failed", "ok", "time limit"]
    assert rows[1]["value"] == 1.0


def test_a_cluster_without_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"fecloth\[dask\]"):
        harness.run_cases([{"how": "no"}], troubled, tmp_path, scheduler="tcp://nowhere:1")


def test_timed_takes_the_fastest_after_the_first():
    waits = iter((0.2, 0.05, 0.01, 0.05))
    seconds = harness.timed(lambda: time.sleep(next(waits)) or 7, repeats=3)
    assert 0.01 <= seconds.wall < 0.05
    assert seconds.cpu < seconds.wall
    assert seconds.first >= 0.2
    assert seconds.compiling == pytest.approx(seconds.first - seconds.wall)
    assert seconds.value == 7


def rows_of_two():
    good = [
        {"method": m, "dt": dt, "error": c * dt, "status": "ok", "cause": "", "path": [1, 2]}
        for m, c in (("A", 1.0), ("B", 2.0))
        for dt in (0.1, 0.2)
    ]
    bad = {"method": "B", "dt": 0.4, "status": "failed", "cause": "StepFailed: a|b\nmore"}
    return [*good, bad]


def test_report_says_all(tmp_path, capsys):
    options = harness.arguments("Errors.\n\nMore.", ["--out", str(tmp_path), "--quick"])
    findings = [harness.Finding("order", 1.02, 0.9, 1.1), harness.Finding("error", 0.3, high=0.1)]
    table = {"Orders": [{"method": "A", "order": 1.0234567}]}
    missed = harness.report(
        options,
        "Two methods",
        rows_of_two(),
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
    assert missed == 1
    assert harness.report(options, "Two", rows_of_two(), findings=findings[:1]) == 0
    assert "error: 0.3 <= 0.1: MISSED" in capsys.readouterr().out
    head, *lines = (tmp_path / "results.csv").read_text().splitlines()
    assert head == "method,dt,error,status,cause"
    assert lines[0] == "A,0.1,0.1,ok,"


def test_figure(tmp_path):
    pytest.importorskip("matplotlib")
    with harness.figure(tmp_path, "errors", "time step [s]", "error [m]") as (figure, ax):
        harness.lines(ax, rows_of_two(), x="dt", y="error", by="method")
        limits = ax.get_xlim(), ax.get_ylim()
        harness.slope_triangle(ax, 2)
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


def test_kept_cases_tell_their_settings(tmp_path):
    harness.run_cases([{"how": "no"}], troubled, tmp_path)
    (file,) = (tmp_path / "cache").iterdir()
    assert json.loads(file.read_text())["settings"] == {"how": "no"}


@pytest.mark.parametrize("name", ["failures", "options", "reports", "timing"])
def test_examples(name):
    failed, tried = doctest.testmod(importlib.import_module(f"harness.{name}"))
    assert tried > 0
    assert failed == 0
