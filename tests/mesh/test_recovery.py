"""Recovery reproduces polynomials on any mesh, apart in each group of triangles."""

import numpy as np
import pytest
from support.plates import PATTERNS, square

from fecloth.mesh.recovery import CONSTANT, LINEAR, QUADRATIC, recovery_gap


def at(cloth, barycentric):
    return np.einsum("qi,tid->tqd", barycentric, cloth.X[cloth.triangles])


def gap_of(cloth, samples, field, group=None):
    """The recovered field minus `field`, whose values at the points are given."""
    group = np.zeros(len(cloth.triangles), int) if group is None else group
    values = field(at(cloth, samples.points))[..., None]
    gap = recovery_gap(cloth.X, cloth.triangles, group, values, samples)[..., 0]
    given = np.einsum("rq,tq->tr", samples.extend, values[..., 0])
    return gap + given - field(at(cloth, samples.rule))


@pytest.mark.parametrize("samples", [CONSTANT, LINEAR, QUADRATIC], ids=["P0", "P1", "P2"])
@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("n", [2, 7])
def test_polynomials_are_reproduced(samples, pattern, n):
    cloth, degree = square(pattern, n), samples.degree
    exact = gap_of(cloth, samples, lambda X: (X[..., 0] + 0.3 * X[..., 1] - 0.4) ** degree)
    beyond = gap_of(cloth, samples, lambda X: (X[..., 0] + 0.3 * X[..., 1]) ** (degree + 1))
    assert np.abs(exact).max() < 1e-12
    assert np.abs(beyond).max() > 1e-5


def test_groups_are_recovered_apart():
    cloth = square("unstructured", 8)
    group = (cloth.X[cloth.triangles].mean(axis=1)[:, 0] > 0.5).astype(int)
    jumps = group[:, None] + at(cloth, CONSTANT.points)[..., 0]
    values = jumps[..., None]
    apart = recovery_gap(cloth.X, cloth.triangles, group, values, CONSTANT)
    across = recovery_gap(cloth.X, cloth.triangles, 0 * group, values, CONSTANT)
    smooth = at(cloth, CONSTANT.rule)[..., 0] - at(cloth, CONSTANT.points)[..., 0]
    assert np.abs(apart[..., 0] - smooth).max() < 1e-12
    assert np.abs(across[..., 0] - smooth).max() > 0.2


def test_one_triangle_takes_what_it_has_for_constant():
    X, triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[0, 1, 2]])
    gap = recovery_gap(X, triangle, np.zeros(1, int), np.full((1, 1, 2), 3.0), CONSTANT)
    assert np.abs(gap).max() < 1e-12
