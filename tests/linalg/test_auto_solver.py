"""The solver "auto": its choice between conjugate gradients and a factorisation."""

import math

import numpy as np
import pytest
from support.matrices import HAS_PARDISO, indefinite, load, missing, relative, sheet

import fecloth as fc
from fecloth.errors import IndefiniteMatrix, InputError
from fecloth.linalg import auto_solver, mkl_pardiso, select

NOWHERE = np.zeros((400, 3))  # the positions do not matter to PCG and direct solvers
EASY, HARD = sheet(m=20, mass=500.0), sheet(m=20, mass=1e-5)  # 5 and 270 iterations to 1e-6


def auto(condition=1.0, nodes=400):
    return select.choose(condition, nodes, True)[0]


def steps(solver, A, count, wx=1.0):
    """Solve with A once in each of `count` steps; return the names of the solvers."""
    names, b = [], load(A)
    for _ in range(count):
        solver.begin(wx, 1.0, NOWHERE)
        solver.prepare(A)
        x, info = solver.solve(b, rtol=1e-6)
        assert relative(A, x, b) <= 1e-6
        names.append(info.name)
    return names


def test_auto_factorises_hard_matrices_and_tries_pcg_less_and_less_often():
    solver, other = auto(), select.direct().name
    for trials, patience in enumerate((8, 16, 32), start=1):
        # The first step begins with pcg and ends with a factorisation when pcg exceeds its limit.
        assert steps(solver, HARD, 1 + patience) == [other] * (1 + patience)
        assert solver._spent == trials * 104  # iterations: 2 (45 + 0.37 · √400)


def test_auto_returns_to_pcg_if_iterations_are_few():
    solver, other = auto(), select.direct().name
    assert steps(solver, HARD, 4) == [other] * 4
    assert steps(solver, EASY, 60) == [other] * 5 + ["pcg"] * 55


def test_auto_uses_a_factorisation_that_serves_many_steps(monkeypatch):
    """In a linear problem one factor serves all steps. This is cheaper than 40 iterations each."""
    for loading, changes in ((0.0, True), (1e12, False)):
        monkeypatch.setattr(auto_solver, "LOADING", loading)
        solver, A, names = auto(), sheet(m=20, mass=0.3), []
        for _ in range(20):
            solver.begin(1.0, 1.0, NOWHERE)
            if solver.name == "pcg" or solver._A is None:
                solver.prepare(A)
            names.append(solver.solve(load(A), rtol=1e-6)[1].name)
        assert 20 < solver._iterations < 100
        assert names[:8] == ["pcg"] * 8
        assert (names[8:] == [select.direct().name] * 12) == changes


def test_auto_tries_a_factorisation_soon_if_predicted_cheaper(monkeypatch):
    monkeypatch.setattr(auto_solver, "LOADING", 0.0)
    A = sheet(m=20, mass=0.3)
    assert steps(auto(condition=1e9), A, 4) == ["pcg"] * 3 + [select.direct().name]
    assert steps(auto(condition=1.0), A, 9) == ["pcg"] * 8 + [select.direct().name]


@pytest.mark.parametrize(("work", "is_worth"), [(0.8, False), (1.25, True)])
@pytest.mark.parametrize("name", ["pardiso", "superlu"])
def test_auto_tries_a_factorisation_if_pcg_takes_more_than_two_solves(
    name, work, is_worth, monkeypatch
):
    monkeypatch.setattr(auto_solver, "LOADING", 0.0)
    if name == "superlu":
        monkeypatch.setattr(mkl_pardiso, "routine", missing)
    elif not HAS_PARDISO:
        pytest.skip("no PARDISO")
    solver = auto()
    solver._get("direct")
    solver._home_work = work * 2 * solver.price / auto_solver.SOLVES[name]
    assert solver._worth_trying("direct") == is_worth


@pytest.mark.parametrize(("work", "is_worth"), [(0.8, False), (1.25, True)])
def test_auto_loads_the_direct_solver_after_enough_iterations(work, is_worth):
    solver = auto(nodes=400)
    solver._home_work = math.inf
    solver._spent = work * auto_solver.LOADING / 400
    assert solver._worth_trying("direct") == is_worth


@pytest.mark.parametrize(("ratio", "is_reset"), [(3.2, False), (5.0, True)])
def test_auto_resets_its_counts_if_the_step_changes_by_two(ratio, is_reset):
    for wx in (ratio, 1 / ratio):
        solver, other = auto(), select.direct().name
        assert steps(solver, HARD, 3) == [other] * 3
        solver.begin(wx, 1.0, NOWHERE)
        assert solver.name == ("pcg" if is_reset else other)


