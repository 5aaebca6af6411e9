"""The joined calls of loads that formulas give: the bits of Python, at any time."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.compiled.calls import Present, join
from fecloth.linalg.block_matrix import BlockMatrix

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
LOADS = {
    "pressure": fc.Pressure("300*t + 1"),
    "exact pressure": fc.Pressure("3*sin(9*t)", tangent="exact"),
    "wind in time": fc.Wind(("3", "2*t", "cos(t)"), normal=0.4, tangential=0.1),
    "wind in space": fc.Wind(("3*t", "sin(9*z)*x", "-1"), normal=0.4, law="linear"),
    "steady wind": fc.Wind((1.0, 2.0, 3.0), normal=0.4, tangential=0.3),
    "point force": fc.PointForce("right", ("t", "1 - t", 2)),
    "edge force": fc.EdgeForce("right", ("t", "1 - t", 2)),
    "edge components": fc.EdgeForce("boundary", normal="9*t", tangent=1.0),
    "following edge force": fc.EdgeForce("boundary", ("t", "1 - t", 2), follow=True),
    "following components": fc.EdgeForce("top", normal="9*t", tangent=1.0, follow=True),
}


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("load", LOADS)
def test_calls_have_the_bits_of_the_term(load, element, rng):
    if element not in LOADS[load].traits.elements:
        pytest.skip("not for these elements")
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.15, element=element)
    system = fc.System(cloth, FABRIC, [fc.StVK(), LOADS[load]], ["left"])
    term = system.bound[1]
    x, v, f, expected = np.zeros((4, len(cloth.X), 3))
    t, wx, wv = np.zeros((3, 1))
    J, of_python = BlockMatrix.zeros(system.pattern), BlockMatrix.zeros(system.pattern)
    force = join(term.force_calls(x, v, t, f))
    weights = Present(wx), Present(wv)
    tangent = join(term.tangent_calls(x, v, t, *weights, J, definite=False))
    definite = term.tangent_calls(x, v, t, *weights, J, definite=True)
    for time in (0.3, 0.7):
        x[:] = system.rest().x + 0.01 * rng.standard_normal(x.shape)
        v[:] = rng.standard_normal(x.shape)
        t[0], wx[0], wv[0] = time, 1.5 * time, 2.0
        force()
        term.add_force(x, v, time, expected)
        assert np.array_equal(f, expected)
        assert f.any()
        tangent()
        term.add_tangent(x, v, time, 1.5 * time, 2.0, of_python, definite=False)
        assert np.array_equal(J.values, of_python.values)
        join(definite)()
        term.add_tangent(x, v, time, 1.5 * time, 2.0, of_python, definite=True)
        assert np.array_equal(J.values, of_python.values)
    is_dead = load in ("point force", "edge force", "edge components")
    assert J.values.any() == (not is_dead)
