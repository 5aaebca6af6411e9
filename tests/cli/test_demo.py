"""`fecloth demo` in a clone; tests/test_wheel.py has it away from one."""

import tomllib

import pytest

from fecloth.cli.demo import gallery
from fecloth.cli.main import main


def test_it_lists_the_scenes_with_their_titles(run_command):
    *lines, following = run_command("demo").out.splitlines()
    titles = {name: tomllib.loads(file.read_text())["title"] for name, file in gallery().items()}
    assert len(titles) > 10
    assert {line.split()[0]: line.split(maxsplit=1)[1] for line in lines} == titles
    assert following == "next: fecloth demo flag"


def test_a_name_runs_that_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    short = ["--set", "cloth.h=0.5", "--quiet"]
    assert main(["demo", "sag", *short]) == 0
    assert main(["demo", "sag", *short, "-o", "other"]) == 0
    assert {folder.name for folder in tmp_path.rglob("*") if (folder / "run.pvd").exists()} == {
        "sag",
        "other",
    }


@pytest.mark.parametrize("name", ["flag", "drape"])
def test_the_scenes_find_their_meshes(name):
    from fecloth.scene.scene import load_scene

    assert len(load_scene(gallery()[name], ["cloth.h=0.05"]).mesh().triangles) > 10
