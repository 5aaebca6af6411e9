"""Weight."""

import numpy as np
import pytest
from conftest import flat
from support.tiers import MASSES, in_turn

import fecloth as fc
from fecloth.integrators import METHODS

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ACCELERATION = (1.5, -2.0, -9.81)
AREA, DENSITY = 0.6, 0.2


@pytest.mark.parametrize("pattern", ["unstructured", "right", "cross", "equilateral"])
def test_force_of_each_node_is_its_share_of_the_weight(pattern, isotropic):
    """ρ g times a third of the area of the triangles around the node, on any mesh."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.17, pattern=pattern)
    system = fc.System(cloth, isotropic, [fc.Gravity(ACCELERATION)])
    a, b, c = np.moveaxis(cloth.X[cloth.triangles], 1, 0)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    third = np.bincount(cloth.triangles.ravel(), np.repeat(area / 3, 3))
    force = system.force(system.rest())
    np.testing.assert_allclose(force, DENSITY * np.outer(third, ACCELERATION), rtol=1e-12)
    weight = DENSITY * AREA * np.array(ACCELERATION)
    np.testing.assert_allclose(force.sum(axis=0), weight, rtol=1e-13)


@pytest.mark.parametrize(("method", "mass"), in_turn([*METHODS.values()], MASSES))
def test_free_fall_of_every_node(method, mass, sheet, isotropic):
    """v = g t exactly; x = ½ g t² at second order, ½ g t (t + dt) by the Euler methods."""
    terms = [fc.StVK(), fc.StrainRateDamping(0.01), fc.Gravity(ACCELERATION)]
    system = fc.System(sheet, isotropic, terms, mass=mass)
    dt, t, g = 0.01, 0.05, np.array(ACCELERATION)
    end = fc.run(
        system, method(), system.rest(), dt, t, solver="direct", newton=fc.Newton(tolerance=1e-12)
    ).state
    way = 0.5 * t * (t if method().traits.order == 2 else t + dt) * g
    np.testing.assert_allclose(end.v, np.tile(t * g, (len(end.v), 1)), atol=1e-10)
    np.testing.assert_allclose(end.x - flat(sheet), np.tile(way, (len(end.x), 1)), atol=1e-12)
