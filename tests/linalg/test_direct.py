"""PARDISO, rslab and SuperLU: analysis, pivots, refinement, memory."""

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from support.matrices import difference, load, needs_pardiso, relative, sheet

from fecloth.compiled.team import Team
from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg import mkl_pardiso, select
from fecloth.linalg.block_matrix import BlockMatrix


@pytest.mark.parametrize("kind", [select.Rslab, select.SuperLU])
def test_a_pivot_of_zero_is_indefinite(kind):
    A = sheet()
    i = A.pattern.diagonal[0]
    A.values[i] = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
    others = (A.pattern.rows == 0) | (A.pattern.indices == 0)
    others[i] = False
    A.values[others] = 0
    with pytest.raises(IndefiniteMatrix):
        kind().prepare(A)


def test_solve_accepts_a_residual_of_round_off_and_reports_it():
    A = sheet(mass=1e-6)
    b = np.ones((len(A.pattern), 3))  # the softest direction: A x cancels to 1e-6 of its parts
    solver = select.direct()
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-10)
    assert 1e-10 < info.residual < 1e-7
    assert info.iterations == 2
    assert difference(x, 1e6 * b) < 1e-6


def test_refinement_corrects_a_poor_factor(monkeypatch):
    A = sheet()
    solver = select.SuperLU()
    solver.prepare(A)
    exact = solver._apply
    monkeypatch.setattr(solver, "_apply", lambda b: exact(b) * (1 + 1e-6))
    x, info = solver.solve(load(A), rtol=1e-10)
    assert info.iterations == 1
    assert relative(A, x, load(A)) < 1e-10
    monkeypatch.setattr(solver, "_apply", lambda b: exact(b) * 1.5)
    with pytest.raises(SolveFailed, match=r"relative residual 1.25e-01, required 1.00e-10"):
        solver.solve(load(A), rtol=1e-10)


@pytest.mark.parametrize("symmetric", [True, False])
def test_threads_change_no_bit_of_rslab(symmetric):
    A = sheet(m=60)
    x = []
    for count in (1, 2):
        solver = select.Rslab(symmetric)
        solver.prepare(BlockMatrix(A.pattern, A.values, Team(count)))
        x.append(solver.solve(load(A))[0])
    np.testing.assert_array_equal(*x)


@needs_pardiso
def test_the_mkl_is_loaded_from_the_folder_of_libraries():
    """Where it lies there, pypardiso need not search the disk for it."""
    folder = Path(sys.prefix, "lib")
    if not list(folder.glob("libmkl_rt.so*")):
        pytest.skip("the MKL is elsewhere")
    mkl_pardiso.routine()
    assert Path(os.environ["PYPARDISO_MKL_RT"]).is_relative_to(folder)


@needs_pardiso
def test_pardiso_frees_its_memory(monkeypatch):
    phases = []
    call = mkl_pardiso.pardiso

    def watched(phase, *args, **named):
        phases.append(phase)
        return call(phase, *args, **named)

    monkeypatch.setattr(mkl_pardiso, "pardiso", watched)
    solver = select.Pardiso()
    solver.prepare(sheet(m=5))
    solver.prepare(sheet(m=6))
    assert phases == [11, 22, -1, 11, 22]
    del solver
    gc.collect()
    assert phases == [11, 22, -1, 11, 22, -1]
