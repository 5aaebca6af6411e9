"""The solver "auto": its choice between conjugate gradients, multigrid and a factorisation."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import scipy.sparse
from support.matrices import hide, load, relative, sheet

import fecloth as fc
from fecloth.errors import InputError
from fecloth.linalg import direct, multigrid, select
from fecloth.linalg.prices import FactorPrices, Prices

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

NOWHERE = np.zeros((400, 3))  # the positions do not matter to PCG and direct solvers


@cache
def easy():
    """A matrix that takes 5 iterations to 1e-6."""
    return sheet(m=20, mass=500.0)


@cache
def middle():
    """A matrix that takes 89 iterations."""
    return sheet(m=20, mass=0.3)


@cache
def hard():
    """A matrix that takes 270 iterations."""
    return sheet(m=20, mass=1e-5)


@cache
def entries(kind):
    """Entries of the factor of these matrices."""
    solver = select.create(kind)
    solver.prepare(easy())
    return solver.entries


def factor_prices(kind, load=700.0, analysis=250.0, factor=95.0, solve=20.0):
    """Prices of a whole factor and of a solve with it."""
    count = entries(kind)
    return FactorPrices(load, analysis, count, factor / count, solve / count)


def prices(fast=None, superlu=None, **changes):
    """Prices that no machine changes: multigrid is too dear; `fast` is of all but SuperLU."""
    fast = fast or factor_prices("direct")
    superlu = superlu or factor_prices("superlu", load=0.0, analysis=0.0, factor=800.0)
    least = Prices(
        tangent=8.0,
        residual=1.0,
        grids=80.0,
        coarse=300.0,
        refill=2.0,
        cycle=200.0,
        factors={"pardiso": fast, "rslab": fast, "superlu": superlu},
    )
    return replace(least, **changes)


CHEAP_MULTIGRID = {"grids": 40.0, "coarse": 40.0, "cycle": 1.0}


def auto(**changes):
    """The solver "auto" with changed prices."""
    solver = select.choose(easy().pattern, True)[0]
    solver._prices = prices(**changes)
    solver.drop()
    return solver


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


# 270 iterations, or 11 of multigrid, against a factor and a solve that cost 124 iterations
CHOICES = [
    (hard, {}, "direct"),
    (easy, {}, "pcg"),
    (middle, {}, "pcg"),
    (hard, {"fast": {"factor": 1000.0}}, "pcg"),
    (hard, {"fast": {"solve": 1000.0}}, "pcg"),
    (hard, {"fast": {"analysis": 1e5}}, "pcg"),
    (hard, {"fast": {"load": 1e5}}, "pcg"),
    (hard, {"residual": 1e4}, "pcg"),  # of all solvers: little remains to be gained
    (hard, CHEAP_MULTIGRID, "multigrid"),
    (easy, CHEAP_MULTIGRID, "pcg"),
    (hard, CHEAP_MULTIGRID | {"cycle": 30.0}, "direct"),
    (hard, CHEAP_MULTIGRID | {"refill": 1000.0}, "direct"),
    (hard, CHEAP_MULTIGRID | {"grids": 1e5}, "direct"),
    (hard, CHEAP_MULTIGRID | {"coarse": 1e5}, "direct"),
]


@pytest.mark.parametrize(("matrix", "changes", "last"), CHOICES)
def test_auto_takes_the_cheapest_solver_and_stays_with_it(matrix, changes, last):
    fast = factor_prices("direct", **changes.get("fast", {}))
    names = steps(auto(**changes | {"fast": fast}), matrix(), 8)
    expected = select.direct().name if last == "direct" else last
    assert names[-1] == expected
    if not changes or changes is CHEAP_MULTIGRID:
        assert set(names) == {expected}


def with_block(A, i, j):
    """A with tiny blocks (i, j) and (j, i), in a pattern of its own."""
    n = 3 * len(A.pattern)
    more = scipy.sparse.lil_matrix((n, n))
    more[3 * i, 3 * j] = more[3 * j, 3 * i] = 1e-12
    return A.plus(more.tocsr())


@pytest.mark.parametrize("changes", [True, False])
def test_auto_counts_what_a_pattern_costs_that_changes(changes):
    """A factor for each pattern costs more than 270 iterations; a factor for all costs less."""
    solver, names = auto(), []
    for i in range(60):  # new arrays each time, as contact makes them
        names += steps(solver, with_block(hard(), 0, 200 + changes * (i % 2)), 1)
    assert names[0] == select.direct().name
    assert names[-20:] == ["pcg" if changes else names[0]] * 20


@pytest.mark.parametrize("kind", ["direct", "rslab", "superlu", "multigrid"])
def test_an_equal_pattern_is_analysed_once(kind, monkeypatch):
    solver, b, made, open_ = select.create(kind), load(hard()), [], []

    def count(make, *args, **options):
        """Count the calls, but not the calls that a call makes for its coarser grids."""
        if not open_:
            made.append(1)
        open_.append(1)
        result = make(*args, **options)
        open_.pop()
        return result

    for name, module in (("ScalarRows", direct), ("make_grids", multigrid)):
        monkeypatch.setattr(module, name, partial(count, getattr(module, name)))
    for A in (with_block(hard(), 0, 200), with_block(easy(), 0, 200), with_block(hard(), 0, 201)):
        solver.prepare(A)
        x, _ = solver.solve(b, rtol=1e-6)
        assert relative(A, x, b) <= 1e-6
    assert len(made) == 2


def reusing_steps(solver, A, count):
    """Solve with A in `count` steps, with one factor; return the names of the solvers."""
    names = []
    for _ in range(count):
        solver.begin(1.0, 1.0, NOWHERE)
        if solver.name == "pcg":
            solver.prepare(A)
        names.append(solver.solve(load(A), rtol=1e-6)[1].name)
    return names


@pytest.mark.parametrize(("load", "changes"), [(700.0, True), (1e9, False)])
def test_auto_uses_a_factorisation_that_serves_many_steps(load, changes, monkeypatch):
    """In a linear problem one factor serves all steps: cheaper than 89 iterations each."""
    monkeypatch.setattr(select, "DECAY", 0.95)
    names = reusing_steps(auto(fast=factor_prices("direct", load=load)), middle(), 80)
    assert names[0] == "pcg"
    assert (names[-30:] == [select.direct().name] * 30) == changes
    assert (set(names) == {"pcg"}) != changes


@pytest.mark.parametrize(("ratio", "is_reset"), [(3.2, False), (5.0, True)])
def test_auto_begins_anew_if_the_step_changes_by_two(ratio, is_reset):
    for wx in (ratio, 1 / ratio):
        solver, other = auto(), select.direct().name
        assert steps(solver, hard(), 3) == [other] * 3
        solver.begin(wx, 1.0, NOWHERE)
        assert solver.name == ("pcg" if is_reset else other)


def test_auto_change_of_solver_needs_a_new_prepare():
    """Otherwise a factor that no longer exists would be reused."""
    solver = auto()
    steps(solver, hard(), 3)
    before = solver.prepared
    solver.begin(100.0, 1.0, NOWHERE)
    assert solver.name == "pcg"
    assert solver.prepared > before
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(hard()))


def test_auto_counts_the_price_of_superlu_where_there_is_no_other(monkeypatch):
    """With PARDISO 270 iterations are too many, with SuperLU they are not."""
    hide(monkeypatch, "pypardiso", "rslab")
    assert steps(auto(), hard(), 3) == ["pcg"] * 3
    cheap = factor_prices("superlu", load=0.0, analysis=0.0)
    assert steps(auto(superlu=cheap), hard(), 3) == ["superlu"] * 3


def test_auto_follows_the_steps_of_a_march(monkeypatch):
    """Every implicit method calls `begin` at the start of a step."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK(), fc.Gravity()], ["left"])
    alpha_m, alpha_f, beta, _ = fc.GeneralizedAlpha(0.8).parameters
    shares = 1.0, 1.0, (1 - alpha_f) * beta / (1 - alpha_m)  # wx / wa over dt²
    methods = fc.BackwardEuler(), fc.LinearlyImplicitEuler(), fc.GeneralizedAlpha(0.8)
    for method, share in zip(methods, shares, strict=True):
        sizes, size = [], share * 1e-3**2
        monkeypatch.setattr(
            select.AutoSolver, "begin", lambda _, wx, wa, x, s=sizes: s.append(wx / wa)
        )
        assert len([*fc.march(system, method, system.rest(), 1e-3, 3e-3)]) == 3
        assert sizes == pytest.approx([size] * 3)
