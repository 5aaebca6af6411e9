import gc
import subprocess
import sys

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from fecloth import cheapest, linear
from fecloth import direct as direct_module
from fecloth.blocks import BlockMatrix, BlockPattern
from fecloth.errors import IndefiniteMatrix, InputError, SolveFailed

try:
    linear.Pardiso()
    HAS_PARDISO = True
except (ImportError, OSError):
    HAS_PARDISO = False

needs_pardiso = pytest.mark.skipif(not HAS_PARDISO, reason="pypardiso or the MKL is missing")
pardiso = pytest.param("pardiso", marks=needs_pardiso)
SYMMETRIC = [pardiso, "superlu", "pcg"]
GENERAL = [pardiso, "superlu"]
BOTH = [
    pytest.param("pardiso", True, marks=needs_pardiso),
    pytest.param("pardiso", False, marks=needs_pardiso),
    ("superlu", True),
    ("superlu", False),
    ("pcg", True),
]


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


@pytest.mark.parametrize("name", SYMMETRIC)
def test_symmetric_solvers_agree_with_scipy(name):
    A = sheet(pinned=range(14))
    b = load(A)
    solver = linear.named(name, symmetric=True)
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-12)
    assert difference(x, reference(A, b)) < 1e-8
    assert (solver.name, solver.symmetric, info.name) == (name, True, name)
    assert min(info.seconds_factor, info.seconds_solve) > 0


@pytest.mark.parametrize("name", GENERAL)
def test_general_solvers_agree_with_scipy(name):
    A = sheet(pinned=range(14), skew=0.3)
    b = load(A)
    solver = linear.named(name, symmetric=False)
    solver.prepare(A)
    x, info = solver.solve(b)
    assert not solver.symmetric
    assert info.residual < 1e-12
    assert difference(x, reference(A, b)) < 1e-8


