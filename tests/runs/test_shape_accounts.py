"""What a run says of the shape at its frames: intersections, folds, stretches; resumed as whole."""

import csv
import json

import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.cli.main import main
from fecloth.scene.scene import load_scene
from fecloth.simulation.doubts.course import doubt_wrinkles
from fecloth.simulation.shapes import find_wrinkles

TEXT = """
cloth = { shape = "rectangle", width = 0.4, height = 0.2, h = 0.05, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-4 }
terms = [
  { type = "StVK" }, { type = "HingeBending" }, { type = "StrainRateDamping", time = 0.01 },
]
pins = [
  { inside = "X < 0.051" },
  { inside = "X > 0.349", motion = ["-0.5*smoothstep(0, 0.1, t)", "0", "0.03*t"] },
]
start = { position = ["X", "Y", "0.01*sin(pi*X/0.4)"] }
time = { method = "backward_euler", dt = 0.01, t_end = 0.2 }
output = { every_steps = 2, restart_steps = 5 }
"""
CALM = "pins=[{inside='X < 0.051'}]"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("shape") / "through.toml"
    path.write_text(TEXT)
    return path


def run(scene, name, *overrides):
    """The summary and the rows of strains.csv of a run of the command line."""
    out = scene.parent / name
    given = [word for each in overrides for word in ("--set", each)]
    assert main(["run", str(scene), "-o", str(out), "--overwrite", "-v", *given]) == 0
    with (out / "strains.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    return json.loads((out / "summary.json").read_text()), rows


def test_a_cloth_that_passes_through_itself_is_reported_once(scene, capsys):
    summary, rows = run(scene, "through")
    printed = capsys.readouterr()
    counts = [row["intersecting"] for row in rows]
    first = next(row["t"] for row in rows if row["intersecting"] > 0)
    assert summary["intersecting_pairs"] == np.nanmax(counts) > 0
    assert summary["least_stretch"] == min(row["smallest"] for row in rows)
    assert summary["largest_stretch"] == max(row["largest"] for row in rows)
    assert summary["inverted_triangles"] == max(row["inverted"] for row in rows)
    words = f"the cloth passes through itself from t = {first:g} s ("
    assert [words in each for each in summary["warnings"]].count(True) == 1
    assert "without SelfContact" in printed.err
    assert f"{np.nanmax(counts):.0f} intersecting pairs, in any frame" in printed.out
    folder = scene.parent / "through"
    assert (folder / "run.log").read_text().count(f"warning: {words}") == 1
    assert words in (folder / "report.html").read_text()
    # counted at the start, every sixth step at a frame, and at the end
    counted = [round(100 * row["t"]) for row in rows if not np.isnan(row["intersecting"])]
    assert counted == [0, 6, 12, 18, 20]


def test_a_calm_cloth_has_no_warning(scene, capsys):
    summary, _ = run(scene, "calm", CALM)
    assert not any(kind in each for each in summary["warnings"] for kind in ("passes", "wrinkles"))
    assert summary["intersecting_pairs"] == summary["inverted_triangles"] == 0
    assert "at most 0 triangles turned over and 0 intersecting pairs" in capsys.readouterr().out
    assert 0.99 < summary["least_stretch"] <= summary["largest_stretch"] < 1.01


def test_a_key_switches_the_count_off(scene, capsys):
    summary, rows = run(scene, "off", "output.intersections=false")
    assert summary["intersecting_pairs"] is None
    assert all(np.isnan(row["intersecting"]) for row in rows)
    assert "intersections were not counted" in capsys.readouterr().out
    assert not any("passes through" in words for words in summary["warnings"])


@pytest.mark.stories
def test_a_resumed_run_counts_at_the_same_frames(scene):
    _, whole = run(scene, "whole")
    run(scene, "part", "time.t_end=0.1")
    out = str(scene.parent / "part")
    assert main(["run", str(scene), "--resume", out]) == 0
    with (scene.parent / "part" / "strains.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    at = [row["t"] for row in rows if not np.isnan(row["intersecting"])]
    expected = [row["t"] for row in whole if not np.isnan(row["intersecting"])]
    assert set(at) == {*expected, 0.1, 0.16} - {0.12, 0.18}
    summary = json.loads((scene.parent / "part" / "summary.json").read_text())
    assert sum("passes through itself" in words for words in summary["warnings"]) == 1


@pytest.mark.parametrize("element", stories_except(["P1", "P2"], "P1"))
def test_the_result_of_run_has_the_shape_at_the_end(scene, element):
    plain = ["cloth.element=P2", "terms=[{type='StVK'}]"] if element == "P2" else []
    problem = load_scene(scene, plain).build()
    start = problem.system, problem.method, problem.start
    with pytest.warns(fc.FeclothWarning, match=r"passes through itself at t = 0\.12 s \(\d+ pairs"):
        result = fc.run(*start, problem.dt, 0.12)
    assert result.shape.intersecting > 0
    assert any("passes through itself" in words for words in result.warnings)
    stretches = fc.fields(problem.system, result.state)[1]["principal_stretches"]
    if element == "P1":
        assert result.shape.least_stretch == pytest.approx(stretches.min(), rel=1e-12)
        assert result.shape.largest_stretch == pytest.approx(stretches.max(), rel=1e-12)


# --- compression ----------------------------------------------------------------------------------


def test_a_tension_field_has_no_wrinkles_as_fine_as_the_mesh(scene):
    fields = ["terms.1.type=Gravity", "terms.0.type=TensionField"]
    system = load_scene(scene, [CALM, *fields]).build().system
    assert doubt_wrinkles(system, 0.5, 0.9, 0.1, 1.0) is None


@pytest.mark.parametrize(("waves", "warned"), [(2.0, False), (17.0, True)])
def test_a_compressed_sheet_warns_where_its_mesh_is_as_coarse_as_its_folds(
    waves, warned, isotropic
):
    """Shortened by 1 % along X, and waved by few or by many waves over 24 edges."""
    cloth = fc.Cloth.rectangle(1.2, 0.6, h=0.05, pattern="right")
    system = fc.System(cloth, isotropic, [fc.StVK()])
    x = system.rest().x
    x[:, 0] *= 0.99
    x[:, 2] = 0.002 * np.sin(2 * np.pi * waves * cloth.X[:, 0] / 1.2 + 1)
    assert bool(find_wrinkles(system, system.state(x), moved=0.01)) == warned
    assert find_wrinkles(system, system.state(x), moved=1.0) is None  # low beside the motion
