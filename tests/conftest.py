"""Cloths, fabrics and states that many tests share."""

import os
import sys

if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):  # each process would compile all sources anew
    sys.dont_write_bytecode = False
if "PYTEST_XDIST_WORKER" in os.environ:  # one process a core: threads would wait for each other
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")

import numpy as np
import pytest
from _pytest.doctest import DoctestModule
from support.counted_work import counted_work as counted_work

import fecloth as fc

collect_ignore = ["support/sliders.py"]  # its record would be marked under two names


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Look for no doctests in the modules of tests, which have none: it takes seconds."""
    return [each for each in (yield) if not isinstance(each, DoctestModule)]


def pytest_collection_modifyitems(items):
    """Begin with the longest tests, so that no process waits for another one at the end."""
    items.sort(key=lambda item: item.path.name not in ("test_wheel.py", "test_site.py"))


@pytest.fixture(scope="session")
def sheet():
    """An unstructured sheet, 1 m × 0.6 m, of about 150 triangles."""
    return fc.Cloth.rectangle(1.0, 0.6, h=0.1)


@pytest.fixture(scope="session")
def small():
    """An unstructured sheet, 0.4 m × 0.3 m, of about 30 triangles."""
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1)


@pytest.fixture(scope="session")
def quadratic():
    """A sheet of quadratic triangles, 0.3 m × 0.2 m."""
    return fc.Cloth.rectangle(0.3, 0.2, h=0.1, element="P2")


@pytest.fixture(scope="session")
def isotropic():
    return fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)


@pytest.fixture(scope="session")
def orthotropic():
    return fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def run_command(capsys):
    """Call ``fecloth`` with these words; it must end with `status`. What it says: `out`, `err`."""
    from fecloth.cli.main import main

    def run(*words, status=0):
        assert main([*map(str, words)]) == status
        return capsys.readouterr()

    return run


def flat(cloth):
    """(n, 3) positions (X, 0)."""
    return np.column_stack([cloth.X, np.zeros(len(cloth.X))])


def rough(cloth, rng, amount=0.02):
    """(n, 3) rotated positions with noise of `amount` metres."""
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return flat(cloth) @ turn + amount * rng.standard_normal((len(cloth.X), 3))


def affine(cloth, F, shift=(0.0, 0.0, 0.0)):
    """(n, 3) positions F X + shift with F of shape (3, 2)."""
    return cloth.X @ np.asarray(F, dtype=float).T + np.asarray(shift)


def taut_start(system, stretch=1.1):
    """`small` stretched, with a smooth transverse and in-plane velocity."""
    X = system.cloth.X
    x = affine(system.cloth, [[stretch, 0.0], [0.0, stretch], [0.0, 0.0]])
    wave = np.sin(np.pi * X[:, 0] / 0.4) * np.sin(np.pi * X[:, 1] / 0.3)
    return system.state(x, np.column_stack([0.3 * wave, 0.2 * wave, 2.0 * wave]))
