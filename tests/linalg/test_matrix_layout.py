"""The pattern and the blocks of a system's matrix: made at the first tangent, and shared."""

import numpy as np
import pytest
from support.every_term import FABRIC, terms_on

import fecloth as fc
from fecloth.system.pieces import _connect


def is_pattern_made(system) -> bool:
    return "pattern" in vars(system.layout)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("pattern", ["right", "cross", "unstructured"])
def test_only_a_tangent_makes_the_pattern(pattern, element):
    cloth = fc.Cloth.rectangle(1.0, 0.7, 0.3, pattern, element)
    system = fc.System(cloth, FABRIC, [*terms_on(element).values()], pins=["left"], mass="lumped")
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
