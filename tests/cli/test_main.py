"""The command line: what a run leaves, its exit status, and what a user's mistake is answered."""

import csv
import json
import random
import re
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest
from support.strips import scene_file

import fecloth as fc
from fecloth.cli.main import main
from fecloth.scene.scene import load_scene

TEXT = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.1 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
time = { method = "backward_euler", dt = 0.005, t_end = 0.1 }
output = { every = 0.02 }
probes = [{ name = "tip", where = "right" }]
[[terms]]
type = "StVK"
[[terms]]
type = "StrainRateDamping"
time = 0.01
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
[expect]
sag = { value = 0.0515, relative = 0.1 }
"""


scene = scene_file(TEXT, "sheet")


def rows(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def frame_times(pvd):
    """Times of the frames that a .pvd lists, all of which must exist."""
    entries = ET.parse(pvd).getroot().iter("DataSet")
    listed = [(float(e.get("timestep")), pvd.parent / e.get("file")) for e in entries]
    assert all(file.is_file() for _, file in listed)
    return [t for t, _ in listed]


def process(*arguments, **options):
    command = [sys.executable, "-m", "fecloth", *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options)


def test_a_run_leaves_its_files(scene, capsys):
    assert main(["run", str(scene)]) == 0
    out = Path("out/sheet")
    assert frame_times(out / "run.pvd") == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.1])
    steps, energies, observed = (rows(out / f"{n}.csv") for n in ("steps", "energies", "observed"))
    assert (len(steps), len(energies), len(observed)) == (20, 21, 21)
    assert float(steps[-1]["t"]) == 0.1
    assert {"kinetic", "StVK", "dissipated:StrainRateDamping", "remainder"} <= set(energies[0])
    assert {"tip.z", "sag", "area", "reaction:left.z"} <= set(observed[0])
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "done"
    assert summary["steps"] == 20
    assert summary["newton"] == sum(int(row["newton"]) for row in steps)
    assert 0 < summary["factorisations"] <= summary["newton"]
    phases = {"mesh", "compile", "assemble", "factor", "solve", "output", "total"}
    assert phases <= set(summary["seconds"])
    assert "done at t = 0.1 s" in (out / "run.log").read_text()
    printed = capsys.readouterr()
    assert "20 steps" in printed.out
    assert "explicit method would need dt" not in printed.err


def test_quiet_prints_nothing_but_what_is_to_be_checked(scene, capfd):
    short = ["--quiet", "--set", "time.dt=0.001"]
    assert main(["run", str(scene), "-o", "a", *short]) == 0
    assert capfd.readouterr() == ("", "")
    assert main(["run", str(scene), "-o", "b", *short, "--set", "fabric.areal_density=20"]) == 0
    out, lines = capfd.readouterr()
    assert not out
    assert lines.startswith("check: areal_density = 20 kg/m²: cloth has 0.01 to 1.")
    assert all(line.startswith("check: ") for line in lines.splitlines())
    assert json.loads(Path("b/summary.json").read_text())["warnings"] == []
    assert 'class="status done"' in Path("b/report.html").read_text(encoding="utf-8")


def test_a_failed_step_is_status_3_and_leaves_the_last_good_state(scene, run_command):
    stop = ["--set", "solver.max_iterations=1", "--set", "solver.tolerance=1e-9"]
    error = run_command("run", scene, "-o", "run", *stop, "--set", "output.every=0.1", status=3).err
    assert "did not converge in 1 iteration" in error
    assert "Take a smaller dt" in error
    summary = json.loads(Path("run/summary.json").read_text())
    assert summary["status"] == "failed"
    assert "did not converge" in summary["error"]
    assert frame_times(Path("run/run.pvd"))[-1] == summary["t"]


@pytest.mark.parametrize("arguments", [[], ["walk"], ["run"], ["run", "sheet.toml", "--quick"]])
def test_usage(arguments, scene, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage: fecloth" in capsys.readouterr().err


def test_check(scene, run_command):
    assert "ok     sag at 0.1 s" in run_command("check", scene).out
    assert (
        "FAILED sag at 0.1 s"
        in run_command("check", scene, "--quiet", "--set", "expect.sag.value=0.2", status=1).out
    )


def test_mesh_describes_and_writes(scene, run_command):
    printed = run_command("mesh", "sheet.toml", "-o", "made/sheet.vtu").out
    cloth = load_scene(scene).mesh()
    assert f"{len(cloth.X)} nodes, {len(cloth.triangles)} triangles, area 0.5 m²" in printed
    assert "set left: 6 nodes" in printed
    mesh = meshio.read("made/sheet.vtu")
    assert np.array_equal(mesh.cells_dict["triangle"], cloth.triangles)
    assert np.flatnonzero(mesh.point_data["set left"]).tolist() == sorted(cloth.nodes("left"))
    again = fc.Cloth.read("made/sheet.vtu")
    assert again.area == pytest.approx(0.5)


def test_info(scene, run_command):
    printed = run_command("info").out
    assert f"fecloth: {fc.__version__}" in printed
    assert "direct solver:" in printed
    pages = re.search(r"^pages: (.*) leads to all$", printed, re.MULTILINE)
    assert Path(pages[1]).is_file()
    printed = run_command("info", scene).out
    assert "terms: StVK, StrainRateDamping, Gravity" in printed
    assert printed.count("triangles") == 1  # the sizes are not printed twice


def long_run(scene, out, **options):
    """A process whose run would take minutes, once it has written three frames."""
    arguments = ["--set", "time.t_end=500", "--set", "output.every_steps=5", "--set", "expect={}"]
    text = scene.read_text().replace("every = 0.02", "")
    scene.write_text(text)
    running = process("run", scene, "-o", out, *arguments, **options)
    while not (out / "frames" / "frame_000003.vtu").exists() and running.poll() is None:
        time.sleep(0.005)
    assert running.poll() is None, running.stderr.read()
    return running


def opens(out):
    """The .pvd's frames, read by VTK; their times."""
    times = frame_times(out / "run.pvd")
    import pyvista  # takes two seconds

    reader = pyvista.get_reader(out / "run.pvd")
    assert reader.time_values == times
    reader.set_active_time_value(times[-1])
    assert np.isfinite(reader.read()[0].points).all()
    return times


