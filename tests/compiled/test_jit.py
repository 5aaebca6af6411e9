"""The disk cache of the kernels: found again by another process, left when a source changes."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import fecloth
from fecloth.compiled import jit

PACKAGE = Path(fecloth.__file__).parent

# an entry point made of a template in another file and a law, and a plain one
PROGRAM = """
import json, numpy as np
from fecloth.compiled import jit
from fecloth.linalg import block_matrix as blocks
from fecloth.terms.membranes import stvk

K, Q, nodes = (0, 0, 0), (0,), np.array([[0, 1, 2]], np.int32)
G = np.array([[[[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]]])
c = np.broadcast_to([100.0, 100.0, 50.0, 0.0, 0.0, 0.0], (1, 6))
x = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 1.0, 0.0]])
energy = stvk.KERNELS.energy(K, Q, nodes, G, np.array([[0.5]]), c, np.zeros((1, 1, 3)), x, x)
pattern = blocks.BlockPattern.union(3, [nodes])
kernels = stvk.KERNELS.energy, stvk.KERNELS.add_tangent, blocks._find_slots
stats = [kernel.stats for kernel in kernels]
of_element = nodes, pattern.slots(nodes), G, np.array([[0.5]]), c, np.zeros((1, 1, 3))
stvk.KERNELS.add_tangent(K, Q, *of_element, x, x, 1.0, 1.0, np.zeros((9, 3, 3)))
print(json.dumps({
    "energy": energy,
    "hits": [sum(s.cache_hits.values()) for s in stats],
    "misses": [sum(s.cache_misses.values()) for s in stats],
    "folder": jit.cache_folder(),
}))
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the package whose sources a test may change."""
    ignore = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "fecloth", ignore=ignore)


def in_a_new_process(package, cache, program=PROGRAM, folder=""):
    paths = os.pathsep.join([str(package.parent), str(folder)])
    environment = os.environ | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, cwd=cache, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.stories
def test_second_process_compiles_only_after_a_source_changed(copy, tmp_path):
    cache = tmp_path / "cache"
    cache.mkdir()
    first, second = (in_a_new_process(copy, cache) for _ in range(2))
    assert (first["hits"], first["misses"]) == ([0, 0, 0], [1, 1, 1])
    assert (second["hits"], second["misses"]) == ([1, 1, 1], [0, 0, 0])
    assert first["folder"] == second["folder"]
    assert Path(first["folder"]).parent == cache
    expected = 0.5 * 0.5 * 100 * 0.625**2  # A ½ Y E₁₁² at a stretch of 1.5
    assert first["energy"] == second["energy"] == pytest.approx(expected, rel=1e-14)
    # the loop is not in the law's file: Numba alone would go on with the old machine code
    loop = copy / "terms" / "loops" / "pointwise_loops.py"
    text = loop.read_text(encoding="utf-8")
    assert text.count("total += w[e, q] * W\n") == 1
    changed = text.replace("total += w[e, q] * W\n", "total += 3.0 * w[e, q] * W\n")
    loop.write_text(changed, encoding="utf-8")
    third = in_a_new_process(copy, cache)
    assert third["energy"] == pytest.approx(3 * expected, rel=1e-14)
    assert third["misses"] == [1, 1, 1]
    assert third["folder"] != first["folder"]


# a law, a condition and a kernel of a user, in a file with helpers in another one
USER_HELPERS = """
from fecloth.compiled.jit import inner

FACTOR = 1.0

@inner
def multiply(a, b):
    return FACTOR * a * b
"""
USER_FILE = """
import math
from fecloth import MembraneLaw
from fecloth.compiled.jit import inner, kernel
from fecloth.terms.loops import bound_condition
import user_helpers

class Law(MembraneLaw):
    def constants(self, fabric):
        return [100.0]

    @staticmethod
    def law(E, c):
        W = user_helpers.multiply(0.5 * c[0], E[0]**2 + E[1]**2 + 2 * E[2]**2)
        k = user_helpers.multiply(c[0], 1.0)
        return W, (k * E[0], k * E[1], k * E[2]), (k, k, 0.5 * k, 0.0, 0.0, 0.0)

@inner
def height(y, c, order, C, g, H):
    C[0] = user_helpers.multiply(y[0, 2], c[0])

KERNELS = bound_condition.ConditionKernels(height)

@kernel
def add(x):
    return later(x) + 1.0

@inner
def later(x):
    return user_helpers.multiply(2.0, x)

@kernel
def double(x):
    return later(x)
"""
USER_PROGRAM = """
import json
import fecloth as fc, numpy as np, user_file
from fecloth.terms.custom import membrane_law

cloth = fc.Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right")
system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [user_file.Law()])
state = system.state(system.rest().x * [1.5, 1.0, 1.0])
height = np.array([[0.0, 0.0, 3.0]])
shape = (0,), (1,), np.zeros((1, 1), np.int32), np.ones((1, 1)), np.ones((1, 1, 1))
found = {
    "law": system.energies(state)["Law"],
    "condition": user_file.KERNELS.energy(*shape, height),
    "add": user_file.add(1.0),
    "double": user_file.double(1.0),
}
law = membrane_law._kernels(user_file.Law.law).energy
kernels = {"law": law, "condition": user_file.KERNELS.energy, "add": user_file.add,
           "double": user_file.double}
