"""Options of a study, each mistake in them as one line, and the predicted size of scenes."""

import errno
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import fecloth as fc
from fecloth.errors import FeclothError, InputError
from fecloth.output.atomic_files import DiskFull
from fecloth.scene.scene import load_scene
from fecloth.study.workload import LONGEST, Workload, check_size, count_steps
from studies import harness
from studies.harness import exit_status

ROOT = Path(__file__).parents[2]
SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.05 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.5 }
"""


@pytest.fixture
def scene(tmp_path):
    """Return the path of a scene."""
    path = tmp_path / "flag.toml"
    path.write_text(SCENE)
    return path


def parse(*arguments):
    return harness.parse_arguments("A study.", [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--jobs", "0"], "--jobs 0: must be at least 1"),
        (["--jobs", "two"], "invalid int value"),
        (["--nonsense"], "unrecognized arguments: --nonsense"),
        (["--scheduler", "tcp://localhost:1"], r"distributed: is not installed.*\.\[dask\]"),
    ],
)
def test_a_mistake_is_one_line_and_exit_status_2(capsys, monkeypatch, arguments, words):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert exit_status(lambda: parse(*arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    with pytest.raises(InputError, match=words):
        parse(*arguments)


def test_a_missing_package_is_noticed_with_the_options(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(InputError, match=r"pyvista: is not installed.*\.\[view\]"):
        harness.parse_arguments("A study.", [], needs=["pyvista"])


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (None, 0, ""),
        (InputError("h = 0", "must be > 0"), 2, "error: h = 0: must be > 0"),
        (FeclothError("the iteration stopped"), 3, "failed: the iteration stopped"),
        (DiskFull("out/report.md", "no space"), 3, "failed: out/report.md"),
        (KeyboardInterrupt(), 4, "interrupted"),
        (PermissionError(13, "not allowed"), 2, "error: [Errno 13] not allowed"),
        (OSError(errno.ENOSPC, "no space"), 3, "failed: [Errno 28] no space. Free space"),
        (MemoryError(), 3, "failed: memory is full"),
    ],
)
def test_exit_statuses_are_those_of_the_command_line(capsys, error, status, words):
    def main():
        if error:
            raise error

    assert exit_status(main) == status
    assert capsys.readouterr().err.startswith(words)


def test_the_predicted_size_is_that_of_the_scene(scene):
    loaded = load_scene(scene)
    triangles = len(loaded.mesh().triangles)
    assert Workload.of(loaded).triangles == pytest.approx(triangles, rel=0.15)
    assert Workload.of(loaded).steps == 50
    assert Workload.of(load_scene(scene, ["time.dt=0.005"])).steps == 100
    explicit = load_scene(
        scene, ["time.method=central_difference", "time.dt=auto", "cloth.pattern=cross"]
    )
    triangles = len(explicit.mesh().triangles)
    assert Workload.of(explicit).triangles == pytest.approx(triangles, rel=0.15)
    system = explicit.build().system
    stable = 0.9 * fc.critical_dt(system, system.rest(), "central_difference")
    assert count_steps(explicit) == pytest.approx(0.5 / stable, rel=0.7)


def test_the_size_of_a_shape_from_a_file_needs_no_fine_mesh(tmp_path):
    """With h in mm by mistake, the mesh alone would take minutes."""
    scene = ROOT / "studies" / "scenes" / "flag.toml"
    triangles = len(load_scene(scene).mesh().triangles)
    assert Workload.of(load_scene(scene)).triangles == pytest.approx(triangles, rel=0.15)
    tiny = load_scene(scene, ["cloth.h=0.0006"])
    assert Workload.of(tiny).triangles == pytest.approx(1e4 * triangles, rel=0.15)


def test_the_results_go_to_the_folder_of_the_study(monkeypatch):
    for script in ("studies/mine/__main__.py", "mine.py"):
        monkeypatch.setattr(sys, "argv", [script])
        assert parse().out.as_posix() == "out/mine"
    assert parse("--out", "here").out.as_posix() == "here"


@pytest.mark.stories
def test_a_study_that_would_take_hours_needs_yes(scene, capsys):
    """A width of 40 m, meant in cm, as in a file of a user."""
    scene.write_text(SCENE.replace("width = 1.0", "width = 40").replace("h = 0.05", "h = 0.01"))
    first = Workload.of(load_scene(scene))
    size = [replace(first, triangles=first.triangles * by**2) for by in (1, 2, 4)]
    assert size[2].triangles > 7e6
    with pytest.raises(InputError, match=r"triangles × 50 steps: .*above 60 min.*runs it anyway"):
        check_size(size, 1, LONGEST, "a scene")
    check_size(size, 1, None, "a scene")
    check_size([Workload(1000, 50)], 1, LONGEST, "a scene")
    assert (
        "1 case, up to 1,000 triangles × 50 steps; predicted: about 1 s" in capsys.readouterr().err
    )
