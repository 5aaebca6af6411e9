"""Definite tangents are symmetric and positive: conjugate gradients serve where they are used."""

import numpy as np
import pytest
from conftest import rough
from support.over_step import energy_momentum as over_step

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix

SKEW = {
    "Pressure": fc.Pressure(30.0, tangent="exact"),
    "Wind": fc.Wind((0.0, "2 * x", 5.0), normal=1.2, tangent="exact"),
    "UserForce": fc.UserForce(
        ("90 * y - 200 * z", "100 * x - 50 * vy", "-100 * z"), tangent="exact"
    ),
    "StrainRateDamping": fc.StrainRateDamping(time=0.01, tangent="exact"),
    "Springs": fc.Springs("structural", 40.0, damping=0.3, tangent="exact"),
}


def matrix(system, x, v, definite):
    J = BlockMatrix.zeros(system.pattern)
    return system.assemble(J, system.state(x, v), 1.0, 0.2, 0.0, definite).to_scipy().toarray()


def asymmetry(A):
    return abs(A - A.T).max() / abs(A).max()


@pytest.mark.parametrize("name", SKEW)
def test_a_definite_tangent_is_symmetric(name, sheet, isotropic, rng):
    system = fc.System(sheet, isotropic, [fc.StVK(), SKEW[name]])
    x, v = rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))
    assert not system.symmetric
    assert asymmetry(matrix(system, x, v, False)) > 1e-4
    A = matrix(system, x, v, True)
    assert asymmetry(A) < 1e-13
    assert np.linalg.eigvalsh(A).min() > -1e-10 * abs(A).max()


def test_a_definite_tangent_over_a_step_is_symmetric(sheet, isotropic, rng):
    system = fc.System(sheet, isotropic, [fc.StVK()])
    x, v = rough(sheet, rng), np.zeros((len(sheet.X), 3))
    over = over_step(system, x + 0.01 * rng.standard_normal(x.shape))
    assert asymmetry(matrix(over, x, v, False)) > 1e-4
    A = matrix(over, x, v, True)
    assert asymmetry(A) < 1e-13
    assert np.linalg.eigvalsh(A).min() > -1e-10 * abs(A).max()


def test_clamped_energy_momentum_is_solved_by_conjugate_gradients(isotropic):
    """The matrix of that method is not symmetric, but the clamped one is; the solution is one."""
    cloth = fc.Cloth.disk(0.5, 0.1)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    run = system, fc.EnergyMomentum("exact"), system.rest(), 1 / 240, 0.1
    options = {"tolerance": 1e-11, "forcing": 1e-6}
    exact = fc.run(*run, newton=fc.Newton(**options)).state
    clamped = fc.Newton(**options, definiteness="clamp")
    found = fc.run(*run, solver="pcg", newton=clamped).state
    np.testing.assert_allclose(found.x, exact.x, atol=1e-8)
    with pytest.raises(fc.InputError, match="symmetric matrices only"):
        fc.run(*run, solver="pcg")
