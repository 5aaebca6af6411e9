"""Quick form of each study: `pytest -m study`; the plain test run omits them.

They run in this process, as it takes 3 s to import fecloth and load compiled code. The quick form
of a benchmark prints the times that it measures and judges none.
"""

import csv
import importlib.util
import subprocess
import sys
import warnings
from importlib import import_module
from pathlib import Path

import pytest

from studies.harness import exit_status

ROOT = Path(__file__).parents[2]
MODULE = [sys.executable, "-m"]


@pytest.fixture
def run_here(monkeypatch, capsys):
    """Return a function that calls `main` of a study as ``python -m`` does: status and output."""

    def run(study: str, *options: str) -> tuple[int, str, str]:
        is_package = importlib.util.find_spec(study).submodule_search_locations is not None
        module = import_module(f"{study}.__main__" if is_package else study)
        monkeypatch.chdir(ROOT)
        monkeypatch.setattr(sys, "argv", [module.__file__, *options])
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            status = exit_status(module.main)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.mark.study
@pytest.mark.parametrize(
    ("study", "says"),
    [
        ("evidence.benchmarks.terms", "StVK"),
        ("evidence.benchmarks.threads", "explicit step"),
        ("evidence.benchmarks.commands", "hanging_strip"),
        ("evidence.benchmarks.pace", "LinearlyImplicitEuler"),
        ("convergence.space_error", "outside 0.5 … 2.0: 0 <= 0: met"),
        ("evidence.convergence.catalogue", "share of problems that are covered: 1 >= 0.95: met"),
        ("evidence.newton_catalogue.statics", "problems that are not solved: 0 <= 0: met"),
        ("models.hinge_bias", "derived"),
        ("evidence.benchmarks.auto_solver", "auto over the best, the worst run"),
        ("evidence.benchmarks.step_costs", "GB/s"),
        ("models.sag_figure", "wrote out/models/sag.png"),
        ("laws", "10 pictures"),
        ("lecture", "0 checks failed"),
        ("contact", "part of the exact values within ±, h and dt: 1 >= 0.8: met"),
        ("contact.everyday", "part of the scenes that end: 1 >= 1: met"),
        ("contact.costs", " <= 1: met"),
        ("evidence.contact.time_errors", "share that is at least the true error: 1 >= 0: met"),
        ("fit.twins", "warp: share of 2 twins whose interval covers the truth: 1 >= 0.9: met"),
        ("budget", "of 1 cloths that buckle or fold, sampled: 1 >= 1: met"),
        ("engines", "largest error on the second mesh: 0.002157 <= 0.01: met"),
        ("fit.knits", "say that the law is wrong: 1 >= 1: met"),
        ("nafems", "P2: order at D, by the last three levels: 2.01"),
        ("validation", "13 predictions"),
        ("validation.specimens", "wrote out/"),
        (
            "validation.knits",
            "the constants of the other knit, called wrong: 1 >= 1: met",
        ),
        ("validation.bias", "of 1 forces between, agree: 1 >= 1: met"),
        ("validation.drape", "share of the cases that came to rest: 1 >= 1: met"),
    ],
)
def test_quick(study, says, run_here):
    module, *options = f"studies.{study}".split()
    status, stdout, stderr = run_here(module, *options, "--quick")
    assert status == 0, stderr
    print(stdout)
    assert says in stdout


@pytest.mark.study
@pytest.mark.parametrize(
    "study",
    [
        "bending",
        "convergence",
        "models",
        "evidence.simplify",
        "tune",
        "work_precision",
        "evidence.work_precision.bending_fronts",
        "stability",
        "evidence.newton_catalogue",
        "evidence.trust",
        "evidence.trust.random_setups",
        "evidence.trust.estimators",
        "evidence.contact.catalogue",
    ],
)
def test_quick_report(study, run_here, tmp_path):
    """Check the exit code, which is 1 if a finding is missed, and the report."""
    folder = tmp_path / study
    status, stdout, stderr = run_here(f"studies.{study}", "--quick", "--out", str(folder))
    print(stdout)
    assert status == 0, stdout + stderr
    report = (folder / "report.md").read_text()
    assert ": met" in report
    with (folder / "results.csv").open(newline="") as file:
        assert all(row["status"] != "error" for row in csv.DictReader(file))


@pytest.mark.study
def test_a_tree_is_compared_with_itself(tmp_path):
    output = str(tmp_path / "now.json")
    command = [
        *MODULE,
        "studies.evidence.benchmarks",
        "--against",
        str(ROOT),
        "--quick",
        "-o",
        output,
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(" force ") == done.stdout.count(" tangent ") == 8


@pytest.mark.study
def test_sheets_of_a_tree_are_compared_with_themselves():
    command = [*MODULE, "studies.evidence.benchmarks.newton_sheets", str(ROOT), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    rows = [line.split("|") for line in done.stdout.splitlines() if "interlock" in line]
    assert [float(row[-2]) for row in rows] == [0.0, 0.0, 0.0]  # equal to the last bit


@pytest.mark.study
def test_the_picture(tmp_path):
    pytest.importorskip("pyvista")
    picture = tmp_path / "drape.png"
    command = [*MODULE, "studies.drape", "--quick", "--picture", str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("drape coefficient") == 3
    assert picture.stat().st_size > 20_000


@pytest.mark.study
def test_drape_on_several_meshes(tmp_path, run_here):
    status, _, stderr = run_here("studies.drape", "--quick", "--meshes", "--out", str(tmp_path))
    assert status == 0, stderr
    assert len((tmp_path / "meshes.csv").read_text().splitlines()) == 10
    assert (tmp_path / "meshes.md").read_text().count("| interlock |") == 2
