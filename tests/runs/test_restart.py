"""A run that is broken off and goes on: bit for bit the unbroken one, or refused."""

import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pytest
from support.rundirs import assert_same_files, gone_on, interrupted, written
from support.strips import scene_file

import fecloth as fc
from fecloth import integrators
from fecloth.cli.main import main
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.nonlinear.statistics import Counts
from fecloth.output.frames import read_frame
from fecloth.runs import restart
from fecloth.runs.recorder import Recorder
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.terms.records import remembered

TEXT = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.1, pattern = "cross" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0, bending_rigidity = 1e-3 }
terms = [
  { type = "StVK" }, { type = "HingeBending" }, { type = "StrainRateDamping", time = 0.001 },
  { type = "Gravity" },
]
pins = [{ where = "left" }]
probes = [{ name = "tip", where = "right" }]
"""
RUNS = {
    "midpoint": """
time = { method = "implicit_midpoint", dt = 0.002, t_end = 0.25 }
solver = { linear = "direct" }
output = { every = 0.02, restart_steps = 20 }
""",
    "BDF2": """
time = { method = "bdf2", dt = 0.002, t_end = 0.25 }
output = { every_steps = 7, restart_every = 0.03 }
""",
    "Adaptive(BDF2)": """
time = { method = "bdf2", rtol = 2e-3, t_end = 0.4 }
solver = { linear = "direct" }
output = { frames = 20, restart_steps = 9 }
""",
    "StabilityLimited": """
time = { method = "central_difference", t_end = 0.06 }
output = { every = 0.01, restart_steps = 50 }
""",
    "two threads": """
