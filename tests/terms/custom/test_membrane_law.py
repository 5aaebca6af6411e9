"""A law that a user writes: studies/examples/law.py, clamped tangents, and what is refused."""

import re

import numpy as np
import pytest
from conftest import affine
from support.examples import example
from support.wrong_calls import linear, mine

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.stability.critical_step import rate_bounds
from fecloth.verify import check_term

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


@pytest.fixture(scope="module")
def own():
    return example("law")


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")


def fung(E, C, strain):
    """W, S (2, 2) of the formula, with sums over the tensors."""
    C11, C22, C66, C12, C16, C26 = C
    T = np.array([[C11 * E[0, 0] + C12 * E[1, 1] + 2 * C16 * E[0, 1], np.nan], [np.nan, np.nan]])
    T[1, 1] = C12 * E[0, 0] + C22 * E[1, 1] + 2 * C26 * E[0, 1]
    T[0, 1] = T[1, 0] = C16 * E[0, 0] + C26 * E[1, 1] + 2 * C66 * E[0, 1]
    c = strain**2 * C11
    grown = np.exp(np.sum(T * E) / c)
    return c / 2 * (grown - 1), grown * T


def test_energy_and_stress_are_those_of_the_formula(own, cloth, orthotropic):
    F = np.array([[1.1, 0.05], [0.0, 0.95], [0.2, 0.1]])
    E = 0.5 * (F.T @ F - np.eye(2))
    W, S = fung(E, orthotropic.moduli(), 0.15)
    system = fc.System(cloth, orthotropic, [own.Fung(0.15)])
    x = affine(cloth, F)
    out = np.zeros((len(cloth.triangles), 4))
    system.bound[0].add_stress(x, out)
    expected = np.tile([S[0, 0], S[1, 1], S[0, 1], W], (len(out), 1))
    np.testing.assert_allclose(out, expected, rtol=1e-11)
    assert system.energies(system.state(x))["Fung"] == pytest.approx(W * 0.12, rel=1e-11)


def test_fung_law_agrees_with_its_formula(own):
    """P₁₁ = λ Y E exp((E/ε)²) with E = (λ² − 1)/2, for ν = 0."""
    lines = re.findall(r"stretch (\S+): +(\S+) N/m, with StVK +(\S+) N/m", own.printed)
    assert len(lines) == 4
    for stretch, force, of_stvk in np.array(lines, dtype=float):
        E = (stretch**2 - 1) / 2
        assert of_stvk == pytest.approx(stretch * 1000 * E, abs=0.06)
        assert force == pytest.approx(stretch * 1000 * E * np.exp((E / 0.2) ** 2), abs=0.06)


class Softening(fc.MembraneLaw):
    """W = Y/2 (E:E − 2 (E:E)²): ℂ has negative eigenvalues from |E| = ½ on, less across."""

    def constants(self, fabric):
        return [fabric.tensile[0]]

    @staticmethod
    def law(E, c):
        I = E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2
        s, d = c[0] * (1 - 4 * I), -8 * c[0]
        C11, C22, C66 = s + d * E[0] ** 2, s + d * E[1] ** 2, s / 2 + d * E[2] ** 2
        C12, C16, C26 = d * E[0] * E[1], d * E[0] * E[2], d * E[1] * E[2]
        W = c[0] * (0.5 * I - I**2)
        return W, (s * E[0], s * E[1], s * E[2]), (C11, C22, C66, C12, C16, C26)


def test_a_definite_tangent_clamps_a_law_that_is_not_convex(cloth, isotropic):
    system = fc.System(cloth, isotropic, [Softening()])
    check_term(Softening(), cloth, isotropic, scales=[1.0])
    state = system.state(affine(cloth, [[1.25, 0.2], [0.0, 1.2], [0.0, 0.0]]))
    J = BlockMatrix.zeros(system.pattern)
    least = {}
    for definite in (False, True):
        A = system.assemble(J, state, wx=1.0, definite=definite).to_scipy().toarray()
        values = np.linalg.eigvalsh(A)
        least[definite] = values[0] / values[-1]
    assert least[False] < -0.1
    assert least[True] > -1e-12


def test_a_law_may_have_no_stiffness_in_shear(cloth, isotropic):
    """Two families of yarns: the bound for ℂ itself, with ℂ = 1000 diag(1, 1, 0)."""

    def yarns(E, c):
        W = 500 * (E[0] ** 2 + E[1] ** 2)
        return W, (1000 * E[0], 1000 * E[1], 0), (1000, 1000, 0, 0, 0, 0)

    system = fc.System(cloth, isotropic, [mine(yarns)])
    stiff = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.0, 1e-6), [fc.StVK()])
    assert rate_bounds(system) == pytest.approx(rate_bounds(stiff), rel=1e-6)


def test_what_numba_does_not_compile_is_told(cloth, isotropic):
    with pytest.raises(fc.InputError, match="^Mine: law: .*'linear'.*must be what"):
        fc.System(cloth, isotropic, [mine(lambda E, c: linear(E, c))])
