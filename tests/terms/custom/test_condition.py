"""The condition loop and a user's own condition: against dense formulas, springs, closed forms."""

import numpy as np
import pytest
from conftest import rough
from support.wrong_calls import squared

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.springs.networks import edges

FABRIC = fc.Fabric(0.2, 1000.0)


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(0.3, 0.2, h=0.1, pattern="cross")


def dense(system, state, wx=0.0, wv=0.0, definite=False):
    J = BlockMatrix.zeros(system.pattern)
    return system.assemble(J, state, wx=wx, wv=wv, definite=definite).to_scipy().toarray()


# --- a vector condition in closed form: C = (y₁ − y₀)·A (y₁ − y₀) with two matrices -------------

A = np.array([[[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 0.5]], np.diag([-1.0, 1.0, 0.4])])


def quadratic(y):
    d = y[:, 1] - y[:, 0]
    return np.einsum("mi,rij,mj->mr", d, A, d)


def quadratic_gradient(y):
    g = 2 * np.einsum("rij,mj->mri", A, y[:, 1] - y[:, 0])
    return np.stack([-g, g], axis=2)


def quadratic_hessian(y):
    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])
    H = 2 * np.einsum("ab,rij->raibj", sign, A)
    return np.broadcast_to(H, (len(y), *H.shape))


def vector(cloth, **options):
    nodes = edges(cloth).nodes[::3]
    m = len(nodes)
    k = np.column_stack([np.linspace(1.0, 2.0, m), np.linspace(30.0, 10.0, m)])
    given = {"gradient": quadratic_gradient, "hessian": quadratic_hessian} | options
    return fc.Condition(quadratic, nodes, k, 0.1 * k[:, ::-1], **given)


def test_operators_are_their_formulas(small, rng):
    """Energy, force, K and D, each stencil by itself with dense matrices (eqs. 6–8, 11–13)."""
    term = vector(small, tangent="exact")
    system = fc.System(small, FABRIC, [term])
    x, v = rough(small, rng), rng.standard_normal((len(small.X), 3))
    n = x.size
    energy, force, K, D = 0.0, np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    dropped, geometric = np.zeros((n, n)), np.zeros((n, n))
    for e, nodes in enumerate(term.nodes):
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        y, u = x[nodes][None], v[nodes].ravel()
        C, g = quadratic(y)[0], quadratic_gradient(y)[0].reshape(2, 6)
        H = quadratic_hessian(y)[0].reshape(2, 6, 6)
        ks, kd = np.diag(term.stiffness[e]), np.diag(term.damping[e])
        rate = g @ u
        energy += 0.5 * C @ ks @ C
        force[dofs] -= g.T @ (ks @ C + kd @ rate)
        at = np.ix_(dofs, dofs)
        K[at] += g.T @ ks @ g
        geometric[at] += np.einsum("r,rij->ij", ks @ C + kd @ rate, H)
        dropped[at] += g.T @ kd @ (H @ u)
        D[at] += g.T @ kd @ g
    state = system.state(x, v)
    assert system.energies(state)["Condition"] == pytest.approx(energy, rel=1e-13)
    np.testing.assert_allclose(system.force(state).ravel(), force, atol=1e-12 * abs(force).max())
    scale = 1e-12 * abs(K).max()
    np.testing.assert_allclose(
        system.stiffness(state).toarray(), K + geometric + dropped, atol=scale
    )
    np.testing.assert_allclose(system.damping(state).toarray(), D, atol=scale)
    plain = fc.System(small, FABRIC, [vector(small)])
    np.testing.assert_allclose(plain.stiffness(state).toarray(), K + geometric, atol=scale)
    newton = fc.System(small, FABRIC, [vector(small, gauss_newton=True)])
    np.testing.assert_allclose(newton.stiffness(state).toarray(), K, atol=scale)
    power = system.bound[0].power(x, v, 0.0)
    assert power == pytest.approx(v.ravel() @ D @ v.ravel(), rel=1e-12)
    assert (plain.symmetric, system.symmetric) == (True, False)


def test_definite_tangent_drops_the_documented_parts(small, rng):
    """With an indefinite ∂²C all of that part goes; with a convex one only where C is negative."""
    x = rough(small, rng, 0.05)
    state = fc.System(small, FABRIC, [vector(small)]).state(x)
    exact, none = (
        fc.System(small, FABRIC, [vector(small, gauss_newton=flag)]) for flag in (False, True)
    )
    definite = dense(exact, state, wx=1.0, definite=True)
    np.testing.assert_allclose(
        definite, dense(none, state, wx=1.0), atol=1e-13 * abs(definite).max()
    )
    nodes = edges(small).nodes
    L = np.linalg.norm(x[nodes[:, 1]] - x[nodes[:, 0]], axis=1)

    def length(y):
        return np.linalg.norm(y[:, 1] - y[:, 0], axis=1) - L * np.where(
            np.arange(len(L)) % 2, 1.2, 0.8
        )

    half = fc.System(small, FABRIC, [fc.Condition(length, nodes, 100.0, convex=True)])
    taut = np.where(np.arange(len(L)) % 2, 0.0, 100.0)
    pull = fc.Condition(length, nodes, taut)
    push = fc.Condition(length, nodes, 100.0 - taut, gauss_newton=True)
    expected = dense(fc.System(small, FABRIC, [pull, push]), state, wx=1.0)
    got = dense(half, state, wx=1.0, definite=True)
    np.testing.assert_allclose(got, expected, atol=1e-7 * abs(expected).max())
    assert np.linalg.eigvalsh(got)[0] > -1e-8 * abs(got).max()


