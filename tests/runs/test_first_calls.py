"""What is compiled before the first step: the kernels of the run, and nothing is suppressed."""

import subprocess
import sys
import warnings

import pytest

import fecloth as fc
from fecloth.runs.first_calls import compile_kernels, list_first_calls
from fecloth.scene.scene import load_scene
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.setup import Setup

RECTANGLE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.3, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-4 }
pins = [{ where = "left" }]
"""
CLAMPED = f"""
{RECTANGLE}
terms = [{{ type = "StVK" }}, {{ type = "HingeBending" }}, {{ type = "Gravity" }}]
time = {{ method = "energy_momentum", dt = 0.005, t_end = 0.025 }}
solver = {{ linear = "superlu", definiteness = "clamp" }}
"""
CONTACT = f"""
{RECTANGLE}
time = {{ method = "auto", t_end = 0.01 }}
[[terms]]
type = "StVK"
[[terms]]
type = "StrainRateDamping"
time = "1 ms"
[[terms]]
type = "PlateBending"
[[terms]]
type = "Obstacle"
gap = "1 mm"
friction = 0.3
shape = {{ type = "Plane", point = [0, 0, -0.0005], normal = [0, 0, 1] }}
"""
STATIC_REGIONS = """
terms = [{ type = "StVK" }, { type = "PlateBending" }, { type = "Pressure", p = 2.0 }]
pins = [{ where = "a/boundary" }, { where = "b/boundary" }]
equilibrium = { load_steps = 2 }
[cloths]
a = { shape = "rectangle", width = 0.4, height = 0.3, h = 0.1, pattern = "right", element = "P2" }
b = { shape = "rectangle", width = 0.3, height = 0.3, h = 0.1, pattern = "right", element = "P2" }
[fabrics]
a = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-4 }
b = { areal_density = 0.3, tensile_stiffness = 300.0, bending_rigidity = 2e-4 }
"""
COUNT = """
import gc, sys
from numba.core.dispatcher import Dispatcher
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

def list_compiled():
    objects = gc.get_objects()
    dispatchers = [each for each in objects if isinstance(each, Dispatcher)]
    return {(each, types) for each in dispatchers for types in each.overloads}

counts = []
mark = lambda *_: counts.append(list_compiled())
result = run_scene(load_scene(sys.argv[1]), sys.argv[2], announce=mark, report=mark)
assert result.status == "done", result.error
before, *_, after = *counts, list_compiled()
assert len(before) > 10
print(*(f"{each.py_func.__module__}.{each.py_func.__name__}" for each, _ in after - before))
"""


@pytest.mark.stories
@pytest.mark.parametrize("scene", [CLAMPED, CONTACT, STATIC_REGIONS])
def test_the_steps_of_a_run_compile_nothing(scene, tmp_path):
    """In a process of its own, in which no other test has called a kernel."""
    file = tmp_path / "scene.toml"
    file.write_text(scene)
    command = [sys.executable, "-c", COUNT, str(file), str(tmp_path / "out")]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


def test_an_explicit_run_makes_no_matrix(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(CLAMPED.replace('"energy_momentum", dt = 0.005', '"central_difference"'))
    problem = load_scene(file).build()
    compile_kernels(problem)
    names = [call.name for call in list_first_calls(problem)]
    assert "StVK.add_force" in names
    assert not {"StVK.add_tangent", "mass", "superlu"} & set(names)
    assert "pattern" not in vars(problem.system.layout)


def test_errors_and_warnings_of_a_term_are_not_suppressed():
    cloth = fc.Cloth.rectangle(0.2, 0.1, 0.1, pattern="right")
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=100.0)
    said = []

    def derivatives(x, v, t):
        if said:
            raise fc.InputError("derivatives", "are not known", "here")
        said.append(warnings.warn("a warning of the term", stacklevel=1))
        return 0.0 * x[:, :, None] * x[:, None, :], 0.0 * x[:, :, None] * x[:, None, :]

    force = fc.UserForce(lambda x, v, t: 0.0 * x, derivatives=derivatives)
    system = fc.System(cloth, fabric, [fc.StVK(), force], pins=["left"])
    setup = Setup(system, system.rest(), FixedStep(fc.BackwardEuler(), 0.1), t_end=0.2)
    with (
        pytest.warns(UserWarning, match="a warning of the term"),
        pytest.raises(fc.InputError, match="are not known"),
    ):
        compile_kernels(setup)
