"""Progress lines of studies: time left, stored cases, short causes; sizes before the first run."""

import pytest
from support.scene_texts import STRIP
from support.strips import scene_file

import fecloth as fc
from fecloth import study
from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.study import measured_runs
from fecloth.study.cases import Progress
from fecloth.study.problem import StudyProblem
from fecloth.study.status import TimeLimit

scene = scene_file(STRIP, "strip")


def test_the_time_left_is_what_cases_took_in_proportion_to_their_costs():
    """Not the time by the clock, in which the first case compiles for 10 s."""
    clock = iter([0.0, 12.0, 14.0]).__next__
    progress = Progress([1.0, 2.0, 6.0], clock=clock)
    progress.add(1.0, seconds=2.0)
    assert progress.seconds_left == pytest.approx(16.0)
    progress.add(2.0, seconds=2.0)
    assert progress.seconds_left == pytest.approx(8.0)


def test_cases_side_by_side_take_a_part_of_the_time():
    progress = Progress([1.0] * 5, at_once=2)
    progress.add(1.0, seconds=3.0)
    assert progress.seconds_left == pytest.approx(6.0)


def test_the_clock_counts_until_a_case_has_measured_its_seconds():
    """A case that failed has none: it ended early."""
    progress = Progress([2.0, 2.0, 6.0], clock=iter([0.0, 10.0]).__next__)
    progress.add(2.0)
    assert progress.seconds_left == pytest.approx(40.0)
    progress.add(2.0, seconds=3.0)
    assert progress.seconds_left == pytest.approx(9.0)


@pytest.mark.parametrize(("most", "stops"), [(31.0, False), (29.0, True), (None, False)])
def test_a_study_stops_after_its_first_case_where_the_others_take_too_long(most, stops, capsys):
    progress = Progress([2.0, 6.0], most_seconds=most, clock=iter([0.0, 10.0]).__next__)
    result = {"status": "ok", "cause": "", "case_seconds": 10.0}
    if not stops:
        progress.print("h", result, 2.0)
        return
    with pytest.raises(InputError, match="after the first of 2 cases, about 30 s left"):
        progress.print("h", result, 2.0)


def test_lines_say_what_is_stored_and_the_first_words_of_a_cause(capsys):
    progress = Progress([1.0, 1.0], stored=3, clock=iter([0.0, 1.0, 1.0, 1.0, 4.0]).__next__)
    progress.print("h / 2", {"status": "failed", "cause": "step 1 failed " * 20}, 1.0)
    progress.print("h / 4", {"status": "ok", "cause": "", "case_seconds": 3.0}, 1.0)
    stored, failed, last = capsys.readouterr().err.splitlines()
    assert stored == "cases already stored: 3 of 5"
    assert failed.startswith("[1/2, 1 s, about 1 s left] h / 2: failed: step 1 failed step")
    assert len(failed) < 150
    assert last == "[2/2, 4 s] h / 4: ok"


def test_commands_share_the_cases_that_they_have_in_common(scene, tmp_path, capsys):
    """`sweep` runs what `converge` has run at the same values, and `compare` the same levels."""
    run = {"cache": tmp_path / "cache"}
    study.converge(scene, "tip.x", levels=3, **run)
    capsys.readouterr()
    study.sweep(scene, "fabric.tensile_stiffness=20,40", "tip.x", **run)
    assert "stored: 1 of 2\n" in capsys.readouterr().err
    study.compare(scene, "fabric.tensile_stiffness=20,40", "tip.x", **run)
    assert "stored: 4 of 6\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    "function",
    [study.converge, study.chart, study.front, fc.tune, study.simplify, study.sensitivity],
)
def test_a_huge_scene_is_refused_before_its_mesh_is_made(function, scene, monkeypatch):
    scene.write_text(scene.read_text().replace("h = 0.125", "h = 1e-5"))
    monkeypatch.setattr(Scene, "build", lambda self, *given: pytest.fail("it was built"))
    with pytest.raises(InputError, match="above 3,600 s"):
        function(scene)


def test_compilation_does_not_count_against_the_limit_of_a_variant(scene, monkeypatch):
    """The run that warms up is over its limit, as where it compiles; the next is not."""
    setup = StudyProblem.of(scene).setup()
    clock = iter([0.0, 2.0, 2.0, 2.5, 3.0])  # begin and step of the first; begin, step and end
    monkeypatch.setattr(measured_runs.time, "process_time", lambda: next(clock))
    row = measured_runs.measure(setup, [], timed=True, repeats=1, most=1.0)
    assert row["cpu_seconds"] == 1.0
    clock = iter([0.0, 2.0])
    with pytest.raises(TimeLimit, match="more than 1 CPU s"):
        measured_runs.measure(setup, [], most=1.0)