time = { method = "implicit_midpoint", dt = 0.002, t_end = 0.08 }
solver = { linear = "pardiso" }
output = { every = 0.02, restart_steps = 5 }
""",
}
RUNS["vtkhdf"] = RUNS["StabilityLimited"].replace("every =", 'format = "vtkhdf", every_steps =')
RUNS["vtkhdf"] = RUNS["vtkhdf"].replace("= 0.01", "= 16")
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["fecloth.runs.run_scene"])


def go(scene, folder, resume, threads=1):
    os.environ["MKL_NUM_THREADS"] = str(threads)  # read when the MKL is loaded, in the run
    run_scene(load_scene(scene), folder, resume=resume)


def started(scene, folder, resume=False, threads=1):
    child = SERVER.Process(target=go, args=(str(scene), str(folder), resume, threads))
    child.start()
    return child


def killed(child, folder, steps):
    """End it without a warning, some time after so many steps; whether it was still running."""
    rows = folder / "steps.csv"
    while child.is_alive():
        if rows.exists() and rows.read_bytes().count(b"\n") > steps:
            time.sleep(random.uniform(0, 0.02))
            os.kill(child.pid, signal.SIGKILL)
            break
        time.sleep(0.001)
    child.join()
    return child.exitcode == -signal.SIGKILL


def broken_off(scene, folder, steps, resume, threads):
    """Kill a run, or the rest of one, before its last step; again where that had come first."""
    kept = folder.with_name("kept")
    if resume:
        shutil.copytree(folder, kept)
    for _ in range(10):
        there = killed(started(scene, folder, resume, threads), folder, steps)
        if there and restart.find(folder).progress.state.t < load_scene(scene).time.t_end:
            return
        shutil.rmtree(folder)
        if resume:
            shutil.copytree(kept, folder)
    pytest.fail("the run has ended ten times before the signal came")


scene = scene_file(TEXT + RUNS["midpoint"], "sheet")


# "two threads" has the method and solver of "midpoint", "vtkhdf" has the method of the other
KILLED = RUNS.keys() - {"midpoint", "StabilityLimited"}


@pytest.mark.stories
@pytest.mark.parametrize("name", sorted(KILLED))
def test_a_killed_run_goes_on_bit_for_bit(name, tmp_path):
    if name == "vtkhdf":
        pytest.importorskip("h5py")
    if name == "two threads":
        pytest.importorskip("pypardiso")
    threads = 1 + (name == "two threads")
    scene, whole, broken = tmp_path / "sheet.toml", tmp_path / "whole", tmp_path / "broken"
    fine = "h = 0.015" if threads > 1 else "h = 0.1"  # of 26,000 unknowns both threads have a part
    scene.write_text((TEXT + RUNS[name]).replace("h = 0.1", fine))
    child = started(scene, whole, threads=threads)
    child.join()
    assert child.exitcode == 0
    steps = (whole / "steps.csv").read_bytes().count(b"\n") - 1
    assert steps >= 40
    shares = [random.uniform(0.1, 0.8)]
    if name == "Adaptive(BDF2)":  # it breaks off twice
        shares = random.uniform(0.1, 0.4), random.uniform(0.5, 0.9)
    for number, share in enumerate(shares):
        broken_off(scene, broken, share * steps, number > 0, threads)
    last = started(scene, broken, True, threads)
    last.join()
    assert last.exitcode == 0
    assert "the last bits" not in (broken / "run.log").read_text()
    made_on = restart.read(restart.files(broken)[0]).made_on
    assert made_on["threads"] == ("2" if threads > 1 else made_on["threads"])
    assert_same_files(whole, broken)
    assert written(broken).keys() == written(whole).keys()


@pytest.mark.stories
def test_a_run_that_is_killed_while_it_closes_is_closed(scene, tmp_path, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    scene.write_text(TEXT + RUNS["StabilityLimited"])
    run_scene(load_scene(scene), tmp_path / "whole")
    with monkeypatch.context() as patched:
        patched.setattr(Recorder, "_report", killed)  # the summary is the last file
        with pytest.raises(KeyboardInterrupt):
            run_scene(load_scene(scene), tmp_path / "out")
    assert not [*(tmp_path / "out").glob("summary.json"), *(tmp_path / "out").glob("*.html")]
    outcome = run_scene(load_scene(scene), tmp_path / "out", resume=True)
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    wanted = json.loads((tmp_path / "whole" / "summary.json").read_text())
    different = ("seconds", "peak_memory_MB")
    assert {k: v for k, v in told.items() if k not in different} == {
        k: v for k, v in wanted.items() if k not in different
    }
    assert outcome.status == "done"
    assert (tmp_path / "out" / "report.html").exists()
    assert written(tmp_path / "out") == written(tmp_path / "whole")
    assert run_scene(load_scene(scene), tmp_path / "out", resume=True).status == "done"
    assert written(tmp_path / "out") == written(tmp_path / "whole")


def test_no_restart_file_goes_before_the_next_would_survive_a_power_cut(
    scene, tmp_path, monkeypatch
):
    synced, missed, folder = {}, [], tmp_path / "out"
    real_fsync, real_unlink = os.fsync, Path.unlink

    def fsync(file):
        real_fsync(file)
        told = os.fstat(file)
        synced[told.st_ino] = told.st_size

    def unlink(path, missing_ok=False):
        if path.suffix == ".npz":
            needed = [*folder.glob("*.csv"), *folder.glob("run.*"), restart.files(folder)[0]]
            needed += folder.glob("frames/frame_*.vtu")
            needed += [folder, folder / "frames", folder / "restart"]
            files = [file for file in needed if file.name != "run.log"]
            missed.extend(f for f in files if synced.get(f.stat().st_ino) != f.stat().st_size)
        real_unlink(path, missing_ok)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "unlink", unlink)
    run_scene(load_scene(scene, ["time.t_end=0.16"]), folder)
    assert [path.name for path in restart.files(folder)] == [
        "restart_000000080.npz",
        "restart_000000060.npz",
    ]
    assert missed == []


# --- what goes on, and what does not --------------------------------------------------------------


UNASKED = TEXT + RUNS["StabilityLimited"].replace(", restart_steps = 50", "")


@pytest.mark.stories
def test_an_interrupted_run_goes_on_without_restart_steps(scene, tmp_path):
    scene.write_text(UNASKED)
    run_scene(load_scene(scene), tmp_path / "whole")
    outcome = interrupted(scene, tmp_path / "broken", 37)
    assert outcome.status == "interrupted"
    assert [f.name for f in restart.files(tmp_path / "broken")] == ["restart_000000037.npz"]
    assert main(["run", str(scene), "--resume", str(tmp_path / "broken"), "--quiet"]) == 0
    assert_same_files(tmp_path / "whole", tmp_path / "broken")


@pytest.mark.stories
def test_sparse_rows_of_fused_steps_are_the_same_after_any_chain_of_interruptions(scene, tmp_path):
    sparse = UNASKED.replace("every = 0.01", "rows = 9, frames = 2")
    scene.write_text(sparse.replace("t_end = 0.06", "dt = 1e-4, t_end = 0.1"))
    counted = []
    run_scene(load_scene(scene), tmp_path / "whole", report=lambda info: counted.append(info.step))
    assert counted[-1] > 3 * len(counted)  # most steps are fused
    broken = tmp_path / "broken"
    for resume, after in enumerate(counted[21:-1:43]):
        assert interrupted(scene, broken, after, resume > 0).status == "interrupted"
    go(scene, broken, resume=True)
    assert_same_files(tmp_path / "whole", broken)
    summaries = [json.loads((f / "summary.json").read_text()) for f in (tmp_path / "whole", broken)]
    whole, resumed = ({**summary, "seconds": 0, "peak_memory_MB": 0} for summary in summaries)
    assert resumed == whole


@pytest.mark.stories
def test_an_interruption_between_two_restarts_costs_no_bit(scene, tmp_path):
    """With a kept factor the run goes back to the last regular restart."""
    gone_on(scene, tmp_path, 33)
    summary = json.loads((tmp_path / "broken" / "summary.json").read_text())
    expected = json.loads((tmp_path / "whole" / "summary.json").read_text())
    for key in ("steps", "newton", "linear", "factorisations", "frames", "ledger", "status"):
        assert summary[key] == expected[key]


@pytest.mark.stories
def test_resume_without_a_usable_restart_is_refused(scene, tmp_path, run_command, monkeypatch):
    scene.write_text(UNASKED)
    resume = ["run", str(scene), "--resume", "out"]
    told = run_command(*resume, status=2).err
    assert "--resume out: there is no restart file" in told
    assert "--overwrite" not in told
    run_scene(load_scene(scene), "out")
    assert "there is no restart file" in run_command(*resume, status=2).err


def test_an_interrupted_run_tells_from_where_it_will_go_on(scene, tmp_path, monkeypatch, capsys):
    """Its solver has kept a factor at step 33, so it goes back to step 20."""
    outcome = interrupted(scene, "out", 33)
    names = [file.name for file in restart.files(Path("out"))]
    assert names == ["restart_000000020.npz", "restart_000000000.npz"]
    result = restart.find(Path("out"))
    assert outcome.resumes == result.progress.state.t < outcome.summary["t"]
    log = (tmp_path / "out" / "run.log").read_text()
    assert f"after 33 steps; --resume goes on from {result.progress.state.t:g} s" in log
    monkeypatch.setattr("fecloth.runs.run_scene.run_scene", lambda *_, **__: outcome)
    assert main(["run", str(scene), "-o", "out", "--quiet"]) == 4
    words = f"--resume out goes on from t = {result.progress.state.t:g} s\n"
    assert words in capsys.readouterr().err


@pytest.mark.stories
def test_a_later_end_is_allowed_and_another_scene_is_not(scene, tmp_path, run_command):
    scene.write_text(UNASKED)
    folder = tmp_path / "out"
    interrupted(scene, folder, 20)
    before = written(folder)
    resume = ["run", str(scene), "--quiet", "--resume", str(folder)]
    changed = ["--set", "fabric.areal_density=0.3", "--set", "terms.1.type=QuadraticBending"]
    told = run_command(*resume + changed, status=2).err
    assert f"{folder} belongs to another scene: " in told
    assert "fabric.areal_density = 0.2 there, 0.3 here" in told
    assert "terms.1.type = HingeBending there, QuadraticBending here" in told
    assert "has already reached" in run_command(*resume, "--set", "time.t_end=0.001", status=2).err
    assert main([*resume, "--overwrite"]) == 2
    assert written(folder) == before
    assert main([*resume, "--set", "time.t_end=0.08"]) == 0
    assert read_frame(max((folder / "frames").iterdir()), load_scene(scene).mesh()).t == 0.08


@pytest.mark.stories
def test_a_broken_restart_file_is_passed_over_or_refused(scene, tmp_path):
    scene.write_text(TEXT + RUNS["StabilityLimited"])
    run_scene(load_scene(scene), tmp_path / "whole")
    run_scene(load_scene(scene), tmp_path / "out")
    newest = restart.files(tmp_path / "out")[0]
    data = newest.read_bytes()
    for place in (data.index(b"array_0") + 200, 200):
        newest.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        with pytest.raises(fc.InputError, match="cannot be read"):
            restart.read(newest)
    newest.write_bytes(data[:-100])
    go(tmp_path / "sheet.toml", tmp_path / "out", resume=True)
    assert written(tmp_path / "out") == written(tmp_path / "whole")
    for file in restart.files(tmp_path / "out"):
        file.write_bytes(b"")
    with pytest.raises(fc.InputError, match="cannot be read"):
        restart.find(tmp_path / "out")


def test_a_table_that_has_lost_rows_is_refused(scene, tmp_path):
    scene.write_text(UNASKED)
    interrupted(scene, tmp_path / "out", 20)
    (tmp_path / "out" / "steps.csv").write_text("step,t\n1,0.1\n")
    with pytest.raises(fc.InputError, match="steps.csv has lost rows"):
        go(scene, tmp_path / "out", resume=True)


def test_another_mesh_behind_the_same_name_is_refused(scene, tmp_path):
    meshio.write(tmp_path / "sheet.vtu", mesh_of(h=0.25))
    text = re.sub("cloth = .*", 'cloth = { shape = "file", path = "sheet.vtu" }', UNASKED)
    scene.write_text(re.sub("probes = .*", "", text.replace('"left"', '"boundary"')))
    interrupted(scene, tmp_path / "out", 5)
    meshio.write(tmp_path / "sheet.vtu", mesh_of(h=0.2))
    with pytest.raises(fc.InputError, match="the mesh or the frame"):
        go(scene, tmp_path / "out", resume=True)


def mesh_of(h):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=h, pattern="right")
    points = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    return meshio.Mesh(points, {"triangle": cloth.triangles})


def test_failed_run_leaves_its_last_state(scene, tmp_path):
    scene.write_text(TEXT + RUNS["midpoint"].replace("0.002", "0.02"))
    overrides = ["solver.max_iterations=2", "output.restart_steps=1"]
    outcome = run_scene(load_scene(scene, overrides), tmp_path / "out")
    assert outcome.status == "failed"
    result = restart.find(tmp_path / "out")
    assert result.progress.state.t == pytest.approx(outcome.summary["t"])
    assert result.progress.memory.step == outcome.summary["steps"]


@remembered
@dataclass(frozen=True, eq=False)
class ForceBefore:
    """The memory of `Kicks`."""

    f: np.ndarray


@dataclass(frozen=True)
class Kicks:
    """A user's Adams–Bashforth method with its own record: v₁ = v₀ + dt M⁻¹ (3 f₀ − f₋)/2."""

    traits = integrators.MethodTraits(order=1, explicit=True, stability=None)

    def check(self, system):
        pass

    def step(self, system, state, dt, solver, memory=None):
        f = system.force(state)
        last = f if memory is None else memory.f
        v = state.v + dt * (1.5 * f - 0.5 * last) / system.nodal_mass[:, None]
        new = fc.State(state.t + dt, state.x + dt * v, v)
        new = integrators.set_prescribed(system, new, integrators.prescribed_end(system, state, dt))
        return integrators.Step(new, state, ForceBefore(f), Counts())

    def numerical(self, system, old, step):
        return 0.0


