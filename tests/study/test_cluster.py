"""Cases on a Dask cluster whose workers are started as studies/README.md says."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support.study_functions import fail_or_return

import fecloth
from fecloth import study
from fecloth.errors import InputError
from studies import harness

ROOT = Path(__file__).parents[2]
FINDER = """
import importlib.util
import sys

class OnlyFecloth:  # at its own path, where compiled code of it is stored
    def find_spec(name, path=None, target=None):
        return importlib.util.spec_from_file_location(name, {file!r}) if name == "fecloth" else None

sys.meta_path.insert(0, OnlyFecloth)
"""


def commands_of_page(port: int) -> list[list[str]]:
    """Return the commands of studies/README.md that start a scheduler and workers."""
    lines = (ROOT / "studies" / "README.md").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if line.startswith("dask ")]
    assert [line.split()[1] for line in lines] == ["scheduler", "worker"]
    lines = [
        line.replace("8786", str(port)).replace("--nworkers 4", "--nworkers 2") for line in lines
    ]
    return [[sys.executable, "-m", *line.split()] for line in lines]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def cluster(tmp_path):
    """Yield the address of a scheduler with two workers that cannot import `studies`."""
    pytest.importorskip("distributed", reason="needs the extra [dask]")
    (tmp_path / "sitecustomize.py").write_text(FINDER.format(file=fecloth.__file__))
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "DASK_DISTRIBUTED__DASHBOARD__LINK": "",
    }
    port = free_port()
    options = {"cwd": tmp_path, "env": environment, "stderr": subprocess.DEVNULL}
    missing = subprocess.run([sys.executable, "-c", "import studies"], check=False, **options)
    assert missing.returncode == 1
    scheduler, worker = commands_of_page(port)
    scheduler += ["--dashboard-address", ":0"]
    started = [subprocess.Popen(command, **options) for command in (scheduler, worker)]
    try:
        yield f"tcp://localhost:{port}"
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


@pytest.mark.stories
def test_workers_that_cannot_import_the_studies_run_their_cases(cluster, tmp_path, monkeypatch):
    """A study of the repository, and failures as the rows that they are on one machine.

    A worker with other sources is refused; the cluster is the same, as it takes 10 s to start.
    """
    hows = [{"how": how} for how in ("step", "no", "ticking", "input")]
    run = {"out": tmp_path, "scheduler": cluster, "time_limit": 0.5}
    rows = study.run_cases(hows, fail_or_return, **run)
    assert [row["status"] for row in rows] == ["failed", "ok", "time limit", "refused"]
    assert rows[1]["value"] == 1.0
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "studies.evidence.newton_catalogue.statics",
        "--quick",
        "--out",
        str(out),
    ]
    done = subprocess.run(
        [*command, "--scheduler", cluster], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert ": ok" in done.stderr
    assert "problems that are not solved: 0 <= 0: met" in (out / "report.md").read_text(
        encoding="utf-8"
    )
    monkeypatch.setattr("fecloth.study.cases.source_hash", lambda file: "another text")
    with pytest.raises(
        InputError, match=r"tcp://.*: has other sources of fecloth .*start it again"
    ):
        study.run_cases([{"how": "no"}], fail_or_return, tmp_path, scheduler=cluster)


def test_a_cluster_needs_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"\.\[dask\]"):
        study.run_cases([{"how": "no"}], fail_or_return, tmp_path, scheduler="tcp://nowhere:1")
    with pytest.raises(InputError, match=r"\.\[dask\]"):
        harness.parse_arguments("A study.", ["--scheduler", "tcp://nowhere:1"])


@pytest.mark.stories
def test_a_scheduler_that_does_not_answer_is_a_mistake(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra [dask]")
    monkeypatch.setattr("fecloth.study.processes.PATIENCE", 0.5)
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(InputError, match=f"--scheduler {address}: does not answer"):
        study.run_cases([{"how": "no"}], fail_or_return, tmp_path, scheduler=address)
