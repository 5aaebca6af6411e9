"""The estimated size of a study before its first case, and the time left after it."""

from pathlib import Path

import pytest
from support.strips import scene_file

import fecloth as fc
from fecloth.errors import InputError
from fecloth.scene.scene import load_scene
from fecloth.study import work
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Run, Runs, announce
from fecloth.study.work import Work, in_magnitude

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.05 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.5 }
"""


scene = scene_file(SCENE, "flag")


def work_of(scene, *changes):
    return StudyProblem.of(load_scene(scene, changes)).work


def test_the_size_is_the_size_of_the_scene(scene):
    triangles = len(load_scene(scene).mesh().triangles)
    assert work_of(scene).triangles == pytest.approx(triangles, rel=0.15)
    assert work_of(scene).steps == 50
    assert work_of(scene, "time.dt=0.005").steps == 100
    changes = ["time.method=central_difference", "time.dt=auto", "cloth.pattern=cross"]
    explicit = load_scene(scene, changes)
    triangles = len(explicit.mesh().triangles)
    assert work_of(scene, *changes).triangles == pytest.approx(triangles, rel=0.15)
    system = explicit.build().system
    stable = 0.9 * fc.critical_dt(system, system.rest(), "central_difference")
    assert work_of(scene, *changes).steps == pytest.approx(0.5 / stable, rel=0.7)
    assert work_of(scene, *changes).kind == "explicit"


def test_the_size_of_a_shape_from_a_file_needs_no_fine_mesh():
    """With h in mm by mistake, the mesh alone would take minutes."""
    scene = SCENES / "flag.toml"
    triangles = len(load_scene(scene).mesh().triangles)
    assert work_of(scene).triangles == pytest.approx(triangles, rel=0.15)
    assert work_of(scene, "cloth.h=0.0006").triangles == pytest.approx(1e4 * triangles, rel=0.15)


def test_kinds_of_steps_and_load_steps_count():
    five, ten = (
        work_of(SCENES / "inflated_disk.toml", f"equilibrium.load_steps={n}") for n in (5, 10)
    )
    assert (five.steps, ten.steps, five.kind) == (50, 100, "static")
    assert five.unit == "Newton iterations"
    assert work_of(SCENES / "drop.toml").kind == "with contact"
    assert work_of(SCENES / "swing.toml").kind == "implicit"


def test_the_estimated_seconds_of_a_case_by_hand():
    """30 µs of meshing for each triangle, the time of a case by its kind, and the steps."""
    implicit, static, contact, explicit = (
        Work(1000.0, 100, kind).seconds
        for kind in ("implicit", "static", "with contact", "explicit")
    )
    triangles = 1000**1.3
    assert implicit == pytest.approx(0.05 + 100 * (4e-3 + 1.5e-6 * triangles))
    assert static == pytest.approx(0.13 + 100 * (1e-3 + 7e-7 * triangles))
    assert contact == pytest.approx(0.05 + 100 * (4.5e-2 + 4.5e-6 * triangles))
    assert explicit == pytest.approx(0.05 + 100 * (1.4e-3 + 1e-6 * 1000))


def test_magnitudes_in_words():
    words = [in_magnitude(t) for t in (9, 11, 61, 601, 3601, 86401)]
    expected = ["some seconds", "half a minute", "minutes", "half an hour", "hours", "2 days"]
    assert words == expected


@pytest.mark.parametrize(("files", "words"), [(["a.nbc"], "some seconds"), ([], "half a minute")])
def test_the_first_time_is_with_start_and_compilation(files, words, tmp_path, monkeypatch, capsys):
    for file in files:
        (tmp_path / file).touch()
    monkeypatch.setattr(work, "cache_folder", lambda: str(tmp_path))
    assert work.start_seconds() == (3.0 if files else 23.0)
    problem = StudyProblem.of(lambda h=1.0: None)
    announce([Run(problem, "", own_work=Work(1000, 50))], Runs(), stages=0)
    first_words = "next stage: 1 case, up to 1,000 triangles × 50 steps; it may take"
    assert capsys.readouterr().err == f"{first_words} {words}\n"


def test_a_study_that_would_take_hours_needs_yes(scene, capsys, monkeypatch):
    """A width of 40 m, meant in cm, as in a file of a user."""
    scene.write_text(SCENE.replace("width = 1.0", "width = 40").replace("h = 0.05", "h = 0.01"))
    problem = StudyProblem.of(scene)
    runs = [Run(problem.finer(h=by), "") for by in (1, 2, 4)]
    assert runs[2].work.triangles > 7e6
    with pytest.raises(InputError, match=r"triangles × 50 steps: .*above 3,600 s.*runs it anyway"):
        announce(runs, Runs())
    announce(runs, Runs(most_seconds=None))
    capsys.readouterr()
    monkeypatch.setattr(work, "cache_folder", lambda: str(scene.parent))  # which is not empty
    announce([Run(problem, "", own_work=Work(1000, 50))], Runs(), stages=2)
    expected = (
        "at most 2 stages, the first of 1 case, up to 1,000 triangles × 50 steps; it may take"
    )
    assert capsys.readouterr().err == f"{expected} some seconds\n"