@pytest.mark.parametrize("rtol", [0.3, 1e-2, 1e-6, 1e-12])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_stated_residual_is_the_true_one(name, rtol):
    A = sheet(pinned=[3, 20])
    b = load(A)
    solver = linear.named(name)
    solver.prepare(A)
    x, info = solver.solve(b, rtol=rtol)
    assert info.residual <= rtol
    assert info.residual == pytest.approx(relative(A, x, b), rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("name", SYMMETRIC)
def test_values_rewritten_in_place_are_prepared_anew(name):
    A = sheet(seed=0)
    b = load(A)
    solver = linear.named(name)
    solver.prepare(A)
    before, _ = solver.solve(b)
    A.values[...] = sheet(seed=5, pinned=[7]).values
    solver.prepare(A)
    after, _ = solver.solve(b, rtol=1e-12)
    assert difference(after, before) > 0.1
    assert difference(after, reference(A, b)) < 1e-8


@pytest.mark.parametrize("name", SYMMETRIC)
def test_one_solver_serves_several_right_sides_and_keeps_its_results(name):
    A = sheet()
    solver = linear.named(name)
    solver.prepare(A)
    b, c = load(A, 1), load(A, 2)
    x, _ = solver.solve(b, rtol=1e-12)
    y, _ = solver.solve(c, rtol=1e-12)
    assert difference(x, reference(A, b)) < 1e-8
    assert difference(y, reference(A, c)) < 1e-8
    np.testing.assert_array_equal(b, load(A, 1))


@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_a_new_pattern_is_analysed(name, symmetric):
    solver = linear.named(name, symmetric)
    # The same number of nodes and of blocks, other neighbours: nothing but `is` can tell.
    first = sheet(m=9)
    order = np.random.default_rng(3).permutation(81)
    bare = first.to_scipy().tocsr()
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    shuffled = bare[dofs][:, dofs].tobsr((3, 3))
    shuffled.sort_indices()
    second = BlockMatrix(BlockPattern(shuffled.indptr, shuffled.indices), shuffled.data)
    assert len(second.pattern.indices) == len(first.pattern.indices)
    for A in (first, second, sheet(m=12), first):
        solver.prepare(A)
        x, _ = solver.solve(load(A), rtol=1e-12)
        assert difference(x, reference(A, load(A))) < 1e-8


@pytest.mark.parametrize("name", GENERAL)
def test_the_analysis_is_kept_with_the_pattern(name, monkeypatch):
    built = []

    class Counted(direct_module._ScalarRows):
        def __init__(self, *args, **kwargs):
            built.append(1)
            super().__init__(*args, **kwargs)

    monkeypatch.setattr(direct_module, "_ScalarRows", Counted)
    solver, A = linear.named(name), sheet(m=6)
    for factor in (1.0, 2.0, 3.0):
        A.values[...] *= factor
        solver.prepare(A)
    assert sum(built) == 1
    solver.prepare(sheet(m=6))
    assert sum(built) == 2


def indefinite(kind):
    A = sheet(mass=0.1)
    if kind == "block":  # a negative diagonal block
        A.values[A.pattern.diagonal[40]] -= 100 * np.eye(3)
    else:  # all diagonal blocks stay positive definite, only smooth vectors see the sign
        A.values[A.pattern.diagonal] -= 0.2 * np.eye(3)
    return A


@pytest.mark.parametrize("kind", ["block", "smooth"])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_indefinite_matrix_is_refused(name, kind):
    A = indefinite(kind)
    eigenvalues = np.linalg.eigvalsh(A.to_scipy().toarray())
    assert eigenvalues[0] < 0 < eigenvalues[3]
    if kind == "smooth":
        assert np.linalg.eigvalsh(A.values[A.pattern.diagonal]).min() > 0
    solver = linear.named(name)

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


@pytest.mark.parametrize("signs", [(-1, 1, 1), (1, 1, -1), (-1, -1, 1), (1, -1, -1), (1, 1, 0)])
def test_block_jacobi_refuses_an_indefinite_block(signs):
    A = sheet()
    A.values[A.pattern.diagonal[40]] = np.diag(signs)
    with pytest.raises(IndefiniteMatrix, match="node 40"):
        linear.PCG().prepare(A)


def test_a_zero_pivot_is_indefinite_for_superlu_though_rows_can_be_interchanged():
    A = sheet()
    i = A.pattern.diagonal[0]
    A.values[i] = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
    others = (A.pattern.rows == 0) | (A.pattern.indices == 0)
    others[i] = False
    A.values[others] = 0
    with pytest.raises(IndefiniteMatrix):
        linear.SuperLU().prepare(A)


@pytest.mark.parametrize("name", GENERAL)
def test_general_solvers_take_an_indefinite_matrix(name):
    A = indefinite("block")
    solver = linear.named(name, symmetric=False)
    solver.prepare(A)
    x, _ = solver.solve(load(A))
    assert difference(x, reference(A, load(A))) < 1e-8


@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_singular_matrix_is_refused(name, symmetric):
    A = sheet(mass=0.0)  # translations cost nothing
    solver = linear.named(name, symmetric)

    def attempt():
        solver.prepare(A)
        solver.solve(np.ones((len(A.pattern), 3)))  # has no solution

    with pytest.raises(SolveFailed):
        attempt()


def test_unconverged_conjugate_gradients_state_their_residual():
    A = sheet(mass=1e-4)
    solver = linear.PCG(max_iterations=5)
    solver.prepare(A)
    with pytest.raises(SolveFailed, match=r"max_iterations = 5.*relative residual") as caught:
        solver.solve(load(A), rtol=1e-8)
    assert not isinstance(caught.value, IndefiniteMatrix)
    assert 1e-8 < caught.value.residual < 100
    assert f"{caught.value.residual:.2e}" in str(caught.value)
    assert caught.value.asked == 1e-8


def test_conjugate_gradients_stop_where_round_off_does():
    A = sheet(mass=1e-5)
    solver = linear.PCG()
    solver.prepare(A)
    with pytest.raises(SolveFailed, match="round-off") as caught:
        solver.solve(load(A), rtol=1e-17)
    assert 1e-17 < caught.value.residual < 1e-9


def test_direct_solvers_accept_round_off_but_state_it():
    A = sheet(mass=1e-6)
    b = np.ones((len(A.pattern), 3))  # the softest direction: A x cancels to 1e-6 of its parts
    solver = linear.direct()
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-10)
    assert 1e-10 < info.residual < 1e-7
    assert info.iterations == 2
    assert difference(x, 1e6 * b) < 1e-6


def test_refinement_corrects_a_poor_factor(monkeypatch):
    A = sheet()
    solver = linear.SuperLU()
    solver.prepare(A)
    exact = solver._apply
    monkeypatch.setattr(solver, "_apply", lambda b: exact(b) * (1 + 1e-6))
    x, info = solver.solve(load(A), rtol=1e-10)
    assert info.iterations == 1
    assert relative(A, x, load(A)) < 1e-10
    monkeypatch.setattr(solver, "_apply", lambda b: exact(b) * 1.5)
    with pytest.raises(SolveFailed, match=r"relative residual 1.25e-01, asked 1.00e-10"):
        solver.solve(load(A), rtol=1e-10)


