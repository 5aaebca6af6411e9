"""A run whose frames do not fit is refused before its first step, and leaves nothing."""

import shutil
from collections import namedtuple

import pytest

import fecloth as fc
from fecloth.runs import recorder, run_files

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
"""
Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sheet.toml").write_text(SCENE)


CASES = [
    ["output.every_steps=1"],
    ["output.frames=10"],
    ["output.every_steps=3"],
    ["output.every=0.03", 'time.dt="auto"'],
    ["output.frames=4", 'time.dt="auto"'],
]


@pytest.mark.parametrize("overrides", CASES, ids=str)
def test_frames_are_counted_before_the_run(scene, tmp_path, overrides):
    loaded = fc.load_scene("sheet.toml", overrides)
    expected = run_files.count_frames(loaded.build())
    assert fc.run_scene(loaded, "out").summary["frames"] == expected


def test_frames_beyond_the_space_on_the_disk_are_refused(scene, tmp_path, monkeypatch, run_command):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1, 1, 10_000))
    assert "output: 11 frames of" in (
        words := run_command("run", "sheet.toml", "--set", "output.every_steps=1", status=2).err
    )
    assert "has 1e-05 GB left" in words
    assert not (tmp_path / "out" / "sheet").exists()


def test_frames_and_steps_have_a_limit(scene, tmp_path, monkeypatch, run_command):
    monkeypatch.setattr(run_files, "MOST_FRAMES", 10)
    assert (
        "11 frames: must be at most 10"
        in run_command("run", "sheet.toml", "--set", "output.every_steps=1", status=2).err
    )
    monkeypatch.setattr(run_files, "MOST_FRAMES", 2)
    steps = ["--set", 'time.dt="auto"', "--set", "output.every_steps=1"]
    assert (
        "one frame more: must be at most 2"
        in run_command("run", "sheet.toml", *steps, status=3).err
    )
    monkeypatch.setattr(run_files, "MOST_FRAMES", 10)
    monkeypatch.setattr(recorder, "MOST_STEPS", 2)
    few = ["--set", "output.frames=2"]
    assert (
        "step 3: must be at most 2"
        in run_command("run", "sheet.toml", *steps[:2], *few, "-o", "other", status=3).err
    )
