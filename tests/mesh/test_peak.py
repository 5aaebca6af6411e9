"""The largest value on a cloth, also inside triangles: closed forms, and the sag of a plate."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.peak import Peak
from fecloth.simulation.probes import Observer

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


def sag_of_plate(h, element):
    """A plate with one clamped, two supported sides and a free one, on which it is lowest."""
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1.0, bending_poisson_ratio=0.3)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0.0, 0.0, -1e-3))]

    def supported(X):
        return (X[:, 0] > 1e-9) & ((X[:, 1] < 1e-9) | (X[:, 0] > 1 - 1e-9))

    pins = [fc.Pin("left", clamp=True), fc.Pin(supported)]
    system = fc.System(cloth(h, element, "right"), fabric, terms, pins)
    rest = fc.equilibrium(system, system.rest())
    return Observer.bind(system, system.rest()).row_at_rest(rest)["sag"], -rest.x[:, 2].min()


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_the_sag_of_a_plate_has_order_2_and_the_lowest_node_has_no_order(element):
    sags, of_nodes = np.array([sag_of_plate(h, element) for h in (1 / 4, 1 / 8, 1 / 16)]).T
    order, order_of_nodes = (np.log2(a[0] / a[1]) for a in map(np.diff, (sags, of_nodes)))
    assert order == pytest.approx(2, abs=0.15)
    assert abs(order_of_nodes - 2) > 0.5
