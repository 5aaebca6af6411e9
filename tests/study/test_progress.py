"""Progress lines of studies: time left, stored cases, short causes; sizes before the first run."""

import pytest
from support.scene_texts import STRIP

import fecloth as fc
from fecloth import study
from fecloth.cli import main as cli
from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.study import measured_runs
from fecloth.study.cases import Progress
from fecloth.study.problem import StudyProblem
from fecloth.study.status import TimeLimit

SCENE = STRIP.partition("interest")[0]


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "strip.toml"
    file.write_text(STRIP)
    return file


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


def test_a_function_that_runs_in_this_process_shows_progress(capsys):
    def strip(h):
        cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, 20.0), [fc.StVK()], pins=["left"])
        return cloth, system, None, system.rest()

    study.sweep(strip, "h=0.25,0.125", "area")
    lines = capsys.readouterr().err.splitlines()
    assert [line.rpartition("] ")[2] for line in lines[1:]] == ["h = 0.25: ok", "h = 0.125: ok"]


def test_commands_share_the_cases_that_they_have_in_common(scene, tmp_path, capsys):
    """`sweep` runs what `converge` has run at the same values, and `compare` the same levels."""
    run = {"cache": tmp_path / "cache"}
    study.converge(scene, "tip.x", levels=3, **run)
    capsys.readouterr()
    study.sweep(scene, "fabric.tensile_stiffness=20,40", "tip.x", **run)
    assert "stored: 1 of 2\n" in capsys.readouterr().err
    study.compare(scene, "fabric.tensile_stiffness=20,40", "tip.x", **run)
    assert "stored: 4 of 6\n" in capsys.readouterr().err


def test_the_quantities_of_interest_share_their_runs(scene, tmp_path, capsys):
    more = '[interest]\nquantities = ["tip.x", "max tip.z"]\n'
    scene.write_text(SCENE + more)
    study.converge(scene, levels=3, cache=tmp_path / "cache")
    capsys.readouterr()
    study.converge(scene, "max tip.z", levels=3, cache=tmp_path / "cache")
    assert "stored: 3 of 3\n" in capsys.readouterr().err


def test_a_sweep_builds_each_scene_once(scene, monkeypatch):
    """Its values are checked without their meshes: only the first scene is built to check it."""
    built = []
    build = Scene.build
    monkeypatch.setattr(Scene, "build", lambda self, *given: built.append(1) or build(self, *given))
    study.sweep(scene, "fabric.tensile_stiffness=10,20,40")
    assert len(built) == 4


def test_values_that_only_the_mesh_refuses_are_rows_or_an_error(scene):
    found = study.sweep(scene, {"pins.0.where": ["left", "nowhere"]}, "tip.x")
    assert found.table["status"] == ["ok", "refused"]
    with pytest.raises(InputError, match="nowhere"):
        study.sweep(scene, {"pins.0.where": ["nowhere"]}, "tip.x")


@pytest.mark.parametrize(
    "function",
    [study.converge, study.chart, study.front, fc.tune, study.simplify, study.sensitivity],
)
def test_a_huge_scene_is_refused_before_its_mesh_is_made(function, scene, monkeypatch):
    scene.write_text(scene.read_text().replace("h = 0.125", "h = 1e-5"))
    monkeypatch.setattr(Scene, "build", lambda self, *given: pytest.fail("it was built"))
    with pytest.raises(InputError, match="above 3,600 s"):
        function(scene)


def test_the_command_names_its_way_out_and_its_mistakes(scene, capsys):
    huge = ["--set", "cloth.h=1e-5"]
    wrong = {
        "--yes, runs it anyway": huge,
        "jobs = 0: must be an integer of at least 1": ["--jobs", "0"],
        "time_limit = 0.0: must be a finite number > 0": ["--time-limit", "0"],
    }
    for said, options in wrong.items():
        assert cli.main(["converge", str(scene), *options]) == 2
        assert said in capsys.readouterr().err


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