@pytest.mark.stories
def test_a_killed_run_leaves_a_pvd_that_opens(scene, tmp_path):
    out = tmp_path / "run"
    running = long_run(scene, out)
    time.sleep(random.uniform(0, 0.1))
    running.kill()
    running.communicate()
    assert len(opens(out)) >= 3


@pytest.mark.stories
def test_energy_balance_that_does_not_close_is_reported(scene, run_command):
    make = ["--set", 'time.method="implicit_midpoint"', "--set", "terms.1.time=1e-9"]
    make += ["--set", "time.dt=0.02", "--set", "output.every=0.1"]
    printed = run_command("run", scene, "-o", "bad", *make, "--set", "time.t_end=0.6")
    warnings = json.loads(Path("bad/summary.json").read_text())["warnings"]
    (sentence,) = [words for words in warnings if "the energy balance is off by" in words]
    assert "take a smaller dt" in sentence
    assert abs(float(rows(Path("bad/steps.csv"))[-1]["drift"])) > 0.05
    assert all(f"warning: {words}\n" in printed.err for words in warnings)
    assert f"{len(warnings)} warning" in printed.out.splitlines()[-1]
    page = Path("bad/report.html").read_text(encoding="utf-8")
    assert '<span class="status warned">done, with warnings</span>' in page
    assert Path("bad/run.log").read_text().count(f"warning: {sentence}") == 1
    assert (
        "the method has made the rest"
        in run_command("run", scene, "-o", "worse", *make, "--set", "time.t_end=1", status=3).err
    )
    assert json.loads(Path("worse/summary.json").read_text())["status"] == "failed"


@pytest.mark.stories
def test_a_run_goes_on_from_a_frame_at_its_time(scene):
    shake = ["--set", "pins.0.motion=['0', '0', '0.05*sin(40*t)']", "--quiet"]
    shake += ["--set", "solver.tolerance=1e-8"]  # both are compared more closely than their error
    assert main(["run", str(scene), "-o", "whole", *shake]) == 0
    frame = Path("whole/frames/frame_000003.vtu").resolve()
    start = ["--set", f"start={{frame='{frame}'}}", "--set", "time.t_start=0.06"]
    assert main(["run", str(scene), "-o", "rest", *shake, *start]) == 0
    assert frame_times(Path("rest/run.pvd")) == pytest.approx([0.06, 0.08, 0.1])
    a, b = (
        meshio.read(f"{name}/frames/frame_00000{i}.vtu") for name, i in (("whole", 5), ("rest", 2))
    )
    assert a.points == pytest.approx(b.points, abs=1e-6)


def test_overwrite_replaces_runs_only(scene, run_command):
    Path("mine").mkdir()
    Path("mine/summary.json").write_text("keep")
    assert (
        "contains other files than a run's"
        in run_command("run", scene, "-o", "mine", "--overwrite", status=2).err
    )
    assert Path("mine/summary.json").read_text() == "keep"


def test_the_version_needs_no_numerical_package():
    command = [sys.executable, "-X", "importtime", "-m", "fecloth", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"fecloth {fc.__version__}\n"
    imported = {line.split("|")[-1].strip() for line in done.stderr.splitlines()}
    assert "fecloth.cli.main" in imported
    assert not imported & {"numpy", "scipy", "numba", "pydantic", "rich", "meshio"}
