"""The manufactured motion of studies/convergence/: derivatives, tension, energy."""

import numpy as np
import pytest

import fecloth as fc
from studies.references import manufactured as made

X = np.random.default_rng(3).uniform(size=(40, 2))
STEP = 1e-4


def slope(function, c):
    """∂/∂X of a field by fourth-order central differences, the new index last."""

    def along(shift):
        f = [function(X + k * STEP * shift, c) for k in (-2, -1, 1, 2)]
        return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * STEP)

    return np.stack([along(np.array(e)) for e in ((1, 0), (0, 1))], axis=-1)


@pytest.mark.parametrize("c", [1.0, -0.6])
def test_derivatives(c):
    near = {"rtol": 1e-8, "atol": 1e-8}
    np.testing.assert_allclose(made.gradient(X, c), slope(made.position, c), **near)
    np.testing.assert_allclose(made.second_gradient(X, c), slope(made.gradient, c), **near)
    of_stress = np.einsum("piLL->pi", slope(made.stress, c))
    assert np.abs(of_stress).max() > 50.0  # N/m²: a load that matters
    np.testing.assert_allclose(made.divergence(X, c), of_stress, rtol=1e-7, atol=1e-6)


def test_the_sheet_is_taut_and_bent():
    assert made.least_stress() > 100.0
    assert np.linalg.matrix_rank(made.position(X) - made.position(X).mean(axis=0)) == 3


def test_stress_and_energy_are_those_of_a_mesh():
    """Of the nodal interpolant, whose energy is wrong by h²: extrapolated from two meshes."""
    result = []
    for n in (32, 64):
        cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, "cross")
        fabric = fc.Fabric(made.DENSITY, made.Y, made.NU)
        system = fc.System(cloth, fabric, [fc.StVK()], mass="consistent")
        state = system.state(made.position(cloth.X), 7.0 * made.wave(cloth.X))
        energies = system.energies(state)
        result.append(energies["StVK"] + energies["kinetic"])
    assert (4 * result[1] - result[0]) / 3 == pytest.approx(made.energy(1.0, 7.0), rel=1e-6)
    assert result[1] != pytest.approx(made.energy(1.0, 7.0), rel=1e-6)
