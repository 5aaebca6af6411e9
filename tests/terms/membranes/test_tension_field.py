"""The relaxed membrane: its minimum, its three states, and the boundaries between them."""

import numpy as np
import pytest
from conftest import affine
from scipy.optimize import minimize

import fecloth as fc
from fecloth.terms.membranes.tension_field import law

Y, NU = 1000.0, 0.3
C = np.array([Y, NU])
STATES = {
    "taut": ([0.4, 0.3], [0.2, -0.05]),
    "wrinkled": ([0.4, -0.13], [0.3, -0.3], [0.01, -0.45]),
    "slack": ([-0.1, -0.2], [-0.01, -0.4]),
}


def turned(E1, E2, angle):
    """(E11, E22, E12) of principal strains at an angle."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    E = R @ np.diag([E1, E2]) @ R.T
    return E[0, 0], E[1, 1], E[0, 1]


def stvk(E):
    factor = Y / (2 * (1 - NU**2))
    return factor * (E[0] ** 2 + E[1] ** 2 + 2 * NU * E[0] * E[1] + 2 * (1 - NU) * E[2] ** 2)


@pytest.mark.parametrize("name", STATES)
def test_energy_is_the_least_that_wrinkles_leave(name):
    """W(E) = min over A = B Bᵀ of the energy of StVK at E + A, found by a general minimiser."""
    for E1, E2 in STATES[name]:
        E = np.array(turned(E1, E2, 0.7))

        def relaxed(b, E=E):
            B = np.array([[b[0], 0.0], [b[1], b[2]]])
            A = B @ B.T
            return stvk(E + [A[0, 0], A[1, 1], A[0, 1]])

        starts = ([0.3, 0.1, 0.3], [0.5, -0.3, 0.1], [0.01, 0.0, 0.02])
        options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000, "maxfev": 4000}
        least = min(minimize(relaxed, s, method="Nelder-Mead", options=options).fun for s in starts)
        assert law(tuple(E), C)[0] == pytest.approx(least, rel=1e-7, abs=1e-7)


def test_the_states():
    """Taut is StVK, wrinkled is a bundle of threads along E₁, slack is nothing."""
    for E1, E2 in STATES["taut"]:
        W, S, _ = law(turned(E1, E2, 0.3), C)
        assert pytest.approx(stvk(turned(E1, E2, 0.3))) == W
        stress = np.linalg.eigvalsh([[S[0], S[2]], [S[2], S[1]]])
        np.testing.assert_allclose(stress, Y / (1 - NU**2) * np.array([E2 + NU * E1, E1 + NU * E2]))
    for E1, E2 in STATES["wrinkled"]:
        W, S, _ = law(turned(E1, E2, 0.3), C)
        assert pytest.approx(0.5 * Y * E1**2) == W
        n = np.array([np.cos(0.3), np.sin(0.3)])
        np.testing.assert_allclose([[S[0], S[2]], [S[2], S[1]]], Y * E1 * np.outer(n, n), 1e-12)
    for E1, E2 in STATES["slack"]:
        assert law(turned(E1, E2, 0.3), C) == (0.0, (0.0,) * 3, (0.0,) * 6)


def test_stress_is_monotone_and_tensile(rng):
    """W is convex in E: (S − S′):(E − E′) ≥ 0 for any two strains, in whatever states."""
    seen = set()
    for _ in range(3000):
        a, b = (turned(*rng.uniform(-0.5, 0.5, 2), rng.uniform(0, np.pi)) for _ in range(2))
        (_, S, D), (_, T, _) = law(a, C), law(b, C)
        assert np.subtract(S, T) @ (np.subtract(a, b) * [1, 1, 2]) >= -1e-10
        assert np.linalg.eigvalsh([[S[0], S[2]], [S[2], S[1]]])[0] > -1e-10 * Y
        M = np.array([[D[0], D[3], D[4]], [D[3], D[1], D[5]], [D[4], D[5], D[2]]])
        assert np.linalg.eigvalsh(M)[0] > -1e-10 * Y
        seen.add(np.linalg.matrix_rank(M, tol=1e-6))
    assert seen == {0, 2, 3}


# --- which laws agree at rest ---------------------------------------------------------------------


def secant(term, fabric, F):
    """S11, S22, S12 at F − rest, by the bound term's own stress, over the strain."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.7, pattern="right")
    out = np.zeros((len(cloth.triangles), 4))
    fc.System(cloth, fabric, [term]).bound[0].add_stress(affine(cloth, F), out)
    return out[0]


