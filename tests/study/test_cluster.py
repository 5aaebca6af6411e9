"""Cases on a Dask cluster."""

import sys

import pytest
from support.study_functions import fail_or_return

from fecloth import study
from fecloth.errors import InputError


def test_a_cluster_gives_the_same_rows(tmp_path):
    distributed = pytest.importorskip("distributed")
    local = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    hows = ({"how": how} for how in ("step", "no", "ticking"))
    with distributed.LocalCluster(**local) as cluster:
        rows = study.run_cases(
            hows, fail_or_return, tmp_path, scheduler=cluster.scheduler_address, time_limit=0.5
        )
    assert [row["status"] for row in rows] == ["failed", "ok", "time limit"]
    assert rows[1]["value"] == 1.0


def test_a_cluster_needs_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"\.\[dask\]"):
        study.run_cases([{"how": "no"}], fail_or_return, tmp_path, scheduler="tcp://nowhere:1")