compiled = [name for name, each in kernels.items() if not each.stats.cache_hits]
print(json.dumps({"found": found, "compiled": compiled}))
"""


@pytest.mark.stories
def test_code_of_a_user_is_compiled_anew_only_when_its_content_changes(tmp_path):
    cache, folder = tmp_path / "cache", tmp_path / "user"
    cache.mkdir()
    folder.mkdir()
    everything = ["law", "condition", "add", "double"]

    def run(text, helpers):
        (folder / "user_file.py").write_text(text, encoding="utf-8")
        (folder / "user_helpers.py").write_text(helpers, encoding="utf-8")
        result = in_a_new_process(PACKAGE, cache, USER_PROGRAM, folder)
        return [result["found"][name] for name in everything], result["compiled"]

    values = [0.5 * 100 * 0.625**2, 4.5, 3.0, 2.0]
    assert run(USER_FILE, USER_HELPERS) == (pytest.approx(values, rel=1e-14), everything)
    # `add` calls what stands below it: nobody can tell at its decoration what that is
    assert run(USER_FILE, USER_HELPERS) == (pytest.approx(values, rel=1e-14), ["add"])
    # a constant of a callee in another file
    factor = USER_HELPERS.replace("FACTOR = 1.0", "FACTOR = 3.0")
    tripled = [3 * 0.5 * 100 * 0.625**2, 9 * 4.5, 7.0, 6.0]
    assert run(USER_FILE, factor) == (pytest.approx(tripled, rel=1e-14), everything)
    # a constant of the law itself; Numba compiles the kernels of an edited file anew anyway
    law = USER_FILE.replace("multiply(0.5 * c[0]", "multiply(1.0 * c[0]").replace(
        "multiply(c[0], 1.0)", "multiply(c[0], 2.0)"
    )
    doubled, compiled = run(law, USER_HELPERS)
    assert doubled == pytest.approx([2 * values[0], *values[1:]], rel=1e-14)
    assert compiled == ["law", "add", "double"]


def function_of(text, **names):
    """The function f that a text defines, with more globals."""
    names |= {"__name__": __name__, "np": np, "numba": numba}
    exec(text, names)
    return names["f"]


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("def f(x):\n return x + 1", "def f(x):\n return x + 1.0"),
        ("def f(x):\n return x + 0.0", "def f(x):\n return x + -0.0"),
        ("def f(x):\n return x + 1", "def f(x):\n return x - 1"),
        ("def f(x, y=1):\n return x", "def f(x, y=2):\n return x"),
        ("def f(x):\n return np.sin(x)", "def f(x):\n return np.cos(x)"),
        ("a = 1\ndef f(x):\n return a", "a = 2\ndef f(x):\n return a"),
        ("a = (1, (2,))\ndef f(x):\n return a", "a = (1, (3,))\ndef f(x):\n return a"),
        ("a = np.ones(2)\ndef f(x):\n return a", "a = np.zeros(2)\ndef f(x):\n return a"),
        (
            "@numba.njit\ndef g(x):\n return x\ndef f(x):\n return g(x)",
            "@numba.njit(fastmath=True)\ndef g(x):\n return x\ndef f(x):\n return g(x)",
        ),
        (
            "@numba.njit\ndef g(x):\n return x + 1\ndef f(x):\n return g(x)",
            "@numba.njit\ndef g(x):\n return x - 1\ndef f(x):\n return g(x)",
        ),
        (
            "def h(a):\n def f(x):\n  return a + x\n return f\nf = h(1)",
            "def h(a):\n def f(x):\n  return a + x\n return f\nf = h(2)",
        ),
        (
            "def f(x):\n return [i + 1 for i in x]",
            "def f(x):\n return [i + 2 for i in x]",
        ),
    ],
)
def test_a_fingerprint_changes_with_the_content(text, other):
    first, again, second = (jit.fingerprint(function_of(each)) for each in (text, text, other))
    assert first == again != second
    assert None not in (first, second)


@pytest.mark.parametrize(
    "text",
    [
        "def f(x):\n return undefined(x)",
        "class A:\n pass\na = A()\ndef f(x):\n return a",
        "def g(x):\n return x\ndef f(x):\n return g(x)",  # Numba may have an overload of g
        "@numba.vectorize\ndef g(x):\n return x\ndef f(x):\n return g(x)",
        "a = np.array([None])\ndef f(x):\n return a",
        "def h():\n def f(x):\n  return a + x\n return f\n a = 1\nf = h()",
        "__name__ = 'not_a_module'\ndef f(x):\n return x",
    ],
)
def test_values_that_processes_cannot_compare_have_no_fingerprint(text):
    assert jit.fingerprint(function_of(text)) is None


def test_functions_that_call_each_other_have_a_fingerprint():
    text = """
@numba.njit
def f(n):
    return n if n < 1 else g(n - 1)

@numba.njit
def g(n):
    return f(n - 1)
"""
    first, second = (function_of(text + "# " * i).py_func for i in (0, 1))
    assert jit.fingerprint(first) == jit.fingerprint(second) is not None


def test_a_template_without_the_name_is_refused():
    with pytest.raises(TypeError, match="in_a_new_process does not call law"):
        jit.insert(in_a_new_process, law=in_a_new_process)


def test_kernels_keep_nan_infinity_and_the_users_own_cache_folder(tmp_path, monkeypatch):
    """Full fast-math would take a − a for 0 and a ≠ a for false; Python would raise at 1/0."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "somewhere")
    monkeypatch.setattr(jit, "cache_folder", lambda: str(tmp_path))

    @jit.kernel
    def probe(a, b):
        return a / b, a - a, a != a

    assert numba.config.CACHE_DIR == "somewhere"
    assert probe(1.0, 0.0) == (np.inf, 0.0, False)
    assert np.isnan(probe(np.inf, 1.0)[1])
    assert np.isnan(probe(np.nan, 1.0)[:2]).all()
    assert probe(np.nan, 1.0)[2]
    assert list(tmp_path.rglob("*.nbi"))
