"""Neo-Hookean membranes: closed forms in uniform states, convexity and its limit."""

import numpy as np
import pytest
from conftest import affine

import fecloth as fc
from fecloth.terms.membranes import neo_hookean

RUBBER = fc.Fabric(0.2, 900.0, 0.3)
LAWS = [fc.NeoHookean(), fc.NeoHookean("compressible")]
EXACT = {"incompressible": neo_hookean.incompressible, "compressible": neo_hookean.compressible}
names = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.kind)


def stress_of(law, C, mu, lam):
    """S and W from C alone, by the textbook's formulas."""
    J, inverse = np.sqrt(np.linalg.det(C)), np.linalg.inv(C)
    if law.kind == "incompressible":
        return mu * (np.eye(2) - inverse / J**2), mu / 2 * (np.trace(C) + J**-2 - 3)
    W = mu / 2 * (np.trace(C) - 2) - mu * np.log(J) + lam / 2 * np.log(J) ** 2
    return mu * (np.eye(2) - inverse) + lam * np.log(J) * inverse, W


def constants(law):
    """μ and λ of RUBBER, from its Y = 900 N/m and ν = 0.3."""
    if law.kind == "incompressible":
        return 300.0, None
    return 900.0 / 2.6, 900.0 * 0.3 / 0.91


def matrix(C):
    C11, C22, C66, C12, C16, C26 = C
    return np.array([[C11, C12, C16], [C12, C22, C26], [C16, C26, C66]])


def test_incompressible_is_convex_in_E(rng):
    for _ in range(300):
        F = rng.standard_normal((3, 2)) * rng.uniform(0.3, 2.0)
        E = 0.5 * (F.T @ F - np.eye(2))
        C = EXACT["incompressible"]((E[0, 0], E[1, 1], E[0, 1]), np.array([300.0]))[2]
        assert np.linalg.eigvalsh(matrix(C))[0] > 0


def test_compressible_is_convex_up_to_its_limit_and_made_so_beyond(rng):
    """ln J = μ/λ is where the least eigenvalue of ℂ changes sign; only beyond is ℂ changed."""
    mu, lam = constants(LAWS[1])
    c = np.array([mu, lam])
    assert np.exp(mu / lam) == pytest.approx(3.2, rel=0.01)
    for sign, log_J in ((1, 0.999 * mu / lam), (-1, 1.001 * mu / lam), (1, -2.0), (-1, 3.0)):
        for _ in range(20):
            C = rng.standard_normal((2, 2))
            C = C @ C.T + 0.1 * np.eye(2)
            C *= np.exp(log_J) / np.sqrt(np.linalg.det(C))
            E = tuple(np.array([C[0, 0] - 1, C[1, 1] - 1, C[0, 1]]) / 2)
            W, S, exact = neo_hookean.compressible(E, c)
            assert np.sign(np.linalg.eigvalsh(matrix(exact))[0]) == sign
            same_W, same_S, made = neo_hookean.convex_compressible(E, c)
            assert (same_W, same_S) == (W, S)
            if sign > 0:
                np.testing.assert_allclose(made, exact, rtol=1e-12)
                continue
            # independent: eigenvalues in the metric of C, that is of LᵀℂL with C = L Lᵀ
            L = np.linalg.cholesky(C)
            basis = [L @ np.array(b) @ L.T for b in ([[1, 0], [0, 0]], [[0, 0], [0, 1]])]
            basis.append(L @ np.array([[0, 1], [1, 0]]) @ L.T / np.sqrt(2))
            V = np.array([[b[0, 0], b[1, 1], 2 * b[0, 1]] for b in basis])
            value, vector = np.linalg.eigh(V @ matrix(exact) @ V.T)
            expected = vector @ np.diag(np.maximum(value, 0)) @ vector.T
            scale = abs(value).max()
            np.testing.assert_allclose(V @ matrix(made) @ V.T, expected, atol=1e-10 * scale)


@names
def test_uniaxial_tension_has_the_tensile_stiffness(law):
    """The lateral stretch that frees the sides: force per width and strain go to Y = 900 N/m."""
    from scipy.optimize import brentq

    def sides(w, e):
        return stress_of(law, np.diag([(1 + e) ** 2, w**2]), *constants(law))[0][1, 1]

    for e in (1e-4, 1e-5):
        w = brentq(sides, 0.9, 1.1, args=(e,), xtol=1e-15)
        S, _ = stress_of(law, np.diag([(1 + e) ** 2, w**2]), *constants(law))
        assert (1 + e) * S[0, 0] / e == pytest.approx(900.0, rel=3 * e)
        if law.kind == "incompressible":  # Treloar: μ (λ − 1/λ²), and the width is λ^(−1/2)
            assert (1 + e) * S[0, 0] == pytest.approx(300 * (1 + e - (1 + e) ** -2), rel=1e-8)
            assert w == pytest.approx((1 + e) ** -0.5, rel=1e-12)


@names
def test_resists_collapse_where_stvk_gives_way(law, sheet):
    """Compressed along the warp: the force of StVK falls to nothing, this one grows like 1/s."""

    def pushes(term, s):
        system = fc.System(sheet, RUBBER, [term])
        out = np.zeros((len(sheet.triangles), 4))
        system.bound[0].add_stress(affine(sheet, [[s, 0], [0, 1], [0, 0]]), out)
        return -s * out[0, 0]  # first Piola–Kirchhoff

    assert pushes(fc.StVK(), 0.01) < 0.1 * pushes(fc.StVK(), 0.5)
    assert pushes(law, 1e-2) > 5 * pushes(law, 1e-1) > 5 * pushes(law, 0.5)
