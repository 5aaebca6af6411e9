"""`fecloth.study.of`: each study is a method, and the shared arguments stand in one place."""

import inspect

import numpy as np
import pytest
from support.scene_texts import STRIP as SCENE
from support.strips import TIP, moving_strip, scene_file, strip

import fecloth as fc
from fecloth.study import problem as problems
from fecloth.study.charts import LONGEST_CASE as LONGEST_OF_CHART
from fecloth.study.opened import open_study
from fecloth.study.stability_map import LONGEST_CASE as LONGEST_OF_STABILITY

STUDIES = {
    "converge": fc.study.converge,
    "compare": fc.study.compare,
    "sweep": fc.study.sweep,
    "chart": fc.study.chart,
    "stability": fc.study.stability,
    "simplify": fc.study.simplify,
    "tune": fc.tune,
}
CALLS = {  # the positional arguments of each study, and its keywords
    "converge": (("tip.x", "h", 3), {"ratio": 2.0}),
    "compare": (("stiffness=40,20", "tip.x"), {}),
    "sweep": (("stiffness=20:80:log:3", "tip.x"), {}),
    "chart": (("tip.x",), {"meshes": 1}),
    "simplify": (("20%", "tip.x"), {"repeats": 1}),
    "tune": (("20 %", "tip.x"), {}),
}
COLUMNS = {"converge": "value", "chart": "error", "simplify": "change [%]", "tune": "error"}
scene = scene_file(SCENE, "strip")


@pytest.mark.parametrize("name", CALLS)
def test_each_study_is_a_method(name, tmp_path):
    given, keywords = CALLS[name]
    shared = {"h": 0.25, "probes": TIP, "cache": tmp_path}
    by_function = STUDIES[name](strip, *given, **keywords, **shared)
    by_method = getattr(fc.study.of(strip, **shared), name)(*given, **keywords)
    assert type(by_method) is type(by_function)
    assert by_method.title == by_function.title == "strip"
    column = COLUMNS.get(name, "tip.x")
    np.testing.assert_array_equal(by_method.table[column][:2], by_function.table[column][:2])


def test_one_study_answers_several_questions_and_reads_its_scene_once(scene, monkeypatch, capsys):
    read = []
    load = problems.load_scene
    monkeypatch.setattr(problems, "load_scene", lambda path: read.append(path) or load(path))
    study = fc.study.of(scene, cache=scene.parent)
    first = study.converge("tip.x", levels=3)
    capsys.readouterr()
    swept = study.sweep("cloth.h=0.125,0.0625", "tip.x")
    assert "stored: 1 of 2\n" in capsys.readouterr().err  # h / 2 started from the first level
    assert swept.table["tip.x"] == pytest.approx(first.table["value"][:2], rel=1e-9)
    assert read == [scene]
    assert repr(study) == "<Study of strip>"


def test_several_problems_are_for_compare_alone(scene):
    other = scene.with_name("other.toml")
    other.write_text(SCENE.replace("= 20.0", "= 40.0"))
    study = fc.study.of([scene, other])
    result = study.compare(quantity="tip.x")
    assert result.table["variant"] == ["strip", "other"]
    assert result.verdict == fc.study.compare([scene, other], quantity="tip.x").verdict


def test_no_study_has_a_shared_argument_of_its_own():
    shared = set(inspect.signature(fc.study.of).parameters) - {"problem"}
    assert len(shared) == 11  # ten, and the settings of a function
    for name, study in STUDIES.items():
        parameters = inspect.signature(study).parameters
        assert not shared & parameters.keys(), name
        assert next(iter(parameters)) == "problem"
        assert parameters["shared"].kind is inspect.Parameter.VAR_KEYWORD
        assert "Arguments of `fecloth.study.of`" in study.__doc__
        assert vars(fc.study.Study)[name] is study


def test_the_usual_time_of_a_case_holds_unless_one_is_given():
    assert (LONGEST_OF_CHART, LONGEST_OF_STABILITY) == (60.0, 120.0)
    for given, then in (({}, 60.0), ({"time_limit": None}, None), ({"time_limit": 5.0}, 5.0)):
        assert open_study(strip, given).runs(60.0).time_limit == then
    assert open_study(strip, {}).runs().time_limit is None


def test_the_modes_are_those_about_the_start_or_the_equilibrium(scene):
    def frequencies(problem, **shared):
        study = fc.study.of(problem, **shared)
        result = study.modes(count=2)
        assert result.title.startswith("Modes of ")
        assert np.array_equal(result.frequencies, study.modes(count=2).frequencies)
        return result.frequencies

    _, system, _, start = strip(0.125)
    hanging = fc.modes(system, fc.equilibrium(system, start), count=2).frequencies
    assert frequencies(strip, h=0.125) == pytest.approx(hanging, rel=1e-12)
    assert frequencies(scene) == pytest.approx(hanging, rel=1e-4)  # by its own load steps
    with pytest.warns(fc.FeclothWarning, match="not in equilibrium"):
        flat = fc.modes(system, start, count=2).frequencies
    with pytest.warns(fc.FeclothWarning, match="not in equilibrium"):
        moving = frequencies(moving_strip, h=0.125, dt=0.1, t_end=0.2, stiffness=20.0)
    assert moving == pytest.approx(flat, rel=1e-12, abs=1e-6)
