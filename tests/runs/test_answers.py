"""The quantities of a scene: values, errors and measured values in all that a run leaves."""

import html
import json
import math
import re
import shlex

import numpy as np
import pytest

import fecloth as fc
from fecloth.runs.outcome import finished_message
from fecloth.simulation.probes import Probe

SWING = """
cloth = { shape = "rectangle", width = 1.0, height = 0.2, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 200.0, bending_rigidity = 1e-4 }
terms = [{ type = "StVK" }, { type = "PlateBending" }, { type = "Gravity" }]
pins = [{ where = "left" }]
probes = [{ name = "tip", where = "right" }, { name = "middle", point = [0.5, 0.1] }]
time = { method = "implicit_midpoint", dt = 0.005, t_end = 0.4 }
[output]
frames = 2
"""
SAG = """
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.25, pattern = "cross" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "boundary", name = "rim" }]
probes = [{ name = "centre", point = [0.5, 0.5] }]
interest = { end = ["sag", "centre.z"], quantities = ["reaction.rim.z", "energy.StVK"] }
equilibrium = {}
[output]
frames = 1
[measured]
sag = [0.0365, "2 %"]
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(text, *changes, out="out"):
        (tmp_path / "my cloth.toml").write_text(text)
        return fc.run_scene(fc.load_scene("my cloth.toml", changes), out, overwrite=True)

    return run


def summary_of(folder="out"):
    with open(f"{folder}/summary.json", encoding="utf-8") as stream:
        return json.load(stream)


def test_without_interest_a_motion_answers_where_its_probes_are(run):
    result = run(SWING)
    names = [f"{probe}.{axis}" for probe in ("tip", "middle") for axis in "xyz"]
    assert list(result.quantities) == list(summary_of()["quantities"]) == names
    assert result.time_error > 0
    for name, answer in result.quantities.items():
        assert answer.value == result.observed[name][-1]
        assert answer.unit == "m"
        assert answer.parts == {"time": answer.uncertainty}
        entry = {"value": answer.value, "uncertainty": answer.uncertainty, "unit": "m"}
        assert summary_of()["quantities"][name] == entry | {"parts": dict(answer.parts)}


def test_the_error_in_time_is_of_the_place_that_moves_most(run):
    """The error of a run with larger steps, by the same run with an eighth of them."""
    coarse = run(SWING, "time.dt=0.01")
    fine = run(SWING, "time.dt=0.00125")
    tip = coarse.quantities["tip.z"]
    x = np.transpose([coarse.observed[f"tip.{axis}"] for axis in "xyz"])
    moved = np.linalg.norm(x - x[0], axis=1).max()
    assert moved > 0.5
    assert tip.uncertainty == pytest.approx(coarse.time_error * moved, rel=1e-12)
    true = max(
        abs(coarse.quantities[name].value - fine.quantities[name].value)
        for name in ("tip.x", "tip.z")
    )
    assert true > 1e-4
    assert 0.5 * true < tip.uncertainty < 8 * true


def test_of_an_equilibrium_the_solver_alone_is_known(run):
    result = run(SAG)
    assert list(result.quantities) == ["reaction.rim.z", "energy.StVK", "sag", "centre.z"]
    scene = fc.load_scene("my cloth.toml").build()
    equilibrium = fc.equilibrium(scene.system, scene.start, load_steps=1)
    sag = result.quantities["sag"]
    assert math.isnan(sag.uncertainty)
    assert sag.parts == pytest.approx({"solver": equilibrium.solver_error})
    assert 0 < sag.parts["solver"] < 1e-6
    entry = summary_of()["quantities"]["sag"]
    assert entry["uncertainty"] is None
    assert summary_of()["solver_error"] == sag.parts["solver"]
    assert entry["measured"] == [0.0365, pytest.approx(0.00073)]
    assert sag.measured == (0.0365, pytest.approx(0.00073))
    reaction = result.quantities["reaction.rim.z"]
    assert (reaction.unit, reaction.parts, reaction.measured) == ("N", {}, None)
    assert reaction.value == pytest.approx(0.2 * 9.81, rel=1e-6)
    assert result.quantities["energy.StVK"].unit == "J"


def test_what_was_measured_is_answered_beside_the_interest(run):
    measured = "\n[measured]\n'max tip.z' = [0.01, 0.002]\nfolds = [4.0, 1.0]\n"
    measured += "total = ['3 J', '2 %']\n"
    result = run(SWING + measured)
    assert list(result.quantities) == ["max tip.z", "folds", "total"]
    assert result.quantities["max tip.z"].value == result.observed["tip.z"].max()
    assert result.quantities["folds"].measured == (4.0, 1.0)
    assert result.quantities["total"].measured == pytest.approx((3.0, 0.06))
    assert result.quantities["folds"].unit == ""


def test_a_quantity_without_a_value_is_null(run):
    """Natural frequencies are left out: a run does not compute them."""
    asked = (
        'interest = { period = ["tip.z"], end = ["displacement"], quantities = ["frequency(1)"] }'
    )
    result = run(f"{asked}\n{SWING}", "time.t_end=0.05")
    answers = summary_of()["quantities"]
    assert list(answers) == ["displacement", "period of tip.z"]
    none = {"value": None, "uncertainty": None, "parts": {}, "unit": "s"}
    assert answers["period of tip.z"] == none
    assert "no value in this run" in finished_message(result)


def test_the_field_of_displacement_has_its_norm_and_the_error_over_the_area(run):
    result = run(f'interest = {{ end = ["displacement"] }}\n{SWING}')
    answer = result.quantities["displacement"]
    cloth = fc.load_scene("my cloth.toml").mesh()
    moved = result.state.x - fc.load_scene("my cloth.toml").build().start.x
    norm = cloth.l2_difference(cloth, 0 * moved, moved)
    assert answer.value == pytest.approx(norm, rel=1e-12)
    # a whole motion of the largest displacement would have the norm scale · √area
    assert answer.uncertainty == pytest.approx(result.time_error * answer.value, rel=0.2)


def test_python_answers_what_is_asked_for(run):
    run(SWING, "time.t_end=0.01")
    system = fc.load_scene("my cloth.toml").build().system
    asked = [Probe("tip", "right"), "line_force:left", "folds"]
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), 0.005, 0.02, probes=asked)
    assert list(result.quantities) == ["tip.x", "tip.y", "tip.z", "line_force.left", "folds"]
    force = [result.observed[f"line_force:left.{axis}"][-1] for axis in "xyz"]
    assert result.quantities["line_force.left"].value == pytest.approx(math.hypot(*force))
    assert result.quantities["line_force.left"].unit == "N/m"


def test_they_are_the_last_lines_of_the_terminal_and_the_first_tiles(run, tmp_path, run_command):
    (tmp_path / "my cloth.toml").write_text(SAG)
    change = ["--set", "fabric.areal_density=0.21"]
    lines = run_command("run", "my cloth.toml", "-o", "out", *change).out.splitlines()
    answers = summary_of()["quantities"]
    first = next(i for i, line in enumerate(lines) if line.startswith("reaction.rim.z "))
    assert [line.split()[0] for line in lines[first : first + 4]] == list(answers)
    assert len(lines) <= first + 4 + 3
    assert lines[-1].startswith("error in space about")
    log = (tmp_path / "out" / "run.log").read_text()
    (line,) = (line for line in lines if line.startswith("sag "))
    assert line in log
    assert f"{answers['sag']['value']:.6g} m" in line
    assert line.endswith("measured 0.03650 ± 0.00073 m")
    page = (tmp_path / "out" / "report.html").read_text()
    tiles = re.findall(r"<div><(?:span|b)>(.*?)<", page)
    assert tiles[:4] == list(answers)
    assert f"{answers['sag']['value']:.6g} m" in html.unescape(page)
    assert not {"0", "0 J"} & set(tiles)
    assert "linear iterations" not in page.partition("<details>")[0]


def test_the_command_in_the_line_runs(run, tmp_path, run_command):
    (tmp_path / "my cloth.toml").write_text(SAG)
    change = ["--set", "cloth.h = 0.5"]
    printed = run_command("run", "my cloth.toml", "-o", "out", *change).out
    command = shlex.split(re.search(r"sag .*not known.*: (fecloth converge [^;]*);", printed)[1])
    assert command[:3] == ["fecloth", "converge", "my cloth.toml"]
    assert "sag = 0.03" in run_command(*command[1:], "--levels", "3", "-o", "study").out
    levels = (tmp_path / "study" / "results.csv").read_text().splitlines()
    assert len(levels) == 4
