"""`PlateBending` over steps."""

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
