"""The compiled membrane loop against scikit-fem forms and closed forms."""

import numpy as np
import pytest
from conftest import affine
from support import oracle
from support.tiers import in_turn

import fecloth as fc
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.loops.green_strain import clamp
from fecloth.terms.traits import traits_of
from fecloth.verify import trial_states

PATTERNS = ["unstructured", "right", "cross", "equilateral"]
FORMS = [
    ("P1", fc.StVK(), "interpolated"),
    ("P1", fc.TensorCondition(250.0), "interpolated"),
    ("P2", fc.StVK(strain="pointwise"), "pointwise"),
]


@pytest.mark.parametrize("number", range(3), ids=["random", "compressed", "nearly degenerate"])
@pytest.mark.parametrize(("element", "law", "strain"), FORMS)
def test_meets_the_scikit_fem_forms(element, law, strain, number, orthotropic):
    """So does the damping of the strain rate by the moduli of the law."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1, element=element)
    system = fc.System(cloth, orthotropic, [law])
    _, x, v = trial_states(cloth)[number]
    state, C = system.state(x, v), law.moduli(orthotropic)
    energy = system.energies(state)[type(law).__name__]
    assert energy == pytest.approx(oracle.energy(cloth, C, x), rel=1e-12)
    damping = fc.System(cloth, orthotropic, [fc.StrainRateDamping(0.02, law, strain=strain)])
    for ours, form in (
        (system.force(state), oracle.force(cloth, C, x)),
        (system.stiffness(state).toarray(), oracle.stiffness(cloth, C, x).toarray()),
        (damping.force(state), oracle.viscous_force(cloth, 0.02 * C, x, v)),
    ):
        assert np.abs(ours - form).max() < 1e-12 * np.abs(form).max()


# --- uniform states -------------------------------------------------------------------------------

UNIFORM = {
    "biaxial": [[1.1, 0.0], [0.0, 1.2], [0.0, 0.0]],
    "uniaxial": [[1.3, 0.0], [0.0, 1.0], [0.0, 0.0]],
    "simple shear": [[1.0, 0.4], [0.0, 1.0], [0.0, 0.0]],
    "turned": [[0.0, -1.1], [0.0, 0.2], [1.05, 0.1]],
    "oblique": [[1.3, 0.2], [0.1, 0.8], [0.0, 0.3]],
    "squeezed": [[0.2, 0.0], [0.0, 2.0], [0.0, 0.0]],
}
DENSITIES = {  # W from C = FᵀF in the axes of the material
    fc.StVK(): lambda C: stvk((C - np.eye(2)) / 2),
    fc.TensorCondition(250.0): lambda C: 125.0 * np.sum((C - np.eye(2)) ** 2),
    fc.BaraffWitkin(): lambda C: (
        0.5
        * (
            2000.0 * (np.sqrt(C[0, 0]) - 1) ** 2
            + 900.0 * (np.sqrt(C[1, 1]) - 1) ** 2
            + 60.0 * C[0, 1] ** 2
        )
    ),
    fc.NeoHookean(): lambda C: 300.0 / 2 * (np.trace(C) + 1 / np.linalg.det(C) - 3),
    fc.NeoHookean("compressible"): lambda C: compressible(np.trace(C), np.linalg.det(C)),
}
WOVEN, RUBBER = fc.Fabric(0.15, (2000.0, 900.0), 0.2, 60.0), fc.Fabric(0.2, 900.0, 0.3)


def stvk(E):
    """½ E:ℂ:E of WOVEN, from its stiffnesses and ν₂₁ = ν₁₂ Y₂/Y₁."""
    nu12, nu21 = 0.2, 0.2 * 900.0 / 2000.0
    S11 = (2000.0 * E[0, 0] + nu21 * 2000.0 * E[1, 1]) / (1 - nu12 * nu21)
    S22 = (900.0 * E[1, 1] + nu12 * 900.0 * E[0, 0]) / (1 - nu12 * nu21)
    return 0.5 * (S11 * E[0, 0] + S22 * E[1, 1] + 4 * 60.0 * E[0, 1] ** 2)


def compressible(trace, det):
    """With μ and λ of Y = 900 N/m and ν = 0.3."""
    mu, lam, log_J = 900.0 / 2.6, 900.0 * 0.3 / 0.91, np.log(det) / 2
    return mu / 2 * (trace - 2) - mu * log_J + lam / 2 * log_J**2


@pytest.mark.parametrize("law", DENSITIES, ids=repr)
@pytest.mark.parametrize(
    ("name", "pattern", "element", "grain"),
    in_turn([*UNIFORM], PATTERNS, ["P1", "P1", "P2"], [0.0, 0.6]),
)
def test_uniform_states(law, name, pattern, element, grain):
    """Energy, stress and balance of F with the warp at an angle, from W alone."""
    if element not in traits_of(law).elements:
        element = "P1"
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.17, pattern=pattern, element=element)
    fabric = RUBBER if isinstance(law, fc.NeoHookean) else WOVEN
    system = fc.System(cloth, fabric, [law], grain=grain)
    F, W = np.array(UNIFORM[name]), DENSITIES[law]
    x = affine(cloth, F, (0.3, -0.2, 0.5))
    turn = np.array([[np.cos(grain), -np.sin(grain)], [np.sin(grain), np.cos(grain)]])
    C = turn.T @ F.T @ F @ turn
    energy = system.energies(system.state(x))[type(law).__name__]
    assert energy == pytest.approx(0.5 * W(C), rel=1e-11)
    out = np.zeros((len(cloth.triangles), 4))
    system.bound[0].add_stress(x, out)
    h, units = 1e-6, (np.diag([1.0, 0]), np.diag([0, 1.0]), np.array([[0, 0.5], [0.5, 0]]))
    S = [(W(C + h * unit) - W(C - h * unit)) / h for unit in units]  # 2 ∂W/∂C
    np.testing.assert_allclose(out[:, :3], np.tile(S, (len(out), 1)), atol=1e-6 * np.abs(S).max())
    np.testing.assert_allclose(out[:, 3], W(C), rtol=1e-11)
    force, inner = system.force(system.state(x)), np.ones(len(cloth.X), bool)
    inner[cloth.nodes("boundary")] = False
    assert abs(force[inner]).max() < 1e-12 * np.abs(S).max()
    stretches = np.sqrt(np.linalg.eigvalsh(F.T @ F))
    computed = principal_stretches(cloth, x)
    np.testing.assert_allclose(computed, np.tile(stretches, (len(computed), 1)), rtol=1e-11)


def test_clamp_keeps_the_tensile_part(rng):
    for _ in range(50):
        S = rng.standard_normal((2, 2))
        S = S + S.T
        value, vector = np.linalg.eigh(S)
        expected = vector @ np.diag(np.maximum(value, 0)) @ vector.T
        got = clamp((S[0, 0], S[1, 1], S[0, 1]))
        np.testing.assert_allclose(got, expected[[0, 1, 0], [0, 1, 1]], atol=1e-14)