def test_warm_start_needs_fewer_iterations():
    A = sheet(mass=1e-3)
    b = load(A)
    solver = linear.PCG()
    solver.prepare(A)
    x, cold = solver.solve(b, rtol=1e-6)
    start = x.copy()
    _, same = solver.solve(b, rtol=1e-6, guess=x)
    y, warm = solver.solve(1.001 * b, rtol=1e-6, guess=x)
    assert same.iterations == 0
    assert 0 < warm.iterations < 0.7 * cold.iterations
    assert relative(A, y, 1.001 * b) <= 1e-6
    np.testing.assert_array_equal(x, start)


def spectrum(values):
    """Pairs of nodes [[I, s Q], [s Qᵀ, I]], Q a rotation: eigenvalues 1 ± s, diagonal blocks I."""
    n = 2 * len(values)
    pairs = np.arange(n, dtype=np.int32).reshape(-1, 2)
    A = BlockMatrix.zeros(BlockPattern.union(n, [pairs]))
    slots = A.pattern.slots(pairs)
    rng = np.random.default_rng(0)
    for slot, s in zip(slots, values, strict=True):
        Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        A.values[slot[0, 0]] = A.values[slot[1, 1]] = np.eye(3)
        A.values[slot[0, 1]], A.values[slot[1, 0]] = s * Q, s * Q.T
    return A


@pytest.mark.parametrize("distinct", [1, 3, 6])
def test_iterations_equal_the_number_of_distinct_eigenvalues(distinct):
    A = spectrum(np.repeat(np.linspace(0.2, 0.9, distinct), 20))  # 1 ± s: 2 · distinct of them
    solver = linear.PCG()
    solver.prepare(A)
    _, info = solver.solve(load(A), rtol=1e-9)
    assert info.iterations == 2 * distinct


def test_iterations_obey_chebyshev_bound_and_come_near_it():
    s = 0.998
    A = spectrum(s * np.cos(np.pi * (np.arange(400) + 0.5) / 800))
    kappa = (1 + s) / (1 - s)
    solver = linear.PCG()
    solver.prepare(A)
    for rtol in (1e-2, 1e-4, 1e-6):
        _, info = solver.solve(load(A), rtol=rtol)
        # The bound holds for the A-norm of the error; the residual adds a factor √κ.
        bound = 0.5 * np.sqrt(kappa) * np.log(2 * np.sqrt(kappa) / rtol)
        assert 0.2 * bound < info.iterations < bound


def test_block_jacobi_removes_any_scale_of_the_nodes():
    A = spectrum(np.linspace(-0.5, 0.5, 50))
    rng = np.random.default_rng(4)
    T = rng.normal(size=(100, 3, 3)) * 10.0 ** rng.uniform(-4, 4, size=(100, 1, 1))
    i, j = A.pattern.rows, A.pattern.indices
    A.values[...] = T[i] @ A.values @ T[j].transpose(0, 2, 1)
    b = np.einsum("ncd,nd->nc", T, load(A))
    solver = linear.PCG()
    solver.prepare(A)
    x, info = solver.solve(b, rtol=1e-8)
    assert info.iterations < 45  # κ = 3; the scalar diagonal leaves thousands
    assert relative(A, x, b) <= 1e-8


@pytest.mark.parametrize("name", SYMMETRIC)
def test_no_load_no_motion(name):
    A = sheet()
    solver = linear.named(name)
    solver.prepare(A)
    x, info = solver.solve(np.zeros((len(A.pattern), 3)), guess=load(A))
    assert not x.any()
    assert (info.iterations, info.residual) == (0, 0.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("name", "symmetric"), BOTH)
def test_numbers_that_are_not_finite_are_refused(name, symmetric, bad):
    A = sheet(m=8)
    solver = linear.named(name, symmetric)
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


def test_misuse_is_refused():
    A = sheet(m=5)
    solver = linear.PCG()
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(A))
    solver.prepare(A)
    for rtol in (0.0, -1e-3, 1.0, np.nan):
        with pytest.raises(InputError, match="rtol"):
            solver.solve(load(A), rtol=rtol)
    with pytest.raises(InputError, match=r"\(75,\).*\(25, 3\)"):
        solver.solve(load(A).ravel())


@pytest.mark.parametrize("name", SYMMETRIC)
def test_after_a_failed_prepare_there_is_nothing_to_solve_with(name):
    A = sheet()
    solver = linear.named(name)
    solver.prepare(A)
    A.values[A.pattern.diagonal[9]] = np.nan
    with pytest.raises(SolveFailed):
        solver.prepare(A)
    with pytest.raises(InputError, match="prepare"):
        solver.solve(load(A))


