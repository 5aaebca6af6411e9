"""Cases in other processes."""

import os
import signal
import subprocess
import sys
import time

import pytest
from support.study_functions import fail_or_return, four_cases, read_thread_limits, square

from fecloth import study
from fecloth.study import processes

pytestmark = pytest.mark.stories
INTERRUPTED = """
import os, signal, sys, time
from fecloth import study

def sleep(x: int, folder: str) -> dict:
    open(f"{folder}/{os.getpid()}.process", "w").close()
    time.sleep(3600)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's job may ignore it
    study.run_cases([{"x": x, "folder": sys.argv[1]} for x in range(4)], sleep, None, jobs=2)
"""


def test_processes_give_the_same_rows(tmp_path):
    log = tmp_path / "log"
    first = study.run_cases(four_cases(log), square, tmp_path / "one")
    second = study.run_cases(four_cases(log), square, tmp_path / "second", jobs=2)
    assert [row["square"] for row in first] == [row["square"] for row in second]
    assert study.run_cases(four_cases(log), square, tmp_path / "second") == study.run_cases(
        four_cases(log), square, tmp_path / "one"
    )
    assert sorted(log.read_text().split()) == sorted(2 * ["3", "1", "2", "4"])


def test_late_and_dead_processes_are_replaced(tmp_path):
    """A limit is CPU time: a case that waits has none of it."""
    hows = ("busy", "killed", "step", "no", "waiting")
    rows = study.run_cases(
        [{"how": how} for how in hows], fail_or_return, tmp_path, jobs=2, time_limit=0.2
    )
    assert [row["status"] for row in rows] == ["time limit", "killed", "failed", "ok", "ok"]
    assert rows[0]["cause"] == "cut off: more than 0.2 CPU s"
    assert "code -9" in rows[1]["cause"]


def test_a_process_that_hangs_is_stopped_by_the_clock(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "LEAST_HANGING", 0.3)
    monkeypatch.setattr(processes, "HANGING_OVER_LIMIT", 1.0)
    (row,) = study.run_cases([{"how": "hanging"}], fail_or_return, None, jobs=2, time_limit=0.3)
    assert row["status"] == "time limit"


def test_a_process_has_one_thread(tmp_path):
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    before = dict(os.environ)
    rows = study.run_cases([{"name": n} for n in names], read_thread_limits, tmp_path, jobs=2)
    assert [(row["threads"], row["numba"]) for row in rows] == 4 * [("1", 1)]
    assert dict(os.environ) == before


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_ctrl_c_stops_the_processes(tmp_path):
    (tmp_path / "script.py").write_text(INTERRUPTED)
    command = [sys.executable, str(tmp_path / "script.py"), str(tmp_path)]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while len(begun := list(tmp_path.glob("*.process"))) < 2:
        assert running.poll() is None
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in running.communicate()[1]
    for file in begun:
        with pytest.raises(ProcessLookupError):
            os.kill(int(file.stem), 0)
