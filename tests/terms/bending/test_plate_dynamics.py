"""`PlateBending` over steps, and its damping."""

import numpy as np
import pytest
from support.plates import flying, square

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=(1e-3, 5e-4), bending_poisson_ratio=0.2)


@pytest.mark.parametrize(
    ("pattern", "tangent"), [("jittered", "exact"), ("jittered", "symmetric"), ("cross", "exact")]
)
def test_energy_momentum_keeps_energy_and_both_momenta(pattern, tangent):
    system, start = flying(square(pattern, 4), FABRIC, fc.StVK())
    method, newton = fc.EnergyMomentum(tangent), fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, dt=0.01, t_end=0.2, newton=newton)
    total = result.energies["total"]
    assert np.ptp(result.energies["PlateBending"]) > 1e-3 * total[0]
    assert np.ptp(total) < 1e-9 * total[0]
    m = system.nodal_mass[:, None]
    for momentum in (lambda s: (m * s.v).sum(axis=0), lambda s: np.cross(s.x, m * s.v).sum(axis=0)):
        assert momentum(result.state) == pytest.approx(momentum(start), abs=1e-9)


@pytest.mark.parametrize("pattern", ["right", "unstructured"])
def test_tangent_over_a_step_is_the_derivative_of_the_force(pattern):
    from fecloth.linalg.block_matrix import BlockMatrix
    from fecloth.terms.step_difference import StepDifference

    system, start = flying(square(pattern, 4), FABRIC, fc.StVK())
    step = StepDifference(start.x, 0.01, 0.005, ((1.0, start.x),), True, False)
    over = system.over_step(step)
    term = over.bound[1]
    x = start.x + 0.02 * start.v
    d = np.random.default_rng(0).normal(size=x.shape)
    J = BlockMatrix.zeros(system.pattern)
    term.add_tangent(x, start.v, 0.0, 1.0, 0.0, J, False)
    errors = []
    for size in (4e-4, 1e-4):
        forces = [np.zeros_like(x), np.zeros_like(x)]
        for f, sign in zip(forces, (1, -1), strict=True):
            term.add_force(x + sign * size * d, start.v, 0.0, f)
        errors.append(np.abs((forces[0] - forces[1]) / (2 * size) + J @ d).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.25)