# --- derivatives that are not given ---------------------------------------------------------------


def test_computed_derivatives_are_as_good_as_stated(sheet, rng):
    """A spring from its length alone, and from length and gradient, against `Springs`."""
    nodes = edges(sheet).nodes
    rest = np.linalg.norm(sheet.X[nodes[:, 1]] - sheet.X[nodes[:, 0]], axis=1)

    def length(y):
        return np.linalg.norm(y[:, 1] - y[:, 0], axis=1) - rest

    def direction(y):
        d = y[:, 1] - y[:, 0]
        n = d / np.linalg.norm(d, axis=1, keepdims=True)
        return np.stack([-n, n], axis=1)

    k = 70.0
    springs = fc.System(sheet, FABRIC, [fc.Springs(stiffness=k, damping=0.02, tangent="exact")])
    state = springs.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)))
    force, K = springs.force(state), springs.stiffness(state)
    for gradient, first, second in ((None, 1e-10, 1e-7), (direction, 1e-14, 1e-10)):
        own = fc.Condition(length, nodes, k, 0.02 * k, gradient=gradient, tangent="exact")
        system = fc.System(sheet, FABRIC, [own])
        assert abs(system.force(state) - force).max() < first * abs(force).max()
        assert abs(system.stiffness(state) - K).max() < second * abs(K).max()


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ({"wrong": 1.001}, r"gradient\[3, 0, 1, 2\] = .*differences of value give"),
        ({"sign": -1.0}, r"hessian\[.*differences of the gradient give"),
    ],
)
def test_a_wrong_derivative_is_refused(mistake, said, small):
    with pytest.raises(fc.InputError, match=said):
        fc.System(small, FABRIC, [squared(**mistake)])


def test_pure_damper(small, rng):
    """k_s = 0: no energy, only dissipation."""
    nodes = edges(small).nodes
    term = fc.Condition(quadratic, nodes, 0.0, 3.0, gradient=quadratic_gradient)
    system = fc.System(small, FABRIC, [term])
    bound = system.bound[0]
    assert (bound.has_energy, bound.dissipative) == (False, True)
    state = system.state(rough(small, rng), rng.standard_normal((len(small.X), 3)))
    power = bound.power(state.x, state.v, 0.0)
    assert power == pytest.approx(-np.vdot(system.force(state), state.v), rel=1e-12)
    assert "Condition" not in system.energies(state)


@pytest.mark.stories
def test_cable_across_a_hanging_cloth():
    """Hung from one corner, a stiff cable along the diagonal keeps its length, a cloth does not.

    It is one stencil of all nodes of the diagonal, through which it runs as through rings.

    The ledger books what the cable holds and what it dissipates, and closes.
    """
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    diagonal = cloth.nodes(lambda X: abs(X[:, 0] - X[:, 1]) < 1e-9)
    diagonal = diagonal[np.argsort(cloth.X[diagonal, 0])]

    def longer(y):
        return np.linalg.norm(np.diff(y, axis=1), axis=2).sum(axis=1) - np.sqrt(2.0)

    term = fc.Condition(longer, [diagonal], 1e4, damping=20.0, convex=True, name="cable")
    corner = fc.Pin([int(diagonal[-1])])
    down = (-9.81 / 2**0.5, -9.81 / 2**0.5, 0.0)
    lengths = []
    for extra in ([], [term]):
        terms = [fc.StVK(), fc.Gravity(down), *extra]
        system = fc.System(cloth, fc.Fabric(0.2, 20.0), terms, pins=[corner])
        result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=0.005, t_end=0.2)
        sides = np.diff(result.state.x[diagonal], axis=0)
        lengths.append(np.linalg.norm(sides, axis=1).sum() / 2**0.5)
    assert lengths[0] > 1.05
    assert abs(lengths[1] - 1) < 1e-3
    energies = result.energies
    assert energies["dissipated:cable"][-1] > 0.0
    assert energies["cable"][-1] == pytest.approx(0.5e4 * 2 * (lengths[1] - 1) ** 2, rel=1e-9)
    assert abs(energies["remainder"][-1]) < 1e-3 * energies["kinetic"].max()
