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
from fecloth import jit

PACKAGE = Path(fecloth.__file__).parent

# an entry point that calls a loop in another file which takes a law, and a plain one
PROGRAM = """
import json, numpy as np
from fecloth import blocks, compiled
from fecloth.terms import stvk

K, Q, nodes = (0, 0, 0), (0,), np.array([[0, 1, 2]], np.int32)
G = np.array([[[[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]]])
c = np.broadcast_to([100.0, 100.0, 50.0, 0.0, 0.0, 0.0], (1, 6))
x = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 1.0, 0.0]])
energy = stvk.energy(K, Q, nodes, G, np.array([[0.5]]), c, x)
pattern = blocks.BlockPattern.union(3, [nodes])
stats = [kernel.stats for kernel in (stvk.energy, blocks._find_slots)]
pattern.slots(nodes)
print(json.dumps({
    "energy": energy,
    "hits": [sum(s.cache_hits.values()) for s in stats],
    "misses": [sum(s.cache_misses.values()) for s in stats],
    "folder": compiled.cache_folder(),
}))
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the package whose sources a test may change."""
    ignore = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "fecloth", ignore=ignore)


def in_a_new_process(package, cache):
    environment = os.environ | {"PYTHONPATH": str(package.parent), "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, cwd=cache, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_second_process_compiles_nothing_unless_a_source_changed(copy, tmp_path):
    cache = tmp_path / "cache"
    cache.mkdir()
    first, second = (in_a_new_process(copy, cache) for _ in range(2))
    assert (first["hits"], first["misses"]) == ([0, 0], [1, 1])
    assert (second["hits"], second["misses"]) == ([1, 1], [0, 0])
    assert first["folder"] == second["folder"]
    assert Path(first["folder"]).parent == cache
    expected = 0.5 * 0.5 * 100 * 0.625**2  # A ½ Y E₁₁² at a stretch of 1.5
    assert first["energy"] == second["energy"] == pytest.approx(expected, rel=1e-14)
    # the loop is not in the law's file: Numba alone would go on with the old machine code
    loop = copy / "terms" / "membrane.py"
    text = loop.read_text(encoding="utf-8")
    assert text.count("total += w[e, q] * W\n") == 1
    changed = text.replace("total += w[e, q] * W\n", "total += 3.0 * w[e, q] * W\n")
    loop.write_text(changed, encoding="utf-8")
    third = in_a_new_process(copy, cache)
    assert third["energy"] == pytest.approx(3 * expected, rel=1e-14)
    assert third["misses"] == [1, 1]
    assert third["folder"] != first["folder"]


def folder_for(package, monkeypatch):
    monkeypatch.setattr(jit, "__file__", str(package / "jit.py"))
    return jit.cache_folder.__wrapped__()


def test_every_file_with_kernels_changes_the_folder(copy, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    own = folder_for(copy, monkeypatch)
    assert own == folder_for(PACKAGE, monkeypatch)  # by content, wherever it lies
    decorated = [
        source
        for source in sorted(copy.rglob("*.py"))
        if any(f"\n@{word}\n" in source.read_text("utf-8") for word in ("kernel", "inner", "loop"))
    ]
    assert {"blocks.py", "constraints.py", "membrane.py", "stvk.py"} <= {p.name for p in decorated}
    for source in [*decorated, copy / "jit.py"]:
        text = source.read_bytes()
        source.write_bytes(text + b"\n")
        assert folder_for(copy, monkeypatch) != own, source.name
        source.write_bytes(text)
    with (copy / "cli.py").open("ab") as other:  # no kernels: nothing to compile anew
        other.write(b"\n")
    assert folder_for(copy, monkeypatch) == own


def test_the_folder_lies_where_it_can_be_written(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    for name, value in (
        ("NUMBA_CACHE_DIR", tmp_path / "numba"),
        ("XDG_CACHE_HOME", tmp_path / "xdg"),
        ("HOME", tmp_path / "home"),
        ("USERPROFILE", tmp_path / "home"),
    ):
        monkeypatch.setenv(name, str(value))
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    wanted = [tmp_path / "numba", tmp_path / "xdg", tmp_path / "home" / ".cache"]
    for name, folder in zip(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"), wanted, strict=True):
        assert Path(jit.cache_folder.__wrapped__()).parent == folder
        monkeypatch.setenv(name, str(blocked))
        monkeypatch.setenv("USERPROFILE", os.environ["HOME"])
    assert Path(jit.cache_folder.__wrapped__()).parent == tmp_path / "temporary"


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
