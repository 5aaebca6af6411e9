"""Weight."""

import numpy as np
import pytest

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

ACCELERATION = (1.5, -2.0, -9.81)
AREA, DENSITY = 0.6, 0.2


@pytest.fixture
def system(sheet, isotropic):
    return fc.System(sheet, isotropic, [fc.Gravity(ACCELERATION)])


def test_force_of_each_node_is_its_share_of_the_weight(system, sheet):
    """ρ g times a third of the area of the triangles around the node."""
    a, b, c = np.moveaxis(sheet.X[sheet.triangles], 1, 0)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    third = np.bincount(sheet.triangles.ravel(), np.repeat(area / 3, 3))
    expected = DENSITY * np.outer(third, ACCELERATION)
    np.testing.assert_allclose(system.force(system.rest()), expected, rtol=1e-12)
