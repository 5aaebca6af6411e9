"""The largest value on a cloth, also inside triangles: closed forms."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.peak import Peak

pytestmark = pytest.mark.filterwarnings("ignore")


def cloth(h, element, pattern="unstructured"):
    return fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern, element=element)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("top", [(0.43, 0.61), (0.37, 1.2), (-0.1, 0.28)])  # inside, beyond sides
def test_a_quadratic_field_has_its_exact_maximum(element, top):
    """3 − (x − a)² − 2 (y − b)², whose maximum on the unit square lies nearest to (a, b)."""
    sheet = cloth(0.2, element)
    X, Y = sheet.X.T
    nearest = np.clip(top, 0.0, 1.0)
    exact = 3 - (nearest - top) ** 2 @ [1.0, 2.0]
    values = 3 - (X - top[0]) ** 2 - 2 * (Y - top[1]) ** 2
    assert values.max() < exact - 1e-5
    assert Peak.on(sheet).largest(values) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_slope_has_its_maximum_at_a_corner_and_nan_stays(element):
    sheet = cloth(0.3, element)
    values = sheet.X @ [1.0, 2.0]
    assert Peak.on(sheet).largest(values) == pytest.approx(3.0, abs=1e-12)
    values[5] = np.nan
    assert np.isnan(Peak.on(sheet).largest(values))


def test_two_triangles_have_the_value_at_their_highest_node():
    sheet = fc.Cloth.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    assert Peak.on(sheet).largest(np.array([0.0, 1.0, 3.0, 2.0])) == 3.0