def test_auto_scales_the_predicted_iterations_with_the_step(monkeypatch):
    """5 iterations become 500 for a step 100 times as long, more than a factorisation costs."""
    monkeypatch.setattr(auto_solver, "LOADING", 0.0)
    solver, A = auto(), sheet(m=20, mass=0.3)
    assert steps(solver, EASY, 3) == ["pcg"] * 3
    assert steps(solver, A, 4, wx=1e4) == ["pcg"] * 3 + [select.direct().name]


def test_auto_follows_the_step_size():
    solver, other = auto(), select.direct().name
    assert steps(solver, HARD, 3, wx=1.0) == [other] * 3
    assert steps(solver, EASY, 1, wx=0.5) == [other]  # dt smaller by 1.4: the counts remain
    assert steps(solver, EASY, 3, wx=1e-4) == ["pcg"] * 3
    assert steps(solver, HARD, 3, wx=1.0) == [other] * 3


def test_auto_after_drop_repeats_its_choices():
    solver = auto()
    first = steps(solver, HARD, 5) + steps(solver, EASY, 30)
    solver.drop()
    assert solver.name == "pcg"
    assert steps(solver, HARD, 5) + steps(solver, EASY, 30) == first


def test_auto_change_of_solver_needs_a_new_prepare():
    """Otherwise a factor that no longer exists would be reused."""
    solver = auto()
    steps(solver, HARD, 9)
    before = solver.prepared
    solver.begin(1.0, 1.0, NOWHERE)  # a trial begins
    assert (solver.name, solver.prepared) == ("pcg", before + 1)
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(HARD))


def test_auto_indefinite_matrix_is_rejected():
    solver, A = auto(), indefinite("smooth")
    solver.begin(1.0, 1.0, NOWHERE)
    solver.prepare(A)
    with pytest.raises(IndefiniteMatrix, match="pcg"):
        solver.solve(load(A))
    assert solver.name == "pcg"


def test_auto_without_pardiso_uses_superlu(monkeypatch):
    monkeypatch.setattr(mkl_pardiso, "routine", missing)
    solver = auto()
    assert solver.price == pytest.approx(45 + 0.37 * 20)
    assert steps(solver, HARD, 1) == ["superlu"]
    assert solver.price == pytest.approx(100 + 10 * 20)


def test_auto_follows_the_steps_of_a_march(monkeypatch):
    """Every implicit method calls `begin` at the start of a step."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK(), fc.Gravity()], ["left"])
    for method in (fc.BackwardEuler(), fc.LinearlyImplicitEuler(), fc.GeneralizedAlpha(0.8)):
        sizes = []
        monkeypatch.setattr(
            auto_solver.AutoSolver, "begin", lambda _, wx, wa, x, s=sizes: s.append(wx / wa)
        )
        fc.run(system, method, system.rest(), 1e-3, 3e-3)
        wx, _, wa = method.weights(1e-3)
        assert sizes == pytest.approx([wx / wa] * 3)


def test_auto_takes_multigrid_on_a_large_cloth_if_pcg_takes_many_iterations(monkeypatch):
    monkeypatch.setattr(auto_solver, "LARGE", 400)
    assert steps(auto(), EASY, 3) == ["pcg"] * 3
    monkeypatch.setattr(auto_solver, "MANY", 20)
    A = sheet(m=20, mass=0.3)  # 40 iterations of PCG
    solver = auto(condition=1e3)
    names = steps(solver, A, 8)
    assert names == ["pcg"] + ["multigrid"] * 7
    solver.drop()
    assert steps(solver, EASY, 3) == ["pcg"] * 3
    monkeypatch.setattr(auto_solver, "LARGE", 401)
    assert set(steps(auto(condition=1e3), A, 8)) == {"pcg"}


@pytest.mark.parametrize(("cycle", "last"), [(4.0, "multigrid"), (100.0, "direct")])
def test_auto_factorises_where_multigrid_takes_too_long(cycle, last, monkeypatch):
    """PCG exceeds its limit of 104 iterations, multigrid needs 18; its limit is 104 / `CYCLE`."""
    monkeypatch.setattr(auto_solver, "LARGE", 400)
    monkeypatch.setattr(auto_solver, "CYCLE", cycle)
    expected = select.direct().name if last == "direct" else last
    assert steps(auto(), HARD, 3) == [expected] * 3