EVERY = [
    *((cls(), 0.01) for cls in METHODS.values()),
    *((cls(beyond_limit=True), 0.001) for cls in EXPLICIT.values()),
    (fc.Adaptive(fc.Newmark(), rtol=1e-4), None),
    (fc.CentralDifference(), None),
    (Kicks(), 0.001),
]


@pytest.mark.parametrize(("method", "dt"), EVERY, ids=lambda m: type(m).__name__)
def test_march_goes_on_from_a_memory_that_was_written(method, dt, isotropic, tmp_path):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], ["left"])
    start, run = system.state(system.rest().x, t=0.1), (dt, 0.153)
    solver = "pcg" if system.symmetric and method.traits.symmetric else "direct"
    options = {"solver": solver, "newton": fc.Newton(reuse=False)}
    whole = list(fc.march(system, method, start, *run, **options))
    state, info = whole[len(whole) // 2]
    arrays = []
    packed = json.dumps(restart._pack(info.memory, arrays))
    memory = restart._unpack(json.loads(packed), arrays)
    rest = list(fc.march(system, method, state, *run, **options, memory=memory))
    assert [i.step for _, i in rest] == [i.step for _, i in whole[len(whole) // 2 + 1 :]]
    for first, second in zip(rest, whole[len(whole) // 2 + 1 :], strict=True):
        assert first[0].t == second[0].t
        np.testing.assert_array_equal(first[0].x, second[0].x)
        np.testing.assert_array_equal(first[0].v, second[0].v)


# --- plates, a turning clamp and rest angles of the start -----------------------------------------

PLATE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.2, h = 0.1 }
terms = [
  { type = "StVK" }, { type = "PlateBending", rest = "start" },
  { type = "BendingDamping", time = 0.01, law = { type = "PlateBending" } },
  { type = "Gravity" },
]
start = { position = ["X", "Y", "0.2 * X ** 2"] }
output = { every_steps = 7, restart_steps = 5 }
[fabric]
areal_density = 0.2
tensile_stiffness = 200.0
bending_rigidity = [2e-3, 1e-3]
bending_poisson_ratio = 0.2
[[pins]]
where = "left"
clamp = true
rotate = { point = [0, 0, 0], axis = [0, 1, 0], angle = "2 * t" }
"""
TIMES = {
    "bdf2": 'dt = 0.004\nt_end = 0.12\n[solver]\nlinear = "direct"\n',
    "energy_momentum": 'dt = 0.004\nt_end = 0.12\n[solver]\nlinear = "direct"\n',
    "central_difference": "t_end = 0.05\n",
}


@pytest.mark.stories
@pytest.mark.parametrize(
    ("method", "element"),
    [("bdf2", "P1"), ("energy_momentum", "P2"), ("central_difference", "P2")],
)
def test_a_run_of_a_plate_goes_on_bit_for_bit(method, element, scene, tmp_path):
    mass = 'mass = "lumped"\n' if method == "central_difference" else ""
    text = PLATE.replace("h = 0.1 ", f'h = 0.1, element = "{element}" ')
    scene.write_text(f'{mass}{text}[time]\nmethod = "{method}"\n{TIMES[method]}')
    whole = gone_on(scene, tmp_path, 17)
    start = load_scene(scene).build().start
    assert np.abs(whole.state.x - start.x)[:, 2].max() > 0.005  # it has moved