def rest_moduli(term, fabric):
    """(C11, C22, C66, C12) by central differences of the stress about a rotated rest, and the
    largest of the others; only from strains in tension where `term` is relaxed."""
    h, base = 1e-6, 1e-3 if isinstance(term, fc.TensionField) else 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))

    def stress(e11, e22, e12):
        E = np.array([[base + e11, e12], [e12, base + e22]])
        root = np.linalg.cholesky(np.eye(2) + 2 * E).T
        return secant(term, fabric, turn[:, :2] @ root)[:3]

    steps = ([h, 0, 0], [0, h, 0], [0, 0, h / 2])
    rows = np.array(
        [(stress(*s) - stress(*np.negative(s))) / (2 * h) for s in map(np.array, steps)]
    )
    return rows


MATCHED = {  # ν at which each is asked to agree with StVK of the same fabric
    "compressible neo-Hookean": (fc.NeoHookean("compressible"), (0.0, 0.3, 0.45)),
    "incompressible neo-Hookean": (fc.NeoHookean(), (0.5,)),
    "relaxed StVK in tension": (fc.TensionField(), (-0.3, 0.0, 0.3, 0.5)),
    "deformation tensor": (fc.TensorCondition(Y / 4), (0.0,)),
    "Baraff and Witkin": (fc.BaraffWitkin(), (0.0,)),
}


@pytest.mark.parametrize("name", MATCHED)
def test_laws_that_agree_to_second_order_at_rest(name):
    """ℂ at a rotation: uniaxial, biaxial and shear moduli of the fabric, for these ν."""
    term, ratios = MATCHED[name]
    for nu in ratios:
        fabric = fc.Fabric(0.2, Y, nu)
        rows = rest_moduli(term, fabric)
        C11 = Y / (1 - nu**2)
        expected = [[C11, nu * C11, 0], [nu * C11, C11, 0], [0, 0, Y / (2 * (1 + nu))]]
        np.testing.assert_allclose(rows, expected, atol=1e-5 * Y)
        np.testing.assert_allclose(
            term.moduli(fabric)[[0, 3, 2]], [C11, nu * C11, rows[2, 2]], 1e-5
        )
        compliance = np.linalg.inv(rows)
        assert 1 / compliance[0, 0] == pytest.approx(Y, rel=1e-5)  # uniaxial
        assert rows[0, 0] + rows[0, 1] == pytest.approx(Y / (1 - nu), rel=1e-5)  # biaxial


def test_energy_is_C1_across_the_boundaries(rng):
    """Along lines through a boundary, W is continuous and S has no jump; ℂ has one."""
    for E1, E2 in ((0.3, -NU * 0.3), (0.05, -NU * 0.05), (0.0, -0.2), (0.0, -0.01)):
        E = np.array(turned(E1, E2, rng.uniform(0, np.pi)))
        direction = rng.standard_normal(3)
        ends = [law(tuple(E + s * direction), C) for s in (-1e-9, 1e-9)]
        assert abs(ends[0][0] - ends[1][0]) < 1e-5  # of a slope of a few hundred: 1e-6
        assert np.abs(np.subtract(ends[0][1], ends[1][1])).max() < 1e-5
        assert np.abs(np.subtract(ends[0][2], ends[1][2])).max() > 10.0  # so the line did cross
        # and the slope of W on either side is S, seen from far enough to be above round-off
        engineering = direction * [1, 1, 2]
        for side in (-1, 1):
            h = side * 1e-5
            slope = (law(tuple(E + h * direction), C)[0] - law(tuple(E), C)[0]) / h
            assert slope == pytest.approx(law(tuple(E), C)[1] @ engineering, abs=0.1)
