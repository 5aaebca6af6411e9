"""Cases are stored on disk, and an interrupted study continues."""

import json
import os
import subprocess
import sys
import time

import pytest
from support.study_functions import fail_or_return, four_cases, square

from fecloth import study
from fecloth.study.cases import Case

pytestmark = pytest.mark.stories


def test_cases_are_run_once(tmp_path):
    log = tmp_path / "log"
    first = study.run_cases(four_cases(log), square, tmp_path)
    again = study.run_cases(four_cases(log), square, tmp_path)
    assert log.read_text().split() == ["3", "1", "2", "4"]
    assert first[2]["square"] == 4.0
    assert [row["square"] for row in again] == [9.0, 1.0, 4.0, 16.0]
    assert again[3]["path"] == [0.0, 4.0]
    assert {row["status"] for row in again} == {"ok"}
    study.run_cases(four_cases(log)[:1], square, tmp_path, fresh=True)
    assert log.read_text().split()[4:] == ["3"]


STUDY = """
import sys, time
from fecloth import study

def slow(x: int, log: str) -> dict:
    with open(log, "a") as stream:
        stream.write(f"{x}\\n")
    if x == 2 and len(sys.argv) > 2:
        time.sleep(3600)
    return {"double": 2 * x}

if __name__ == "__main__":
    out = sys.argv[1]
    rows = study.run_cases([{"x": i, "log": out + "/log"} for i in range(4)], slow, out)
    print([row["double"] for row in rows])
"""


@pytest.mark.skipif(os.name != "posix", reason="kills")
def test_a_killed_study_continues(tmp_path):
    (tmp_path / "study.py").write_text(STUDY)
    command = [sys.executable, str(tmp_path / "study.py"), str(tmp_path)]
    options = {"text": True}
    killed = subprocess.Popen([*command, "sleep"], **options)
    log = tmp_path / "log"
    while "2" not in (log.read_text() if log.exists() else ""):
        assert killed.poll() is None
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    done = subprocess.run(command, capture_output=True, check=True, **options)
    assert done.stdout.strip() == "[0, 2, 4, 6]"
    assert log.read_text().split() == ["0", "1", "2", "2", "3"]


def test_results_that_may_change_are_not_stored(tmp_path):
    def is_stored(how):
        return (tmp_path / "cache" / f"{Case.of(fail_or_return, {'how': how}).key}.json").exists()

    hows = ("step", "input", "memory", "bug")
    study.run_cases([{"how": how} for how in hows], fail_or_return, tmp_path)
    assert [is_stored(how) for how in hows] == [True, True, False, False]


def test_a_late_case_runs_again_only_with_a_longer_limit(tmp_path, monkeypatch):
    looks, check = [], study.check_time_limit
    monkeypatch.setattr(study, "check_time_limit", lambda: looks.append(1) or check())

    def runs(limit):
        looks.clear()
        rows = study.run_cases([{"how": "ticking"}], fail_or_return, tmp_path, time_limit=limit)
        assert [row["status"] for row in rows] == ["time limit"]
        return len(looks) > 0

    assert [runs(limit) for limit in (0.3, 0.2, 0.4)] == [True, False, True]


def test_the_key_depends_on_settings_function_and_source(tmp_path):
    key = Case.of(fail_or_return, {"how": "no", "dt": 0.1}).key
    assert Case.of(fail_or_return, {"dt": 0.1, "how": "no"}).key == key
    others = [
        Case.of(fail_or_return, {"how": "no", "dt": 0.1000000001}),
        Case.of(fail_or_return, {"how": "no"}),
        Case.of(square, {"how": "no", "dt": 0.1}),
        Case(
            {"how": "no", "dt": 0.1},
            Case.of(fail_or_return, {}).file,
            "fail_or_return",
            source="another text",
        ),
    ]
    assert len({key, *(case.key for case in others)}) == 5


WHOLE = {"settings": {"x": 2}, "time_limit": None, "result": {"status": "ok", "cause": ""}}
DAMAGES = {
    "empty": b"",
    "cut": json.dumps(WHOLE).encode()[:-9],
    "no text": b"\xff\xfe\x00",
    "zeros": bytes(64),
    "no table": b"[1, 2]",
    "no entry": b"null",
    "nested too deep": b"[" * 200_000,
    "no result": json.dumps(WHOLE | {"result": None}).encode(),
    "no status": json.dumps(WHOLE | {"result": {"value": 4.0, "cause": ""}}).encode(),
    "other status": json.dumps(WHOLE | {"result": {"status": "odd", "cause": ""}}).encode(),
    "no time limit": json.dumps({"result": WHOLE["result"]}).encode(),
    "a word for a limit": json.dumps(WHOLE | {"time_limit": "soon"}).encode(),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_stored_result_that_cannot_be_read_is_computed_again(tmp_path, damage):
    cases = [{"x": 2.0, "log": str(tmp_path / "log")}]
    study.run_cases(cases, square, tmp_path)
    (entry,) = (tmp_path / "cache").iterdir()
    stored = entry.read_bytes()
    entry.write_bytes(damage)
    assert study.run_cases(cases, square, tmp_path)[0]["square"] == 4.0
    assert entry.read_bytes() == stored
    entry.write_bytes(stored.replace(b"4.0", b"5.0"))  # a whole one is read
    assert study.run_cases(cases, square, tmp_path)[0]["square"] == 5.0
