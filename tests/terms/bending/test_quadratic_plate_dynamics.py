"""P2 with the interpolated strain and `PlateBending` over time steps."""

import numpy as np
import pytest
from support.plates import flying, square

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, 50.0, 0.2, bending_rigidity=(0.02, 0.01), bending_poisson_ratio=0.2)


@pytest.mark.stories
@pytest.mark.parametrize("kind", ["incompressible", "compressible"])
def test_neo_hookean_takes_no_step_to_strains_that_no_deformation_has(kind):
    """There det C = det(I + 2 E_h) ≤ 0, and its energy would be far below that at rest."""
    fabric = fc.Fabric(0.2, 500.0, 0.5, bending_rigidity=1e-3)
    system, start = flying(square("right", 4, "P2"), FABRIC, fc.NeoHookean(kind))
    system = fc.System(system.cloth, fabric, system.terms)
    crushed = np.vstack([start.x[:1] * 0.5, start.x[1:]]) * [1.0, -1.0, 1.0]
    crushed[::3] += np.random.default_rng(0).normal(0, 0.5, crushed[::3].shape)
    assert not np.isfinite(system.energies(system.state(crushed))["NeoHookean"])
    end = fc.run(system, fc.BDF2(), start, dt=0.005, t_end=0.05).state
    assert system.energies(end)["NeoHookean"] > 0
