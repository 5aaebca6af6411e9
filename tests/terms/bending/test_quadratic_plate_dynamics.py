"""P2 with the interpolated strain and `PlateBending` over time steps."""

import numpy as np
import pytest
from support.tiers import slow_except

import fecloth as fc

FABRIC = fc.Fabric(0.2, 50.0, 0.2, bending_rigidity=(0.02, 0.01), bending_poisson_ratio=0.2)


METHODS = [fc.BDF2(), fc.ImplicitMidpoint(), fc.EnergyMomentum()]


@pytest.mark.parametrize("method", slow_except(METHODS, METHODS[0]))
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


@pytest.mark.parametrize("pattern", slow_except(["right", "unstructured"], "right"))
@pytest.mark.parametrize("tangent", ["exact", "symmetric"])
def test_energy_momentum_keeps_energy_and_both_momenta(pattern, tangent):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.25, pattern, "P2")
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending()])
    X = cloth.X
    x = np.column_stack([X, 0.15 * np.sin(2.5 * X[:, 0] + X[:, 1])])
    v = np.cross([1.0, 3.0, 2.0], x) + np.sin(5 * x[:, ::-1])
    start, newton = system.state(x, v), fc.Newton(tolerance=1e-12)
    result = fc.run(system, fc.EnergyMomentum(tangent), start, dt=0.01, t_end=0.2, newton=newton)
    total, M = result.energies["total"], system.scalar_mass
    assert np.ptp(result.energies["PlateBending"]) > 1e-2 * total[0]
    assert np.ptp(total) < 1e-9 * total[0]
    for momentum in (lambda s: (M @ s.v).sum(axis=0), lambda s: np.cross(s.x, M @ s.v).sum(axis=0)):
        assert momentum(result.state) == pytest.approx(momentum(start), abs=1e-9)
