"""The error in space of a run says where P1 triangles may be too stiff."""

from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.error_in_space import LOCKED, ErrorInSpace, remedy_of_locking


@pytest.mark.parametrize(("part", "named"), [(0.8, False), (1.25, True)])
def test_locking_is_named_from_an_error_of_a_fifth(part, named):
    cloth = fc.Cloth.rectangle(0.2, 0.1, h=0.1, pattern="right")
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5)
    stiff = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()])
    assert bool(remedy_of_locking(stiff, part * LOCKED)) == named
    assert not remedy_of_locking(fc.System(cloth, fabric, [fc.StVK()]), part * LOCKED)


@pytest.mark.parametrize(
    ("element", "terms", "locks"),
    [
        ("P1", (fc.StVK(), fc.PlateBending()), True),
        ("P1", (fc.StVK(),), False),
        ("P2", (fc.StVK(), fc.PlateBending()), False),
    ],
)
def test_an_arc_on_linear_triangles_that_bend_may_lock(element, terms, locks):
    """On P1 with the pattern "cross" the midpoints of cells lie off the chords of the arc."""
    cloth = fc.Cloth.rectangle(0.2, 0.05, h=0.025, pattern="cross", element=element)
    fabric = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5)
    system = fc.System(cloth, fabric, terms)
    angle, radius = cloth.X[:, 0] / 0.1, 0.1
    x = np.column_stack([radius * np.sin(angle), cloth.X[:, 1], radius * np.cos(angle)])
    end = SimpleNamespace(state=system.state(x, 0 * x))
    error = ErrorInSpace().finish(SimpleNamespace(system=system), end, None)
    assert ("they lock" in error.words()) == locks
