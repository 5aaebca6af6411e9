"""The minima in pyproject.toml are the versions that the workflow `minima` installs."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[1]
TRIED = (ROOT / ".github" / "minima.txt").read_text(encoding="utf-8")


def versions(lines, operator):
    """Package: its version behind `operator`."""
    parsed = [Requirement(line) for line in lines]
    return {
        each.name.lower(): Version(spec.version)
        for each in parsed
        for spec in each.specifier
        if spec.operator == operator
    }


def test_the_declared_minima_are_those_tried():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    optional = [line for name in ("hdf", "test") for line in extras[name]]
    tried = versions([x for x in TRIED.splitlines() if not x.startswith("#")], "==")
    needed = versions(project["dependencies"], ">=")
    assert needed.keys() <= tried.keys()
    declared = needed | versions(optional, ">=")
    assert {name: declared[name] for name in tried} == tried


def test_the_workflow_tries_the_oldest_python():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    workflow = (ROOT / ".github" / "workflows" / "minima.yml").read_text(encoding="utf-8")
    assert f'python-version: "{project["requires-python"].removeprefix(">=")}"' in workflow
    assert "pip install -r .github/minima.txt" in workflow
