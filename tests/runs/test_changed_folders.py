"""Folders of runs that are changed from outside: frames lost, folders moved, headers spoiled."""

import shutil
import signal
from pathlib import Path

import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.cli.main import main

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
output = { every_steps = 1, restart_steps = 2 }
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sheet.toml").write_text(SCENE)
    return fc.load_scene("sheet.toml")


def run(scene, folder, steps=None, **options):
    """Run, and stop after so many steps."""

    def report(info):
        if info.step == steps:
            signal.raise_signal(signal.SIGTERM)

    return fc.run_scene(scene, folder, report=report, **options)


@pytest.mark.parametrize("number", stories_except([0, 3, 5], 3))
@pytest.mark.parametrize("is_empty", [False, True])
def test_a_missing_frame_is_refused_at_resume(scene, tmp_path, number, is_empty):
    run(scene, "out", steps=6)
    frame = tmp_path / "out/frames" / f"frame_{number:06d}.vtu"
    frame.write_bytes(b"") if is_empty else frame.unlink()
    before = sorted(file.name for file in (tmp_path / "out").rglob("*"))
    with pytest.raises(fc.InputError, match=rf"{frame.name}.* is missing.*--overwrite"):
        run(scene, "out", resume=True)
    assert sorted(file.name for file in (tmp_path / "out").rglob("*")) == before
    assert main(["run", "sheet.toml", "--resume", "out"]) == 2


@pytest.mark.stories
@pytest.mark.parametrize("every", [1, 100], ids=["between frames", "before the end"])
def test_a_folder_that_moves_during_a_run_is_told_and_not_made_again(scene, tmp_path, every):
    def move(info):
        if info.step == 5:
            shutil.move("out", "moved")

    scene = fc.load_scene(
        "sheet.toml", [f"output.every_steps={every}", f"output.restart_steps={every}"]
    )
    outcome = fc.run_scene(scene, "out", report=move)
    assert outcome.status == "failed"
    assert "out was moved or removed during the run" in str(outcome.error)
    assert not Path("out").exists()
    assert (tmp_path / "moved/steps.csv").is_file()
    outcome = fc.run_scene(scene, "moved", resume=True)
    assert outcome.status == "done"
