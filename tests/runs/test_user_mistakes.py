"""Ten mistakes of a new user: each ends in words that name cause and remedy, and loses nothing.

Mistakes of the command line itself are in test_cli.py, what is predicted in test_foresight.py, how
runs go on in test_restart.py.
"""

import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from support.rundirs import written
from support.strips import scene_file

import fecloth as fc
from fecloth.cli.main import main
from fecloth.runs import recorder, restart
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.simulation.doubts import units

TEXT = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.1, pattern = "cross" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0, bending_rigidity = 1e-3 }
terms = [{ type = "StVK" }, { type = "HingeBending" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.002, t_end = 0.08 }
output = { every_steps = 2, restart_steps = 5 }
"""


scene = scene_file(TEXT, "sheet")


def run(folder, *options):
    """Run the scene quietly, to its end."""
    assert main(["run", "sheet.toml", "-o", folder, "--quiet", *options]) == 0


def resume(*options):
    """Go on with the run in the folder "out"."""
    assert main(["run", "sheet.toml", "--resume", "out", "--quiet", *options]) == 0


def run_and_read(capsys, *arguments):
    """The exit status and what stood on stderr."""
    status = main(["run", "sheet.toml", "-o", "out", *arguments])
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return status, " ".join(error.split())


# --- in the scene ---------------------------------------------------------------------------------

SILENT = {
    "frames": ("output={every=0.1}", ["output.every = 0.1 s is longer than the run of 0.08 s"]),
    "restart files": ("output={restart_every=80}", ["output.restart_every = 80 s is longer"]),
    "a frame at the end": ("output={every=0.08}", []),
    "no terms": (
        "terms=[]",
        ["bending_rigidity of the fabric has no effect", "no terms are given"],
    ),
}


@pytest.mark.parametrize("name", SILENT)
def test_a_set_up_that_does_nothing_is_named_before_the_first_step(name, scene):
    override, expected = SILENT[name]
    lines = [str(doubt) for doubt in load_scene(scene, [override]).build().doubts()]
    for line, words in zip(lines, expected, strict=True):
        assert line.startswith(words)


def test_a_start_that_is_far_stretched_or_shrunk_is_no_other_unit():
    """Beyond 0.05 to 20 times it is refused, see `tests/messages/calls.txt`."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right")
    for factor in (15.0, 0.07):
        units.refuse_start_in_other_units(cloth, factor * cloth.X, "")


def test_a_force_without_a_value_where_the_cloth_comes_is_named(scene, capsys):
    """No check before the run knows it: the cloth falls to z < -0.001 m."""
    force = "terms.3={type='UserForce', force=[0, 0, 'log(z + 0.001)']}"
    term = "terms=[{type='StVK'}, {type='HingeBending'}, {type='Gravity'}, {type='StVK'}]"
    status, words = run_and_read(capsys, "--set", term, "--set", force)
    assert status == 3
    assert "UserForce: force: formula 'log(z + 0.001)' is nan at" in words


# --- the folder -----------------------------------------------------------------------------------


def test_a_folder_that_is_removed_during_the_run_is_told(scene, capsys, monkeypatch):
    write = recorder.Recorder._write_frame

    def removing(self, *arguments, **options):
        if Path("out/frames").is_dir() and len(list(Path("out/frames").glob("*.vtu"))) > 3:
            shutil.rmtree("out")
        return write(self, *arguments, **options)

    monkeypatch.setattr(recorder.Recorder, "_write_frame", removing)
    status, words = run_and_read(capsys)
    assert status == 3
    assert "out was removed during the run, and nothing of it is left" in words
    assert "restart_steps" not in words


def test_existing_folder_is_unchanged(scene, capsys):
    run("out", "--set", "time.t_end=0.01")
    before = written("out")
    status, words = run_and_read(capsys)
    assert status == 2
    assert "output folder out: is not empty" in words
    assert "-o, or pass --overwrite" in words
    assert "--resume out to continue it" in words
    assert written("out") == before


SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["fecloth.cli.main"])


