"""Cases in other processes."""

import os
import time

from support.study_functions import fail_or_return, four_cases, read_thread_limits, square

from fecloth import study


def test_processes_give_the_same_rows(tmp_path):
    log = tmp_path / "log"
    one = study.run_cases(four_cases(log), square, tmp_path / "one")
    two = study.run_cases(four_cases(log), square, tmp_path / "two", jobs=2)
    assert [row["square"] for row in one] == [row["square"] for row in two]
    assert study.run_cases(four_cases(log), square, tmp_path / "two") == study.run_cases(
        four_cases(log), square, tmp_path / "one"
    )
    assert sorted(log.read_text().split()) == sorted(2 * ["3", "1", "2", "4"])


def test_late_and_dead_processes_are_replaced(tmp_path):
    hows = ("slow", "killed", "step", "no")
    begin = time.perf_counter()
    rows = study.run_cases(
        [{"how": how} for how in hows], fail_or_return, tmp_path, jobs=2, time_limit=0.5
    )
    assert [row["status"] for row in rows] == ["time limit", "killed", "failed", "ok"]
    assert "code -9" in rows[1]["cause"]
    assert time.perf_counter() - begin < 50


def test_a_process_has_one_thread(tmp_path):
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    before = dict(os.environ)
    rows = study.run_cases([{"name": n} for n in names], read_thread_limits, tmp_path, jobs=2)
    assert [(row["threads"], row["numba"]) for row in rows] == 4 * [("1", 1)]
    assert dict(os.environ) == before
