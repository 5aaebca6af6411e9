"""One way to change a problem: what applies, what is refused, and which cases are the same."""

from dataclasses import replace

import pytest
from support.scene_texts import STRIP
from support.strips import moving_strip as strip

import fecloth as fc
from fecloth.study.cases import Case
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import run_case_of_problem


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "strip.toml"
    path.write_text(STRIP)
    return StudyProblem.of(path)


def key_of(problem):
    return Case.of(run_case_of_problem, {"problem": problem.case()}).key


def test_the_same_problem_is_the_same_case_however_it_was_changed(scene):
    """Words do not count; a value, a term and a file that the scene reads do."""
    h = scene.h
    finer = scene.at({"cloth.h": h / 2})
    assert key_of(finer) != key_of(scene)
    assert key_of(finer) == key_of(scene.finer(h=2.0)) == key_of(scene.choose(h=h / 2))
    assert key_of(finer.at({"cloth.h": h})) == key_of(scene)
    assert key_of(scene.at({"title": "another"})) == key_of(scene)
    assert key_of(scene.finer()) == key_of(scene)
    assert key_of(scene.finer(sharper=100.0)) != key_of(scene.finer(sharper=1.0))


def test_a_type_of_a_term_comes_without_the_defaults_of_the_old_type(scene):
    changed = scene.at({"terms.0.type": "Springs"})
    assert changed.source.scene.terms[0].type == "Springs"


def test_another_element_takes_its_usual_mass_where_the_method_allows_it(scene):
    def mass_of(**values):
        return scene.at({key.replace("_", "."): v for key, v in values.items()}).tables["mass"]

    assert mass_of(cloth_h=0.1) == mass_of(cloth_element="P1") == "lumped"
    assert mass_of(cloth_element="P2") == scene.choose(element="P2").tables["mass"] == "consistent"
    assert mass_of(cloth_element="P2", mass="lumped") == "lumped"
    explicit = scene.at(
        {"equilibrium": None, "time": {"method": "central_difference", "t_end": 0.1}}
    )
    assert explicit.at({"cloth.element": "P2"}).tables["mass"] == "lumped"
    implicit = {"cloth.element": "P2", "time.method": {"type": "bdf2"}}
    assert explicit.at(implicit).tables["mass"] == "consistent"


def test_a_function_has_other_arguments_and_other_terms():
    opened = StudyProblem.of(strip, h=0.25, dt=0.01, t_end=0.1)
    other = opened.at({"h": 0.125, "stiffness": 40.0})
    assert (other.h, other.dt, other.source.arguments["stiffness"]) == (0.125, 0.01, 40.0)
    light = opened.at({"terms": [term for term in opened.tables["terms"] if term["number"] == 0]})
    assert light.first.system.terms == (fc.StVK(),)
    assert light.finer(h=2.0).first.system.terms == (fc.StVK(),)
    assert len({key_of(problem) for problem in (opened, other, light)}) == 3
    assert key_of(opened.at({"h": 0.25})) == key_of(opened)


def test_equal_steps_end_at_the_end():
    """Steps of 0.03 s would pass 0.1 s: four of 0.025 s do not, eight on the next level."""
    opened = StudyProblem.of(strip, h=0.25, dt=0.03, t_end=0.1)
    assert opened.first.steps.dt == 0.1 / 4
    assert opened.finer(dt=2.0).first.steps.dt == 0.1 / 8


def needy(h, stiffness, power=0):
    return strip(h, 0.01, stiffness * 10.0**power)


def test_a_function_takes_the_values_without_which_it_has_no_set_up():
    opened = StudyProblem.of(needy, h=0.25)
    completed = opened.completed({"stiffness": 3.0, "power": 2})
    assert completed.source.arguments == {"h": 0.25, "stiffness": 3.0}
    assert completed.root is None  # its size comes from its own set-up
    assert completed.completed({"stiffness": 5.0}) is completed


def test_the_size_of_a_level_needs_no_set_up(scene):
    """Neither for a scene nor for a function; another shape of a scene has its own size."""
    function = StudyProblem.of(strip, h=0.25, dt=0.01, t_end=0.1)
    triangles = len(function.first.cloth.triangles)
    calls = []
    counted = replace(function.source, function=lambda h, dt: calls.append(h) or strip(h, dt))
    opened = replace(function, source=counted)
    assert opened.work.triangles == triangles
    assert opened.finer(h=2.0, dt=2.0).work.triangles == 4 * triangles
    assert opened.finer(h=2.0, dt=2.0).work.steps == 20
    assert calls == [0.25]
    assert scene.finer(h=2.0).work.triangles == pytest.approx(4 * scene.work.triangles)
    wide = scene.at({"cloth.height": 0.5}).work.triangles
    assert wide == pytest.approx(2 * scene.work.triangles)