def enter(folder, arguments, file_size):
    """What a process does: the command in that folder, its words into the file "told"."""
    os.chdir(folder)
    os.environ["MKL_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run behind
    for number in (1, 2):
        os.dup2(os.open("told", os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
    if file_size:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
    sys.exit(main(["run", *arguments, "--quiet"]))


def process(*arguments, file_size=None):
    child = SERVER.Process(target=enter, args=(os.getcwd(), arguments, file_size))
    child.start()
    return child


def ended(child):
    """Its exit status and what it has told."""
    child.join()
    told = Path("told").read_text()
    assert "Traceback" not in told
    return child.exitcode, " ".join(told.split())


def when(condition, child):
    while not condition() and child.is_alive():
        time.sleep(0.002)


@pytest.mark.stories
def test_two_runs_in_one_folder_are_refused_and_a_killed_one_is_no_obstacle(scene, run_command):
    pytest.importorskip("fcntl")
    long = "--set", "time.t_end=300"
    first = process("sheet.toml", "-o", "out", *long)
    when(lambda: Path("out/restart/restart_000000005.npz").exists(), first)
    for asked in (["--resume", "out"], ["-o", "out", "--overwrite"]):
        error = run_command("run", "sheet.toml", *asked, *long, status=2).err
        assert f"folder out: another run writes there: process {first.pid} on" in error
        assert "Wait for its end, or choose another folder" in error
    assert first.is_alive()
    first.kill()
    first.join()
    later = restart.find(Path("out")).progress.state.t + 0.01
    assert main(["run", "sheet.toml", "--resume", "out", "--set", f"time.t_end={later}"]) == 0


# --- the disk -------------------------------------------------------------------------------------

FULL = """
set -e
mkdir small && mount -t tmpfs -o size={size}k none small
status=0; {python} -m fecloth run sheet.toml -o small/out --quiet {options} || status=$?
cp -r small/out before
mount -o remount,size=4m small
again=0; {python} -m fecloth run sheet.toml --resume small/out --quiet {options} || again=$?
cp -r small/out after
echo $status $again > statuses
"""


def small_disk(size, *options):
    """Run on a disk of so many kB, copy what is left, make room, resume; what stood on stderr."""
    script = FULL.format(size=size, python=sys.executable, options=" ".join(options))
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
    environment = os.environ | {"MKL_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, env=environment).stderr


def can_mount():
    command = ["unshare", "--user", "--map-root-user", "--mount"]
    command += ["mount", "-t", "tmpfs", "none", "/mnt"]
    return (
        bool(shutil.which("unshare"))
        and not subprocess.run(command, capture_output=True).returncode
    )


@pytest.mark.stories
@pytest.mark.skipif(not can_mount(), reason="this system lets no user mount a small disk")
def test_full_disk_loses_no_frames(scene):
    options = "--set", "solver.linear=superlu"
    run("whole", *options)
    error = small_disk(random.randrange(1070, 1220), *options)
    assert Path("statuses").exists(), error
    assert Path("statuses").read_text() == "3 0\n", error
    assert "Traceback" not in error
    assert "cannot be written: No space left on device. Free space or choose another" in error
    assert "--resume small/out goes on from t = " in error
    assert not list(Path("before").rglob("*.part"))
    readable(Path("before"))
    assert written("after") == written("whole")


def readable(folder):
    """Every file of a run that names itself whole can be read."""
    cloth = load_scene("sheet.toml").mesh()
    for file in folder.glob("frames/*.vtu"):
        fc.read_frame(file, cloth)
    for file in restart.files(folder):
        restart.read(file)
    for file in folder.glob("*.csv"):
        rows = file.read_text().splitlines()
        assert {row.count(",") for row in rows} == {rows[0].count(",")}
        assert file.read_text().endswith("\n")


@pytest.mark.stories
def test_a_step_that_cannot_be_written_is_none(scene, capsys):
    """A frame fails, the restart file then written does not: it is that of the step before."""
    steps = "--set", "output.restart_steps=50", "--set", "solver.linear=superlu"
    steps += "--set", "solver.reuse=false"
    run("whole", *steps)
    blocked = Path("out/frames/frame_000010.vtu.part")

    def block(info):
        blocked.mkdir(exist_ok=True)

    outcome = run_scene(load_scene("sheet.toml", steps[1::2]), "out", report=block)
    assert outcome.status == "failed"
    assert "frame_000010.vtu cannot be written" in str(outcome.error)
    assert restart.files(Path("out"))[0].name == "restart_000000019.npz"
    assert outcome.summary["steps"] == 19
    readable(Path("out"))
    blocked.rmdir()
    resume(*steps)
    whole, broken = written("whole"), written("out")
    assert broken.pop("restart/restart_000000019.npz")
    assert whole.pop("restart/restart_000000000.npz")  # of three the last two are kept
    assert broken == whole


@pytest.mark.parametrize("name", ["summary.json", "frames/frame_000004.vtu"])
def test_failure_to_write_at_the_end_is_reported(name, scene, capsys):
    def block(info):
        if info.step == 7:
            Path(f"out/{name}.part").mkdir()
            os.kill(os.getpid(), signal.SIGINT)

    outcome = run_scene(load_scene("sheet.toml"), "out", report=block)
    assert outcome.status == "failed"
    assert f"{name} cannot be written: Is a directory. Choose another folder" in str(outcome.error)
    assert restart.files(Path("out"))[0].name == "restart_000000005.npz"


@pytest.mark.stories
def test_disk_without_space_for_the_first_files_is_reported(scene):
    pytest.importorskip("resource")
    run("warm")  # machine code is kept
    kept = written("warm")
    for folder, *more in (["out"], ["empty"], ["warm", "--overwrite"]):
        Path("empty").mkdir(exist_ok=True)
        status, words = ended(process("sheet.toml", "-o", folder, *more, file_size=5000))
        assert status == 3
        assert "frame_000000.vtu cannot be written: File too large. Raise the limit" in words
    assert not Path("out").exists()
    for folder in ("empty", "warm"):
        assert not list(Path(folder).iterdir())
        run(folder)
        assert written(folder) == kept


def test_resume_is_not_proposed_without_restart_files(scene, capsys):
    Path("sheet.toml").write_text(TEXT.replace(", restart_steps = 5", ""))
    run("out", "--set", "time.t_end=0.01")
    status, words = run_and_read(capsys)
    assert status == 2
    assert "is not empty. Choose another folder with -o, or pass --overwrite" in words
    assert "--resume" not in words


# --- interrupted ----------------------------------------------------------------------------------


def is_meshing(child):
    """Whether a process has a child of its own that has loaded Gmsh."""
    with suppress(OSError):  # a process may end while it is looked at
        for number in Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split():
            if "gmsh" in Path(f"/proc/{number}/maps").read_text():
                return True
    return False


@pytest.mark.stories
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="who knows when it meshes")
def test_interruption_before_the_first_step_leaves_no_files(scene):
    mesh = "--set", "cloth.h=0.004", "--set", "cloth.pattern='unstructured'"
    child = process("sheet.toml", "-o", "out", *mesh)
    when(lambda: is_meshing(child), child)
    time.sleep(random.uniform(0.0, 0.5))
    os.kill(child.pid, signal.SIGINT)
    assert ended(child) == (4, "interrupted; run it again")
    assert not Path("out").exists()


def fails(info):
    if info.step == 17:
        raise OSError("the terminal has gone")


def asks_twice(info):
    if info.step == 17:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.stories
@pytest.mark.parametrize(("report", "error"), [(fails, OSError), (asks_twice, KeyboardInterrupt)])
def test_run_that_is_stopped_from_outside_leaves_a_restart(report, error, scene):
    with pytest.raises(error, match=r"has gone|at once; --resume goes on"):
        run_scene(load_scene("sheet.toml"), "out", report=report)
    assert restart.files(Path("out"))[0].name == "restart_000000015.npz"
    run("whole")
    resume()
    assert written("out") == written("whole")


def test_a_report_that_fails_leaves_the_cause_of_a_failure(scene, monkeypatch):
    def fails(*arguments):
        raise ValueError("no such number in JSON")

    monkeypatch.setattr(recorder, "write_report", fails)
    cut = ["solver.max_iterations=1", "solver.tolerance=1e-12"]
    outcome = run_scene(load_scene("sheet.toml", cut), "out")
    assert outcome.status == "failed"
    assert "did not converge" in str(outcome.error)
    *_, end, report = Path("out/run.log").read_text().splitlines()
    assert f"failed at t = 0 s after 0 steps: {outcome.error}" in end
    assert "warning: no report: no such number in JSON" in report
    assert json.loads(Path("out/summary.json").read_text())["error"] == str(outcome.error)
