"""P2 with the interpolated strain and `PlateBending` over time steps."""

import numpy as np
import pytest
from support.plates import flying, square
from support.tiers import stories_except

import fecloth as fc

METHODS = [fc.BDF2(), fc.ImplicitMidpoint(), fc.EnergyMomentum()]


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


@pytest.mark.stories
@pytest.mark.parametrize("method", stories_except(METHODS, METHODS[0]))
def test_methods_keep_their_order_in_time(method):
    """A damped strip, clamped level, falls from rest to half its length below the clamp."""
    cloth = fc.Cloth.rectangle(0.5, 0.25, 0.125, "right", "P2")
    damping = [fc.StrainRateDamping(0.01), fc.BendingDamping(0.01, law=fc.PlateBending())]
    terms = [fc.StVK(), fc.PlateBending(), *damping, fc.Gravity()]
    system = fc.System(cloth, FABRIC, terms, [fc.Pin("left", clamp=True)])
    newton = fc.Newton(tolerance=1e-10)
    a, b, c = (
        fc.run(system, method, system.rest(), dt=0.2 / n, t_end=0.2, newton=newton).state.x
        for n in (40, 80, 160)
    )
    assert -c[:, 2].min() > 0.2
    assert np.log2(np.linalg.norm(a - b) / np.linalg.norm(b - c)) == pytest.approx(2.0, abs=0.15)
