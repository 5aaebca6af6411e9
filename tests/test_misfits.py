"""Arguments of public classes and functions: what does not fit, and texts with units."""

import inspect
import warnings

import numpy as np
import pytest
from support.scene_texts import STRIP
from support.wrong_calls import CLOTH, START, SYSTEM

import fecloth as fc
from fecloth import terms
from fecloth.integrators import EXPLICIT, METHODS

SHAPES = [each for each in vars(fc.shapes).values() if inspect.isclass(each)]
SHAPES = [each for each in SHAPES if fc.shapes.Shape in each.__bases__]
OTHERS = [fc.Adaptive, fc.Auto, fc.Newton, fc.Rotation, fc.Condition, fc.Fabric, fc.Grading]
OTHERS += [fc.Pin, fc.Slide, fc.Probe, fc.System]
CLASSES = [getattr(fc, name) for name in terms.__all__]
CLASSES += [*(METHODS | EXPLICIT).values(), *SHAPES, *OTHERS]
FUNCTIONS = [fc.run, fc.march, fc.equilibrium, fc.many_steps]
FUNCTIONS += [fc.Cloth.rectangle, fc.Cloth.disk, fc.Cloth.read, fc.Cloth.from_arrays]

# arguments that are right, by name; what is not here may be 1.0
RIGHT = dict.fromkeys(("center", "point", "a", "velocity"), (0.0, 0.0, 0.0))
RIGHT |= dict.fromkeys(("axis", "b", "size", "force"), (1.0, 1.0, 1.0))
RIGHT |= {"where": "left", "shape": fc.shapes.Sphere((0, 0, 0), 1.0), "path": "a.stl"}
RIGHT |= {"formula": "z", "name": "tip", "angle": "t", "method": fc.BDF2(), "nodes": [[0, 1]]}
RIGHT |= {"value": lambda y: y, "cloth": CLOTH}
RIGHT |= {"fabric": fc.Fabric(0.1, 10.0), "terms": [fc.StVK()]}
# what may be any object until a cloth is there: node sets, functions, the path of a file, words
CHECKED_LATER = {
    "where",
    "without",
    "point",
    "path",
    "derivatives",
    "name",
    "gradient",
    "hessian",
    "source",
}
CHECKED_LATER |= {"gauss_newton", "convex"}


def required(target):
    parameters = inspect.signature(target).parameters
    needed = {name for name, each in parameters.items() if each.default is each.empty}
    right = RIGHT | ({"normal": (0, 0, 1)} if target in SHAPES else {})
    return {name: right.get(name, 1.0) for name in needed}


@pytest.mark.parametrize("target", CLASSES + FUNCTIONS, ids=lambda target: target.__qualname__)
def test_arguments_that_do_not_fit_are_an_input_error_with_all_arguments(target):
    names, needed = list(inspect.signature(target).parameters), required(target)
    name = target.__qualname__
    calls = {f"{name}: argument 'qqq' is unknown": lambda: target(**needed, qqq=1)}
    if names[:1] and names[0] in needed:
        calls[f"{name}: {names[0]} "] = lambda: target(
            **{key: value for key, value in needed.items() if key != names[0]}
        )
    calls[f"{name}: .* is a value too many"] = lambda: target(*[1.0] * (len(names) + 1))
    for text, call in calls.items():
        with pytest.raises(fc.InputError, match=text) as raised:
            call()
        assert all(key in str(raised.value) for key in names)


@pytest.mark.parametrize("target", CLASSES, ids=lambda target: target.__qualname__)
def test_a_value_of_a_wrong_type_is_an_input_error_with_the_argument(target):
    for name in inspect.signature(target).parameters:
        if name in CHECKED_LATER or target is fc.System:
            continue
        right = required(target) | ({"where": "left"} if target is fc.Grading else {})
        with pytest.raises(fc.InputError, match=name):
            target(**right | {name: object()})


def test_lengths_and_times_may_be_texts_with_units(tmp_path):
    cloth = fc.Cloth.rectangle("100 cm", "50 cm", h="250 mm", pattern="right")
    assert np.array_equal(cloth.X, fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right").X)
    assert np.array_equal(fc.Cloth.disk("20 cm", "10 cm").X, fc.Cloth.disk(0.2, 0.1).X)
    times = fc.run(SYSTEM, fc.BDF2(), START, dt="5 ms", t_end="0.01 s").times
    assert np.array_equal(times, [0.0, 0.005, 0.01])
    steps = fc.march(SYSTEM, fc.BDF2(), START, ["1 ms", "2 ms"])
    assert [info.dt for _, info in steps] == pytest.approx([0.001, 0.002])
    assert fc.Adaptive(fc.BDF2(), longest="3 ms").longest == 0.003
    (tmp_path / "a.geo").write_text('SetFactory("OpenCASCADE");\nDisk(1) = {0, 0, 0, 0.2};\n')
    assert len(fc.Cloth.read(tmp_path / "a.geo", h="10 cm").X) > 8


def test_a_study_takes_texts_with_units_and_further_arguments_as_they_are():
    def strip(h, dt, stiffness="soft"):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h=h, pattern="right")
        fabric = fc.Fabric(0.2, {"soft": 10.0, "hard": 100.0}[stiffness])
        system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
        return cloth, system, fc.BDF2(), system.rest()

    given = {"h": "25 cm", "dt": "5 ms", "t_end": "10 ms", "stiffness": "hard"}
    first = fc.study.of(strip, **given).problem.first
    assert (len(first.cloth.triangles), first.t_end) == (16, 0.01)
    assert first.steps.dt == 0.005


def test_a_warning_of_a_run_stands_at_its_call():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fc.run(SYSTEM, fc.BackwardEuler(), START, dt=0.2, t_end=0.4)
        plane = SYSTEM.replace(terms=[fc.StVK()], pins=["left", "right"])
        fc.equilibrium(plane, plane.state(START.x * (0.9, 1, 1)))  # flat, compressed: unstable
    assert any("unstable" in str(each.message) for each in caught)
    assert {each.filename for each in caught} == {__file__}


def test_an_argument_may_have_its_name_of_earlier_versions(tmp_path):
    assert fc.Pressure(p="5 hPa", tangent="exact") == fc.Pressure(500.0, "exact")
    scene = tmp_path / "a.toml"
    old = """type = "Pressure", p = "5 hPa\""""
    scene.write_text(STRIP.replace("""type = "Gravity", acceleration = [9.81, 0, 0]""", old))
    assert fc.load_scene(scene).terms[1].make() == fc.Pressure(500.0)
    assert fc.load_scene(scene, ["terms.1.p=3.0"]).terms[1].pressure == 3.0
    with pytest.raises(fc.SceneError, match="a.toml.*pressure and p are given"):
        fc.load_scene(scene, ["terms.1.pressure=3.0"])
