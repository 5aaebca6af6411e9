"""Scenes with [equilibrium]: their files, restart, stability, expectations and mistakes."""

import csv
import json
import os
import signal
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from support.inflated import shooting
from support.strips import scene_file

import fecloth as fc
from fecloth.cli.main import main
from fecloth.linalg import mkl_pardiso
from fecloth.mesh.peak import Peak
from fecloth.runs.run_scene import run_scene
from fecloth.scene.plan import plan
from fecloth.scene.scene import load_scene
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.rest_stability import RestStability

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
SHEET = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.125, pattern = "cross" }
fabric = { areal_density = 0.3, tensile_stiffness = 1000.0, poisson_ratio = 0.3 }
terms = [{ type = "StVK" }, { type = "Gravity" }, { type = "Pressure", p = -2.0 }]
pins = [{ where = "boundary", name = "rim" }]
output = { restart_steps = 1 }
probes = [{ name = "middle", point = [0.5, 0.25] }]
expect = { sag = { value = 0.05, relative = 1.0 } }
[equilibrium]
load_steps = 4
"""


scene = scene_file(SHEET, "sheet")


def rows(path):
    with open(path, encoding="utf-8") as stream:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]


def last_frame(folder, problem, number):
    return fc.read_frame(folder / f"frames/frame_{number:06d}.vtu", problem.cloth)


def dense_least(system, state):
    Z = system.admissible
    return eigvalsh((Z.T @ system.stiffness(state) @ Z).toarray())[0]


def test_a_run_leaves_the_files_of_its_load_steps(scene, tmp_path, capsys):
    assert main(["run", str(scene), "-o", "out", "-v"]) == 0
    out, problem = tmp_path / "out", load_scene(scene).build()
    observed, energies = rows(out / "observed.csv"), rows(out / "energies.csv")
    assert [row["t"] for row in observed] == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    exact = fc.equilibrium(problem.system, problem.start, load_steps=4)
    np.testing.assert_allclose(last_frame(out, problem, 4).x, exact.x, rtol=0, atol=1e-12)
    assert not last_frame(out, problem, 4).v.any()
    fall = Peak.on(problem.system.cloth).largest((problem.start.x - exact.x)[:, 2])
    assert observed[-1]["sag"] == pytest.approx(fall, abs=1e-12)
    weight = 0.3 * 9.81 * 0.5  # and the pressure
    for row in observed[1:]:
        assert row["reaction:rim.z"] > row["t"] * weight
    balance = weight - problem.system.bound[2].p(0.0) * shadow(problem, exact)
    assert observed[-1]["reaction:rim.z"] == pytest.approx(balance, rel=1e-6)
    assert all(abs(row["remainder"]) < 1e-12 for row in energies)
    assert energies[-1]["StVK"] == pytest.approx(problem.system.energies(exact)["StVK"], rel=1e-6)
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["steps"], summary["frames"]) == ("done", 4, 5)
    least = dense_least(problem.system, exact)
    assert summary["least_eigenvalue"] == pytest.approx(least, rel=1e-6)
    printed = capsys.readouterr()
    words = f"equilibrium: stable; the least eigenvalue of K is {least:.4g} N/m"
    assert words in printed.out
    assert "energy at 1 of the loads" in printed.out
    assert "static equilibrium in 4 load steps, tolerance auto" in printed.err
    assert "done at 1 of the loads after 4 steps" in (out / "run.log").read_text()
    report = (out / "report.html").read_text()
    assert "least eigenvalue of K" in report
    assert f"{least:.4g} N/m" in report
    assert "part of the loads" in report
    assert "Step size" not in report
    assert main(["view", "out", "--no-open"]) == 0
    for page in (report, (out / "view.html").read_text()):
        assert '"unit": " of the loads"' in page


def shadow(problem, state):
    """Area of the cloth's shadow, on which the pressure lies [m²]."""
    a, b, c = np.moveaxis(state.x[problem.cloth.triangles], 1, 0)
    return 0.5 * np.cross(b - a, c - a)[:, 2].sum()


