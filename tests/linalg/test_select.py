"""Every linear solver, one row each: solutions, patterns, what it refuses; and the selection."""

import subprocess
import sys

import numpy as np
import pytest
from support.matrices import (
    HAS_PARDISO,
    difference,
    hide,
    indefinite,
    load,
    needs_pardiso,
    reference,
    relative,
    sheet,
)

from fecloth.errors import IndefiniteMatrix, InputError, SolveFailed
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.prices import Prices

SOLVERS = [
    pytest.param("pardiso", True, marks=needs_pardiso),
    pytest.param("pardiso", False, marks=needs_pardiso),
    ("rslab", True),
    ("rslab", False),
    ("superlu", True),
    ("superlu", False),
    ("pcg", True),
    ("multigrid", True),
]
SYMMETRIC = [pytest.param("pardiso", marks=needs_pardiso), "rslab", "superlu", "pcg", "multigrid"]
every_solver = pytest.mark.parametrize(("name", "symmetric"), SOLVERS)


def shuffled(A, nodes):
    """A with its nodes in another order: as many blocks, other neighbours."""
    dofs = (3 * np.random.default_rng(3).permutation(nodes)[:, None] + np.arange(3)).ravel()
    other = A.to_scipy().tocsr()[dofs][:, dofs].tobsr((3, 3))
    other.sort_indices()
    return BlockMatrix(BlockPattern(other.indptr, other.indices), other.data)


def check_solution(solver, A, rtol=1e-12):
    """It is SciPy's, and its residual is the true one."""
    b = load(A)
    solver.prepare(A)
    x, info = solver.solve(b, rtol=rtol)
    assert (info.name, min(info.seconds_factor, info.seconds_solve) > 0) == (solver.name, True)
    assert info.residual <= rtol
    assert info.residual == pytest.approx(relative(A, x, b), rel=1e-6, abs=1e-13)
    assert difference(x, reference(A, b)) < 1e4 * rtol


@every_solver
def test_solutions_are_those_of_scipy(name, symmetric):
    """On patterns that change, also between equal numbers of blocks; and on values that do."""
    solver = select.create(name, symmetric)
    assert (solver.name, solver.symmetric) == (name, symmetric)
    skew = 0.0 if symmetric else 0.3
    first = sheet(m=9, skew=skew, pinned=range(9))
    other = shuffled(first, 81)
    assert len(other.pattern.indices) == len(first.pattern.indices)
    for A in (first, other, sheet(m=12, skew=skew), first):
        check_solution(solver, A)
    first.values[...] = sheet(m=9, skew=skew, pinned=[7], seed=5).values
    check_solution(solver, first)
    for rtol in (0.3, 1e-2, 1e-6):
        check_solution(solver, sheet(pinned=[3, 20], skew=skew), rtol)


@pytest.mark.parametrize("kind", ["block", "smooth"])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_indefinite_matrix_is_rejected(name, kind):
    A, solver = indefinite(kind), select.create(name)
    eigenvalues = np.linalg.eigvalsh(A.to_scipy().toarray())
    assert eigenvalues[0] < 0 < eigenvalues[3]
    if kind == "smooth":
        assert np.linalg.eigvalsh(A.values[A.pattern.diagonal]).min() > 0
    with pytest.raises(IndefiniteMatrix, match=name):
        attempt(solver, A)
    A.values[...] = sheet().values
    check_solution(solver, A)  # the solver is not broken by it


def attempt(solver, A, b=None):
    solver.prepare(A)
    solver.solve(load(A) if b is None else b)


@every_solver
def test_singular_matrix_is_rejected(name, symmetric):
    A = sheet(mass=0.0)  # translations cost nothing
    with pytest.raises(SolveFailed):
        attempt(select.create(name, symmetric), A, np.ones((len(A.pattern), 3)))  # no solution


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@every_solver
def test_numbers_that_are_not_finite_are_rejected(name, symmetric, bad):
    A = sheet(m=8)
    solver = select.create(name, symmetric)
    b = load(A)
    b[5, 1] = bad
    with pytest.raises(SolveFailed, match="b is not finite"):
        attempt(solver, A, b)
    for slot in (A.pattern.diagonal[30], A.pattern.diagonal[30] + 1):
        wrong = BlockMatrix(A.pattern, A.values.copy())
        wrong.values[slot, 1, 2] = bad
        with pytest.raises(SolveFailed, match="finite") as caught:
            attempt(solver, wrong)
        assert not isinstance(caught.value, IndefiniteMatrix)
        check_solution(solver, A)


@pytest.mark.parametrize("name", SYMMETRIC)
def test_solve_after_a_failed_prepare_is_rejected(name):
    A = sheet()
    solver = select.create(name)
    solver.prepare(A)
    A.values[A.pattern.diagonal[9]] = np.nan
    with pytest.raises(SolveFailed):
        solver.prepare(A)
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(A))


def test_a_solver_that_is_not_installed_says_how_to_get_it(monkeypatch):
    hide(monkeypatch, "pypardiso", "rslab")
    for name, package in (("pardiso", "pypardiso"), ("rslab", "rslab")):
        with pytest.raises(InputError, match=f"cannot be loaded.*pip install {package}"):
            select.create(name, True)


def test_direct_is_the_fastest_that_is_installed(monkeypatch):
    assert select.direct().name == select.expected() == ("pardiso" if HAS_PARDISO else "rslab")
    hide(monkeypatch, "pypardiso")
    assert select.direct().name == select.expected() == "rslab"
    hide(monkeypatch, "rslab")
    assert select.direct().name == select.expected() == "superlu"
    assert select.create("direct", False).name == "superlu"
    assert not select.direct(symmetric=False).symmetric


def test_choose_states_what_a_factorisation_costs():
    pattern = sheet(m=20).pattern
    solver, reason = select.choose(pattern, True)
    assert solver.name == "pcg"
    prices = Prices.of(pattern)
    solve = prices.factors[select.expected()]
    factor = prices.tangent + solve.factor * solve.entries
    costs = 0.45 * factor + solve.solve * solve.entries + prices.residual
    assert reason == f"at first; a factor and a solve cost about as much as {costs:.0f} iterations"
    general, reason = select.choose(pattern, False)
    assert general.name == select.direct().name
    assert not general.symmetric
    assert "not symmetric" in reason


def test_import_loads_no_library():
    code = "import sys, fecloth.linalg.select; print({'pypardiso', 'rslab'} & sys.modules.keys())"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