def test_named_refuses_what_it_cannot_give(monkeypatch):
    with pytest.raises(InputError, match="direct, pardiso, superlu, pcg"):
        linear.named("mumps", True)
    with pytest.raises(InputError, match="symmetric matrices only"):
        linear.named("pcg", symmetric=False)
    monkeypatch.setattr(direct_module, "_mkl_pardiso", _missing)
    with pytest.raises(InputError, match=r"no MKL.*pip install pypardiso"):
        linear.named("pardiso", True)


def _missing():
    raise ImportError("no MKL here")


def test_direct_falls_back_to_superlu(monkeypatch):
    assert linear.direct().name == ("pardiso" if HAS_PARDISO else "superlu")
    monkeypatch.setattr(direct_module, "_mkl_pardiso", _missing)
    assert linear.direct().name == "superlu"
    assert linear.named("direct", False).name == "superlu"
    assert not linear.direct(symmetric=False).symmetric


def test_choice_states_its_numbers():
    solver, reason = linear.choose(1e3, 26_000, True)
    assert solver.name == "pcg"
    # 0.45 · ½ · √1000 · ln 200 = 37.7; 45 + 0.37 · √26000 = 104.7
    counts = "about 38 iterations of it predicted, a factorisation costs about 105"
    assert reason == f"to start with; {counts}"
    general, why = linear.choose(1.0, 26_000, False)
    assert general.name == linear.direct().name
    assert not general.symmetric
    assert "not symmetric" in why


EASY, HARD = sheet(m=20, mass=500.0), sheet(m=20, mass=1e-5)  # 5 and 270 iterations to 1e-6


def auto(condition=1.0, nodes=400):
    return linear.choose(condition, nodes, True)[0]


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
    solver, other = auto(), linear.direct().name
    for trials, patience in enumerate((8, 16, 32), start=1):
        # The first step begins with pcg and ends with the factorisation, as it needs more than
        assert steps(solver, HARD, 1 + patience) == [other] * (1 + patience)
        assert solver._spent == trials * 104  # iterations: 2 (45 + 0.37 · √400)


def test_auto_comes_back_when_iterations_are_cheap():
    solver, other = auto(), linear.direct().name
    assert steps(solver, HARD, 4) == [other] * 4
    assert steps(solver, EASY, 60) == [other] * 5 + ["pcg"] * 55


def test_auto_tries_a_factorisation_that_lasts(monkeypatch):
    """In a linear problem one factor serves all steps: cheaper than 40 iterations each."""
    for loading, turns in ((0.0, True), (1e12, False)):
        monkeypatch.setattr(cheapest, "LOADING", loading)
        solver, A, names = auto(), sheet(m=20, mass=0.3), []
        for _ in range(20):
            solver.begin(1.0, 1.0)
            if solver.name == "pcg" or solver._A is None:
                solver.prepare(A)
            names.append(solver.solve(load(A), rtol=1e-6)[1].name)
        assert 20 < solver._iterations < 100
        assert names[:8] == ["pcg"] * 8
        assert (names[8:] == [linear.direct().name] * 12) == turns


def test_where_a_factorisation_is_predicted_it_is_tried_soon(monkeypatch):
    monkeypatch.setattr(cheapest, "LOADING", 0.0)
    A = sheet(m=20, mass=0.3)
    assert steps(auto(condition=1e9), A, 4) == ["pcg"] * 3 + [linear.direct().name]
    assert steps(auto(condition=1.0), A, 9) == ["pcg"] * 8 + [linear.direct().name]


def test_auto_follows_the_step_size():
    solver, other = auto(), linear.direct().name
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
    monkeypatch.setattr(direct_module, "_mkl_pardiso", _missing)
    solver = auto()
    assert solver.price == pytest.approx(45 + 0.37 * 20)
    assert steps(solver, HARD, 1) == ["superlu"]
    assert solver.price == pytest.approx(100 + 10 * 20)


@needs_pardiso
def test_pardiso_frees_its_memory(monkeypatch):
    phases = []
    call = direct_module._pardiso

    def watched(phase, *args):
        phases.append(phase)
        return call(phase, *args)

    monkeypatch.setattr(direct_module, "_pardiso", watched)
    solver = linear.Pardiso()
    solver.prepare(sheet(m=5))
    solver.prepare(sheet(m=6))
    assert phases == [11, 22, -1, 11, 22]
    del solver
    gc.collect()
    assert phases == [11, 22, -1, 11, 22, -1]


def test_import_does_not_load_the_mkl():
    code = "import sys, fecloth.linear; print('pypardiso' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
