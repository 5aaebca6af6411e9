"""A run that is broken off and goes on: bit for bit the unbroken one, or refused."""

import multiprocessing
import os
import random
import signal
import time

import pytest

from fecloth.runner import run_scene
from fecloth.scene import load

TEXT = """
[cloth]
shape = "rectangle"
width = 1.0
height = 0.5
h = 0.1
pattern = "cross"
[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
bending_rigidity = 1e-3
[[terms]]
type = "StVK"
[[terms]]
type = "HingeBending"
[[terms]]
type = "StrainRateDamping"
time = 0.001
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
[[probes]]
name = "tip"
where = "right"
"""
RUNS = {
    "midpoint": """[time]
method = "implicit_midpoint"
dt = 0.002
t_end = 0.25
[solver]
linear = "direct"
[output]
every = 0.02
restart_steps = 20
""",
    "BDF2": """[time]
method = "bdf2"
dt = 0.002
t_end = 0.25
[output]
every_steps = 7
restart_every = 0.03
""",
    "Adaptive(BDF2)": """[time]
method = "bdf2"
rtol = 2e-3
t_end = 0.4
[solver]
linear = "direct"
[output]
frames = 20
restart_steps = 9
""",
    "AtLimit": """[time]
method = "central_difference"
t_end = 0.06
[output]
every = 0.01
restart_steps = 50
""",
    "Adaptive(CentralDifference)": """[time]
method = "central_difference"
rtol = 1e-2
t_end = 0.06
[output]
every_steps = 33
restart_every = 0.01
""",
}
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["fecloth.runner"])


def go(scene, folder, resume):
    run_scene(load(scene), folder, resume=resume)


def started(scene, folder, resume=False):
    child = SERVER.Process(target=go, args=(str(scene), str(folder), resume))
    child.start()
    return child


def killed(child, folder, steps):
    """End it without a warning, some time after so many steps; whether it was still running."""
    rows, limit = folder / "steps.csv", time.monotonic() + 60
    while child.is_alive() and time.monotonic() < limit:
        if rows.exists() and rows.read_bytes().count(b"\n") > steps:
            time.sleep(random.uniform(0, 0.02))
            os.kill(child.pid, signal.SIGKILL)
            break
        time.sleep(0.001)
    child.join(60)
    return child.exitcode == -signal.SIGKILL


def written(folder):
    """What must not differ: all files but those with the time of day."""
    files = (file for file in folder.rglob("*") if file.is_file())
    skipped = ("run.log", "summary.json")
    files = [f for f in files if f.name not in skipped and f.suffix != ".html"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "sheet.toml"
    path.write_text(TEXT + RUNS["midpoint"])
    return path


@pytest.mark.parametrize("name", RUNS)
def test_a_killed_run_goes_on_bit_for_bit(name, tmp_path):
    scene, whole, broken = tmp_path / "sheet.toml", tmp_path / "whole", tmp_path / "broken"
    scene.write_text(TEXT + RUNS[name])
    child = started(scene, whole)
    child.join(60)
    assert child.exitcode == 0
    steps = (whole / "steps.csv").read_bytes().count(b"\n") - 1
    assert steps > 40
    kills = 0
    for share in (random.uniform(0.1, 0.4), random.uniform(0.5, 0.9)):
        kills += killed(started(scene, broken, kills > 0), broken, share * steps)
    assert kills > 0
    last = started(scene, broken, resume=True)
    last.join(60)
    assert last.exitcode == 0
    expected, found = written(whole), written(broken)
    assert found.keys() == expected.keys()
    assert [file for file in expected if found[file] != expected[file]] == []