@pytest.mark.stories
def test_a_killed_run_goes_on_bit_for_bit(scene, tmp_path):
    def stop(info):
        if info.step == 2:
            raise KeyboardInterrupt

    whole = load_scene(scene)
    run_scene(whole, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run_scene(whole, tmp_path / "killed", report=stop)
    assert len(rows(tmp_path / "killed/observed.csv")) == 3
    assert main(["run", str(scene), "--resume", "killed", "--quiet"]) == 0
    for name in ("observed.csv", "energies.csv", "strains.csv", "frames/frame_000004.vtu"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    log = (tmp_path / "killed/run.log").read_text()
    assert "goes on from step 2 at 0.5 of the loads" in log


def test_ctrl_c_stops_after_a_load_step(scene, tmp_path, capsys, monkeypatch):
    @contextmanager
    def stopping(console, scene, quiet):
        yield lambda info: info.step == 2 and os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("fecloth.cli.progress.progress", stopping)
    assert main(["run", str(scene), "-o", "out", "--quiet"]) == 4
    words = "out is readable up to 0.5 of the loads; --resume out goes on from 0.5 of the loads"
    assert words in capsys.readouterr().err
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert (summary["status"], summary["steps"]) == ("interrupted", 2)


@pytest.mark.stories
def test_a_picture_is_of_a_part_of_the_loads(scene, capsys, run_command, tmp_path):
    pytest.importorskip("pyvista")
    assert main(["run", str(scene), "-o", "out", "--quiet"]) == 0
    picture = ["render", "out", "-o", "end.png", "--size", "160x120"]
    assert run_command(*picture).out.endswith("wrote end.png: 1 of the loads\n")
    assert main([*picture, "--time", "0.45"]) == 0
    words = "wrote end.png: 0.5 of the loads, of the frame next to 0.45 of the loads\n"
    assert capsys.readouterr().out.endswith(words)


def test_the_loads_of_one_step_are_no_long_step_in_time(recwarn):
    """A step of a second is warned of; one from no loads to all is not."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="cross")
    terms = [fc.StVK(), fc.Gravity(), fc.HingeBending()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, bending_rigidity=1e-4), terms, ["boundary"])
    fc.run(system, LoadSteps(), system.rest(), t_end=1.0)
    assert not [each for each in recwarn if "is large" in str(each.message)]
    with pytest.warns(fc.FeclothWarning, match="dt = 1 s is large"):
        fc.run(system, fc.BackwardEuler(), system.rest(), dt=1.0, t_end=1.0)


def test_check_compares_the_equilibrium(scene, run_command):
    assert "sag at 1 of the loads: 0.0" in run_command("check", scene).out
    wrong = "expect.sag={ value = 0.05, relative = 1e-6, at = 0.5 }"
    assert (
        "FAILED sag at 0.5 of the loads"
        in run_command("check", scene, "--set", wrong, status=1).out
    )


def test_the_resolved_scene_is_the_scene(scene, tmp_path):
    loaded = load_scene(scene, ["equilibrium.tolerance=1e-8", "solver.linear=superlu"])
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(loaded.to_toml())
    again = load_scene(resolved)
    assert again == loaded
    assert again.time is None
    assert again.schedule.steps() == LoadSteps(4, 1e-8)


def test_an_unstable_equilibrium_is_warned_of(scene, tmp_path, capsys, run_command):
    """A sheet squeezed in its plane, with no force across: flat, and about to buckle."""
    flat = ["terms=[{type='StVK'}]", "start.position=['0.99 * X', 'Y', '0']"]
    sets = [word for each in flat for word in ("--set", each)]
    assert main(["run", str(scene), "-o", "out", *sets]) == 0
    words = "the equilibrium is unstable: the least eigenvalue of K is -"
    assert f"warning: {words}" in capsys.readouterr().err
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["least_eigenvalue"] < 0
    assert summary["warnings"][-1].startswith(words)
    assert f"warning: {words}" in run_command("check", scene, *sets).err


def test_stability_without_stiffness_and_without_freedom():
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    fabric = fc.Fabric(0.2, 1e3)
    slack = fc.System(cloth, fabric, [fc.StVK()], ["boundary"])
    assert "a motion without stiffness" in RestStability.of(slack, slack.rest()).words()
    held = fc.System(cloth, fabric, [fc.StVK()], [fc.Pin(lambda X: X[:, 0] > -1)])
    rest = RestStability.of(held, held.rest())
    assert rest.words() == "equilibrium: not known whether it is stable"
    assert not rest.doubts()


def test_a_load_without_a_balance_fails_and_leaves_what_it_has(scene, tmp_path, run_command):
    sets = ["terms=[{type='StVK'}, {type='Gravity'}]", "pins=[]"]
    words = [word for each in sets for word in ("--set", each)]
    printed = run_command("run", scene, "-o", "out", "--quiet", *words, status=3).err
    assert "of the loads, failed: load stepping ended at 0 of the loads: nothing holds" in printed
    assert "Pin it, or take the load away." in printed
    assert "out is readable up to 0 of the loads" in printed
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert (summary["status"], summary["time_error_in_words"]) == (
        "failed",
        "equilibrium: not reached",
    )


@pytest.mark.stories
def test_the_example_expects_the_height_of_the_exact_membrane():
    scene = load_scene(SCENES / "inflated_disk.toml")
    height, _ = shooting(500.0)
    assert scene.expect["middle.z"][0].value == pytest.approx(height, rel=1e-5)
    assert main(["check", str(SCENES / "inflated_disk.toml"), "--quiet"]) == 0


# --- paths ----------------------------------------------------------------------------------------

DRAWN = """
[cloth]
shape = "rectangle"
width = 0.2
height = 0.05
h = 0.0125
pattern = "right"

[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
poisson_ratio = 0.3

[[terms]]
type = "StVK"

[[pins]]
inside = "X < 1e-9 and Y < 1e-9"

[[pins]]
inside = "X < 1e-9 and Y > 1e-9"
normal = [1, 0, 0]

[[pins]]
where = "right"
name = "grip"
normal = [1, 0, 0]
motion = ["0.04 * t", "0", "0"]

[equilibrium]
load_steps = 4
"""


def test_a_specimen_is_drawn_in_load_steps(tmp_path):
    """Uniaxial tension in closed form: F = width λ S₁₁ with S₁₁ = Y (λ² − 1)/2, at each row."""
    file = tmp_path / "drawn.toml"
    file.write_text(DRAWN)
    assert main(["run", str(file), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    observed, energies = (rows(tmp_path / "out" / f"{t}.csv") for t in ("observed", "energies"))
    assert [row["t"] for row in observed] == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    for row, energy in zip(observed[1:], energies[1:], strict=True):
        stretch = 1 + 0.2 * row["t"]
        strain = (stretch**2 - 1) / 2
        assert row["reaction:grip.x"] == pytest.approx(0.05 * stretch * 1000 * strain, rel=1e-7)
        assert energy["StVK"] == pytest.approx(0.2 * 0.05 * 1000 * strain**2 / 2, rel=1e-7)
        assert abs(energy["remainder"]) < 1e-9 * energy["StVK"]
    problem = load_scene(file).build()
    end = last_frame(tmp_path / "out", problem, 4)
    np.testing.assert_allclose(end.x[problem.cloth.nodes("right"), 0], 0.24, atol=1e-12)


def test_the_plan_of_a_scene_loads_no_library(scene, monkeypatch):
    """Only a factorisation needs the MKL, which takes 0.5 s to load."""

    @cache
    def routine():
        raise AssertionError("the MKL is loaded")

    monkeypatch.setattr(mkl_pardiso, "routine", routine)
    (line,) = (line for line in plan(load_scene(scene).build(), "") if "a factor" in line)
    assert "thread" in line
    assert "in factorisations" not in line


DRAGGED = """
cloth = { shape = "rectangle", width = 0.4, height = 0.02, h = 0.02, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 50.0 }
start = { plane = "xy", shift = [0, 0, 0.00099] }
pins = [{ where = "right" }]
equilibrium = { load_steps = 2 }

[[terms]]
type = "StVK"

[[terms]]
type = "Gravity"

[[terms]]
type = "Obstacle"
friction = 0.5
shape = { type = "Plane", point = [0, 0, 0], normal = [0, 0, 1], motion = ["-0.05*t", "0", "0"] }
"""


def test_a_table_that_moves_drags_a_strip_in_a_static_scene(tmp_path):
    """By its friction; the obstacle follows the part of the loads, and summary.json says so."""
    file = tmp_path / "dragged.toml"
    file.write_text(DRAGGED)
    assert main(["run", str(file), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    observed = rows(tmp_path / "out" / "observed.csv")
    weight = 0.2 * 0.4 * 0.02 * 9.81 * (1 - 1 / 40)  # without what the pin carries
    for row in observed[1:]:
        assert row["reaction:right.x"] == pytest.approx(0.5 * weight * row["t"], rel=0.02)
    summary = (tmp_path / "out" / "summary.json").read_text()
    assert "on the number of load steps, here 2" in summary
