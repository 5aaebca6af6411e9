"""The choice "auto" between conjugate gradients and a factorisation, by what it counts."""

import pytest
from support.matrices import indefinite, load, missing, relative, sheet

import fecloth as fc
from fecloth.errors import IndefiniteMatrix, InputError
from fecloth.linalg import auto_solver, mkl_pardiso, select

EASY, HARD = sheet(m=20, mass=500.0), sheet(m=20, mass=1e-5)  # 5 and 270 iterations to 1e-6


def auto(condition=1.0, nodes=400):
    return select.choose(condition, nodes, True)[0]


def steps(solver, A, count, wx=1.0):
    """The names of the solvers that solved A in so many steps of one solve each."""
    names, b = [], load(A)
    for _ in range(count):
        solver.begin(wx, 1.0)
        solver.prepare(A)
        x, info = solver.solve(b, rtol=1e-6)
        assert relative(A, x, b) <= 1e-6
        names.append(info.name)
    return names


def test_auto_falls_over_to_a_factorisation_and_tries_again_ever_less_often():
    solver, other = auto(), select.direct().name
    for trials, patience in enumerate((8, 16, 32), start=1):
        # The first step begins with pcg and ends with the factorisation, as it needs more than
        assert steps(solver, HARD, 1 + patience) == [other] * (1 + patience)
        assert solver._spent == trials * 104  # iterations: 2 (45 + 0.37 · √400)


def test_auto_comes_back_when_iterations_are_cheap():
    solver, other = auto(), select.direct().name
    assert steps(solver, HARD, 4) == [other] * 4
    assert steps(solver, EASY, 60) == [other] * 5 + ["pcg"] * 55


def test_auto_tries_a_factorisation_that_lasts(monkeypatch):
    """In a linear problem one factor serves all steps: cheaper than 40 iterations each."""
    for loading, turns in ((0.0, True), (1e12, False)):
        monkeypatch.setattr(auto_solver, "LOADING", loading)
        solver, A, names = auto(), sheet(m=20, mass=0.3), []
        for _ in range(20):
            solver.begin(1.0, 1.0)
            if solver.name == "pcg" or solver._A is None:
                solver.prepare(A)
            names.append(solver.solve(load(A), rtol=1e-6)[1].name)
        assert 20 < solver._iterations < 100
        assert names[:8] == ["pcg"] * 8
        assert (names[8:] == [select.direct().name] * 12) == turns


def test_where_a_factorisation_is_predicted_it_is_tried_soon(monkeypatch):
    monkeypatch.setattr(auto_solver, "LOADING", 0.0)
    A = sheet(m=20, mass=0.3)
    assert steps(auto(condition=1e9), A, 4) == ["pcg"] * 3 + [select.direct().name]
    assert steps(auto(condition=1.0), A, 9) == ["pcg"] * 8 + [select.direct().name]


def test_auto_follows_the_step_size():
    solver, other = auto(), select.direct().name
    assert steps(solver, HARD, 3, wx=1.0) == [other] * 3
    assert steps(solver, EASY, 1, wx=0.5) == [other]  # dt less by 1.4: the accounts stay
    assert steps(solver, EASY, 3, wx=1e-4) == ["pcg"] * 3
    assert steps(solver, HARD, 3, wx=1.0) == [other] * 3


def test_auto_repeats_itself_after_drop():
    solver = auto()
    first = steps(solver, HARD, 5) + steps(solver, EASY, 30)
    solver.drop()
    assert solver.name == "pcg"
    assert steps(solver, HARD, 5) + steps(solver, EASY, 30) == first


def test_a_change_of_solver_is_a_new_preparation():
    """Or a factor that is no longer there would be taken for one."""
    solver = auto()
    steps(solver, HARD, 9)
    before = solver.prepared
    solver.begin(1.0, 1.0)  # of a trial
    assert (solver.name, solver.prepared) == ("pcg", before + 1)
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(HARD))


def test_auto_passes_on_that_a_matrix_is_indefinite():
    solver, A = auto(), indefinite("smooth")
    solver.begin(1.0, 1.0)
    solver.prepare(A)
    with pytest.raises(IndefiniteMatrix, match="pcg"):
        solver.solve(load(A))
    assert solver.name == "pcg"


def test_auto_without_pardiso(monkeypatch):
    monkeypatch.setattr(mkl_pardiso, "routine", missing)
    solver = auto()
    assert solver.price == pytest.approx(45 + 0.37 * 20)
    assert steps(solver, HARD, 1) == ["superlu"]
    assert solver.price == pytest.approx(100 + 10 * 20)


def test_auto_follows_the_steps_of_a_march(monkeypatch):
    """Every implicit method tells it where a step begins."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK(), fc.Gravity()], ["left"])
    for method in (fc.BackwardEuler(), fc.LinearlyImplicitEuler(), fc.GeneralizedAlpha(0.8)):
        sizes = []
        monkeypatch.setattr(
            auto_solver.Cheapest, "begin", lambda _, wx, wa, s=sizes: s.append(wx / wa)
        )
        fc.run(system, method, system.rest(), 1e-3, 3e-3)
        wx, _, wa = method.weights(1e-3)
        assert sizes == pytest.approx([wx / wa] * 3)
