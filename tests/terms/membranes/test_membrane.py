"""The compiled membrane loop against scikit-fem forms and closed forms."""

import numpy as np
import pytest
from conftest import affine, rough
from support import oracle
from support.tiers import in_turn

import fecloth as fc
from fecloth.terms.kinematics import deformation_gradient
from fecloth.terms.loops.green_strain import clamp

LAWS = [fc.StVK(), fc.TensorCondition(250.0)]
PATTERNS = ["unstructured", "right", "cross", "equilateral"]


def relative(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_meets_the_scikit_fem_forms(law, sheet, orthotropic, rng):
    system = fc.System(sheet, orthotropic, [law])
    state = system.state(rough(sheet, rng))
    moduli = law.moduli(orthotropic)
    energy = system.energies(state)[type(law).__name__]
    assert energy == pytest.approx(oracle.energy(sheet, moduli, state.x), rel=1e-12)
    assert relative(system.force(state), oracle.force(sheet, moduli, state.x)) < 1e-12
    difference = system.stiffness(state) - oracle.stiffness(sheet, moduli, state.x)
    assert abs(difference).max() < 1e-12 * abs(system.stiffness(state)).max()


def test_tensor_condition_energy_is_its_definition(sheet, rng):
    k, x = 250.0, rough(sheet, rng)
    F = deformation_gradient(sheet, x)[:, 0]
    C = np.swapaxes(F, 1, 2) @ F - np.eye(2)
    expected = np.sum(0.5 * k * np.sum(C * C, axis=(1, 2)) * sheet.weights[:, 0])
    system = fc.System(sheet, fc.Fabric(0.2, 1.0), [fc.TensorCondition(k)])
    assert system.energies(system.state(x))["TensorCondition"] == pytest.approx(expected, rel=1e-13)


UNIFORM = {
    "biaxial": [[1.1, 0.0], [0.0, 1.2], [0.0, 0.0]],
    "uniaxial": [[1.3, 0.0], [0.0, 1.0], [0.0, 0.0]],
    "simple shear": [[1.0, 0.4], [0.0, 1.0], [0.0, 0.0]],
    "turned": [[0.0, -1.1], [0.0, 0.2], [1.05, 0.1]],
}


@pytest.mark.parametrize(("pattern", "name"), in_turn(PATTERNS, list(UNIFORM)))
def test_uniform_states(pattern, name, orthotropic):
    """Stress and energy of a homogeneous state, from the definitions, on any mesh."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.17, pattern=pattern)
    F = np.array(UNIFORM[name])
    system = fc.System(cloth, orthotropic, [fc.StVK()])
    x = affine(cloth, F, (0.3, -0.2, 0.5))
    E = 0.5 * (F.T @ F - np.eye(2))
    warp, weft = orthotropic.tensile
    nu12, nu21 = 0.2, 0.2 * weft / warp
    S11 = (warp * E[0, 0] + nu21 * warp * E[1, 1]) / (1 - nu12 * nu21)
    S22 = (weft * E[1, 1] + nu12 * weft * E[0, 0]) / (1 - nu12 * nu21)
    S12 = 2 * 60.0 * E[0, 1]
    W = 0.5 * (S11 * E[0, 0] + S22 * E[1, 1] + 2 * S12 * E[0, 1])
    out = np.zeros((len(cloth.triangles), 4))
    system.bound[0].add_stress(x, out)
    scale = max(abs(S11), abs(S22), abs(S12))
    np.testing.assert_allclose(
        out[:, :3], np.tile([S11, S22, S12], (len(out), 1)), atol=1e-12 * scale
    )
    assert system.energies(system.state(x))["StVK"] == pytest.approx(W * 0.5, rel=1e-12)
    inner = np.ones(len(cloth.X), bool)
    inner[cloth.nodes("boundary")] = False
    force = system.force(system.state(x))
    assert abs(force[inner]).max() < 1e-12 * scale  # in equilibrium inside


def test_clamp_keeps_the_tensile_part(rng):
    for _ in range(50):
        S = rng.standard_normal((2, 2))
        S = S + S.T
        value, vector = np.linalg.eigh(S)
        expected = vector @ np.diag(np.maximum(value, 0)) @ vector.T
        got = clamp((S[0, 0], S[1, 1], S[0, 1]))
        np.testing.assert_allclose(got, expected[[0, 1, 0], [0, 1, 1]], atol=1e-14)
