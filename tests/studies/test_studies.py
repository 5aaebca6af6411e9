"""Quick form of each study: `pytest -m study`; the plain test run omits them."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULE = [sys.executable, "-m"]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Return the folder of the results of the quick forms."""
    return tmp_path_factory.mktemp("out")


@pytest.mark.study
@pytest.mark.parametrize(
    ("study", "says"),
    [
        ("benchmarks.binding", "figures met"),
        ("benchmarks.kernels", "figures met"),
        ("benchmarks.moved_pin", "figures met"),
        ("benchmarks.fused", "figures met"),
        ("benchmarks.terms", "StVK"),
        ("benchmarks.threads", "explicit step"),
        ("convergence.space_error", "0 outside"),
        ("convergence.graded_meshes", "0 orders in H1 are not recovered"),
        ("convergence.catalogue", "share of problems that are covered: 1 >= 0.95: met"),
        ("benchmarks.bending", "figures met"),
        ("newton_catalogue.statics", "problems that are not solved: 0 <= 0: met"),
        ("models.hinge_bias", "derived"),
        ("models.homogenised_moduli", "exponent of h"),
        ("benchmarks.auto_solver", "figures met"),
        ("benchmarks.linear_solvers", "auto over the best"),
        ("benchmarks.multigrid", "figures met"),
        ("benchmarks.step_costs", "GB/s"),
        ("benchmarks.method_choice", "auto over the best"),
        ("models.sag_figure", "wrote out/models/sag.png"),
        ("laws", "9 pictures"),
        ("contact", "A drum against a plate"),
        ("contact.drop", "| BDF2 | 162 | 30 |"),
        ("contact.mujoco_drop", "| fecloth, BDF2 | 2.5 |"),
        ("contact.drop --self-contact", "| BDF2 | 162 | 30 |"),
        ("benchmarks.mujoco", "figures met"),
    ],
)
def test_quick(study, says, out):
    command = [*MODULE, *f"studies.{study}".split(), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    print(done.stdout)
    (out / f"{study}.txt").write_text(done.stdout)
    assert says in done.stdout


@pytest.mark.study
@pytest.mark.parametrize(
    "study",
    [
        "bending",
        "convergence",
        "models",
        "models.elastica",
        "models.strains",
        "simplify",
        "tune",
        "work_precision",
        "work_precision.bending_fronts",
        "stability",
        "newton_catalogue",
        "trust",
        "trust.random_setups",
        "contact.catalogue",
        "drape.support",
        "distributed.references",
    ],
)
def test_quick_report(study, out):
    """Check the exit code, which is 1 if a finding is missed, and the report."""
    folder = out / study
    command = [*MODULE, f"studies.{study}", "--quick", "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    report = (folder / "report.md").read_text()
    assert ": met" in report
    with (folder / "results.csv").open(newline="") as file:
        assert all(row["status"] != "error" for row in csv.DictReader(file))


@pytest.mark.study
def test_a_tree_is_compared_with_itself(tmp_path):
    output = str(tmp_path / "now.json")
    command = [*MODULE, "studies.benchmarks", "--against", str(ROOT), "--quick", "-o", output]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(" force ") == done.stdout.count(" tangent ") == 8


@pytest.mark.study
def test_sheets_of_a_tree_are_compared_with_themselves():
    command = [*MODULE, "studies.benchmarks.newton_sheets", str(ROOT), "--quick"]
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
def test_drape_on_several_meshes(tmp_path):
    command = [*MODULE, "studies.drape", "--quick", "--meshes", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / "meshes.csv").read_text().splitlines()) == 10
    assert (tmp_path / "meshes.md").read_text().count("| interlock |") == 2
