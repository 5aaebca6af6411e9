"""What the README tells a reader to type works."""

import re
import tomllib
from pathlib import Path

import pytest

import fecloth as fc
from fecloth.scene import load

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_the_python_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("python")
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    tip, remainder = map(float, capsys.readouterr().out.splitlines()[0].split())
    assert -1.1 < tip < -0.5
    assert abs(remainder) < 1e-2
    assert (tmp_path / "out" / "swing.pvd").is_file()
    assert names["K"].shape == names["M"].shape == (3 * len(names["cloth"].X),) * 2


def test_the_scene_of_the_readme_builds(tmp_path):
    (text,) = blocks("toml")
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    scene = load(path)
    scene.require_expectations()
    built = scene.build()
    assert built.system.names == ("StVK", "StrainRateDamping", "Gravity")


@pytest.mark.parametrize(
    "pattern", [r"`(studies/[\w./]+)`", r"`(meshes/[\w./]*)`", r"\((\S+png)\)"]
)
def test_files_that_it_names_exist(pattern):
    named = re.findall(pattern, README)
    assert named
    for name in named:
        assert (ROOT / name).exists(), name


def test_its_folder_table_names_every_mesh_and_only_those():
    line = next(line for line in README.splitlines() if line.startswith("| `meshes/`"))
    assert set(re.findall(r"`(\w+)`", line)) == {p.stem for p in (ROOT / "meshes").glob("*.geo")}


def test_ci_uses_its_test_command():
    command = next(line.strip() for line in README.splitlines() if line.endswith("pytest -q"))
    assert command.startswith("python3 -m venv .venv && ")
    assert "pytest -q$' README.md" in (ROOT / ".ci" / "run").read_text()


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == fc.__version__
    assert f"- {fc.__version__}" in README.split("## Changelog")[1]
