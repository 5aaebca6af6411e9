"""The isometric quadratic form against hinges and cotangents."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.terms.bending.hinge import hinge_stiffness

PATTERNS = ["unstructured", "right", "cross", "equilateral"]
FABRIC = fc.Fabric(0.15, (2000.0, 900.0), 0.2, 60.0, bending_rigidity=(4e-5, 1e-5))


def system_of(cloth, term, fabric=FABRIC):
    return fc.System(cloth, fabric, [term], grain=0.3)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_is_the_linearisation_of_hinge_bending_at_flat(pattern):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.1, pattern=pattern)
    hinge, quadratic = (system_of(cloth, t) for t in (fc.HingeBending(), fc.QuadraticBending()))
    K = hinge.stiffness(hinge.rest()).toarray()
    Q = quadratic.stiffness(quadratic.rest()).toarray()
    across = slice(2, None, 3)
    size = abs(K).max()
    np.testing.assert_allclose(Q[across, across], K[across, across], atol=1e-10 * size)
    in_plane = np.delete(K, np.s_[2::3], axis=0)
    assert abs(in_plane).max() < 1e-12 * size  # and a hinge at flat has no other stiffness


def test_is_the_form_of_the_paper(sheet):
    """Q(e) = 3/(A₁ + A₂) K₀ᵀK₀ with K₀ of the cotangents at the edge's ends, for B = 3 N m."""
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=3.0)
    system = fc.System(sheet, fabric, [fc.QuadraticBending()])
    hinges, X = sheet.hinges, sheet.X
    expected = np.zeros((len(X), len(X)))

    def cotangent(corner, p, q):
        u, w = X[p] - X[corner], X[q] - X[corner]
        return u @ w / abs(u[0] * w[1] - u[1] * w[0])

    for nodes, area in zip(hinges.nodes, hinges.area, strict=True):
        p, q, left, right = nodes
        c1, c2 = cotangent(p, q, left), cotangent(p, q, right)
        c3, c4 = cotangent(q, p, left), cotangent(q, p, right)
        K0 = np.array([c3 + c4, c1 + c2, -c1 - c3, -c2 - c4])
        expected[np.ix_(nodes, nodes)] += 3 / area * np.outer(K0, K0)
    Q = system.bound[0].matrix.toarray()
    np.testing.assert_allclose(Q, expected, atol=1e-12 * abs(Q).max())
    J = system.stiffness(system.rest()).toarray()
    np.testing.assert_allclose(J, np.kron(Q, np.eye(3)), atol=1e-12 * abs(Q).max())


@pytest.mark.parametrize("fold", [0.01, 0.5, 2.0, np.pi])
def test_energy_of_a_rigid_fold(fold):
    X = np.array([[0.0, -0.1], [0.0, 0.2], [-0.3, 0.0], [0.4, 0.1]])
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2], [1, 0, 3]], renumber=False)
    x = flat(cloth)
    x[3] = [0.4 * np.cos(fold), 0.1, 0.4 * np.sin(fold)]
    system = system_of(cloth, fc.QuadraticBending())
    k = hinge_stiffness(system.panel, "")[0]
    energy = system.energies(system.state(x))["QuadraticBending"]
    assert energy == pytest.approx(2 * k * np.sin(0.5 * fold) ** 2, rel=1e-11)
