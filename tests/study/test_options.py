"""Options of a study, each mistake in them as one line, and the estimated size of problems."""

import errno
import sys

import pytest

import fecloth as fc
from fecloth.errors import FeclothError, InputError
from fecloth.output.atomic_files import DiskFull
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Run
from studies import harness
from studies.harness import exit_status


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


def strip(h, dt=0.01, stiffness=1000.0, method="bdf2"):
    """A strip that can be made on a coarse mesh only, with its first stiffness."""
    if h < 0.2 or stiffness != 1000.0:
        raise InputError("a number", "is refused")
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, stiffness), [fc.StVK()], ["left"], mass="lumped")
    methods = {"bdf2": fc.BDF2, "central": fc.CentralDifference}
    return cloth, system, methods[method](), system.rest()


def test_a_function_with_another_method_has_the_steps_of_that_method():
    chosen = StudyProblem.of(strip, h=0.25, t_end=0.5).choose(method="central")
    assert chosen.work.kind == "explicit"
    stable = fc.critical_dt(chosen.first.system, chosen.first.start, "central_difference")
    assert chosen.work.steps == pytest.approx(0.5 / stable, abs=1)
    finer = chosen.finer(h=10)
    assert finer.work.steps == pytest.approx(10 * 0.5 / stable, rel=0.01)


def test_arguments_that_are_no_json_values_run_in_this_process():
    """A tuple counts as the list that JSON reads back."""
    problem = StudyProblem.of(strip, h=0.25)
    assert Run(problem.at({"stiffness": (1.0, 2.0)}), "").problem.case()["source"]["arguments"] == {
        "h": 0.25,
        "stiffness": [1.0, 2.0],
    }
    assert Run(problem, "").case is not None
    assert Run(problem.at({"stiffness": object()}), "").case is None
