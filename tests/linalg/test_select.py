"""Properties of all linear solvers, and the selection of a solver."""

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

pardiso = pytest.param("pardiso", marks=needs_pardiso)
SYMMETRIC = [pardiso, "rslab", "superlu", "pcg", "multigrid"]
GENERAL = [pardiso, "rslab", "superlu"]
BOTH = [
    pytest.param("pardiso", True, marks=needs_pardiso),
    pytest.param("pardiso", False, marks=needs_pardiso),
    ("rslab", True),
    ("rslab", False),
    ("superlu", True),
    ("superlu", False),
    ("pcg", True),
    ("multigrid", True),
]


@pytest.mark.parametrize("name", SYMMETRIC)
def test_symmetric_solvers_agree_with_scipy(name):
    A = sheet(pinned=range(14))
    b = load(A)
    solver = select.create(name, symmetric=True)
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-12)
    assert difference(x, reference(A, b)) < 1e-8
    assert (solver.name, solver.symmetric, info.name) == (name, True, name)
    assert min(info.seconds_factor, info.seconds_solve) > 0


@pytest.mark.parametrize("name", GENERAL)
def test_general_solvers_agree_with_scipy(name):
    A = sheet(pinned=range(14), skew=0.3)
    b = load(A)
    solver = select.create(name, symmetric=False)
    solver.prepare(A)
    x, info = solver.solve(b)
    assert not solver.symmetric
    assert info.residual < 1e-12
    assert difference(x, reference(A, b)) < 1e-8


@pytest.mark.parametrize("rtol", [0.3, 1e-2, 1e-6, 1e-12])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_solve_info_residual_is_the_true_residual(name, rtol):
    A = sheet(pinned=[3, 20])
    b = load(A)
    solver = select.create(name)
    solver.prepare(A)
    x, info = solver.solve(b, rtol=rtol)
    assert info.residual <= rtol
    assert info.residual == pytest.approx(relative(A, x, b), rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("name", SYMMETRIC)
def test_prepare_uses_values_changed_in_place(name):
    A = sheet(seed=0)
    b = load(A)
    solver = select.create(name)
    solver.prepare(A)
    before, _ = solver.solve(b)
    A.values[...] = sheet(seed=5, pinned=[7]).values
    solver.prepare(A)
    after, _ = solver.solve(b, rtol=1e-12)
    assert difference(after, before) > 0.1
    assert difference(after, reference(A, b)) < 1e-8


@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_prepare_analyses_a_new_pattern(name, symmetric):
    solver = select.create(name, symmetric)
    # Both patterns have the same numbers of nodes and blocks, but other neighbours. Only the
    # identity of the object distinguishes them.
    first = sheet(m=9)
    order = np.random.default_rng(3).permutation(81)
    scalar = first.to_scipy().tocsr()
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    shuffled = scalar[dofs][:, dofs].tobsr((3, 3))
    shuffled.sort_indices()
    second = BlockMatrix(BlockPattern(shuffled.indptr, shuffled.indices), shuffled.data)
    assert len(second.pattern.indices) == len(first.pattern.indices)
    for A in (first, second, sheet(m=12), first):
        solver.prepare(A)
        x, _ = solver.solve(load(A), rtol=1e-12)
        assert difference(x, reference(A, load(A))) < 1e-8


@pytest.mark.parametrize("kind", ["block", "smooth"])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_indefinite_matrix_is_rejected(name, kind):
    A = indefinite(kind)
    eigenvalues = np.linalg.eigvalsh(A.to_scipy().toarray())
    assert eigenvalues[0] < 0 < eigenvalues[3]
    if kind == "smooth":
        assert np.linalg.eigvalsh(A.values[A.pattern.diagonal]).min() > 0
    solver = select.create(name)

    def attempt():
        solver.prepare(A)
        solver.solve(load(A))

    with pytest.raises(IndefiniteMatrix, match=name):
        attempt()
    # The solver is not broken by it.
    A.values[...] = sheet().values
    solver.prepare(A)
    x, _ = solver.solve(load(A), rtol=1e-12)
    assert difference(x, reference(A, load(A))) < 1e-8


@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_singular_matrix_is_rejected(name, symmetric):
    A = sheet(mass=0.0)  # translations cost nothing
    solver = select.create(name, symmetric)

    def attempt():
        solver.prepare(A)
        solver.solve(np.ones((len(A.pattern), 3)))  # has no solution

    with pytest.raises(SolveFailed):
        attempt()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_numbers_that_are_not_finite_are_rejected(name, symmetric, bad):
    A = sheet(m=8)
    solver = select.create(name, symmetric)
    solver.prepare(A)
    b = load(A)
    b[5, 1] = bad
    with pytest.raises(SolveFailed, match="b is not finite"):
        solver.solve(b)
    for slot in (A.pattern.diagonal[30], A.pattern.diagonal[30] + 1):
        wrong = BlockMatrix(A.pattern, A.values.copy())
        wrong.values[slot, 1, 2] = bad

        def attempt(wrong=wrong):
            solver.prepare(wrong)
            solver.solve(load(A))

        with pytest.raises(SolveFailed, match="finite") as caught:
            attempt()
        assert not isinstance(caught.value, IndefiniteMatrix)
        solver.prepare(A)
        solver.solve(load(A))


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


def test_named_unknown_or_unsuitable_solver_is_rejected(monkeypatch):
    with pytest.raises(InputError, match="direct, pardiso, rslab, superlu, pcg, multigrid"):
        select.create("mumps", True)
    with pytest.raises(InputError, match="symmetric matrices only"):
        select.create("pcg", symmetric=False)
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
