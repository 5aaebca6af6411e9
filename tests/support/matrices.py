"""Matrices of 3×3 blocks, loads and solutions for the tests of the linear solvers."""

import sys
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from fecloth.linalg import mkl_pardiso
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern

HAS_PARDISO = find_spec("pypardiso") is not None
needs_pardiso = pytest.mark.skipif(not HAS_PARDISO, reason="pypardiso is missing")


def grid(m):
    """(2 (m − 1)², 3) triangles on m × m nodes."""
    corner = (np.arange(m - 1)[:, None] * m + np.arange(m - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + m], axis=1)
    upper = np.stack([corner + 1, corner + m + 1, corner + m], axis=1)
    return np.vstack([lower, upper]).astype(np.int32)


def sheet(m=14, mass=0.1, pinned=(), skew=0.0, seed=0):
    """A random block Laplacian over a grid of triangles plus a mass, some rows projected."""
    rng = np.random.default_rng(seed)
    triangles = grid(m)
    A = BlockMatrix.zeros(BlockPattern.union(m * m, [triangles]))
    slots = A.pattern.slots(triangles)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        root = rng.normal(size=(len(triangles), 3, 3))
        k = root @ root.transpose(0, 2, 1)
        for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
            np.add.at(A.values, slots[:, i, j], sign * k)
    A.values[A.pattern.diagonal] += mass * np.eye(3)
    A.values[...] += skew * rng.normal(size=A.values.shape)
    project(A, pinned)
    return A


def project(A, pinned):
    held = np.isin(A.pattern.rows, pinned) | np.isin(A.pattern.indices, pinned)
    A.values[held] = 0
    A.values[A.pattern.diagonal[list(pinned)]] = 2.5 * np.eye(3)


def load(A, seed=1):
    return np.random.default_rng(seed).normal(size=(len(A.pattern), 3))


def reference(A, b):
    return spsolve(A.to_scipy().tocsc(), b.ravel()).reshape(b.shape)


def relative(A, x, b):
    return np.linalg.norm(b.ravel() - A.to_scipy() @ x.ravel()) / np.linalg.norm(b)


def difference(x, y):
    return np.linalg.norm(x - y) / np.linalg.norm(y)


def indefinite(kind):
    A = sheet(mass=0.1)
    if kind == "block":  # a negative diagonal block
        A.values[A.pattern.diagonal[40]] -= 100 * np.eye(3)
    else:  # all diagonal blocks stay positive definite, only smooth vectors see the sign
        A.values[A.pattern.diagonal] -= 0.2 * np.eye(3)
    return A


def hide(monkeypatch, *packages):
    """As on a machine where these packages of direct solvers are not installed."""
    for name in packages:
        monkeypatch.setitem(sys.modules, name, None)
    if "pypardiso" in packages:  # it may be loaded already
        monkeypatch.setattr(mkl_pardiso, "routine", cache(partial(import_module, "pypardiso")))
