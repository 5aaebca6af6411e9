"""A case that fails is a row with its status and its cause."""

import pytest
from support.study_functions import fail_or_return

from fecloth import study


@pytest.mark.parametrize(
    ("how", "status", "cause"),
    [
        ("step", "failed", "StepFailed: step 3 from t = 0.1 s"),
        ("solve", "failed", "SolveFailed: missed"),
        ("input", "refused", "areal_density"),
        ("memory", "memory", ""),
        ("bug", "error", "TypeError: odd"),
        ("ticking", "time limit", "cut off: more than 0.05 CPU s"),
        ("waiting", "ok", ""),
    ],
)
def test_a_failure_is_a_row_with_status_and_cause(tmp_path, how, status, cause):
    rows = study.run_cases([{"how": how}, {"how": "no"}], fail_or_return, tmp_path, time_limit=0.05)
    assert rows[0]["status"] == status
    assert cause in rows[0]["cause"]
    assert rows[0]["how"] == how
    assert (rows[1]["status"], rows[1]["value"]) == ("ok", 1.0)
