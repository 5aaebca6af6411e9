"""Strain-rate damping: the term that its symmetric tangent omits."""

import numpy as np
from conftest import rough

import fecloth as fc
from fecloth.terms.kinematics import deformation_gradient


def test_symmetric_tangent_differs_by_the_non_symmetric_part(sheet, orthotropic, rng):
    """exact − symmetric = Bᵀ τℂ₀ B(Ḟ), computed here from scikit-fem's derivative of Ė."""
    x, v = rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))
    exact = fc.System(sheet, orthotropic, [fc.StrainRateDamping(0.02, tangent="exact")])
    symmetric = fc.System(sheet, orthotropic, [fc.StrainRateDamping(0.02)])
    state = exact.state(x, v)
    K = symmetric.stiffness(state).toarray()
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    dropped = exact.stiffness(state).toarray() - K
    assert abs(dropped - dropped.T).max() > 0.1 * abs(dropped).max()
    # ∂Ė/∂x · u = sym(∇uᵀ Ḟ) = the strain rate of u seen from Ḟ, contracted with τℂ₀ and B(F)ᵀ
    u = rng.standard_normal(x.shape)
    F, H, U = (deformation_gradient(sheet, y)[:, 0] for y in (x, v, u))
    change = 0.5 * (np.swapaxes(U, 1, 2) @ H + np.swapaxes(H, 1, 2) @ U)
    C11, C22, C66, C12, _, _ = 0.02 * orthotropic.moduli()
    S = np.empty_like(change)
    S[:, 0, 0] = C11 * change[:, 0, 0] + C12 * change[:, 1, 1]
    S[:, 1, 1] = C12 * change[:, 0, 0] + C22 * change[:, 1, 1]
    S[:, 0, 1] = S[:, 1, 0] = 2 * C66 * change[:, 0, 1]
    expected = np.zeros_like(x)
    contribution = np.einsum("e,eij,eaj->eai", sheet.weights[:, 0], F @ S, sheet.gradients[:, 0])
    np.add.at(expected, sheet.stencil, contribution)
    np.testing.assert_allclose(
        (dropped @ u.ravel()).reshape(-1, 3), expected, atol=1e-11 * abs(expected).max()
    )
