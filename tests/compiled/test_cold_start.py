"""What is compiled with an empty cache, and at what price."""

import subprocess
import sys

import numba
import pytest
from numba.core.errors import TypingError

from fecloth.compiled.jit import inner

SCENE = """
import fecloth as fc

cloth = fc.Cloth.rectangle(0.4, 0.5, h=0.1, pattern="right")
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), fc.Gravity()], pins=["top"])
fc.run(system, fc.BDF2(), system.rest(), dt=0.005, t_end=0.05)
"""


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
