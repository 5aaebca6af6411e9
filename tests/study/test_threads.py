"""Studies work on one thread: their commands, their scripts, and each run that they measure.

Processes of --jobs have a test in test_processes.py.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

import fecloth as fc
from fecloth.study.measured_runs import measure
from fecloth.study.problem import StudyProblem
from fecloth.study.threads import NAMES

pytestmark = pytest.mark.stories
COMMANDS = """
import os, sys
import fecloth.study
from fecloth.cli.commands import COMMANDS
from fecloth.cli.study_command import Running
from fecloth.study.threads import NAMES

for command in [command for command in COMMANDS if hasattr(command, "__wrapped__")]:
    for each in NAMES:
        os.environ.pop(each, None)
    del sys.modules["fecloth.study.threads"], fecloth.study.threads
    sys.modules["numpy"] = None  # what is imported before it counts
    needed = {"over": ["a=1"]} if command.__name__ == "sweep" else {}
    try:
        command("a.toml", running=Running(), **needed)
    except ImportError:
        assert "numba" not in sys.modules
        print(command.__name__, *(os.environ.get(each) for each in NAMES))
"""
SCRIPTS = """
import os
import studies.evidence.benchmarks.{name}
from fecloth.study.threads import NAMES
from fecloth.compiled.team import Team

print(Team("auto").count, *(os.environ.get(each) for each in NAMES))
"""


def lines_of(code):
    """What code prints in a process whose environment has no limits."""
    clean = {name: value for name, value in os.environ.items() if name not in NAMES}
    done = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def test_commands_limit_every_library_before_they_import_it():
    lines = lines_of(COMMANDS)
    assert len(lines) == 11
    for name, *limits in lines:
        assert limits == ["1"] * len(NAMES), name


@pytest.mark.parametrize("name", ["step_costs", "terms"])
def test_scripts_work_on_one_thread(name):
    assert lines_of(SCRIPTS.format(name=name)) == [["1"] * (1 + len(NAMES))]


CLOTH = fc.Cloth.rectangle(1.0, 1.0, h=0.03, pattern="right")
METHODS = {
    "implicit": (fc.BackwardEuler(), 2e-3, 2e-3),
    "explicit": (fc.CentralDifference(), 2e-5, 4e-4),
    "equilibrium": (None, None, None),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_measured_run_is_on_one_thread(name):
    terms, (method, dt, t_end) = [fc.StVK(), fc.Gravity()], METHODS[name]
    system = fc.System(CLOTH, fc.Fabric(0.2, 1000.0), terms, ["boundary"], threads=2)
    start = system.state(1.02 * system.rest().x)
    setup = StudyProblem.of(lambda: (CLOTH, system, method, start), dt=dt, t_end=t_end).first
    assert np.isfinite(measure(setup, [])["cpu_seconds"])
    assert system.team.used == 1
    assert system.team.count == 2
    system.force(start)
    assert system.team.used == 2
