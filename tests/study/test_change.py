"""One way to change a problem: what applies, what is refused, and which cases are the same."""

from dataclasses import replace

import pytest
from support.scene_texts import STRIP

import fecloth as fc
from fecloth.errors import InputError
from fecloth.scene.scene import scene_of
from fecloth.study.cases import Case
from fecloth.study.change import AS_IS, Change, Level
from fecloth.study.problems import open_problem
from fecloth.study.run_problems import run_task


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "strip.toml"
    path.write_text(STRIP)
    return open_problem(path)


def strip(h, dt=0.01, stiffness=20.0):
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    fabric = fc.Fabric(0.2, stiffness)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    return cloth, system, fc.BackwardEuler(), system.rest()


def drop_gravity(tables):
    tables["terms"] = [term for term in tables["terms"] if term["type"] != "Gravity"]
    return tables


def key_of(problem):
    return Case.of(run_task, {"problem": problem.case()}).key


def test_edits_come_before_values_and_the_tables_given_stay():
    def edit(tables):
        tables["cloth"]["h"] *= 2
        return tables

    tables = {"cloth": {"h": 0.1, "element": "P1"}}
    assert Change(edits=(edit, edit)).apply(tables)["cloth"]["h"] == 0.4
    both = Change(values={"cloth.element": "P2", "cloth.h": 0.3}, edits=(edit,))
    assert both.apply(tables) == {"cloth": {"h": 0.3, "element": "P2"}}
    assert tables == {"cloth": {"h": 0.1, "element": "P1"}}


@pytest.mark.parametrize("value", [1e-6, 3, True, "P2", [0.5, 1.0], {"x": [True, "a b"]}])
def test_values_arrive_as_they_are(value):
    assert Change(values={"a.b": value}).apply({"a": {}}) == {"a": {"b": value}}


def test_the_same_problem_is_the_same_case_however_it_was_changed(scene):
    """Words do not count; a value, a term and a file that the scene reads do."""
    h = scene.h
    finer = scene.changed(Change.of({"cloth.h": h / 2}))
    assert key_of(finer) != key_of(scene)
    assert key_of(finer) == key_of(scene.refined(Level(h=2.0, sharper=None)))
    assert key_of(finer.changed(Change.of({"cloth.h": h}))) == key_of(scene)
    assert key_of(scene.changed(Change.of({"title": "another"}))) == key_of(scene)
    assert key_of(scene.refined(AS_IS)) == key_of(scene)
    number = scene.changed(Change.of({"equilibrium.tolerance": 1e-8}))
    assert key_of(number.refined(Level(sharper=100.0))) != key_of(number)
    assert key_of(scene.refined(Level(sharper=100.0))) == key_of(scene)  # "auto": sharp enough


def test_a_type_of_a_term_comes_without_the_defaults_of_the_old_type(scene):
    changed = scene.changed(Change.of({"terms.0.type": "Springs"}))
    assert changed.scene.terms[0].type == "Springs"


def test_a_refused_change_names_the_file_the_change_and_the_key(scene):
    titled = replace(scene, name="A flag")
    with pytest.raises(InputError, match=r"^strip\.toml with cloth.h = true: cloth.h = True: must"):
        titled.changed(Change.of({"cloth.h": "true"}))
    with pytest.raises(InputError, match=r"^strip\.toml: refine = 'dt': an equilibrium has no dt"):
        titled.check("dt")
    with pytest.raises(InputError, match="^the scene: refine = 'dt'"):
        open_problem(scene_of(scene.tables)).check("dt")
    with pytest.raises(InputError, match="speed = 3: the function takes h, dt, stiffness"):
        open_problem(strip, h=0.25).changed(Change.of({"speed": 3}))


def test_a_function_has_other_arguments_and_other_terms():
    opened = open_problem(strip, h=0.25, dt=0.01, t_end=0.1)
    other = opened.changed(Change.of({"h": 0.125, "stiffness": 40.0}))
    assert (other.h, other.dt, other.settings) == (0.125, 0.01, {"stiffness": 40.0})
    light = opened.changed(Change(edits=(drop_gravity,)))
    assert light.first.system.terms == (fc.StVK(),)
    assert light.refined(Level(h=2.0)).first.system.terms == (fc.StVK(),)
    assert len({key_of(problem) for problem in (opened, other, light)}) == 3
    assert key_of(opened.changed(Change.of({"h": 0.25}))) == key_of(opened)


def test_equal_steps_end_at_the_end():
    """Steps of 0.03 s would pass 0.1 s: four of 0.025 s do not, eight on the next level."""
    opened = open_problem(strip, h=0.25, dt=0.03, t_end=0.1)
    assert opened.arguments()[1] == 0.1 / 4
    assert opened.refined(Level(dt=2.0)).arguments()[1] == 0.1 / 8
