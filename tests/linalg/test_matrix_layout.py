"""The pattern and the blocks of a system's matrix: made at the first tangent, and shared."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.system.pieces import _connect

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
TERMS = [
    fc.StVK(),
    fc.StrainRateDamping(time=0.01),
    fc.PlateBending(),
    fc.BendingDamping(time=0.01, law=fc.PlateBending()),
    fc.MassDamping(rate=1.0),
    fc.Pressure(1.0),
    fc.UserForce(("-x", "0", "1")),
    fc.Tether("left", point=(0.0, 0.0, 0.0), stiffness=1.0),
    fc.Gravity(),
]
ON_P1 = [
    fc.HingeBending(),
    fc.QuadraticBending(),
    fc.Springs(),
    fc.BaraffWitkin(area_exponent=0.5),
    fc.Drag(normal=1.0),
]


def is_pattern_made(system) -> bool:
    return "pattern" in vars(system.layout)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("pattern", ["right", "cross", "unstructured"])
def test_only_a_tangent_makes_the_pattern(pattern, element):
    cloth = fc.Cloth.rectangle(1.0, 0.7, 0.3, pattern, element)
    terms = TERMS + ON_P1 * (element == "P1")
    system = fc.System(cloth, FABRIC, terms, pins=["left"], mass="lumped")
    state = system.rest()
    system.force(state), system.energies(state), system.movable_pieces
    for _ in fc.march(system, fc.CentralDifference(beyond_limit=True), state, 1e-7, 2e-7):
        pass
    assert not is_pattern_made(system)
    K = system.stiffness(state)
    assert is_pattern_made(system)
    blocks = K.tobsr((3, 3))
    assert blocks.indices.tolist() == system.pattern.indices.tolist()


def test_nodes_are_connected_through_any_stencil():
    cells, spring = np.array([[0, 1], [2, 3], [4, 5]]), np.array([[5, 0]])
    assert _connect(6, [cells])[1].tolist() == [0, 0, 1, 1, 2, 2]
    count, label = _connect(6, [cells, np.array([[3]]), spring])
    assert (count, label.tolist()) == (2, [0, 0, 1, 1, 0, 0])
