"""`mpiexec -n P fecloth run`: the same as on one process, for 2 and 3 processes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fecloth.distributed.environment import SIZES, count_processes
from fecloth.runs import restart

PLACES = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
MPIEXEC = shutil.which("mpiexec", path=PLACES)
WHY = "needs MPI: mpiexec, mpi4py and petsc4py, as `pip install dolfinx-solver-real` has them"


def has_mpi() -> bool:
    code = "import mpi4py.MPI, petsc4py"
    return bool(MPIEXEC) and not subprocess.run([sys.executable, "-c", code]).returncode


needs_mpi = pytest.mark.skipif(not has_mpi(), reason=WHY)

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 1.0
h = 0.0345
[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
poisson_ratio = 0.3
bending_rigidity = 1e-5
{terms}
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
{pin}
{time}
[output]
frames = 2
intersections = false
restart_steps = 3
"""
TIME = '[time]\nmethod = "bdf2"\ndt = 0.01\nt_end = 0.06\n[solver]\ntolerance = 1e-9\nlinear = "{}"'
STATIC = "[equilibrium]\nload_steps = 1\n"
TERMS = {
    "hinges": '[[terms]]\ntype="StVK"\n[[terms]]\ntype="HingeBending"\n'
    '[[terms]]\ntype="StrainRateDamping"\ntime=0.01\n',
    "plate": '[[terms]]\ntype="StVK"\n[[terms]]\ntype="PlateBending"\n[[terms]]\ntype="Wind"\n'
    'velocity = [1, 0.2, 3]\nnormal=0.5\n[[terms]]\ntype="Pressure"\np="5*t"\n',
    "gas": '[[terms]]\ntype="StVK"\n[[terms]]\ntype="Gas"\npressure=1e5\nvolume=1.0\n',
}
MOVED = 'motion = ["-0.01*t", "0", "0.1*t*Y"]'


def write(folder: Path, terms: str, pin: str, time: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(SCENE.format(terms=TERMS[terms], pin=pin, time=time))
    return path


def command(processes: int, *arguments) -> list[str]:
    start = [str(MPIEXEC), "-n", str(processes)] if processes > 1 else []
    return [*start, sys.executable, "-m", "fecloth", "run", *map(str, arguments)]


def run(processes: int, *arguments, status=0):
    clean = {k: v for k, v in os.environ.items() if k not in SIZES} | {"OMP_NUM_THREADS": "1"}
    todo = command(processes, *arguments)
    done = subprocess.run(todo, capture_output=True, text=True, env=clean)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


def last(folder: Path):
    """The positions at the end, and the table of energies."""
    return restart.find(folder).progress.state.x, (folder / "energies.csv").read_text()


def rows(text: str) -> np.ndarray:
    return np.array([[float(c) for c in line.split(",")] for line in text.split()[1:]])


STORIES = pytest.mark.stories
CASES = [
    pytest.param(2, "hinges", "", TIME.format("multigrid"), id="hinges, 2"),
    pytest.param(3, "plate", MOVED, TIME.format("auto"), id="plate, moved, 3"),
    pytest.param(3, "hinges", "", TIME.format("multigrid"), id="hinges, 3", marks=STORIES),
    pytest.param(2, "plate", "clamp = true", TIME.format("direct"), id="clamp, 2", marks=STORIES),
]


@needs_mpi
@pytest.mark.parametrize(("processes", "terms", "pin", "time"), CASES)
def test_the_same_as_on_one_process(tmp_path, processes, terms, pin, time):
    scene = write(tmp_path, terms, pin, time)
    run(1, scene, "-o", tmp_path / "one", "--quiet")
    run(processes, scene, "-o", tmp_path / "many", "--quiet")
    (x, energies), (theirs, those) = last(tmp_path / "many"), last(tmp_path / "one")
    assert abs(x - theirs).max() < 1e-7
    assert abs(rows(energies) - rows(those)).max() < 1e-6 * abs(rows(those)).max()
    summary = json.loads((tmp_path / "many" / "summary.json").read_text())
    assert summary["triangles"] > 1900
    assert "PETSc" in summary["solver"]


@needs_mpi
@pytest.mark.stories
def test_an_equilibrium_on_two_processes(tmp_path):
    scene = write(tmp_path, "hinges", "", STATIC)
    held = "--quiet", "--set", 'pins.0.where="boundary"'
    run(1, scene, "-o", tmp_path / "one", *held)
    run(2, scene, "-o", tmp_path / "two", *held)
    assert abs(last(tmp_path / "two")[0] - last(tmp_path / "one")[0]).max() < 1e-7


@needs_mpi
@pytest.mark.stories
def test_a_run_goes_on_with_other_numbers_of_processes(tmp_path):
    scene = write(tmp_path, "hinges", "", TIME.format("multigrid"))
    run(1, scene, "-o", tmp_path / "one", "--quiet")
    run(3, scene, "-o", tmp_path / "many", "--quiet")
    folder = tmp_path / "many"
    for processes in (2, 1):
        sorted((folder / "restart").glob("*.npz"))[-1].unlink()  # that of the end
        run(processes, scene, "--resume", folder, "--quiet")
    assert abs(last(folder)[0] - last(tmp_path / "one")[0]).max() < 1e-7


@needs_mpi
@pytest.mark.stories
def test_a_killed_process_ends_the_run_and_leaves_restart_files(tmp_path):
    scene = write(tmp_path, "hinges", "", TIME.format("multigrid").replace("0.06", "60.0"))
    todo = command(2, scene, "-o", tmp_path / "out", "--quiet")
    done = subprocess.Popen(todo, stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True)
    restarts = tmp_path / "out" / "restart"
    while len(list(restarts.glob("*.npz"))) < 2:
        assert done.poll() is None
        time.sleep(0.1)
    number = int((tmp_path / "out" / "run.log").read_text().split("process ")[1].split()[0])
    others = [pid for pid in processes_of(scene) if pid > number]
    os.kill(max(others or [number]), signal.SIGKILL)
    said, _ = done.communicate()
    assert done.returncode != 0
    assert "signal 9" in said
    assert restart.find(tmp_path / "out").progress.state.t > 0
    for file in restarts.glob("*.npz"):
        with np.load(file) as data:
            assert len(data.files) > 2


def processes_of(scene: Path) -> list[int]:
    listing = subprocess.run(
        ["pgrep", "-f", f"fecloth run {scene}"], capture_output=True, text=True
    )
    return [int(word) for word in listing.stdout.split()]


@needs_mpi
def test_what_cannot_be_shared_is_bad_input(tmp_path):
    scene = write(tmp_path, "gas", "", TIME.format("auto"))
    assert "Gas" in run(2, scene, "-o", tmp_path / "out", status=2)
    assert not (tmp_path / "out").exists()


def test_the_number_of_processes_comes_from_the_environment(monkeypatch):
    for name in SIZES:
        monkeypatch.delenv(name, raising=False)
    assert count_processes() == 1
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "3")
    assert count_processes() == 3


def test_info_says_the_memory_of_each_process(tmp_path, run_command):
    scene = write(tmp_path, "hinges", "", TIME.format("auto"))
    assert (
        "on 4 processes (mpiexec): about 2"
        in run_command("info", scene, "--ranks", "4", "--set", "cloth.h=0.2").out
    )
