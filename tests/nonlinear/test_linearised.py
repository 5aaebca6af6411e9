"""The linear equation of a derivative: corrections, another matrix, GMRES, and no derivative."""

import numpy as np
import pytest

from fecloth.errors import SolveFailed
from fecloth.nonlinear.linearised import NoDerivative, correct


def solve_by(A, b, solvers, known=None, tolerance=1e-9, floor=0.0):
    """Solve A y = b by corrections with the solvers; count their calls."""
    calls = dict.fromkeys(solvers, 0)

    def counted(name, inverse):
        def solve(r):
            calls[name] += 1
            return (inverse @ r.ravel()).reshape(r.shape)

        return lambda: solve

    given = {name: counted(name, inverse) for name, inverse in solvers.items()}
    size_of = np.linalg.norm
    answer = correct(
        lambda y: (A @ y.ravel()).reshape(y.shape) - b,
        np.zeros_like(b), given, known or {}, size_of, tolerance, floor,
    )  # fmt: skip
    return answer, calls


@pytest.fixture
def equation():
    random = np.random.default_rng(1)
    A = np.eye(12) + 0.3 * random.standard_normal((12, 12))
    return A, random.standard_normal((4, 3))


def test_an_exact_matrix_takes_two_corrections_and_one_where_its_contraction_is_known(equation):
    A, b = equation
    exact = np.linalg.inv(A)
    answer, calls = solve_by(A, b, {"exact": exact})
    assert np.allclose(A @ answer.y.ravel(), b.ravel())
    assert calls["exact"] == 2
    assert solve_by(A, b, {"exact": exact}, {"exact": 1e-12})[1]["exact"] == 1


def is_solved(A, b, y, tolerance):
    exact = np.linalg.solve(A, b.ravel())
    return np.linalg.norm(y.ravel() - exact) <= tolerance * np.linalg.norm(exact)


@pytest.mark.parametrize(("part", "is_next_taken"), [(0.1, False), (0.4, False), (0.625, True)])
def test_the_next_matrix_is_taken_where_corrections_shrink_by_less_than_half(
    equation, part, is_next_taken
):
    A, b = equation
    exact = np.linalg.inv(A)
    answer, calls = solve_by(A, b, {"held": exact * (1 - part), "exact": exact}, tolerance=1e-4)
    assert (calls["exact"] > 0) == is_next_taken
    assert answer.contractions["held"] == pytest.approx(part)
    assert is_solved(A, b, answer.y, 1.01e-4)


def test_gmres_solves_what_no_matrix_does(equation):
    A, b = equation
    answer, _ = solve_by(A, b, {"poor": np.eye(12)}, tolerance=1e-8)
    assert np.allclose(A @ answer.y.ravel(), b.ravel(), atol=1e-6)


def test_a_matrix_without_a_factor_is_passed_over(equation):
    A, b = equation

    def fails():
        raise SolveFailed("singular")

    def residual(y):
        return (A @ y.ravel()).reshape(y.shape) - b

    def solve(r):
        return np.linalg.solve(A, r.ravel()).reshape(r.shape)

    zero = np.zeros_like(b)
    answer = correct(
        residual, zero, {"a": fails, "b": lambda: solve}, {}, np.linalg.norm, 1e-9, 0.0
    )
    assert np.allclose(A @ answer.y.ravel(), b.ravel())
    with pytest.raises(NoDerivative, match="no derivative here: the tangent has no factor"):
        correct(residual, zero, {"a": fails}, {}, np.linalg.norm, 1e-9, 0.0)


def test_a_singular_equation_has_no_derivative(equation):
    _, b = equation
    A = np.diag([1.0] * 11 + [0.0])
    with pytest.raises(NoDerivative, match="singular"):
        solve_by(A, b, {"poor": 0.2 * np.eye(12)})


# --- the numbers, from both sides -----------------------------------------------------------------


def corrections_of(sizes, tolerance=0.0):
    """How many corrections of these sizes are made, and whether the next matrix is taken.

    The unknown is of size 1.
    """
    made = []
    next_matrix = []

    def scripted(r):
        made.append(sizes[len(made)])
        return np.array([[made[-1]]])

    def take_next():
        next_matrix.append(True)
        return lambda r: np.zeros((1, 1))

    correct(
        residual=lambda y: y,
        y=np.zeros((1, 1)),
        solvers={"scripted": lambda: scripted, "next": take_next},
        known={},
        size_of=lambda y: 1.0,
        tolerance=tolerance,
        floor=0.0,
    )
    return len(made), bool(next_matrix)


SHRINKING = [0.4**n for n in range(20)]
MILLIONTH = np.array([4.0, 1.2, 1.0]) * 1e-6


@pytest.mark.parametrize(
    ("sizes", "tolerance", "count", "takes_next"),
    [
        (SHRINKING, 0.0, 12, True),  # a matrix makes twelve corrections
        # the first two shrink by less than a fifth, the third no longer: round-off
        ([1.0, 0.8 * 0.2, 0.9 * 0.8 * 0.2], 0.0, 3, False),
        ([1.0, 1.25 * 0.2, 0.9 * 1.25 * 0.2], 0.0, 3, True),
        # corrections of a millionth that no longer shrink are round-off
        (0.8 * MILLIONTH, 0.0, 3, False),
        (1.25 * MILLIONTH, 0.0, 3, True),
        # the first counts as of a contraction of 0.3: 0.3/0.7 of it are left
        ([1.0, 0.0], 0.8 * 0.3 / 0.7, 2, False),
        ([1.0, 0.0], 1.25 * 0.3 / 0.7, 1, False),
    ],
)
def test_how_many_corrections_are_made(sizes, tolerance, count, takes_next):
    assert corrections_of(sizes, tolerance) == (count, takes_next)
