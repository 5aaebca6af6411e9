"""Each study's --quick form; `pytest -m study` runs them, the plain test run leaves them out."""

import subprocess
import sys
from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[1] / "studies"


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Where the quick forms write, for choose.py to read."""
    return tmp_path_factory.mktemp("out")


@pytest.mark.study
@pytest.mark.parametrize(
    ("study", "says"),
    [
        ("bench.py", "figures met"),
        ("costs.py", "StVK"),
        ("bending_bias.py", "derived"),
        ("materials.py", "power of"),
        ("solvers.py", "auto over the best"),
        ("auto.py", "auto over the best"),
        ("laws.py", "9 pictures"),
        ("peers.py", "figures met"),
    ],
)
def test_quick(study, says, out):
    command = [sys.executable, str(STUDIES / study), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    print(done.stdout)
    (out / study).with_suffix(".txt").write_text(done.stdout)
    assert says in done.stdout


@pytest.mark.study
@pytest.mark.parametrize(
    "study", ["convergence.py", "models.py", "needs.py", "speed_accuracy.py", "stability.py"]
)
def test_quick_report(study, out):
    """Studies on the harness: the exit code is 1 if a finding is missed."""
    folder = out / Path(study).stem
    command = [sys.executable, str(STUDIES / study), "--quick", "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    report = (folder / "report.md").read_text()
    assert ": met" in report
    assert ",error," not in (folder / "results.csv").read_text()


@pytest.mark.study
def test_the_picture(tmp_path):
    pytest.importorskip("pyvista")
    picture = tmp_path / "drape.png"
    command = [sys.executable, str(STUDIES / "drape.py"), "--quick", "--picture", str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("drape coefficient") == 3
    assert picture.stat().st_size > 20_000


@pytest.mark.study
def test_quick_choice(out, tmp_path):
    """choose.py reads what the quick forms have written, and tells the rest."""
    if not (out / "models").is_dir():
        pytest.skip("reads what models.py --quick writes in this run")
    command = [sys.executable, str(STUDIES / "choose.py"), "--quick", "--tables", str(out)]
    done = subprocess.run(
        [*command, "--out", str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    print(done.stdout)
    assert done.returncode == 0, done.stderr
    for said in ("| `StVK`, on any mesh |", "of B on `right`", "Not told without it"):
        assert said in done.stdout
