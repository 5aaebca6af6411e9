"""The two parts of the tangent of a plate, and of a membrane, against their formulas in NumPy."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.bending.dihedral_angle import condition
from fecloth.terms.bending.plate import BoundPlate
from fecloth.terms.loops import green_strain

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3, bending_poisson_ratio=0.2)


@pytest.fixture(scope="module")
def crumpled():
    """A plate with a clamped edge, some of whose angles are beyond a right angle, and x (n, 3)."""
    cloth = fc.Cloth.rectangle(1.0, 0.8, h=0.2, pattern="unstructured")
    pins = [fc.Pin("left", clamp=True)]
    system = fc.System(cloth, FABRIC, [fc.PlateBending()], pins)
    x = system.rest().x + 0.12 * np.random.default_rng(5).normal(size=system.rest().x.shape)
    (term,) = (each for each in system.bound if isinstance(each, BoundPlate))
    return system, term.plate, x


def dense(J):
    return J.to_scipy().toarray()


def scattered(nodes, g, n):
    """(h, 3 n) the gradients g (h, 4, 3) of hinges at all nodes; −1 is no node."""
    G = np.zeros((len(nodes), n + 1, 3))
    for e in range(len(nodes)):
        G[e, nodes[e]] += g[e]
    return G[:, :n].reshape(len(nodes), 3 * n)


def test_the_products_are_those_of_dense_matrices(crumpled):
    system, plate, x = crumpled
    left, right = np.random.default_rng(6).normal(size=(2, len(plate.nodes), 4, 3))
    assert (plate.nodes < 0).any()
    J = BlockMatrix.zeros(system.pattern)
    plate.add_products(left, right, 0.7, J)
    plate.add_products(right, left, 0.3, J, entries=2.0 * plate.stiffness.data)
    Q = plate.stiffness.toarray()
    L, R = (scattered(plate.nodes, g, len(x)) for g in (left, right))
    expected = 0.7 * L.T @ Q @ R + 0.6 * R.T @ Q @ L
    np.testing.assert_allclose(dense(J), expected, rtol=0, atol=1e-14 * abs(expected).max())


def second_derivatives(y):
    """∂²μ/∂x∂x (4, 3, 4, 3) of a hinge with the positions y (4, 3), and whether μ is not θ."""
    theta, g, H = np.empty(1), np.empty((1, 4, 3)), np.empty((1, 4, 3, 4, 3))
    condition(y, np.zeros(1), 2, theta, g, H)
    beyond = abs(theta[0]) - np.pi / 2
    if beyond <= 0:
        return H[0], False
    t = np.tan(beyond)  # μ = ±(π/2 + t)
    slope, bend = 1 + t**2, np.sign(theta[0]) * 2 * t * (1 + t**2)
    return slope * H[0] + bend * np.multiply.outer(g[0], g[0]), True


def test_the_curvatures_are_the_second_derivatives_of_all_angles(crumpled):
    system, plate, x = crumpled
    moment = np.random.default_rng(7).normal(size=len(plate.nodes))
    J = BlockMatrix.zeros(system.pattern)
    plate.add_curvatures(x, 0.0, moment, 0.7, J)
    first = len(plate.nodes) - len(plate.held)
    n = len(x)
    expected = np.zeros((n + 1, 3, n + 1, 3))
    folded = 0
    for e, nodes in enumerate(plate.nodes):
        y = x[nodes].copy()
        if nodes[3] < 0:
            y[3] = plate.held[e - first]
        H, beyond = second_derivatives(y)
        folded += beyond
        for i, node in enumerate(nodes):
            for j, other in enumerate(nodes):
                expected[node, :, other] += 0.7 * moment[e] * H[i, :, j]
    assert 3 < folded < len(plate.nodes) - 3
    expected = expected[:n, :, :n].reshape(3 * n, 3 * n)
    np.testing.assert_allclose(dense(J), expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_the_blocks_of_a_membrane_are_those_of_its_formula():
    """B_aᵀ ℂ B_b(H) + (G_a · S G_b) I₃, with H = F in the symmetric loop."""
    rng = np.random.default_rng(8)
    G, F, H, S = (
        rng.normal(size=(1, 1, 3, 2)),
        rng.normal(size=6),
        rng.normal(size=6),
        (3.0, 1.0, 0.5),
    )
    C = (5.0, 7.0, 2.0, 1.5, 0.3, 0.6)  # C11, C22, C66, C12, C16, C26
    moduli = np.array([[5.0, 1.5, 0.3], [1.5, 7.0, 0.6], [0.3, 0.6, 2.0]])
    stress = np.array([[3.0, 0.5], [0.5, 1.0]])
    slots = np.arange(9).reshape(1, 3, 3)

    def B(a, columns):
        g1, g2 = G[0, 0, a]
        first, second = columns[:3], columns[3:]
        return np.array([first * g1, second * g2, first * g2 + second * g1])

    for right, scatter in ((F, green_strain.scatter_symmetric), (H, green_strain.scatter_mixed)):
        numbers = np.ones(81)
        shape = (0, 0, 0), slots, G, 0, 0, 0.7, 1.3, tuple(F)
        shape += () if scatter is green_strain.scatter_symmetric else (tuple(H),)
        scatter(*shape, S, C, numbers)
        for a in range(3):
            for b in range(3):
                geometric = 0.7 * (G[0, 0, a] @ stress @ G[0, 0, b]) * np.eye(3)
                block = 1.3 * B(a, F).T @ moduli @ B(b, right) + geometric
                got = numbers.reshape(9, 3, 3)[slots[0, a, b]]
                np.testing.assert_allclose(got, 1.0 + block, rtol=1e-12, atol=1e-12)
