"""What is compiled with an empty cache, and at what price."""

import gc
import os
import subprocess
import sys

import numba
import pytest
from numba.core import event
from numba.core.errors import TypingError

from fecloth.compiled.jit import inner

SCENE = """
import fecloth as fc

cloth = fc.Cloth.rectangle(0.4, 0.5, h=0.1, pattern="right")
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), fc.Gravity()], pins=["top"])
fc.run(system, fc.BDF2(), system.rest(), dt=0.005, t_end=0.05)
"""
KERNELS = {
    # the terms
    "pointwise_loops": {"energy", "add_force", "add_tangent", "add_moduli", "add_stress"},
    "plate_loops": {"add_curvatures", "add_force", "add_measures", "add_products"}
    | {"fill_gradients", "fill_moments", "fill_rows", "sum_products"},
    "dihedral_angle": {"angles"},
    # Newton's equations, in joined calls
    "calls": {"_call_once"},
    "array_updates": {"add", "clear", "scale", "subtract"},
    "stage_arrays": {"balance", "copy_blocks", "place"},
    "constraints": {"project_blocks", "project_rows"},
    "block_matrix": {"_find_slots", "add_mass"},
    "mixed_precision": {"solve_by_cg"},
    "pcg": {"invert_blocks"},
    "reductions": {"dot", "weighted_dot", "weighted_sum"},
    "threads": {"wait"},
    # the errors in time and space, and the shape
    "rigid_motion": {"_sums"},
    "kinematics": {"_extreme_stretches"},
    "probes": {"_area"},
}


@pytest.mark.stories
def test_a_scene_compiles_what_it_names_and_nothing_else(tmp_path):
    """Each entry point has a file in the cache: `module.function-line.python.nbi`."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", SCENE], env=environment, check=True)
    compiled = {}
    for file in tmp_path.rglob("*.nbi"):
        module, _, function = file.name.partition("-")[0].partition(".")
        compiled.setdefault(module, set()).add(function)
    assert compiled == KERNELS


@pytest.mark.stories
def test_a_scene_imports_no_library_that_it_does_not_use():
    """Each of these takes 0.03 to 1 s; the scene has no mesh file, factor, picture or table."""
    unused = [
        "gmsh",
        "meshio",
        "pypardiso",
        "rslab",
        "pydantic",
        "rich",
        "jinja2",
        "pebble",
        "ipctk",
    ]
    unused += ["matplotlib", "pyvista", "imageio", "h5py", "mpi4py", "petsc4py", "distributed"]
    unused += ["scipy.optimize"]
    show = f"\nimport sys\nprint(*sys.modules.keys() & {set(unused)})"
    run = subprocess.run([sys.executable, "-c", SCENE + show], check=True, capture_output=True)
    assert run.stdout.split() == []


def has_wrapper(function):
    """Whether its first machine code has an entry for Python, which Numba names `cpython::…`."""
    machine_code = function.overloads[function.signatures[0]]
    return "_ZN7cpython" in machine_code.library.get_llvm_str()


def test_an_inner_function_has_a_wrapper_for_python_only_if_python_calls_it():
    """The functions are new in each call, so that no cache and no other test has compiled them."""

    @inner
    def square(a):
        return a * a

    square_plus_one = numba.njit(lambda a: square(a) + 1)
    assert square_plus_one(2.0) == 5.0
    assert has_wrapper(square_plus_one)
    assert not has_wrapper(square)
    assert (square(3.0), square(3), square(a=4.0)) == (9.0, 9, 16.0)
    assert square_plus_one(5.0) == 26.0
    with pytest.raises(TypingError):
        square("a")


class Watch(event.Listener):
    def __init__(self):
        self.thresholds = set()

    def on_start(self, event):
        self.thresholds.add(gc.get_threshold()[0])

    def on_end(self, event):
        pass


def test_garbage_is_collected_seldom_during_a_compilation_only():
    def double(a):
        return 2 * a

    before = gc.get_threshold()
    with event.install_listener("numba:compile", Watch()) as watch:
        assert inner(double)(2) == 4
    assert watch.thresholds == {50_000}
    with pytest.raises(TypingError):
        inner(double)(None)
    assert gc.get_threshold() == before
