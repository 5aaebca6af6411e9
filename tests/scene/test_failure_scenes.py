"""The catalogue of failures runs: each scene fails as its head says, and its remedies cure it.

The predicted boundaries are held against the runs in test_failures_explicit.py and
test_failures_implicit.py.
"""

import re
import shlex
from pathlib import Path

import pytest

from fecloth.cli.main import main

SCENES = Path(__file__).parents[2] / "studies" / "scenes" / "failures"
FAILS = re.compile(r'^# fails: (run|check)(.*) exits (\d) and says "(.+)"$', re.MULTILINE)
REMEDY = re.compile(r"^# remedy: (.+)$", re.MULTILINE)


def lines(pattern):
    """(scene, what the pattern finds) for each line of a head that it finds."""
    result = []
    for path in sorted(SCENES.glob("*.toml")):
        of_scene = pattern.findall(path.read_text(encoding="utf-8"))
        assert of_scene, path
        result += [(path.stem, line) for line in of_scene]
    return result


def called(command, name, text, folder):
    """Exit status of `fecloth` with options as one types them in a shell."""
    more = ["-o", str(folder / "out")] if command == "run" else []
    return main([command, str(SCENES / f"{name}.toml"), *shlex.split(text), *more, "--quiet"])


def test_there_are_fourteen():
    assert len(list(SCENES.glob("*.toml"))) == 14


@pytest.mark.stories
@pytest.mark.parametrize(("name", "line"), lines(FAILS), ids=str)
def test_failure_scene_fails_as_documented(name, line, tmp_path, capfd):
    command, overrides, status, says = line
    assert called(command, name, overrides, tmp_path) == int(status)
    captured = capfd.readouterr()
    assert says in re.sub(r"\s+", " ", captured.out + captured.err)


@pytest.mark.stories
@pytest.mark.parametrize(("name", "remedy"), lines(REMEDY), ids=str)
def test_the_remedy_cures_it(name, remedy, tmp_path):
    assert called("check", name, remedy, tmp_path) == 0
